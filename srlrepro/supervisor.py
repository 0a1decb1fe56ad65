"""The supervisor of eq. (6): π(x) until the first predicted-unsafe state, then K(x), then a new trial."""

from typing import Any, NamedTuple, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from srlrepro.assessment import RegionArrays, query
from srlrepro.config import ParameterError
from srlrepro.env import TIME_OVER, Task, ThreeLinkCircleEnv
from srlrepro.labels import OUTCOMES, ClosedLoop, Labels, Rollouts, recover
from srlrepro.lqg import LQG, Gains
from srlrepro.pendulum import Floats, jit
from srlrepro.safe_region import SafeRegion

SUPERVISED = "supervised"


class Guard(NamedTuple):
    """A supervisor whose hypothesis is a `SafeRegion`, as compiled code takes it.

    Attributes:
        active: False: nobody watches, and the rest is not read.
        region, p_t: h(x) = 1 if Γ(Ψ(x)) > p_t.
        gains, periods: of K, which has so many periods to recover the system.
        terminates: an activation of K ends the trial for the learner; False: cuts it off.
    """

    active: bool
    region: RegionArrays
    p_t: float
    gains: Gains
    periods: int
    terminates: bool


@jit
def watch(guard: Guard, task: Task, x: Floats, ended: int) -> tuple[int, int]:
    """After a period of π, at x [6]: (outcome of K, its control periods), or (0, 0) if K is not needed.

    ended: what `advance` says of the trial.
    """
    if not guard.active or not (ended == 0 or ended == TIME_OVER):
        return 0, 0
    if query(guard.region, x)[2] > guard.p_t:  # eqs. (5), (8), and so t' of eq. (6)
        return 0, 0
    return recover(task.coefficients, guard.gains, task.limits, guard.periods, x, np.empty((0, 6)))


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

    @property
    def guard(self) -> Guard:
        """This supervisor for `watch`.

        Raises:
            ParameterError: its hypothesis is not a `SafeRegion`.
        """
        if not isinstance(self.region, SafeRegion):
            raise ParameterError(
                f"region = a {type(self.region).__name__}: must be a SafeRegion in compiled code"
            )
        _, gains, _, periods = self.loop.kernel_arguments
        ends = self.task.config.choices.early_stop == "terminate"
        return Guard(True, self.region.arrays_, self.region.p_t, gains, periods, ends)

    def _predicted_safe(self) -> bool:
        return bool(self.region.predict(self.task.state)[0] == 1)


def nobody() -> Guard:
    """The guard of an environment without a supervisor."""
    none, table = np.zeros(0), np.zeros((0, 0))
    region = RegionArrays(none, table, table, 0, table, none, 0.0)
    return Guard(False, region, 0.0, (table, table, table, table, 0.0), 0, True)
