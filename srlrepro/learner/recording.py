"""What a training records: trials, visited states, the learning curve and the counts of Fig. 3."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from tqdm import tqdm

from srlrepro.dynamics.closed_loop import HIT_GROUND, NOT_RECOVERED, OUTCOMES
from srlrepro.fast_ppo.rollout import Steps
from srlrepro.fast_ppo.sb3_bridge import RolloutCallback
from srlrepro.learner.checkpoint import Progress, save
from srlrepro.learner.trials import evaluate
from srlrepro.storage.files import ResultError
from srlrepro.supervisor import QUIET, Info

Kept = tuple[Path, int, dict[str, Any]]
Report = Callable[[str], None]
TRIAL_COLUMNS = ("step", "length", "return", "outcome", "activated", "recovery", "recovery_time")


def require_finite(model: BaseAlgorithm) -> None:
    """Raise `ResultError` if the policy has diverged: one of its parameters is not a finite number."""
    for name, values in model.policy.state_dict().items():
        if not torch.isfinite(values).all():
            raise ResultError(
                f"the policy has diverged within {model.num_timesteps} steps: {name} is not finite; "
                "learning_rate, a coefficient of the loss or the reward is too large"
            )


class Recorder(RolloutCallback):
    """Collects the trials and visited states of a training, shows progress and writes checkpoints.

    Args:
        progress: what has been collected so far; grows in place.
        steps: of the whole training; stride: between two states that are kept.
        checkpoint: (file, number of updates between two checkpoints, identity of the run), or None.
        alone: the task without a supervisor, in which the mean policy is tried every ``every`` steps.
        report: receives sparse lines when no terminal shows the bar.

    Raises:
        ResultError: the policy has diverged, or a checkpoint cannot be written.
    """

    def __init__(
        self,
        progress: Progress,
        steps: int,
        stride: int,
        checkpoint: Kept | None,
        report: Report,
        alone: gym.Env[Any, Any],
        every: int,
    ) -> None:
        super().__init__()
        self.alone, self.every = alone, every
        self.progress, self.steps, self.stride = progress, steps, stride
        self.checkpoint, self.report = checkpoint, report
        self.started = time.perf_counter() - progress.seconds
        self.updates = 0

    def _on_training_start(self) -> None:
        self.scale = self.training_env.get_attr("observation_scale")[0].astype(np.float32)
        self.reached = self.num_timesteps
        self.bar = tqdm(total=self.steps, initial=self.reached, unit="step", disable=None, desc="training")

    def _on_rollout_start(self) -> None:
        require_finite(self.model)
        self._evaluate()
        self.progress.seconds = time.perf_counter() - self.started
        if self.checkpoint is not None and self.updates and self.updates % self.checkpoint[1] == 0:
            save(self.checkpoint[0], self.model, self.progress, self.checkpoint[2])
        self.updates += 1

    def _on_step(self) -> bool:
        for info, observation in zip(self.locals["infos"], self.locals["new_obs"], strict=True):
            if self.num_timesteps % self.stride == 0:
                reached = info.get("terminal_observation", observation)
                self.progress.visited.append(reached[: self.scale.size] * self.scale)
            if "episode" in info:
                self._record(info, self.num_timesteps)
        return True

    def _on_steps(self, steps: Steps, trials: list[tuple[int, Info]]) -> None:
        first = self.num_timesteps - len(steps.rewards) + 1  # the number of the rollout's first step
        kept = steps.reached[-first % self.stride :: self.stride, : self.scale.size]
        self.progress.visited.extend(kept * self.scale)
        for n, info in trials:
            self._record(info, first + n)

    def _record(self, info: Info, step: int) -> None:
        """A trial that ended at a step; ``info``: of that step."""
        total, length = info["episode"]["r"], info["episode"]["l"]
        trial = QUIET | info | {"step": step, "length": length, "return": total}
        self.progress.trials.append({name: trial[name] for name in TRIAL_COLUMNS})

    def _on_rollout_end(self) -> None:
        first, tenth = self.reached, max(1, self.steps // 10)
        self.reached = self.num_timesteps
        self.bar.update(self.reached - first)
        if self.bar.disable and self.reached // tenth > first // tenth:
            elapsed = time.perf_counter() - self.started
            left = elapsed * (self.steps - self.num_timesteps) / self.num_timesteps
            self.report(f"step {self.num_timesteps} of {self.steps}, about {max(left, 0) / 60:.1f} min left")

    def _evaluate(self) -> None:
        """Try the mean policy, if steps enough have been made since it was tried."""
        tried = self.progress.evaluations[-1]["step"] if self.progress.evaluations else 0
        if self.num_timesteps // self.every > tried // self.every:
            self.progress.evaluations.append({"step": self.num_timesteps, **evaluate(self.model, self.alone)})

    def _on_training_end(self) -> None:
        require_finite(self.model)
        self._evaluate()
        self.bar.close()
        self.progress.seconds = time.perf_counter() - self.started


def learning_curve(trials: pd.DataFrame, window: int, rows: int) -> pd.DataFrame:
    """One row per ``window`` of steps, over the trials that ended in it.

    Columns: ``step`` (at its end), ``trials``, ``mean_return`` (empty if no trial ended), ``mean_length``
    (control periods), ``reward_per_step``, ``activations``, ``failures`` (of K), ``falls`` (of π).
    """
    within = (trials["step"] - 1) // window
    grouped = trials.assign(
        failure=trials["recovery"].isin([OUTCOMES[HIT_GROUND], OUTCOMES[NOT_RECOVERED]]),
        fall=trials["outcome"] == OUTCOMES[HIT_GROUND],
    ).groupby(within)
    every = pd.RangeIndex(rows)
    curve = pd.DataFrame({"step": (every + 1) * window}, index=every)
    curve["trials"] = grouped.size().reindex(every, fill_value=0)
    curve["mean_return"] = grouped["return"].mean()
    curve["mean_length"] = grouped["length"].mean()
    curve["reward_per_step"] = grouped["return"].sum() / grouped["length"].sum()
    for name, column in (("activations", "activated"), ("failures", "failure"), ("falls", "fall")):
        curve[name] = grouped[column].sum().reindex(every, fill_value=0).astype(int)
    return curve


def count(trials: pd.DataFrame) -> dict[str, int]:
    """The counts of Fig. 3 (d)-(f).

    Returns:
        ``trials``; ``activations`` of K; its recoveries and failures by kind (neither, where K was not
        tried); and what K did not prevent: ``falls`` of π, and trials that ``diverged`` (the rate bound).
    """
    active = trials[trials["activated"].astype(bool)]
    counts = {"trials": len(trials), "activations": len(active)}
    counts |= {name.replace(" ", "_"): int((active["recovery"] == name).sum()) for name in OUTCOMES.values()}
    ends = trials["outcome"].value_counts()
    return counts | {"falls": int(ends.get("hit the ground", 0)), "diverged": int(ends.get("diverged", 0))}
