"""A compiled rollout told to the gymnasium objects and the callbacks of stable-baselines3, step by step."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from srlrepro.dynamics.circle_env import ENDS, ThreeLinkCircleEnv
from srlrepro.fast_ppo.rollout import Steps
from srlrepro.settings.fields import ParameterError
from srlrepro.supervisor import RECOVERIES, SUPERVISED, Guard, Supervisor, nobody


@dataclass(frozen=True)
class Stack:
    """The wrappers that stock PPO would step through: Monitor, maybe Supervisor, task.

    Raises:
        ParameterError (from `of`): the environment is built otherwise.
    """

    monitor: Monitor[Any, Any]
    supervisor: Supervisor | None
    task: ThreeLinkCircleEnv

    @classmethod
    def of(cls, env: VecEnv) -> "Stack":
        """The wrappers of a vectorised environment."""
        monitor = env.envs[0] if isinstance(env, DummyVecEnv) and env.num_envs == 1 else None
        inner = monitor.env if type(monitor) is Monitor else None
        supervisor = inner if type(inner) is Supervisor else None
        task = inner if supervisor is None else supervisor.env
        if type(monitor) is not Monitor or type(task) is not ThreeLinkCircleEnv:
            raise ParameterError(
                f"env = {monitor or env}: must be one ThreeLinkCircleEnv, or one Supervisor of it, "
                "in nothing but a Monitor; or use stable-baselines3's PPO"
            )
        return cls(monitor, supervisor, task)

    @property
    def guard(self) -> Guard:
        """Who watches."""
        return nobody() if self.supervisor is None else self.supervisor.guard

    def place(self, state: np.ndarray, period: int) -> None:
        """Put the task into a state, so many periods into a trial."""
        self.task.state, self.task.period = state.copy(), period
        if self.supervisor is not None:
            self.supervisor.recovery = None

    def rewind(self, steps: Steps, n: int) -> None:
        """Put the task where it stood after step n of a rollout; the Monitor has been told so far."""
        period = len(self.monitor.rewards)
        self.place(steps.states[n] if period else np.zeros(6), period)

    def infos(self, steps: Steps) -> Iterator[dict[str, Any]]:
        """``info`` of every step, as the wrappers and the vectorised environment would have put it together.

        Trials are entered into the Monitor's books on the way.
        """
        monitor, dt = self.monitor, self.task.rule.control_period
        lists = (steps.rewards, steps.ended, steps.cut_off, steps.recoveries)
        told = enumerate(zip(*(numbers.tolist() for numbers in lists), strict=True))
        for n, (reward, end, cut_off, recovery) in told:
            info: dict[str, Any] = {"outcome": SUPERVISED if recovery else ENDS[end]}
            if self.supervisor is not None:
                info["activated"] = recovery != 0
                info["recovery"] = RECOVERIES[recovery] if recovery else ""
                info["recovery_time"] = int(steps.recovery_periods[n]) * dt if recovery else 0.0
            info["TimeLimit.truncated"] = bool(cut_off)
            monitor.rewards.append(reward)
            monitor.total_steps += 1
            if end or recovery:
                info["terminal_observation"] = steps.reached[n]
                info["episode"] = self._episode()
            yield info

    def _episode(self) -> dict[str, Any]:
        """What the Monitor says of a trial that has ended; it is ready for the next one."""
        monitor = self.monitor
        total, length, passed = sum(monitor.rewards), len(monitor.rewards), time.time() - monitor.t_start
        episode = {"r": round(total, 6), "l": length, "t": round(passed, 6)}
        monitor.episode_returns.append(total)
        monitor.episode_lengths.append(length)
        monitor.episode_times.append(passed)
        if monitor.results_writer:
            monitor.results_writer.write_row(episode)
        monitor.rewards = []
        return episode
