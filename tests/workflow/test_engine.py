"""Snakemake under the driver: options, progress, planned jobs. The workflow itself is what `--quick` runs."""

import io
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from plans import planned

import workflow
from srlrepro.storage.files import ResultError, write_json
from workflow import engine
from workflow.__main__ import main
from workflow.command_line import CORES, make_parser

ROOT = Path(__file__).parents[2]


def test_no_progress_is_told_where_nothing_was_done() -> None:
    assert not engine.follow(io.StringIO("Nothing to be done\n"), io.StringIO())


def test_progress_names_jobs_time_and_failures(capsys: pytest.CaptureFixture[str]) -> None:
    lines = io.StringIO(
        "noise\n1 of 2 steps (50%) done\nError in rule training_run:\n2 of 2 steps (100%) done\n"
    )
    log = io.StringIO()
    assert engine.follow(lines, log)
    out = capsys.readouterr().out
    assert "2 of 2 jobs" in out and "Error in rule training_run" in out and log.getvalue() == lines.getvalue()


def test_jobs_run_here_or_on_slurm() -> None:
    assert engine.engine(False, 3) == ["--cores", "3"]
    assert engine.engine(False, None) == ["--cores", str(CORES)]
    assert engine.engine(True, None) == ["--profile", str(engine.PROFILE)]
    assert engine.engine(True, 7)[2:] == ["--jobs", "7"]
    assert (engine.PROFILE / "config.yaml").exists()


@pytest.mark.slow
def test_the_workflow_plans_one_job_per_notebook_and_run(tmp_path: Path) -> None:
    """36 runs and their measures; data, region and three notebooks for each dataset; nine others; the
    policies; the target.

    There are 3 datasets for each of 3 α; a notebook shows those of all α.
    """
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
    assert (
        counts["training_run"] == counts["run_measures"] == "36" and counts["data"] == counts["region"] == "9"
    )
    assert counts["total"] == "112"
    assert not (ROOT / "results" / "nowhere").exists()


STUDIES = [("multiverse", 95), ("calibrated", 10), ("crossed", 4), ("caution", 30), ("shift", 25)]


@pytest.mark.slow
@pytest.mark.parametrize(("study", "universes"), STUDIES)
def test_a_study_is_one_job_per_universe(study: str, universes: int, tmp_path: Path) -> None:
    path = tmp_path / "workflow.json"
    path.write_text(json.dumps(planned(f"--{study}") | {"name": "nowhere"}))
    command = ["snakemake", study, "--dry-run", "--nolock", "--cores", "2", "--configfile", str(path)]
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    counts = dict(line.split() for line in done.stdout.splitlines() if len(line.split()) == 2)
    assert done.returncode == 0, done.stderr
    others = 1 if study == "multiverse" else 2  # their tables are gathered first
    assert int(counts["total"]) == universes + others and int(counts["universe"]) == universes


def test_documents_that_cannot_be_rendered_fail_the_run_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(name: str) -> None:
        raise ResultError(f"missing result {name}")

    assert engine.tell("quick") == 0 and capsys.readouterr().out == ""
    monkeypatch.setattr("replication.documents.refresh", missing)
    assert engine.tell("full") == 1
    assert capsys.readouterr().err.endswith("missing result full\n")


def test_the_time_of_results_is_that_of_all_sittings(tmp_path: Path) -> None:
    file = tmp_path / "run_time.json"
    for minutes, total, sittings in ((2.0, 2.0, 1), (0.5, 2.5, 2)):
        timing = engine.add_time(file, minutes, cores=2)
        assert timing == json.loads(file.read_text())
        assert (timing["minutes"], timing["sittings"], timing["cores"]) == (total, sittings, 2)


def test_what_trainings_took_is_summed_over_the_seeds_asked_for(tmp_path: Path) -> None:
    for seed, seconds in enumerate((1800, 3600, 7200)):
        (tmp_path / f"run_{seed}").mkdir()
        result = {"run": {"seed": seed}, "provenance": {"seconds": seconds, "peak_memory_mb": 500 + seed}}
        (tmp_path / f"run_{seed}" / "run.json").write_text(json.dumps(result))
    assert engine.spent(tmp_path, [0, 1]) == {"trainings": 2, "core_hours": 1.5, "peak_memory_mb": 501}
    assert engine.spent(tmp_path)["trainings"] == 3
    assert engine.spent(tmp_path / "nowhere", [0])["trainings"] == 0


def test_a_time_is_kept_by_the_explicit_command_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for module in (engine, workflow):
        monkeypatch.setattr(module, "ROOT", tmp_path)
    options = make_parser().parse_args(["--cores", "1"])
    engine.note_time({"name": "few", "cells": "few", "steps": 5, "study": "", "seeds": [0]}, options, 2.5)
    assert [path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*")] == [
        "results/few/run_time.json"
    ]
    assert main(["record", "few"]) == 0 and "docs/records/few.json" in capsys.readouterr().out
    kept = json.loads((tmp_path / "docs" / "records" / "few.json").read_text())
    assert kept["minutes"] == 2.5 and kept["trainings"] == 0 and len(kept["date"]) == len("2026-01-31")
    with pytest.raises(SystemExit) as end:
        main(["record", "many"])
    said = capsys.readouterr().err
    assert end.value.code == 2 and "NAME = many: must be results here that were timed (few)" in said


def shell_commands(path: Path, *arguments: str) -> str:
    """What Snakemake says that it would run for a command line of the driver."""
    write_json(path, planned(*arguments))
    command = [
        "snakemake",
        "all",
        "--dry-run",
        "--printshellcmds",
        "--nolock",
        "--cores",
        "2",
        "--configfile",
    ]
    done = subprocess.run(
        [sys.executable, "-m", *command, str(path)], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return done.stdout


def test_what_a_set_of_more_seeds_shares_is_made_by_the_same_command(tmp_path: Path) -> None:
    """So that what is there is not made again: Snakemake makes anew what another command would make."""
    few, more = (
        {line.split(" execute ")[1].split()[1]: line for line in printed.splitlines() if " execute " in line}
        for printed in (
            shell_commands(tmp_path / "workflow.json", "--steps", "64", "--seeds", seeds) for seeds in "34"
        )
    )
    shared = few.keys() & more.keys()
    assert {name: few[name] for name in shared} == {name: more[name] for name in shared}
    trained = {name for name in more if "05_training_run" in name}
    assert len(trained) == 48 and len(trained & shared) == 36 < len(shared)


def test_what_draws_shared_figures_records_the_shared_command(tmp_path: Path) -> None:
    printed = shell_commands(tmp_path / "workflow.json", "--seeds", "4", "--steps", "64")
    said = re.findall(r"SRLREPRO_COMMAND='([^']*)' \S+ -m workflow execute notebooks/(\w+)", printed)
    by = {notebook: command for command, notebook in said}
    assert by["01_pendulum"] == by["11_behaviour"] == "./reproduce.sh --steps 64"
    assert by["06_learning_performance"] == by["08_claims"] == "./reproduce.sh --seeds 4 --steps 64"
