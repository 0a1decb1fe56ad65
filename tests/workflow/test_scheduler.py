"""Snakemake's scheduler without its timers."""

import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
from snakemake.scheduling.job_scheduler import JobScheduler  # type: ignore[import-untyped]

from workflow import ROOT
from workflow.scheduler import look_at_ends_alone

TIMERS = "_schedule_reevalutation"
CHAIN = """
rule all:
    input: expand("{n}.second", n=range(6))

rule first:
    output: "{n}.first"
    shell: "touch {output}"

rule second:
    input: "{n}.first"
    output: "{n}.second"
    shell: "cp {input} {output}"
"""


def test_no_timer_is_started_where_snakemake_starts_one(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[threading.Timer] = []
    monkeypatch.setattr(threading.Timer, "start", lambda timer: started.append(timer))
    monkeypatch.setattr(JobScheduler, TIMERS, getattr(JobScheduler, TIMERS))  # is given back at the end
    scheduler = SimpleNamespace(_open_jobs=threading.Semaphore())
    JobScheduler._schedule_reevalutation(scheduler, 1)
    assert len(started) == 1
    look_at_ends_alone()
    JobScheduler._schedule_reevalutation(scheduler, 1)
    assert len(started) == 1


def test_another_snakemake_is_not_taken_for_this_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(JobScheduler, TIMERS)
    with pytest.raises(RuntimeError, match="no timers any more"):
        look_at_ends_alone()


def test_every_job_is_found_at_the_end_of_another(tmp_path: Path) -> None:
    """More jobs than cores, some of which wait for others."""
    (tmp_path / "Snakefile").write_text(CHAIN)
    command = [sys.executable, "-m", "workflow.scheduler", "--cores", "2", "--directory", str(tmp_path)]
    command += ["--snakefile", str(tmp_path / "Snakefile"), "--scheduler", "greedy", "--quiet"]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert ended.returncode == 0, ended.stderr
    assert len(list(tmp_path.glob("*.second"))) == 6
