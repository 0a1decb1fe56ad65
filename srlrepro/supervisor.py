"""The supervisor of eq. (6): π(x) until the first predicted-unsafe state, then K(x), then a new trial."""

from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from srlrepro.config import ParameterError
from srlrepro.env import ThreeLinkCircleEnv
from srlrepro.labels import OUTCOMES, ClosedLoop, Labels, Rollouts
from srlrepro.lqg import LQG

SUPERVISED = "supervised"


class Hypothesis(Protocol):
    """Anything that predicts safety: h(x) (a SafeRegion), or l(x) itself (a ClosedLoop, eq. 3)."""

    def predict(self, x: ArrayLike) -> Labels:
        """Labels [B] of the states x [B, 6]: 1 = safe."""
        ...


class Supervisor(
    gym.Wrapper[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]
):
    """Switch from π to K at the first state with h(x) = 0 (time t' of eq. 6).

    The state machine of a trial, checked after every control period of π:

    1. the environment *terminated* (the first link fell although every state before was predicted safe):
       the trial ends; this is a violation that the supervisor did not foresee;
    2. else h(x) = 0: K is activated and runs on the real system until it has recovered it, or failed;
       the trial ends. For the learner the trial *terminates* at x (or, if ``early_stop`` is
       "truncate", is cut off there); the steps of K are not its steps, and carry no reward;
    3. else π goes on, until the time limit.

    ``info`` of every step: ``activated``; ``recovery`` ("recovered", "hit the ground", "not recovered in
    time", or "" while K was not needed); ``recovery_time`` in s; and ``outcome`` of the trial, which is
    "supervised" if K was activated, else the environment's.

    Args:
        env: a `ThreeLinkCircleEnv`, wrapped or not.
        region: the hypothesis h (or the labels l).
        controller: K.

    Attributes:
        recovery: the rollout of K that ended the last trial, with its path, or None.

    Raises:
        ValueError: h(x) = 0 at the start of a trial: the paper assumes that the origin is known to be
            safe (Sec. II-A), and π would never act.
    """

    def __init__(
        self, env: gym.Env[NDArray[np.float32], NDArray[np.float32]], region: Hypothesis, controller: LQG
    ) -> None:
        super().__init__(env)
        task = env.unwrapped
        if not isinstance(task, ThreeLinkCircleEnv):
            raise ParameterError(f"env = {task}: must be a ThreeLinkCircleEnv")
        self.task = task
        self.region = region
        self.loop = ClosedLoop(task.pendulum, controller, task.rule)
        self.recovery: Rollouts | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start a trial; see the class for what it raises."""
        observation, info = self.env.reset(seed=seed, options=options)
        self.recovery = None
        if not self._predicted_safe():
            raise ParameterError(
                "region: predicts the start of the trial as unsafe, so that π would never act"
            )
        return observation, info | {"activated": False, "recovery": "", "recovery_time": 0.0}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """One control period of π and, if it is needed, the whole recovery by K."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        info |= {"activated": False, "recovery": "", "recovery_time": 0.0}
        if not terminated and not self._predicted_safe():
            self.recovery = self.loop.rollout(self.task.state)
            info["activated"] = True
            info["recovery"] = OUTCOMES[int(self.recovery.outcomes[0])]
            info["recovery_time"] = float(self.recovery.durations[0])
            info["outcome"] = SUPERVISED
            terminated = self.task.config.choices.early_stop == "terminate"
            truncated = not terminated
        return observation, float(reward), terminated, truncated, info

    def _predicted_safe(self) -> bool:
        return bool(self.region.predict(self.task.state)[0] == 1)
