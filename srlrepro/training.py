"""One training run: PPO (stable-baselines3, App. C) with or without a supervisor, resumable.

The products of a run, in one folder:

- ``trials.csv``: one row per trial (`TRIAL_COLUMNS`);
- ``curve.csv``: the learning curve, one row per update (`learning_curve`);
- ``visited.npz``: states x [N, 6] that the learner visited, a sample of the distribution 𝒟 of Sec. III;
- ``policy.zip``: the final policy, an archive of stable-baselines3 (the one kind of file with pickles);
- ``run.json``: what was run, the counts of Fig. 3 (d)-(f), the final policy's trials, and provenance.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor
from tqdm import tqdm

from srlrepro.checkpoint import Progress, restore, save
from srlrepro.config import Config, check, condition
from srlrepro.env import ThreeLinkCircleEnv
from srlrepro.files import beside, require_writable, write_arrays, write_json, write_table
from srlrepro.labels import HIT_GROUND, OUTCOMES, ClosedLoop
from srlrepro.provenance import provenance
from srlrepro.supervisor import Hypothesis, Supervisor

VISITED_FORMAT = "srlrepro-visited-1"
TRIAL_COLUMNS = ("step", "length", "return", "outcome", "activated", "recovery", "recovery_time")


@dataclass(frozen=True)
class Run:
    """What is trained.

    Attributes:
        alpha: share of UD in the training data of the region; None: no supervisor ("none").
        delta: mass mismatch Δ of the real system.
        seed: of the learner.
        steps: training steps; PPO rounds them up to whole updates.
    """

    alpha: float | None
    delta: float
    seed: int
    steps: int

    def __post_init__(self) -> None:
        check(self.alpha is None or 0 <= self.alpha <= 1, "alpha", self.alpha, "a number in [0, 1], or none")
        check(self.delta > 0, "delta", self.delta, "a finite number > 0")
        for name, least in (("seed", 0), ("steps", 1)):
            value = getattr(self, name)
            check(isinstance(value, int) and value >= least, name, value, f"a whole number in [{least}, inf)")

    @property
    def name(self) -> str:
        """Names the run's folder and files."""
        return f"alpha_{condition(self.alpha)}__delta_{self.delta:g}__seed_{self.seed}"


def make_env(run: Run, config: Config, region: Hypothesis | None) -> gym.Env[Any, Any]:
    """The environment of a run: the task, under a supervisor if there is a region.

    Raises:
        ValueError: α without a region, or a region without α.
    """
    check((run.alpha is None) == (region is None), "region", region, "given exactly if alpha is not none")
    env = ThreeLinkCircleEnv(run.delta, config=config)
    if region is None:
        return env
    return Supervisor(env, region, ClosedLoop.from_config(config).controller)


def make_learner(env: gym.Env[Any, Any], config: Config, seed: int) -> PPO:
    """PPO with the parameters of App. C; everything else is stable-baselines3's default, or a `Choices`."""
    p, c = config.paper, config.choices
    return PPO(
        "MlpPolicy",
        Monitor(env),
        learning_rate=p.learning_rate,
        n_steps=p.n_steps,
        batch_size=p.n_steps // p.n_minibatches,
        n_epochs=p.n_epochs,
        gamma=p.discount,
        gae_lambda=p.gae_lambda,
        clip_range=c.clip_range,
        ent_coef=p.ent_coef,
        vf_coef=p.vf_coef,
        max_grad_norm=p.max_grad_norm,
        policy_kwargs={"net_arch": [p.hidden_width] * p.hidden_layers, "log_std_init": c.log_std_init},
        seed=seed,
        device="cpu",
    )


class Recorder(BaseCallback):
    """Collects the trials and visited states of a training, shows progress and writes checkpoints.

    Args:
        progress: what has been collected so far; grows in place.
        steps: total training steps.
        stride: every how many steps a state is kept.
        state_max: [6] half ranges that undo the scaling of the observations.
        checkpoint: (file, number of updates between two checkpoints, identity of the run), or None.
        report: receives sparse lines when no terminal shows the bar.
    """

    def __init__(
        self,
        progress: Progress,
        steps: int,
        stride: int,
        state_max: tuple[float, ...],
        checkpoint: tuple[Path, int, dict[str, Any]] | None,
        report: Callable[[str], None],
    ) -> None:
        super().__init__()
        self.progress, self.steps, self.stride = progress, steps, stride
        self.scale = np.array(state_max, dtype=np.float32)
        self.checkpoint, self.report = checkpoint, report
        self.started = time.perf_counter() - progress.seconds
        self.updates = 0

    def _on_training_start(self) -> None:
        self.first = self.num_timesteps
        self.bar = tqdm(total=self.steps, initial=self.first, unit="step", disable=None, desc="training")

    def _on_rollout_start(self) -> None:
        self.progress.seconds = time.perf_counter() - self.started
        if self.checkpoint is not None and self.updates and self.updates % self.checkpoint[1] == 0:
            save(self.checkpoint[0], self.model, self.progress, self.checkpoint[2])
        self.updates += 1

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                self.progress.trials.append(
                    {
                        "step": self.num_timesteps,
                        "length": info["episode"]["l"],
                        "return": info["episode"]["r"],
                        "outcome": info["outcome"],
                        "activated": info.get("activated", False),
                        "recovery": info.get("recovery", ""),
                        "recovery_time": info.get("recovery_time", 0.0),
                    }
                )
        return True

    def _on_rollout_end(self) -> None:
        assert isinstance(self.model, PPO)
        observed = self.model.rollout_buffer.observations[:, 0, :6]
        first = self.num_timesteps - len(observed)
        kept = observed[(-first) % self.stride :: self.stride]
        self.progress.visited.append(kept * self.scale)
        self.bar.update(len(observed))
        tenth = max(1, self.steps // 10)
        if self.bar.disable and self.num_timesteps // tenth > first // tenth:
            elapsed = time.perf_counter() - self.started
            left = elapsed * (self.steps - self.num_timesteps) / self.num_timesteps
            self.report(f"step {self.num_timesteps} of {self.steps}, about {max(left, 0) / 60:.1f} min left")

    def _on_training_end(self) -> None:
        self.bar.close()
        self.progress.seconds = time.perf_counter() - self.started


def learning_curve(trials: pd.DataFrame, n_steps: int, updates: int) -> pd.DataFrame:
    """One row per update of n_steps steps, over the trials that ended in it.

    Columns: ``step`` (at its end), ``trials``, ``mean_return`` (empty if no trial ended), ``mean_length``
    (control periods), ``reward_per_step``, ``activations``, ``failures`` (of K), ``falls`` (of π).
    """
    update = (trials["step"] - 1) // n_steps
    grouped = trials.assign(
        failure=trials["activated"] & (trials["recovery"] != "recovered"),
        fall=trials["outcome"] == OUTCOMES[HIT_GROUND],
    ).groupby(update)
    every = pd.RangeIndex(updates)
    curve = pd.DataFrame({"step": (every + 1) * n_steps}, index=every)
    curve["trials"] = grouped.size().reindex(every, fill_value=0)
    curve["mean_return"] = grouped["return"].mean()
    curve["mean_length"] = grouped["length"].mean()
    curve["reward_per_step"] = grouped["return"].sum() / grouped["length"].sum()
    for name, column in (("activations", "activated"), ("failures", "failure"), ("falls", "fall")):
        curve[name] = grouped[column].sum().reindex(every, fill_value=0).astype(int)
    return curve


def count(trials: pd.DataFrame) -> dict[str, int]:
    """The counts of Fig. 3 (d)-(f): activations of K, its recoveries and failures by kind, and what K
    did not prevent: falls of π, and trials given up by the rate bound."""
    active = trials[trials["activated"]]
    counts = {"trials": len(trials), "activations": len(active)}
    counts |= {name.replace(" ", "_"): int((active["recovery"] == name).sum()) for name in OUTCOMES.values()}
    outcomes = trials["outcome"]
    return counts | {
        "falls": int((outcomes == "hit the ground").sum()),
        "diverged": int((outcomes == "diverged").sum()),
    }


def evaluate(model: BaseAlgorithm, env: gym.Env[Any, Any]) -> dict[str, Any]:
    """One trial with the policy's mean action; task and policy are deterministic, so one says it all."""
    observation, info = env.reset()
    total, length, ended = 0.0, 0, False
    while not ended:
        action, _ = model.predict(observation, deterministic=True)
        observation, reward, terminated, truncated, info = env.step(action)
        total, length, ended = total + float(reward), length + 1, terminated or truncated
    return {"return": total, "length": length, "outcome": info["outcome"]}


def train(
    run: Run,
    config: Config,
    region: Hypothesis | None,
    folder: Path,
    checkpoint: Path | None = None,
    report: Callable[[str], None] = print,
) -> dict[str, Any]:
    """Train one run and write its products (see the module) to ``folder``; returns what run.json holds.

    Args:
        checkpoint: file to go on from if it exists and to write every ``checkpoint_updates`` updates; it is
            removed at the end. The result is the same as without an interruption.
        report: receives sparse progress lines when there is no terminal.

    Raises:
        ValueError: a parameter is not allowed, or the region predicts the origin as unsafe.
        ResultError: the folder cannot be written, or the checkpoint is truncated or of another run.
    """
    torch.set_num_threads(1)
    folder, choices = Path(folder), config.choices
    require_writable(folder)
    env = make_env(run, config, region)
    model, progress = make_learner(env, config, run.seed), Progress()
    identity = {"run": asdict(run), "config": config.as_dict()}
    if checkpoint is not None and checkpoint.exists():
        model, progress = restore(checkpoint, model, identity)
        report(f"going on from step {model.num_timesteps}")
    updates = -(-run.steps // config.paper.n_steps)
    steps = updates * config.paper.n_steps
    recorder = Recorder(
        progress,
        steps,
        stride=max(1, steps // choices.visited_states),
        state_max=config.paper.state_max,
        checkpoint=None if checkpoint is None else (checkpoint, choices.checkpoint_updates, identity),
        report=report,
    )
    if model.num_timesteps < steps:
        model.learn(
            steps - model.num_timesteps, callback=recorder, reset_num_timesteps=model.num_timesteps == 0
        )
    trials = pd.DataFrame(progress.trials, columns=list(TRIAL_COLUMNS))
    result = {
        "run": asdict(run),
        "steps_done": model.num_timesteps,
        "counts": count(trials),
        "final_policy": {
            "own condition": evaluate(model, make_env(run, config, region)),
            "no supervisor": evaluate(model, ThreeLinkCircleEnv(run.delta, config=config)),
        },
        "config": config.as_dict(),
        "provenance": provenance(progress.seconds),
    }
    write_table(folder / "trials.csv", trials)
    write_table(folder / "curve.csv", learning_curve(trials, config.paper.n_steps, updates))
    write_arrays(folder / "visited.npz", VISITED_FORMAT, x=np.concatenate(progress.visited))
    with beside(folder / "policy.zip") as temporary:
        model.save(temporary)
    write_json(folder / "run.json", result)
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    return result
