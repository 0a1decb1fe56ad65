"""Checkpoints: a training that was interrupted or killed gives the same numbers; others are refused."""

import random
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from runs import CASES, CONDITIONS, UPDATE, UPDATES, Case, interrupt, products
from stable_baselines3 import PPO

from srlrepro.learner import recording
from srlrepro.learner.checkpoint import FORMAT, TRIAL, restore, save
from srlrepro.learner.recording import TRIAL_COLUMNS
from srlrepro.learner.training import OF_THE_SITTING, identify, make_env, make_learner
from srlrepro.storage.files import ResultError, read_arrays, write_arrays

FREE = CASES[0]


@CONDITIONS
@pytest.mark.parametrize("which", [0, -1], ids=["early", "late"])
def test_interrupted_and_resumed_gives_the_same_numbers(
    case: Case, which: int, whole: dict[str, Path], tmp_path: Path
) -> None:
    ends = set(pd.read_csv(whole[case.name] / "trials.csv")["step"])
    updates = [n for n in range(1, UPDATES) if n * UPDATE not in ends][which]
    file = interrupt(case, tmp_path, updates * UPDATE + 10)
    assert len(read_arrays(file, FORMAT, ("rewards",))["rewards"]) > 0  # in the middle of a trial
    np.random.random()  # noqa: NPY002  (whatever happens to the global generators in between)
    torch.rand(1)
    lines: list[str] = []
    case.train(tmp_path, file, report=lines.append)
    assert lines[0] == f"going on from step {updates * UPDATE}"
    assert products(tmp_path) == products(whole[case.name])
    policies = [(folder / "policy.zip").read_bytes() for folder in (tmp_path, whole[case.name])]
    assert policies[0] == policies[1]
    assert not file.exists()


def test_interrupted_twice_gives_the_same_numbers(whole: dict[str, Path], tmp_path: Path) -> None:
    interrupt(FREE, tmp_path, UPDATE + 1)
    file = interrupt(FREE, tmp_path, 2 * UPDATE + 1)
    FREE.train(tmp_path, file)
    assert products(tmp_path) == products(whole[FREE.name])


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from runs import CASES
from srlrepro.learner.recording import Recorder
look, taken = Recorder._on_steps, [0]
def deadly(recorder, steps, trials):
    taken[0] += len(steps.rewards)
    if taken[0] >= {at}:
        os.kill(os.getpid(), signal.SIGKILL)
    return look(recorder, steps, trials)
Recorder._on_steps = deadly
CASES[0].train(Path({folder!r}), Path({folder!r}) / "checkpoint.zip")
"""


@pytest.mark.slow
def test_killed_and_resumed_gives_the_same_numbers(whole: dict[str, Path], tmp_path: Path) -> None:
    tests = Path(__file__).parents[1]
    program = KILLED.format(tests=str(tests), folder=str(tmp_path), at=int(3.4 * UPDATE))
    command = [sys.executable, "-c", program]
    child = subprocess.run(command, cwd=tests.parent, check=False, capture_output=True)
    assert child.returncode == -signal.SIGKILL, child.stderr.decode()
    assert list(tmp_path.iterdir()) == [tmp_path / "checkpoint.zip"]
    FREE.train(tmp_path, tmp_path / "checkpoint.zip")
    assert products(tmp_path) == products(whole[FREE.name])


def test_a_checkpoint_has_all_columns_of_a_trial() -> None:
    assert tuple(TRIAL) == TRIAL_COLUMNS


def test_a_checkpoint_of_another_run_is_refused(tmp_path: Path) -> None:
    file = interrupt(FREE, tmp_path, UPDATE + 10)
    other = replace(FREE, run=replace(FREE.run, seed=FREE.run.seed + 1))
    for case in (other, replace(FREE, config=FREE.config.with_values(learning_rate=2e-4))):
        with pytest.raises(ResultError, match=r"checkpoint\.zip is a checkpoint of another run"):
            case.train(tmp_path, file)
    assert file.exists()


@pytest.mark.parametrize("share", [0.0, 0.2, 0.6, 0.99])
def test_a_truncated_checkpoint_is_refused(share: float, tmp_path: Path) -> None:
    file = interrupt(FREE, tmp_path, UPDATE + 10)
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ResultError, match=rf"checkpoint\.zip is truncated or not a {FORMAT} file"):
        FREE.train(tmp_path, file)


def test_a_foreign_checkpoint_is_refused(tmp_path: Path, whole: dict[str, Path]) -> None:
    for name in ("policy.npz", "policy.zip", "visited.npz", "trials.csv"):
        with pytest.raises(ResultError, match=f"not a {FORMAT} file: delete it"):
            FREE.train(tmp_path, whole[FREE.name] / name)


@pytest.mark.parametrize(
    ("entry", "value", "fits"),
    [(2, 624, True), (2, 625, False), (2, -1, False), (3, 2, False), (3, -1, False), (0, UPDATE + 1, False)],
)
def test_counts_that_no_generator_has_are_refused(entry: int, value: int, fits: bool, tmp_path: Path) -> None:
    """counts: steps, period, the place in numpy's 624 numbers, and whether it keeps a normal one."""
    file = interrupt(FREE, tmp_path, UPDATE + 10)
    with np.load(file) as archive:
        stored = {key: part.copy() for key, part in archive.items() if key != "format"}
    stored["counts"][entry] = value
    write_arrays(file, FORMAT, **stored)
    fresh = make_learner(make_env(FREE.run, FREE.config, FREE.region), FREE.config, FREE.run.seed)
    identity = identify(FREE.run, FREE.config, FREE.region)
    if fits:
        restore(file, fresh, identity, FREE.run.steps)
    else:
        with pytest.raises(ResultError, match=r"checkpoint\.zip "):
            restore(file, fresh, identity, FREE.run.steps)


@pytest.mark.parametrize("name", TRIAL)
def test_a_column_that_is_shorter_than_the_others_is_refused(name: str, tmp_path: Path) -> None:
    file = interrupt(FREE, tmp_path, 2 * UPDATE + 10)
    with np.load(file) as archive:
        stored = {key: part for key, part in archive.items() if key != "format"}
    column = stored[f"trial.{name}"]
    assert len(column) > 0
    write_arrays(file, FORMAT, **stored | {f"trial.{name}": column[:-1]})
    with pytest.raises(ResultError, match=r"checkpoint\.zip "):
        FREE.train(tmp_path, file)


def parts_of(model: PPO) -> dict[str, Any]:
    """Whatever a learner, its environment and the generators hold, but for what only the log reads."""
    logged = {*OF_THE_SITTING, "_total_timesteps", "_current_progress_remaining", "_logger", "_views"}
    found = {
        k: v for k, v in vars(model).items() if k not in logged and isinstance(v, (int, float, np.ndarray))
    }
    (env,) = model.get_env().envs  # type: ignore[union-attr]
    found |= {"state": env.unwrapped.state, "period": env.unwrapped.period, "rewards": env.rewards}
    found |= {f"weight {k}": v.numpy() for k, v in model.policy.state_dict().items()}
    states = model.policy.optimizer.state_dict()["state"]
    found |= {f"{k} {name}": v.numpy() for k, kept in states.items() for name, v in kept.items()}
    _, keys, *places = np.random.get_state()  # noqa: NPY002
    found |= {"numpy": [keys.tolist(), *places], "torch": torch.get_rng_state().tolist()}
    found["python"] = random.getstate()
    found["space"] = model.action_space.np_random.bit_generator.state
    found["environment"] = env.unwrapped.np_random.bit_generator.state
    return {
        name: repr(np.asarray(v).tolist() if isinstance(v, np.ndarray) else v) for name, v in found.items()
    }


@CONDITIONS
def test_a_restored_learner_holds_all_that_the_stored_one_held(case: Case, tmp_path: Path) -> None:
    """Also what a checkpoint leaves out, since nothing has drawn from it."""
    held: list[dict[str, Any]] = []

    def keep(path: Path, model: PPO, *values: Any) -> None:
        save(path, model, *values)
        held.append(parts_of(model))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording, "save", keep)
        file = interrupt(case, tmp_path, 3 * UPDATE + 10)
    fresh = make_learner(make_env(case.run, case.config, case.region), case.config, case.run.seed)
    restore(file, fresh, identify(case.run, case.config, case.region), case.run.steps)
    assert parts_of(fresh) == held[-1]
