"""Checkpoints: a training that was interrupted or killed gives the same numbers; others are refused."""

import json
import signal
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from runs import CASES, CONDITIONS, UPDATE, UPDATES, Case, products

from srlrepro.learner.recording import Recorder
from srlrepro.storage.files import ResultError

FREE = CASES[0]


def interrupt(case: Case, folder: Path, steps: int) -> Path:
    """Train for a number of steps, with a checkpoint after every update; returns the last checkpoint."""
    file, taken, look = folder / "checkpoint.zip", [0], Recorder._on_step

    def stopping_look(recorder: Recorder) -> bool:
        taken[0] += 1
        if taken[0] > steps:
            raise KeyboardInterrupt
        return look(recorder)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Recorder, "_on_step", stopping_look)
        with pytest.raises(KeyboardInterrupt):
            case.train(folder, file)
    return file


@CONDITIONS
@pytest.mark.parametrize("which", [0, -1], ids=["early", "late"])
def test_interrupted_and_resumed_gives_the_same_numbers(
    case: Case, which: int, whole: dict[str, Path], tmp_path: Path
) -> None:
    ends = set(pd.read_csv(whole[case.name] / "trials.csv")["step"])
    updates = [n for n in range(1, UPDATES) if n * UPDATE not in ends][which]
    file = interrupt(case, tmp_path, updates * UPDATE + 10)
    with zipfile.ZipFile(file) as stored:
        assert json.loads(stored.read("rest.json"))["period"] > 0  # in the middle of a trial
    np.random.random()  # noqa: NPY002  (whatever happens to the global generators in between)
    torch.rand(1)
    lines: list[str] = []
    case.train(tmp_path, file, report=lines.append)
    assert lines[0] == f"going on from step {updates * UPDATE}"
    assert products(tmp_path) == products(whole[case.name])
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
look, steps = Recorder._on_step, []
def deadly(recorder):
    steps.append(0)
    if len(steps) == {at}:
        os.kill(os.getpid(), signal.SIGKILL)
    return look(recorder)
Recorder._on_step = deadly
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
    with pytest.raises(ResultError, match=r"checkpoint\.zip is truncated or not a checkpoint"):
        FREE.train(tmp_path, file)


def test_a_foreign_checkpoint_is_refused(tmp_path: Path, whole: dict[str, Path]) -> None:
    for name in ("policy.npz", "policy.zip", "visited.npz", "trials.csv"):
        with pytest.raises(ResultError, match="not a checkpoint"):
            FREE.train(tmp_path, whole[FREE.name] / name)
