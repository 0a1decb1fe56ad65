"""Trials, step by step: what π does, where the supervisor steps in, and how K fares."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import gymnasium as gym
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv, target
from srlrepro.dynamics.pendulum import Floats
from srlrepro.supervisor import Supervisor

Actor = Callable[[NDArray[np.float32]], NDArray[np.float32]]  # an action [n] from an observation [2n + 2]


class Predictor(Protocol):
    """A policy: a learner of stable-baselines3, a `TrainedPolicy`, or anything else that predicts actions."""

    def predict(self, observation: NDArray[np.float32], *, deterministic: bool = ...) -> tuple[Any, Any]:
        """The action [3] of an observation [8], and a state of its own."""


class Transition(NamedTuple):
    """One control period of π: states [2n] before and after it in rad and rad/s, R, and what was said of it.

    action: [n] in units of ``action_unit``.
    """

    x: Floats
    action: NDArray[np.float32]
    reward: float
    following: Floats
    info: dict[str, Any]


def untrained(rng: Generator, log_std: float, links: int) -> Actor:
    """About what a policy does before its training: normal actions of mean 0, whatever it sees."""
    return lambda _: rng.normal(0.0, np.exp(log_std), links).astype(np.float32)


def transitions(env: gym.Env[Any, Any], act: Actor) -> Iterator[Transition]:
    """Reset a task, supervised or not, and yield the control periods of one trial under a policy."""
    task = env.unwrapped
    assert isinstance(task, ThreeLinkCircleEnv)
    observation, _ = env.reset()
    stands, ended = env if isinstance(env, Supervisor) else task, False  # K may move the task itself
    while not ended:
        x, action = task.state.copy(), act(observation)
        observation, reward, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
        yield Transition(x, action, float(reward), stands.state.copy(), info)


@dataclass(frozen=True)
class Trial:
    """One trial, with the recovery by K if there was one.

    Attributes:
        joints: [T + 1, n + 1, 2] m, at the control instants.
        targets: [T + 1, 2] m, p_d at the same instants.
        supervised: [T + 1] whether K acts from the instant on.
        total: return of π; steps: its control periods.
        outcome: of the trial, and of K if it was activated.
    """

    joints: Floats
    targets: Floats
    supervised: NDArray[np.bool_]
    total: float
    steps: int
    outcome: str


def run_trial(model: Predictor, env: gym.Env[Any, Any], deterministic: bool) -> Trial:
    """One trial of a policy from the origin, with the recovery by K if there was one.

    deterministic: π takes its mean actions, else it draws them.
    """
    task = env.unwrapped
    assert isinstance(task, ThreeLinkCircleEnv)
    states, total = [], 0.0
    for step in transitions(env, lambda o: model.predict(o, deterministic=deterministic)[0]):
        states.append(step.x)
        total += step.reward
    states.append(step.following)
    steps, outcome = len(states) - 1, step.info["outcome"]
    k_acts = len(states)
    if isinstance(env, Supervisor) and env.recovery is not None:
        k_acts, outcome = steps, f"K: {step.info['recovery']}"
        states += list(env.recovery_path)
    times = task.rule.control_period * np.arange(len(states))
    circle = np.array([target(task.arrays.circle, float(t)) for t in times])
    supervised = np.arange(len(states)) >= k_acts
    return Trial(task.pendulum.joints(np.array(states)), circle, supervised, total, steps, outcome)


def evaluate(model: Predictor, env: gym.Env[Any, Any]) -> dict[str, Any]:
    """One trial with the policy's mean action; task and policy are deterministic, so one says it all.

    Returns:
        ``return``, ``length`` in control periods, and ``outcome``.
    """
    total, length = 0.0, 0
    for step in transitions(env, lambda o: model.predict(o, deterministic=True)[0]):
        total, length = total + step.reward, length + 1
    return {"return": total, "length": length, "outcome": step.info["outcome"]}
