"""A system under K(x): closed-loop rollouts, recoveries, and the labels l_n(x) and l(x).

A state is safe (eq. 2) if K steers the system from it back to upright. The region of attraction has no closed
form: simulation decides, with a finite horizon and a small box around upright. One compiled kernel serves
the nominal system (l_n), every real system (l) and the recoveries of the supervisor (eq. 6).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from srlrepro.compiled.jit import inner, jit
from srlrepro.compiled.stack import read, unpacked, write
from srlrepro.dynamics.lqg import LQG, Gains, lqg_update
from srlrepro.dynamics.pendulum import Coefficients, Floats, Pendulum, State, Torque, as_states, rk4_step
from srlrepro.settings.choices import Choices
from srlrepro.settings.config import Config, check_parameters
from srlrepro.settings.fields import check
from srlrepro.settings.paper import Paper

Labels = NDArray[np.int64]
Limits = tuple[float, int, float, float, float, float]
Loop = tuple[Coefficients, Gains, Limits, int]  # and the control periods that K has to recover
RECOVERED, HIT_GROUND, NOT_RECOVERED = 1, 2, 3
OUTCOMES = {RECOVERED: "recovered", HIT_GROUND: "hit the ground", NOT_RECOVERED: "not recovered in time"}


@dataclass(frozen=True)
class RecoveryRule:
    """When a closed-loop rollout ends, and how it is integrated."""

    control_period: float = Choices.control_period  # s
    substeps: int = Choices.substeps  # Runge-Kutta steps per control period
    recovery_horizon: float = Choices.recovery_horizon  # s that K has to recover the system
    theta1_max: float = Paper.theta1_max  # rad, |θ1| at which the first link lies on the ground
    recovered_angle: float = Choices.recovered_angle  # rad, |θ_i| that counts as upright
    recovered_rate: float = Choices.recovered_rate  # rad/s, |θ̇_i| that counts as upright
    rate_bound: float = Choices.rate_bound  # rad/s, |θ̇_i| where the integration is no longer accurate

    def __post_init__(self) -> None:
        check_parameters(vars(self))

    @property
    def periods(self) -> int:
        """Control periods in the horizon."""
        return round(self.recovery_horizon / self.control_period)

    @property
    def limits(self) -> Limits:
        """The rule as `recover` takes it."""
        dt, box = self.control_period / self.substeps, (self.recovered_angle, self.recovered_rate)
        return dt, self.substeps, self.theta1_max, *box, self.rate_bound


@jit
def _within(state: State, angle: float, rate: float) -> bool:
    """Whether no |θ_i| exceeds ``angle`` and no |θ̇_i| exceeds ``rate``; NaN exceeds both."""
    x, n, inside = unpacked(state), len(state) // 2, True
    for i in range(n):
        inside = inside and abs(x[i]) <= angle and abs(x[n + i]) <= rate
    return inside


@jit
def hold_torque(coefficients: Coefficients, limits: Limits, state: State, u: Torque) -> tuple[State, int]:
    """One control period from the state [2n], with the torque u [n] held.

    Returns:
        (state, 0 or the outcome that ends the rollout). No step beyond the rate bound (or to NaN) is taken.
    """
    dt, substeps, ground, _, _, bound = limits
    for _ in range(substeps):
        new = rk4_step(coefficients, state, u, dt)
        if not _within(new, np.inf, bound):
            return state, NOT_RECOVERED
        state = new
        if abs(state[0]) >= ground:
            return state, HIT_GROUND
    return state, 0


@jit
def is_upright(limits: Limits, state: State) -> bool:
    """Whether the state [2n] lies in the box that counts as recovered."""
    return _within(state, limits[3], limits[4])


@inner
def recover(
    coefficients: Coefficients, gains: Gains, limits: Limits, periods: int, x: Floats, path: Floats
) -> tuple[int, int]:
    """Run K from x [2n].

    Args:
        path: [periods + 1, 2n], filled with the states at the control instants, the last one repeated after
            the outcome; without rows nothing is recorded.

    Returns:
        (outcome, control periods until it).
    """
    xbar, y, u = x.copy(), x.copy(), np.zeros(len(coefficients.idle))
    state, outcome, t = read(x, coefficients.upright), 0, 0
    record = path.shape[0] > 0
    if abs(state[0]) >= limits[2]:
        outcome = HIT_GROUND
    while True:
        write(state, y)
        if record:
            for j in range(y.size):
                path[t, j] = y[j]
        if outcome == 0 and is_upright(limits, state):
            outcome = RECOVERED
        if outcome == 0 and t == periods:
            outcome = NOT_RECOVERED
        if outcome != 0:
            break
        lqg_update(gains, xbar, y, u)
        state, outcome = hold_torque(coefficients, limits, state, read(u, coefficients.idle))
        t += 1
    for later in range(t + 1, path.shape[0]):
        for j in range(y.size):
            path[later, j] = y[j]
    return outcome, t


@jit
def _recover_batch(loop: Loop, x: Floats, paths: Floats, outcomes: Labels, durations: Floats) -> None:
    for i in range(x.shape[0]):
        outcomes[i], durations[i] = recover(*loop, x[i], paths[i])


@dataclass(frozen=True, eq=False)
class Rollouts:
    """Closed-loop rollouts from B states."""

    outcomes: Labels  # [B] keys of `OUTCOMES`
    durations: Floats  # [B] s until the outcome
    paths: Floats  # [B, T + 1, 2n] rad and rad/s at the control instants; [B, 0, 2n] if not asked for

    @property
    def labels(self) -> Labels:
        """Safety labels z [B] of eq. (2): 1 recovered, 0 else."""
        return np.asarray(self.outcomes == RECOVERED, np.int64)


@dataclass(frozen=True)
class ClosedLoop:
    """A system (nominal or real) under the corrective controller K."""

    system: Pendulum = Pendulum()
    controller: LQG = LQG()  # K, always derived from the nominal system
    rule: RecoveryRule = RecoveryRule()  # when a rollout ends

    def __post_init__(self) -> None:
        links, known = self.system.links, self.controller.nominal.links
        check(known == links, "controller.nominal.links", known, f"{links}, as the system has")

    @classmethod
    def from_config(cls, config: Config, delta: float = 1.0) -> "ClosedLoop":
        """The system with mismatch Δ under K, with the values of a configuration."""
        nominal = Pendulum(**config.arguments_of(Pendulum))
        controller = LQG(nominal, **config.arguments_of(LQG))
        rule = RecoveryRule(**config.arguments_of(RecoveryRule))
        return cls(replace(nominal, delta=delta), controller, rule)

    @cached_property
    def kernel_arguments(self) -> Loop:
        """(coefficients, gains, limits, periods) as `recover` takes them."""
        return self.system.coefficients, self.controller.arrays, self.rule.limits, self.rule.periods

    def rollout(self, x: ArrayLike, record: bool = True) -> Rollouts:
        """Run K from the states x [B, 2n]; ``record``: keep the paths."""
        states = as_states(x, self.system.dimension)
        batch, rows = len(states), (self.rule.periods + 1) if record else 0
        paths, outcomes = np.empty((batch, rows, self.system.dimension)), np.empty(batch, np.int64)
        durations = np.empty(batch)
        _recover_batch(self.kernel_arguments, states, paths, outcomes, durations)
        return Rollouts(outcomes, durations * self.rule.control_period, paths)

    def predict(self, x: ArrayLike) -> Labels:
        """Labels [B] of eq. (2), 1 = safe: l_n(x) if the system is nominal, else l(x), the h of eq. (3)."""
        return self.rollout(x, record=False).labels
