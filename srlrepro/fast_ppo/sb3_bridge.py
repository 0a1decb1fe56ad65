"""A compiled rollout told to the gymnasium objects and the callbacks of stable-baselines3, step by step."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from srlrepro.dynamics.circle_env import ENDS, TIME_OVER, Task, ThreeLinkCircleEnv
from srlrepro.fast_ppo.rollout import Steps
from srlrepro.settings.fields import ParameterError
from srlrepro.supervisor import QUIET, RECOVERIES, STOCK, SUPERVISED, UNSUPERVISED, Supervision, Supervisor

MADE_BY_GYMNASIUM = (OrderEnforcing, PassiveEnvChecker, TimeLimit)  # the wrappers that `gymnasium.make` adds


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

    def infos(self, steps: Steps) -> Iterator[dict[str, Any]]:
        """``info`` of every step, as the wrappers and the vectorised environment would have put it together.

        Trials are entered into the Monitor's books on the way.
        """
        monitor, dt = self.monitor, self.task.rule.control_period
        columns = (steps.rewards, steps.ended, steps.cut_off, steps.recoveries, steps.recovery_periods)
        rows = enumerate(zip(*(column.tolist() for column in columns), strict=True))
        for n, (reward, end, cut_off, recovery, periods) in rows:
            monitor.rewards.append(reward)
            monitor.total_steps += 1
            by_wrapper = end == TIME_OVER and len(monitor.rewards) < self.task.arrays.periods
            info: dict[str, Any] = {"outcome": "" if by_wrapper else ENDS[end]}
            if self.supervisor is not None:
                info |= QUIET
            if recovery:
                info |= {"activated": True, "recovery": RECOVERIES[recovery], "recovery_time": periods * dt}
                info["outcome"] = SUPERVISED
            info["TimeLimit.truncated"] = bool(cut_off)
            if end or recovery:
                info["terminal_observation"] = steps.reached[n]
                info["episode"] = self._episode(info)
            yield info

    def _episode(self, info: dict[str, Any]) -> dict[str, Any]:
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
