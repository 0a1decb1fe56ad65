"""The driver: what it refuses, what it sets up, its lock."""

import fcntl
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from workflow import driver as reproduce

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--alphas", "0", "2"], "--alphas = 2"),
        (["--alphas", "x"], "--alphas = x"),
        (["--alphas", "0.5", "0.50"], "different from each other"),
        (["--alphas", "none"], "at least one number"),
        (["--deltas", "-1"], "--deltas = -1.0"),
        (["--deltas", "nan"], "--deltas = nan"),
        (["--seeds", "0"], "--seeds = 0"),
        (["--steps", "0"], "--steps = 0"),
        (["--cores", "0"], "--cores = 0"),
        (["--limit", "0"], "--limit: invalid number of hours in (0, 8766] value: '0'"),
        (["--limit", "inf"], "--limit: invalid number of hours"),
        (["--set", "p_t=2"], "p_t = 2"),
        (["--set", "colour=red"], "no such parameter"),
        (["--name", "../x"], "--name = ../x"),
        (["--fast"], "unrecognized arguments: --fast"),
        (["--qui"], "unrecognized arguments: --qui"),
        (["--seeds", "two"], "invalid int value"),
    ],
)
def test_wrong_use_is_one_line_and_writes_nothing(arguments: list[str], message: str, tmp_path: Path) -> None:
    """On a copy without an environment, with the machine's own Python: nothing is installed first."""
    shutil.copytree(ROOT / "srlrepro", tmp_path / "srlrepro", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "reproduce.sh").write_bytes((ROOT / "reproduce.sh").read_bytes())
    before = sorted(tmp_path.rglob("*"))
    done = subprocess.run(["bash", "reproduce.sh", *arguments], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and message in done.stderr
    assert done.stderr.count("\n") == 1 and done.stdout == ""
    assert sorted(tmp_path.rglob("*")) == before


def test_a_second_driver_leaves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reproduce, "ROOT", tmp_path)
    with reproduce.only_one():
        with pytest.raises(SystemExit, match="another"), reproduce.only_one():
            pass
        with (tmp_path / "results" / ".lock").open() as file, pytest.raises(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with reproduce.only_one():
        pass


@pytest.mark.parametrize(
    ("arguments", "further"),
    [
        ([], []),
        (["site"], []),
        (["--slurm", "--quick"], ["requirements-slurm.txt"]),
        (["test", "-x"], ["requirements-test.txt"]),
    ],
)
def test_each_way_of_use_sets_up_what_it_needs(
    arguments: list[str], further: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[list[str]] = []
    started: list[list[str]] = []
    monkeypatch.setattr(reproduce, "VENV", tmp_path)
    monkeypatch.setattr(reproduce, "set_up", asked.append)
    monkeypatch.setattr(reproduce.os, "execv", lambda _, command: started.append(command) or sys.exit(0))
    with pytest.raises(SystemExit):
        reproduce.main(arguments)
    assert asked == [["requirements.txt", *further]] and started[0][3:] == arguments
