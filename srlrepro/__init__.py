"""Replication of a method that generates training data for learning a low-dimensional safe region.

The modules, each depending only on those before it: `parameters`, `paper`, `choices`, `config`, `pendulum`,
`lqg`, `labels`, `sampling`, `embedding`, `assessment`, `judging`, `safe_region`, `env`, `supervisor`,
`hypotheses`, `checkpoint`, `recording`, `training`; then what serves the notebooks and the command line.
Importing the package registers the task with gymnasium and imports none of them.
"""

from importlib.util import find_spec

ENVIRONMENT = "srlrepro/ThreeLinkCircle-v0"

if find_spec("gymnasium") is not None:  # it is missing only while reproduce.sh checks a command line
    from gymnasium.envs.registration import register, registry

    if ENVIRONMENT not in registry:
        register(id=ENVIRONMENT, entry_point="srlrepro.env:ThreeLinkCircleEnv")
