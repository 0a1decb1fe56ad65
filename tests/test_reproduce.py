"""The driver: its command line, plan, lock and progress. The workflow itself is what `--quick` runs."""

import fcntl
import io
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from srlrepro import reproduce
from srlrepro.config import Choices, ParameterError
from srlrepro.files import ResultError
from srlrepro.plan import CORES, STUDIES, make_parser, plan

ROOT = Path(__file__).parent.parent


def planned(*arguments: str) -> dict[str, object]:
    return plan(make_parser().parse_args(list(arguments)))


def test_the_default_is_the_papers_grid() -> None:
    grid = planned()
    assert grid["alphas"] == ["0", "0.5", "1", "none"] and grid["deltas"] == [1.1, 1.5, 4.0]
    assert grid["seeds"] == [0, 1, 2] and grid["steps"] == Choices.total_steps
    assert grid["name"] == "full" and grid["note"] == ""


def test_quick_differs_in_the_steps_alone_and_says_so() -> None:
    full, quick = planned(), planned("--quick")
    assert {key for key in full if full[key] != quick[key]} == {"name", "cells", "steps", "note"}
    assert quick["name"] == "quick" and str(Choices.quick_steps) in str(quick["note"])


def test_a_varied_grid_never_replaces_the_papers() -> None:
    assert planned("--deltas", "2")["name"] == planned("--deltas", "2")["cells"] == "custom"
    assert planned("--quick", "--set", "k=500", "--name", "k500")["name"] == "k500"
    with pytest.raises(ParameterError, match="another name"):
        planned("--seeds", "10", "--name", "full")


def test_the_verdicts_larger_set_is_the_papers_grid() -> None:
    assert planned("--seeds", "10", "--name", "seeds_10")["cells"] == "full"
    for other in (["--alphas", "0"], ["--steps", "4096"], ["--seeds", "5"], ["--quick", "--seeds", "10"]):
        with pytest.raises(ParameterError, match="another name"):
            planned(*other, "--name", "seeds_10")


def test_documents_that_cannot_be_rendered_fail_the_run_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(name: str) -> None:
        raise ResultError(f"missing result {name}")

    assert reproduce.tell("quick") == 0 and capsys.readouterr().out == ""
    monkeypatch.setattr("srlrepro.report.refresh", missing)
    assert reproduce.tell("full") == 1
    assert capsys.readouterr().err.endswith("missing result full\n")


def test_grids_with_other_seeds_alone_share_their_runs() -> None:
    more = planned("--seeds", "10")
    assert (more["name"], more["cells"]) == ("seeds_10", "full")
    assert planned("--quick", "--seeds", "2")["cells"] == "quick"
    for other in (["--steps", "4096"], ["--set", "k=500"], ["--alphas", "0"]):
        assert planned("--seeds", "10", *other)["cells"] == "custom"


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


def test_no_progress_is_told_where_nothing_was_done() -> None:
    assert not reproduce.follow(io.StringIO("Nothing to be done\n"), io.StringIO())


def test_progress_names_jobs_time_and_failures(capsys: pytest.CaptureFixture[str]) -> None:
    lines = io.StringIO(
        "noise\n1 of 2 steps (50%) done\nError in rule training_run:\n2 of 2 steps (100%) done\n"
    )
    log = io.StringIO()
    assert reproduce.follow(lines, log)
    out = capsys.readouterr().out
    assert "2 of 2 jobs" in out and "Error in rule training_run" in out and log.getvalue() == lines.getvalue()


def test_jobs_run_here_or_on_slurm() -> None:
    assert reproduce.engine(False, 3) == ["--cores", "3"]
    assert reproduce.engine(False, None) == ["--cores", str(CORES)]
    assert reproduce.engine(True, None) == ["--profile", str(reproduce.PROFILE)]
    assert reproduce.engine(True, 7)[2:] == ["--jobs", "7"]
    assert (reproduce.PROFILE / "config.yaml").exists()
    assert planned("--slurm") == planned()  # where it runs is no part of what is run


@pytest.mark.slow
def test_the_workflow_plans_one_job_per_notebook_and_run(tmp_path: Path) -> None:
    """36 runs, three notebooks for each of 3 datasets, nine others, and the target."""
    path = tmp_path / "workflow.json"
    path.write_text(json.dumps(planned("--name", "nowhere", "--seeds", "3", "--steps", "64")))
    command = [
        sys.executable,
        "-m",
        "snakemake",
        "--dry-run",
        "--nolock",
        "--cores",
        "2",
        "--configfile",
        str(path),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    counts = dict(line.split() for line in done.stdout.splitlines() if len(line.split()) == 2)
    assert done.returncode == 0, done.stderr
    assert counts["training_run"] == "36" and counts["total"] == "55"
    assert not (ROOT / "results" / "nowhere").exists()


def test_a_study_has_its_own_grid_and_name() -> None:
    study = planned("--multiverse")
    assert (study["name"], study["study"], study["deltas"]) == ("multiverse", "multiverse", [1.1, 4.0])
    assert study["steps"] == STUDIES["multiverse"].steps and "reduced" in str(study["note"])
    quick = planned("--hypotheses", "--quick")
    assert (quick["name"], quick["few"], quick["steps"]) == ("hypotheses_quick", True, Choices.quick_steps)
    assert planned("--multiverse", "--steps", "64")["name"] == "custom"
    assert planned()["study"] == "" and planned("--quick")["few"] is False


@pytest.mark.parametrize(
    "arguments",
    [["--multiverse", "--seeds", "5"], ["--hypotheses", "--set", "k=500"], ["--name", "multiverse"]],
)
def test_a_study_is_not_mixed_with_other_results(arguments: list[str]) -> None:
    with pytest.raises(ParameterError, match=r"must be|without one"):
        planned(*arguments, "--alphas", "0", "1")


@pytest.mark.slow
@pytest.mark.parametrize(("study", "jobs"), [("multiverse", 96), ("hypotheses", 9)])
def test_a_study_is_one_job_per_universe(study: str, jobs: int, tmp_path: Path) -> None:
    path = tmp_path / "workflow.json"
    path.write_text(json.dumps(planned(f"--{study}") | {"name": "nowhere"}))
    command = ["snakemake", study, "--dry-run", "--nolock", "--cores", "2", "--configfile", str(path)]
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    counts = dict(line.split() for line in done.stdout.splitlines() if len(line.split()) == 2)
    assert done.returncode == 0, done.stderr
    assert int(counts["total"]) == jobs and int(counts["universe"]) == jobs - 1
