"""Learning a low-dimensional safe region for safe reinforcement learning, on a three-link pendulum.

Importing the package loads nothing else, so that `pins` can be set before numpy is there; its public names
are loaded when they are first used. The task is then registered with gymnasium, or at once if that is there.
The rooms, each depending only on those before it: `pins`, `settings`, `storage`, `dynamics`, `samplers`,
`region`, `supervisor`, `fast_ppo`, `learner`.
"""

import sys
from importlib import import_module
from typing import Any

ENVIRONMENT = "srlrepro/ThreeLinkCircle-v0"
PUBLIC = {  # name: the module that holds it
    "Choices": "srlrepro.settings.choices",
    "Config": "srlrepro.settings.config",
    "Paper": "srlrepro.settings.paper",
    "Pendulum": "srlrepro.dynamics.pendulum",
    "LQG": "srlrepro.dynamics.lqg",
    "ClosedLoop": "srlrepro.dynamics.closed_loop",
    "RecoveryRule": "srlrepro.dynamics.closed_loop",
    "StateRule": "srlrepro.dynamics.stepped_loop",
    "SteppedLoop": "srlrepro.dynamics.stepped_loop",
    "ThreeLinkCircleEnv": "srlrepro.dynamics.circle_env",
    "MultivariateNormal": "srlrepro.samplers",
    "TrainingData": "srlrepro.samplers",
    "generate": "srlrepro.samplers",
    "sample_mnd": "srlrepro.samplers",
    "sample_uniform": "srlrepro.samplers",
    "visited_states": "srlrepro.samplers",
    "Hypothesis": "srlrepro.region.hypothesis",
    "SafeRegion": "srlrepro.region.safe_region",
    "learn_region": "srlrepro.region.safe_region",
    "Supervisor": "srlrepro.supervisor",
    "CompiledPPO": "srlrepro.fast_ppo.ppo",
    "Run": "srlrepro.learner.training",
    "TrainedPolicy": "srlrepro.learner.policy",
    "load_policy": "srlrepro.learner.policy",
    "train": "srlrepro.learner.training",
}
__all__ = ["ENVIRONMENT", *PUBLIC]


def register_task() -> None:
    """Register the task with gymnasium, unless that has been done."""
    from gymnasium.envs.registration import register, registry

    if ENVIRONMENT not in registry:
        register(id=ENVIRONMENT, entry_point="srlrepro.dynamics.circle_env:ThreeLinkCircleEnv")


if "gymnasium" in sys.modules:
    register_task()


def __getattr__(name: str) -> Any:
    """A public name, loaded when it is first used."""
    if name not in PUBLIC:
        raise AttributeError(f"module 'srlrepro' has no attribute {name!r}")
    register_task()
    return getattr(import_module(PUBLIC[name]), name)


def __dir__() -> list[str]:
    """The public names."""
    return sorted(__all__)
