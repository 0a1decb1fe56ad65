"""Learning a low-dimensional safe region for safe reinforcement learning, on a three-link pendulum.

Importing the package registers the task with gymnasium; its public names are loaded when they are first used.
The rooms, each depending only on those before it: `settings`, `storage`, `dynamics`, `samplers`, `region`,
`supervisor`, `fast_ppo`, `learner`.
"""

from importlib import import_module
from typing import Any

from gymnasium.envs.registration import register, registry

ENVIRONMENT = "srlrepro/ThreeLinkCircle-v0"
PUBLIC = {  # name: the module that holds it
    "Choices": "srlrepro.settings.choices",
    "Config": "srlrepro.settings.config",
    "Paper": "srlrepro.settings.paper",
    "Pendulum": "srlrepro.dynamics.pendulum",
    "LQG": "srlrepro.dynamics.lqg",
    "ClosedLoop": "srlrepro.dynamics.closed_loop",
    "RecoveryRule": "srlrepro.dynamics.closed_loop",
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
    "load_policy": "srlrepro.learner.trials",
    "train": "srlrepro.learner.training",
}
__all__ = ["ENVIRONMENT", *PUBLIC]

if ENVIRONMENT not in registry:
    register(id=ENVIRONMENT, entry_point="srlrepro.dynamics.circle_env:ThreeLinkCircleEnv")


def __getattr__(name: str) -> Any:
    """A public name, loaded when it is first used."""
    if name not in PUBLIC:
        raise AttributeError(f"module 'srlrepro' has no attribute {name!r}")
    return getattr(import_module(PUBLIC[name]), name)


def __dir__() -> list[str]:
    """The public names."""
    return sorted(__all__)
