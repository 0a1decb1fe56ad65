"""Checkpoints: a training that was interrupted or killed gives the same numbers; others are refused."""

import json
import signal
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from runs import CONDITIONS, CONFIG, FREE, UPDATE, UPDATES, products, quiet

from srlrepro.env import ThreeLinkCircleEnv
from srlrepro.files import ResultError
from srlrepro.supervisor import Hypothesis
from srlrepro.training import Run, train


def interrupt(run: Run, region: Hypothesis | None, folder: Path, steps: int) -> Path:
    """Train for a number of steps, with a checkpoint after every update; returns the last checkpoint."""
    file, taken, step = folder / "checkpoint.zip", [0], ThreeLinkCircleEnv.step

    def stopping_step(*arguments: Any) -> Any:
        taken[0] += 1
        if taken[0] > steps:
            raise KeyboardInterrupt
        return step(*arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ThreeLinkCircleEnv, "step", stopping_step)
        with pytest.raises(KeyboardInterrupt):
            train(run, CONFIG, region, folder, file, quiet)
    return file


@CONDITIONS
@pytest.mark.parametrize("which", [0, -1], ids=["early", "late"])
def test_interrupted_and_resumed_gives_the_same_numbers(
    run: Run, region: Hypothesis | None, which: int, whole: dict[Run, Path], tmp_path: Path
) -> None:
    ends = set(pd.read_csv(whole[run] / "trials.csv")["step"])
    updates = [n for n in range(1, UPDATES) if n * UPDATE not in ends][which]
    file = interrupt(run, region, tmp_path, updates * UPDATE + 10)
    with zipfile.ZipFile(file) as stored:
        assert json.loads(stored.read("rest.json"))["period"] > 0  # in the middle of a trial
    np.random.random()  # noqa: NPY002  (whatever happens to the global generators in between)
    torch.rand(1)
    lines: list[str] = []
    train(run, CONFIG, region, tmp_path, file, lines.append)
    assert lines[0] == f"going on from step {updates * UPDATE}"
    assert products(tmp_path) == products(whole[run])
    assert not file.exists()


def test_interrupted_twice_gives_the_same_numbers(whole: dict[Run, Path], tmp_path: Path) -> None:
    interrupt(FREE, None, tmp_path, UPDATE + 1)
    file = interrupt(FREE, None, tmp_path, 2 * UPDATE + 1)
    train(FREE, CONFIG, None, tmp_path, file, quiet)
    assert products(tmp_path) == products(whole[FREE])


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from runs import CONFIG, FREE, quiet
from srlrepro.env import ThreeLinkCircleEnv
from srlrepro.training import train
step, steps = ThreeLinkCircleEnv.step, []
def deadly(*arguments):
    steps.append(0)
    if len(steps) == {at}:
        os.kill(os.getpid(), signal.SIGKILL)
    return step(*arguments)
ThreeLinkCircleEnv.step = deadly
train(FREE, CONFIG, None, Path({folder!r}), Path({folder!r}) / "checkpoint.zip", quiet)
"""


@pytest.mark.slow
def test_killed_and_resumed_gives_the_same_numbers(whole: dict[Run, Path], tmp_path: Path) -> None:
    tests = Path(__file__).parent
    program = KILLED.format(tests=str(tests), folder=str(tmp_path), at=int(3.4 * UPDATE))
    command = [sys.executable, "-c", program]
    child = subprocess.run(command, cwd=tests.parent, check=False, capture_output=True)
    assert child.returncode == -signal.SIGKILL, child.stderr.decode()
    assert list(tmp_path.iterdir()) == [tmp_path / "checkpoint.zip"]
    train(FREE, CONFIG, None, tmp_path, tmp_path / "checkpoint.zip", quiet)
    assert products(tmp_path) == products(whole[FREE])


def test_a_checkpoint_of_another_run_is_refused(tmp_path: Path) -> None:
    file = interrupt(FREE, None, tmp_path, UPDATE + 10)
    other = Run(None, FREE.delta, FREE.seed + 1, FREE.steps)
    for run, config in ((other, CONFIG), (FREE, CONFIG.with_values(learning_rate=2e-4))):
        with pytest.raises(ResultError, match=r"checkpoint\.zip is a checkpoint of another run"):
            train(run, config, None, tmp_path, file, quiet)
    assert file.exists()


@pytest.mark.parametrize("share", [0.0, 0.2, 0.6, 0.99])
def test_a_truncated_checkpoint_is_refused(share: float, tmp_path: Path) -> None:
    file = interrupt(FREE, None, tmp_path, UPDATE + 10)
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ResultError, match=r"checkpoint\.zip is truncated or not a checkpoint"):
        train(FREE, CONFIG, None, tmp_path, file, quiet)


def test_a_foreign_checkpoint_is_refused(tmp_path: Path, whole: dict[Run, Path]) -> None:
    for name in ("policy.zip", "visited.npz", "trials.csv"):
        with pytest.raises(ResultError, match="not a checkpoint"):
            train(FREE, CONFIG, None, tmp_path, whole[FREE] / name, quiet)
