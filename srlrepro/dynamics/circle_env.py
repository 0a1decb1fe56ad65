"""The task as a gymnasium environment: the end-effector follows a circle (Sec. IV-A, App. C).

Registered as ``srlrepro/ThreeLinkCircle-v0``. It serves every condition; the supervisor wraps it.
"""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from srlrepro import register_task
from srlrepro.compiled.arithmetic import sin_cos
from srlrepro.compiled.jit import jit
from srlrepro.compiled.stack import packed, unpacked
from srlrepro.dynamics.closed_loop import HIT_GROUND, NOT_RECOVERED, ClosedLoop, Limits, hold_torque
from srlrepro.dynamics.pendulum import Coefficients, Floats, State, Torque, tip
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check

if TYPE_CHECKING:
    from srlrepro.dynamics.rendering import PendulumView

Seen = NDArray[np.float32]  # an observation
Info = dict[str, Any]
Circle = tuple[float, float, float]  # height of the centre (m), radius (m), speed (rad/s)
TIME_OVER = 10  # beside the outcomes of `hold_torque`
ENDS = {0: "", HIT_GROUND: "hit the ground", NOT_RECOVERED: "diverged", TIME_OVER: "time limit"}


def perfect_return(config: Config) -> float:
    """Return of a trial that never leaves the target: R_c in every control period of a trial (App. C)."""
    return config.paper.reward_constant * round(config.choices.trial_length / config.choices.control_period)


@jit
def target(circle: Circle, t: float) -> tuple[float, float]:
    """p_d(t): the point (m) on the circle at the time t (s), clockwise from the top, where p_e starts."""
    height, radius, speed = circle
    sine, cosine = sin_cos(speed * t)
    return radius * sine, height + radius * cosine


class Task(NamedTuple):
    """The task as compiled code takes it."""

    coefficients: Coefficients
    lengths: tuple[float, ...]  # [n] m
    limits: Limits  # of the integration and of a trial
    circle: Circle
    reward: tuple[float, float]  # R_c, penalty per metre
    torque_limit: float  # N·m
    action_unit: float  # N·m of an action of 1
    scale: Floats  # [2n] units of the observed state
    control_period: float  # s
    periods: int  # of a trial


@jit
def advance(task: Task, state: State, action: Torque, period: int) -> tuple[State, float, int]:
    """One control period of a trial, number ``period`` from 0; action [n] in ``action_unit``, limited here.

    Returns:
        The state; the reward R of the state and the target at the end of the period; 0, or the key of `ENDS`
        that says why the trial ends.
    """
    unit, limit = task.action_unit, task.torque_limit
    u = unpacked(action)
    for j in range(len(action)):
        u[j] = min(max(unit * u[j], -limit), limit)
    state, ended = hold_torque(task.coefficients, task.limits, state, packed(u, action))
    px, py = tip(task.lengths, state)
    dx, dy = target(task.circle, (period + 1) * task.control_period)
    dx, dy = px - dx, py - dy
    reward = task.reward[0] - task.reward[1] * math.sqrt(dx * dx + dy * dy)  # App. C: R_c − 10 ‖p_e − p_d‖
    if ended == 0 and period + 1 >= task.periods:
        ended = TIME_OVER
    return state, reward, ended


@jit
def observe(task: Task, state: State, period: int, out: Seen) -> None:
    """Observation [2n + 2]: the state in units of ``scale``, sine and cosine of the target's phase."""
    x, size = unpacked(state), len(state)
    for j in range(size):
        out[j] = x[j] / task.scale[j]
    out[size], out[size + 1] = sin_cos(task.circle[2] * (period * task.control_period))


class ThreeLinkCircleEnv(gym.Env[Seen, NDArray[np.float32]]):
    """Track the circle with the pendulum of mismatch Δ, which has the links of the configuration.

    Observation [2n + 2]: x (in half ranges of App. C if ``observation = scaled``), sin and cos of the phase.
    Action [n]: torques in units of ``action_unit``, within the torque limit. Reward: App. C.
    A trial starts at the origin. It is *terminated* when the first link hits the ground (or, to keep the
    integration accurate, when a velocity exceeds ``rate_bound``) and *truncated* after the trial length;
    ``info["outcome"]`` then says which.

    Args:
        delta: mass mismatch Δ > 0.
        trial_length: s; the configuration's if not given.
        render_mode: "rgb_array" (one picture per control period), "human" (a window, in real time) or None.
        config: every other value.

    Raises:
        ParameterError: a parameter is not allowed.
        DependencyNotInstalled (from `reset`): "human" without a GUI toolkit that matplotlib knows.
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 100}  # noqa: RUF012

    def __init__(
        self,
        delta: float = 1.0,
        trial_length: float | None = None,
        render_mode: str | None = None,
        config: Config = Config(),
    ) -> None:
        length = config.choices.trial_length if trial_length is None else trial_length
        config = config.with_values(trial_length=length)
        modes = self.metadata["render_modes"]
        check(render_mode in (None, *modes), "render_mode", render_mode, f"None or one of {modes}")
        self.config, self.render_mode, paper = config, render_mode, config.paper
        loop, dt = ClosedLoop.from_config(config, delta), config.choices.control_period
        self.pendulum, self.rule = loop.system, loop.rule
        self.metadata = self.metadata | {"render_fps": round(1.0 / dt)}
        limit, unit = paper.torque_limit, config.choices.action_unit
        largest = limit / unit
        most = float(np.finfo(np.float32).max)
        check(largest <= most, "torque_limit", limit, f"at most {most:g} times action_unit")
        self.action_space = spaces.Box(-largest, largest, (self.pendulum.links,), np.float32)
        size = self.pendulum.dimension
        self.observation_space = spaces.Box(-np.inf, np.inf, (size + 2,), np.float32)
        self.state, self.period = np.zeros(size), 0
        scaled = config.choices.observation == "scaled"
        self.observation_scale = scale = np.array(paper.state_max) if scaled else np.ones(size)
        moving = self.pendulum.coefficients, self.pendulum.lengths, self.rule.limits
        circle = paper.circle_height, paper.circle_radius, paper.circle_speed
        reward = paper.reward_constant, paper.reward_slope
        self.arrays = Task(*moving, circle, reward, limit, unit, scale, dt, round(length / dt))
        self._view: PendulumView | None = None

    @property
    def time(self) -> float:
        """s since the trial started."""
        return self.period * self.rule.control_period

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Seen, Info]:
        """Start a trial at the origin (Sec. IV-B), or at ``options["state"]`` [2n]."""
        super().reset(seed=seed)
        origin = np.zeros(self.pendulum.dimension)
        start = np.asarray((options or {}).get("state", origin), np.float64)
        fits = start.shape == origin.shape and bool(np.isfinite(start).all())
        check(fits, "state", start, f"{origin.size} finite numbers")
        self.state, self.period = start.copy(), 0
        if self.render_mode == "human":
            self.render()
        return self.observation(), {"outcome": ""}

    def step(self, action: NDArray[np.float32]) -> tuple[Seen, float, bool, bool, Info]:
        """One control period."""
        torque = np.asarray(action, np.float64).reshape(self.pendulum.links)
        state, reward, ended = advance(self.arrays, self._state, tuple(torque.tolist()), self.period)
        self.state, self.period = np.array(state), self.period + 1
        truncated = ended == TIME_OVER
        terminated = ended != 0 and not truncated
        if self.render_mode == "human":
            self.render()
        return self.observation(), float(reward), terminated, truncated, {"outcome": ENDS[ended]}

    @property
    def _state(self) -> State:
        return tuple(self.state.tolist())

    def observation(self) -> Seen:
        """What π sees now, [2n + 2]."""
        out = np.empty(self.pendulum.dimension + 2, np.float32)
        observe(self.arrays, self._state, self.period, out)
        return out

    def render(self) -> NDArray[np.uint8] | None:
        """The picture [H, W, 3] in "rgb_array"; draws the window in "human"."""
        return self.draw(self.state, self.time)

    def draw(self, x: Floats, time: float, words: str = "") -> NDArray[np.uint8] | None:
        """As `render`, of any state x [2n] and the target at ``time`` (s), with words in the title."""
        if self.render_mode is None:
            gym.logger.warn("render() without a render_mode: pass render_mode to gymnasium.make")
            return None
        if self._view is None:
            from srlrepro.dynamics.rendering import PendulumView  # with matplotlib, which training can spare

            self._view = PendulumView(self.config.paper, window=self.render_mode == "human")
        title = f"t = {time:.2f} s{words}"
        self._view.draw(self.pendulum.joints(x)[0], target(self.arrays.circle, time), title)
        if self.render_mode == "human":
            self._view.show(time)
            return None
        return self._view.image()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._view is not None:
            self._view.close()
            self._view = None


register_task()  # for those who import the module alone
