"""Any environment under a controller of one's own, step by step: recoveries, rollouts and labels (eqs. 2, 6).

What `ClosedLoop` is for the pendulum, in plain Python: the system is a gymnasium environment whose state can
be read, and a rule on the state says when K has recovered it or failed. K acts on the environment itself,
beneath all wrappers: none limits its time, counts its steps or rescales its actions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from srlrepro.dynamics.closed_loop import HIT_GROUND, NOT_RECOVERED, RECOVERED, Labels, Rollouts
from srlrepro.dynamics.pendulum import Floats
from srlrepro.settings.fields import check, check_whole, is_number

AnyEnv = gym.Env[Any, Any]
FAILED = HIT_GROUND  # what `HIT_GROUND` is of any other system


class Controller(Protocol):
    """K of any system; it may remember what it has seen since `reset`."""

    def reset(self, x: Floats) -> Any:
        """Be activated at the state x [d]."""

    def action(self, x: Floats) -> Any:
        """The action, as the environment takes it, for one control period from the state x [d]."""


def never(x: Floats) -> bool:
    """No state x [d] is a failure, beyond those where the environment terminates."""
    return False


@dataclass(frozen=True)
class StateRule:
    """When K has recovered a system, and when it has failed.

    What terminates the environment is a failure too; its time limit is none.

    Raises:
        ParameterError: a value is not allowed.
    """

    recovered: Callable[[Floats], bool]  # of a state x [d]
    failed: Callable[[Floats], bool] = never  # of a state x [d]; it is asked first
    periods: int = 1000  # steps of the environment that K has to recover it
    control_period: float = 1.0  # s of a step; 1: times are numbers of steps

    def __post_init__(self) -> None:
        for name in ("recovered", "failed"):
            check(callable(getattr(self, name)), name, getattr(self, name), "a function of a state [d]")
        check_whole("periods", self.periods, 1)
        dt = self.control_period
        check(is_number(dt) and 0 < dt < np.inf, "control_period", dt, "a number in (0, inf)")


def state_of(env: AnyEnv) -> Any:
    """The attribute ``state`` of the environment beneath all wrappers; None if it has none."""
    return getattr(env.unwrapped, "state", None)


def put(env: AnyEnv, x: Floats) -> None:
    """Start the environment beneath all wrappers anew, in the state x [d]: its attribute ``state``."""
    env.unwrapped.reset()
    env.unwrapped.state = x.copy()  # type: ignore[attr-defined]


def stand(env: AnyEnv, x: Floats) -> None:
    """Leave the environment in the state x [d], where it stands."""


@dataclass(frozen=True)
class SteppedLoop:
    """A gymnasium environment under a controller K.

    Raises:
        ParameterError: a part is of another kind; or, as it is run, the state cannot be read.
    """

    env: AnyEnv
    controller: Controller
    rule: StateRule  # when a rollout ends
    state: Callable[[AnyEnv], Any] = state_of  # reads the state [d]
    place: Callable[[AnyEnv, Floats], Any] = put  # starts the environment in a state [d]

    def __post_init__(self) -> None:
        check(isinstance(self.env, gym.Env), "env", self.env, "an environment of gymnasium")
        own = all(callable(getattr(self.controller, name, None)) for name in ("reset", "action"))
        check(own, "controller", self.controller, "a controller: with reset(x) and action(x)")
        check(isinstance(self.rule, StateRule), "rule", self.rule, "a StateRule: when K has recovered it")
        for name in ("state", "place"):
            check(callable(getattr(self, name)), name, getattr(self, name), "a function of an environment")

    def read(self) -> Floats:
        """The state [d] of the environment, a copy."""
        found = self.state(self.env)
        try:
            x = np.array(found, np.float64)
        except (TypeError, ValueError):  # no numbers
            x = np.zeros(0)
        check(x.ndim == 1 and x.size > 0, "state", found, "a function of env that reads its state [d]")
        return x

    def _recover(self) -> tuple[int, list[Floats]]:
        """Run K from where the environment stands: the outcome, and the states [d] until it."""
        path, ended = [self.read()], False
        self.controller.reset(path[0])
        while True:
            x = path[-1]
            if ended or self.rule.failed(x):
                return FAILED, path
            if self.rule.recovered(x):
                return RECOVERED, path
            if len(path) > self.rule.periods:
                return NOT_RECOVERED, path
            ended = bool(self.env.unwrapped.step(self.controller.action(x))[2])
            path.append(self.read())

    def rollout(self, x: ArrayLike, record: bool = True) -> Rollouts:
        """Run K from each of the states x [B, d]; ``record``: keep the paths.

        Returns:
            Outcomes [B], durations [B] in s and paths [B, T + 1, d], their last states repeated after the
            outcome.
        """
        states = np.atleast_2d(np.asarray(x, np.float64))
        (batch, size), rows = states.shape, self.rule.periods + 1 if record else 0
        outcomes, durations = np.empty(batch, np.int64), np.empty(batch)
        paths = np.empty((batch, rows, size))
        for i, start in enumerate(states):
            self.place(self.env, start)
            outcomes[i], path = self._recover()
            durations[i] = (len(path) - 1) * self.rule.control_period
            if record:
                paths[i, : len(path)], paths[i, len(path) :] = path, path[-1]
        return Rollouts(outcomes, durations, paths)

    def predict(self, x: ArrayLike) -> Labels:
        """Labels [B] of eq. (2) of the states x [B, d], 1 = safe: K recovers the environment."""
        return self.rollout(x, record=False).labels
