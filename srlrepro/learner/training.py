"""One training run: PPO (stable-baselines3, App. C) with or without a supervisor, resumable.

The products of a run, in one folder:

- ``trials.csv``: one row per trial (`TRIAL_COLUMNS`);
- ``curve.csv``: the learning curve, one row per window of steps (`learning_curve`);
- ``evaluations.csv``: trials of the mean policy without a supervisor, every ``evaluation_steps``;
- ``visited.npz``: states x [N, 2n] that the learner's steps reached, the last of a trial included: a sample
  of the distribution 𝒟 of Sec. III;
- ``policy.npz``: the actor of the final policy as plain arrays (`srlrepro.load_policy`);
- ``policy.zip``: the whole learner, an archive of stable-baselines3 with pickles, which nothing here reads;
- ``run.json``: what was run, the counts of Fig. 3 (d)-(f), the final policy's trials, and provenance.
"""

import io
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from zipfile import ZipFile, ZipInfo

import gymnasium as gym
import numpy as np
import pandas as pd
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.monitor import Monitor

from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.fast_ppo.ppo import CompiledPPO
from srlrepro.learner import VISITED_FORMAT
from srlrepro.learner.checkpoint import EVALUATION, Progress, restore
from srlrepro.learner.policy import TrainedPolicy, record_of
from srlrepro.learner.recording import TRIAL_COLUMNS, Recorder, Report, count, learning_curve
from srlrepro.learner.trials import evaluate
from srlrepro.pins import ARITHMETIC
from srlrepro.region.hypothesis import CompiledHypothesis, Hypothesis
from srlrepro.settings.condition import Condition
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check, check_whole
from srlrepro.storage import files
from srlrepro.storage.provenance import provenance
from srlrepro.supervisor import Supervisor

OF_THE_SITTING = (
    "start_time",
    "ep_info_buffer",
    "_num_timesteps_at_start",
)  # of a learner; only logs read them
SHORTEST = 256  # steps of a row of the learning curve, at least, so that some trials end in it


@dataclass(frozen=True)
class Run(Condition):
    """What is trained: a condition, for a number of steps.

    Attributes:
        steps: training steps; PPO rounds them up to whole updates.
    """

    steps: int

    def __post_init__(self) -> None:
        super().__post_init__()
        check_whole("steps", self.steps, 1)


def make_env(run: Run, config: Config, region: Hypothesis | None) -> gym.Env[Any, Any]:
    """The environment of a run: the task, under a supervisor if there is a region.

    Raises:
        ParameterError: α without a region, or a region without α.
    """
    check((run.alpha is None) == (region is None), "region", region, "given exactly if alpha is not none")
    env = ThreeLinkCircleEnv(run.delta, config=config)
    if region is None:
        return env
    return Supervisor(env, region, ClosedLoop.from_config(config).controller)


def make_learner(env: gym.Env[Any, Any], config: Config, seed: int) -> PPO:
    """PPO with the parameters of App. C; everything else is stable-baselines3's default, or a `Choices`."""
    p, c = config.paper, config.choices
    values = config.arguments_of(PPO)  # those that have the same name there
    values |= {"batch_size": p.n_steps // p.n_minibatches, "gamma": p.discount, "seed": seed, "device": "cpu"}
    policy = {"net_arch": [p.hidden_width] * p.hidden_layers, "log_std_init": c.log_std_init}
    learner = CompiledPPO if c.learner == "compiled" else PPO
    return learner("MlpPolicy", Monitor(env), policy_kwargs=policy, **values)


def identify(run: Run, config: Config, region: Hypothesis | None) -> dict[str, Any]:
    """What tells a run from others, for run.json and checkpoints: ``run``, ``config`` and ``region``."""
    learned = region.digest() if isinstance(region, CompiledHypothesis) else type(region).__name__
    return {"run": asdict(run), "config": config.as_dict(), "region": learned}


def _refuse_another(folder: Path, identity: dict[str, Any]) -> None:
    """Raise `ResultError` if the folder holds a finished run of another identity."""
    path = folder / "run.json"
    if not path.exists():
        return
    held, own = files.read_json(path), json.loads(json.dumps(identity))
    others = [part for part in own if not isinstance(held, dict) or held.get(part) != own[part]]
    if others:
        raise files.ResultError(
            f"{folder} holds a finished training of another {' and '.join(others)}: "
            "give another folder, or delete this one"
        )


def _write_policy(path: Path, model: PPO) -> None:
    """Write the archive of a learner without times, so that the same run gives the same bytes."""
    archive = io.BytesIO()
    model.save(archive, exclude=OF_THE_SITTING)
    with files.beside(path) as temporary, ZipFile(archive) as parts, ZipFile(temporary, "w") as file:
        for name in parts.namelist():
            file.writestr(ZipInfo(name), parts.read(name))


def train(
    run: Run,
    config: Config,
    region: Hypothesis | None,
    folder: Path,
    checkpoint: Path | None = None,
    report: Report = print,
) -> dict[str, Any]:
    """Train one run and write its products (see the module) to ``folder``.

    A folder that holds the same run is written anew, as its code may have changed; another one is refused.

    Args:
        checkpoint: file to go on from if it exists and to write every ``checkpoint_updates`` updates; it is
            removed at the end. The result is the same as without an interruption.
        report: receives sparse progress lines when there is no terminal.

    Returns:
        What run.json holds.

    Raises:
        ParameterError: a parameter is not allowed, or the region predicts the origin as unsafe.
        ResultError: the folder cannot be written or holds another run, the checkpoint is truncated or of
            another run, or the policy has diverged.
    """
    torch.set_num_threads(1)
    folder, choices, n_steps = Path(folder), config.choices, config.paper.n_steps
    env = make_env(run, config, region)
    env.reset()  # refuses a region that predicts the origin as unsafe, before anything is written
    model, progress = make_learner(env, config, run.seed), Progress()
    identity = identify(run, config, region)
    _refuse_another(folder, identity)
    for place in (folder, folder if checkpoint is None else checkpoint.parent):
        files.require_writable(place)
    steps = -(-run.steps // n_steps) * n_steps
    if checkpoint is not None and os.path.lexists(checkpoint):
        progress = restore(checkpoint, model, identity, steps)
        report(f"going on from step {model.num_timesteps}")
    kept = None if checkpoint is None else (checkpoint, choices.checkpoint_updates, identity)
    alone = ThreeLinkCircleEnv(run.delta, config=config)
    stride = max(1, steps // choices.visited_states)
    recorder = Recorder(progress, steps, stride, kept, report, alone, choices.evaluation_steps)
    if model.num_timesteps < steps:
        model.learn(steps - model.num_timesteps, recorder, reset_num_timesteps=model.num_timesteps == 0)
    trials = pd.DataFrame(progress.trials, columns=list(TRIAL_COLUMNS))
    result = {
        **identity,
        "arithmetic": ARITHMETIC,
        "steps_done": model.num_timesteps,
        "counts": count(trials),
        "final_policy": {
            "own condition": evaluate(model, make_env(run, config, region)),
            "no supervisor": evaluate(model, alone),
        },
        "provenance": provenance(progress.seconds),
    }
    files.remove(folder / "run.json")  # no tables of one training beside the counts of another
    files.write_table(folder / "trials.csv", trials)
    window = min(n_steps, max(SHORTEST, steps // 100))  # an update; less in a short run
    files.write_table(folder / "curve.csv", learning_curve(trials, window, -(-steps // window)))
    evaluations = pd.DataFrame(progress.evaluations, columns=list(EVALUATION))
    files.write_table(folder / "evaluations.csv", evaluations)
    files.write_arrays(folder / "visited.npz", VISITED_FORMAT, x=np.array(progress.visited))
    _write_policy(folder / "policy.zip", model)
    TrainedPolicy.of(model, record_of(result)).save(folder / "policy.npz")
    files.write_json(folder / "run.json", result)
    if checkpoint is not None:
        files.remove(checkpoint)
    return result
