"""A compiled rollout told to the gymnasium objects and the callbacks of stable-baselines3."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit
from stable_baselines3.common.callbacks import BaseCallback, CallbackList, ConvertCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from srlrepro.dynamics.circle_env import ENDS, TIME_OVER, Task, ThreeLinkCircleEnv
from srlrepro.fast_ppo.network import Integers
from srlrepro.fast_ppo.rollout import Steps
from srlrepro.settings.fields import ParameterError
from srlrepro.supervisor import (
    QUIET,
    RECOVERIES,
    STOCK,
    SUPERVISED,
    UNSUPERVISED,
    Info,
    Singles,
    Supervision,
    Supervisor,
)

MADE_BY_GYMNASIUM = (OrderEnforcing, PassiveEnvChecker, TimeLimit)  # the wrappers that `gymnasium.make` adds


class RolloutCallback(BaseCallback):
    """A callback that can be told of all steps of a rollout at once.

    `CompiledPPO` does so if no other callback is there, as telling step by step takes longer than a step.
    What ``_on_step`` would have done, ``_on_steps`` does. It cannot stop the training.
    """

    def _on_steps(self, steps: Steps, trials: list[tuple[int, Info]]) -> None:
        """Take note of a rollout, whose last step is number ``num_timesteps``; trials: see `Stack.trials`."""
        raise NotImplementedError


def told_at_once(callback: BaseCallback) -> bool:
    """Whether nothing in a callback, which may be a list, must be told step by step."""
    if type(callback) is CallbackList:
        return all(map(told_at_once, callback.callbacks))
    nobody = type(callback) is ConvertCallback and callback.callback is None
    return nobody or isinstance(callback, RolloutCallback)


def tell(callback: BaseCallback, steps: Steps, trials: list[tuple[int, Info]]) -> None:
    """Tell a callback that is `told_at_once` of a rollout after which the model's step counter stands."""
    callback.n_calls += len(steps.rewards)
    callback.num_timesteps = callback.model.num_timesteps
    if isinstance(callback, RolloutCallback):
        callback._on_steps(steps, trials)
    for inner in callback.callbacks if isinstance(callback, CallbackList) else []:
        tell(inner, steps, trials)


def _codes(steps: Steps) -> tuple[Integers, ...]:
    """What ended a trial, whether it was cut off, the outcome of K and its control periods, each [N]."""
    return steps.ended, steps.cut_off, steps.recoveries, steps.recovery_periods


@dataclass(frozen=True)
class Stack:
    """The wrappers that stock PPO would step through: Monitor, maybe Supervisor, task.

    Those that ``gymnasium.make`` adds may lie between them. A check that a step would have passed is left to
    the first step that goes through them.

    Raises:
        ParameterError (from `of`): the environment is built otherwise.
    """

    monitor: Monitor[Any, Any]
    supervisor: Supervisor | None
    time_limits: tuple[TimeLimit[Any, Any], ...]
    task: ThreeLinkCircleEnv

    @classmethod
    def of(cls, env: VecEnv) -> "Stack":
        """The wrappers of a vectorised environment."""
        monitor = env.envs[0] if isinstance(env, DummyVecEnv) and env.num_envs == 1 else None
        inner = monitor.env if type(monitor) is Monitor else None
        wrappers: list[gym.Wrapper[Any, Any, Any, Any]] = []
        while isinstance(inner, gym.Wrapper) and type(inner) in (Supervisor, *MADE_BY_GYMNASIUM):
            wrappers.append(inner)
            inner = inner.env
        supervisors = [wrapper for wrapper in wrappers if isinstance(wrapper, Supervisor)]
        limits = tuple(wrapper for wrapper in wrappers if isinstance(wrapper, TimeLimit))
        if type(monitor) is not Monitor or type(inner) is not ThreeLinkCircleEnv or len(supervisors) > 1:
            raise ParameterError(
                f"env = {monitor or env}: must be one ThreeLinkCircleEnv, or one Supervisor of it, in no "
                f"wrappers but a Monitor and the wrappers of gymnasium.make; {STOCK} takes any"
            )
        return cls(monitor, supervisors[0] if supervisors else None, limits, inner)

    @property
    def arrays(self) -> Task:
        """The task, with the shortest of its time limits."""
        limits = [limit._max_episode_steps for limit in self.time_limits]
        return self.task.arrays._replace(periods=min([self.task.arrays.periods, *limits]))

    @property
    def supervision(self) -> Supervision:
        """The supervisor, if there is one."""
        return UNSUPERVISED if self.supervisor is None else self.supervisor.arrays

    def place(self, state: np.ndarray, period: int) -> None:
        """Put the task into a state in a trial of which ``period`` control periods are over."""
        self.task.state, self.task.period = state.copy(), period
        for limit in self.time_limits:
            limit._elapsed_steps = period  # type: ignore[assignment]
        if self.supervisor is not None:
            self.supervisor.recovery = None

    def rewind(self, steps: Steps, n: int) -> None:
        """Put the task where it stood after step n of a rollout; the Monitor has been told so far."""
        period = len(self.monitor.rewards)
        self.place(steps.states[n] if period else np.zeros_like(steps.states[n]), period)

    def infos(self, steps: Steps) -> Iterator[Info]:
        """``info`` of every step, as the wrappers and the vectorised environment would have put it together.

        Steps and trials are entered into the Monitor's books on the way.
        """
        rewards = steps.rewards.tolist()
        rows = zip(*(column.tolist() for column in _codes(steps)), strict=True)
        for n, row in enumerate(rows):
            self.monitor.rewards.append(rewards[n])
            self.monitor.total_steps += 1
            yield self._info(row, steps.reached[n])

    def trials(self, steps: Steps) -> list[tuple[int, Info]]:
        """(n, ``info``) of every step n that ended a trial; the books are those that `infos` leaves."""
        rewards, told, first = steps.rewards.tolist(), [], 0
        for n in np.flatnonzero(steps.dones).tolist():
            self.monitor.rewards += rewards[first : n + 1]
            codes = tuple(int(column[n]) for column in _codes(steps))
            told.append((n, self._info(codes, steps.reached[n])))
            first = n + 1
        self.monitor.rewards += rewards[first:]
        self.monitor.total_steps += len(rewards)
        return told

    def _info(self, codes: tuple[int, ...], reached: Singles) -> Info:
        """Of the last step that the Monitor knows; codes: see `_codes`; reached: observation."""
        end, cut_off, recovery, periods = codes
        by_wrapper = end == TIME_OVER and len(self.monitor.rewards) < self.task.arrays.periods
        info: Info = {"outcome": "" if by_wrapper else ENDS[end]}
        if self.supervisor is not None:
            info |= QUIET
        if recovery:
            duration = periods * self.task.rule.control_period
            info |= {"activated": True, "recovery": RECOVERIES[recovery], "recovery_time": duration}
            info["outcome"] = SUPERVISED
        info["TimeLimit.truncated"] = bool(cut_off)
        if end or recovery:
            info["terminal_observation"] = reached
            info["episode"] = self._episode(info)
        return info

    def _episode(self, info: Info) -> Info:
        """What the Monitor says of a trial that has ended; it is ready for the next one."""
        monitor = self.monitor
        total, length, passed = sum(monitor.rewards), len(monitor.rewards), time.time() - monitor.t_start
        episode = {"r": round(total, 6), "l": length, "t": round(passed, 6)}
        episode |= {key: info[key] for key in monitor.info_keywords}
        monitor.episode_returns.append(total)
        monitor.episode_lengths.append(length)
        monitor.episode_times.append(passed)
        if monitor.results_writer:
            monitor.results_writer.write_row(episode)
        monitor.rewards = []
        return episode
