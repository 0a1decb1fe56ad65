"""A grid of six jobs in a checkout of its own, the processes that work on it, and what they have made."""

import base64
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import psutil
from checkouts import start

FEW = """

rule all:
    input:
        f"{EXECUTED}/06_learning_performance.ipynb",
        f"{EXECUTED}/07_activations_and_failures.ipynb",
"""
GRID = ["--alphas", "0", "none", "--deltas", "1.1", "--seeds", "1", "--steps", "20480"]
SMALL = ["k=150", "random_rollouts=500", "n_steps=256", "n_minibatches=16", "checkpoint_updates=10"]
OPTIONS = [*GRID, "--set", *SMALL]
LIMIT = 900.0  # s for a grid, on a machine that does other things as well
ENDING = 10.0  # s in which all has to end


def shorten(checkout: Path) -> None:
    """Let the target be two notebooks that read all runs, in place of every figure."""
    snakefile = checkout / "workflow" / "Snakefile"
    snakefile.write_text(snakefile.read_text().replace("rule all:", "rule everything:") + FEW)


def run(checkout: Path, name: str, *options: str) -> subprocess.CompletedProcess[str]:
    """The driver on the grid, to its end."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with start(checkout, "--name", name, *OPTIONS, *options, **pipes) as driver:
        out, err = driver.communicate(timeout=LIMIT)
    return subprocess.CompletedProcess(driver.args, driver.returncode, out, err)


def processes(checkout: Path) -> dict[str, list[psutil.Process]]:
    """{kind: processes that work in a checkout}, wherever they hang in the tree."""
    kinds = {
        "driver": "workflow.driver",
        "lifeline": "workflow.lifeline",
        "workflow": "workflow.scheduler",
        "notebook": "execute",
        "kernel": "ipykernel_launcher",
    }
    found: dict[str, list[psutil.Process]] = {kind: [] for kind in [*kinds, "other"]}
    for process in psutil.process_iter():
        try:
            zombie = process.status() == psutil.STATUS_ZOMBIE
            if zombie or process.environ().get("PYTHONPATH") != str(checkout):
                continue
            words = process.cmdline()[:4]
        except psutil.Error:  # it has ended, or is another user's
            continue
        found[next((kind for kind, word in kinds.items() if word in words), "other")].append(process)
    return found


def alive(checkout: Path) -> list[psutil.Process]:
    """All processes that work in a checkout."""
    return [process for some in processes(checkout).values() for process in some]


def seconds_until(condition: Callable[[], bool], limit: float) -> float:
    """Wait for a condition; returns how long (s).

    Raises:
        TimeoutError: it does not come true within the limit (s).
    """
    began = time.monotonic()
    while not condition():
        if time.monotonic() - began > limit:
            raise TimeoutError(f"not within {limit:g} s")
        time.sleep(0.2)
    return time.monotonic() - began


def finished_runs(checkout: Path, name: str) -> dict[str, tuple[int, int]]:
    """{run: (inode, time of writing) of its run.json} of all runs that count as finished."""
    marks = (checkout / ".snakemake" / "incomplete").glob("*")
    incomplete = " ".join(base64.urlsafe_b64decode(mark.name).decode() for mark in marks)
    results = (checkout / "results" / name / "runs").glob("*/run.json")
    executed = checkout / "notebooks" / "executed" / name / "runs"
    return {
        file.parent.name: (file.stat().st_ino, file.stat().st_mtime_ns)
        for file in results
        if file.parent.name not in incomplete
        and (executed / f"05_training_run__{file.parent.name}.ipynb").exists()
    }
