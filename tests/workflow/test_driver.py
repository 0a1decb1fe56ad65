"""The driver: what it refuses, what it sets up, its lock."""

import fcntl
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from srlrepro import pins
from srlrepro.storage.files import ResultError, read_json, write_json
from workflow import driver

ROOT = Path(__file__).parents[2]


OF_FORM = [
    (["--fast"], "unrecognized arguments: --fast"),
    (["--qui"], "unrecognized arguments: --qui"),
    (["--seeds", "two"], "invalid int value"),
    (["--limit", "long"], "invalid float value"),
    (["--quick", "--multiverse", "--caution"], "not allowed with argument"),
]


@pytest.mark.parametrize(("arguments", "message"), OF_FORM)
def test_a_command_line_of_the_wrong_form_is_one_line_before_anything_is_installed(
    arguments: list[str], message: str, tmp_path: Path
) -> None:
    """On a copy without an environment, with the machine's own Python."""
    shutil.copytree(ROOT / "workflow", tmp_path / "workflow", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "srlrepro").mkdir()
    for name in ("reproduce.sh", "srlrepro/__init__.py", "srlrepro/pins.py"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    before = sorted(tmp_path.rglob("*"))
    done = subprocess.run(["bash", "reproduce.sh", *arguments], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and message in done.stderr
    assert done.stderr.count("\n") == 1 and done.stdout == ""
    assert sorted(tmp_path.rglob("*")) == before


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
        (["--limit", "0"], "--limit = 0.0: must be a number of hours in (0, 8766]"),
        (["--limit", "inf"], "--limit = inf"),
        (["--set", "p_t=2"], "p_t = 2"),
        (["--set", "colour=red"], "no such parameter"),
        (["--name", "../x"], "--name = ../x"),
        (["--only", "fig9"], "--only = fig9"),
        (["--name", "full", "--steps", "5"], "--name = full"),
    ],
)
def test_a_wrong_value_is_one_line_and_writes_nothing(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "VENV", Path(sys.prefix))
    monkeypatch.setattr(driver, "only_one", None)  # from here on something would be written
    with pytest.raises(SystemExit) as stop:
        driver.main(arguments)
    said = capsys.readouterr()
    assert stop.value.code == 2 and message in said.err
    assert said.err.count("\n") == 1 and said.out == ""


def test_a_second_driver_leaves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driver, "ROOT", tmp_path)
    with driver.only_one():
        with pytest.raises(SystemExit, match="another"), driver.only_one():
            pass
        with (tmp_path / "results" / ".lock").open() as file, pytest.raises(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with driver.only_one():
        pass


@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_a_forged_lock_is_refused(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lock, target = tmp_path / "results" / ".lock", tmp_path / "target"
    lock.parent.mkdir()
    target.write_text("kept")
    {"link": lambda: lock.symlink_to(target), "pipe": lambda: os.mkfifo(lock), "folder": lock.mkdir}[kind]()
    monkeypatch.setattr(driver, "ROOT", tmp_path)
    with pytest.raises(ResultError, match=r"cannot write .*\.lock: it is"), driver.only_one():
        pass
    assert target.read_text() == "kept"


@pytest.mark.parametrize(
    ("arguments", "further"),
    [
        ([], []),
        (["site"], ["requirements-site.txt"]),
        (["--slurm", "--quick"], ["requirements-slurm.txt"]),
        (["test", "-x"], ["requirements-test.txt"]),
    ],
)
def test_each_way_of_use_sets_up_what_it_needs(
    arguments: list[str], further: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[list[str]] = []
    started: list[list[str]] = []
    monkeypatch.setattr(driver, "VENV", tmp_path)
    monkeypatch.setattr(driver, "set_up", asked.append)
    monkeypatch.setattr(driver.os, "execv", lambda _, command: started.append(command) or sys.exit(0))
    with pytest.raises(SystemExit):
        driver.main(arguments)
    assert asked == [["requirements.txt", *further]] and started[0][3:] == arguments


def test_the_kernel_of_the_environment_has_the_pins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driver, "VENV", tmp_path)
    driver.pin_kernels()  # where there is none, none is made
    assert list(tmp_path.iterdir()) == []
    file = tmp_path / "share" / "jupyter" / "kernels" / "python3" / "kernel.json"
    write_json(file, {"argv": ["python"], "env": {"OMP_NUM_THREADS": "7"}})
    driver.pin_kernels()
    assert read_json(file) == {"argv": ["python"], "env": pins.pins()}
    before = file.stat().st_mtime_ns
    driver.pin_kernels()
    assert file.stat().st_mtime_ns == before


def test_jobs_have_the_pins_and_nothing_of_the_users_matplotlib(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MATPLOTLIBRC", "/somewhere")
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    found = driver.environment()
    assert "MATPLOTLIBRC" not in found and pins.pins().items() <= found.items()


def test_the_driver_says_what_it_replaces_in_one_line() -> None:
    """It is stopped at its lock here."""
    code = "import pathlib, sys, workflow.driver as d\nd.VENV = pathlib.Path(sys.prefix)\n"
    code += "d.pin_kernels = lambda: None\nd.only_one = lambda: sys.exit(0)\nd.main(['--dry-run'])"
    variables = os.environ | {"OPENBLAS_CORETYPE": "Zen"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=variables, cwd=ROOT, capture_output=True, text=True
    )
    line = "reproduce.sh: takes its own pins instead of OPENBLAS_CORETYPE=Zen\n"
    assert (done.returncode, done.stderr) == (0, line if pins.is_covered() else "")
