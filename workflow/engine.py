"""The workflow under its driver: how Snakemake is called, followed and ended, and what is noted after it."""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any, NamedTuple, NoReturn

from tqdm import tqdm

from replication.digests import write_digests
from srlrepro.settings.fields import check
from srlrepro.storage.files import ResultError, read_json, remove_unfinished, require_replaceable, write_json
from srlrepro.storage.provenance import processor
from workflow import ROOT
from workflow.command_line import CORES, LIMIT_VARIABLE
from workflow.notebooks import require_undamaged

PROFILE = ROOT / "workflow" / "profiles" / "slurm"
DONE = re.compile(r"^(\d+) of (\d+) steps \(")
TIME = "run_time.json"  # beside results, not beside figures: a rerun takes another time
INTERRUPTED = 130  # exit status after Ctrl-C
REPORT_EVERY = 30.0  # s between two progress lines where there is no terminal


def machine() -> dict[str, Any]:
    """Where and when a time was measured."""
    today = datetime.now(UTC).date().isoformat()
    return {"processor": processor(), "processor_cores": os.cpu_count(), "date": today}


def add_time(file: Path, minutes: float, **run: Any) -> dict[str, Any]:
    """Keep, in a file beside results, the time that they took over all sittings in which a job was done.

    `record` copies it to the repository.
    """
    before = read_json(file) if file.exists() else {"minutes": 0.0, "sittings": 0}
    timing = {"minutes": round(before["minutes"] + minutes, 1), "sittings": before["sittings"] + 1}
    timing |= run | machine()
    write_json(file, timing)
    return timing


def record(name: str) -> Path:
    """Keep the time that results here took, for the documents; returns the file.

    Nothing else writes a time or the name of a processor to a tracked file.

    Raises:
        ParameterError: results of this name have left no time.
    """
    measured = ROOT / "results" / name / TIME
    known = sorted(path.parent.name for path in measured.parent.parent.glob(f"*/{TIME}"))
    check(
        name in known, "NAME", name, f"results here that were timed ({', '.join(known) or 'there are none'})"
    )
    write_json(kept := ROOT / "docs" / "records" / f"{name}.json", read_json(measured))
    return kept


def spent(folder: Path, seeds: list[int] | None = None) -> dict[str, Any]:
    """What the finished trainings (of some seeds) below a folder took: number, core hours, largest memory."""
    found = [read_json(path) for path in folder.rglob("run.json")]
    costs = [result["provenance"] for result in found if seeds is None or result["run"]["seed"] in seeds]
    return {
        "trainings": len(costs),
        "core_hours": round(sum(cost["seconds"] for cost in costs) / 3600, 2),
        "peak_memory_mb": max((cost["peak_memory_mb"] for cost in costs), default=0),
    }


class Ended(NamedTuple):
    """How Snakemake came to its end: its exit status, whether a job was done, whether it was interrupted."""

    status: int
    worked: bool
    interrupted: bool


def follow(lines: IO[str], log: IO[str]) -> bool:
    """Copy Snakemake's output to the log, show one progress with the time left; True if a job was done."""
    bar: tqdm[NoReturn] | None = None
    started = reported = time.monotonic()
    for line in lines:
        log.write(line)
        log.flush()
        if line.startswith("Error in rule"):
            tqdm.write(line.strip().rstrip(":"))
        match = DONE.match(line)
        if match is None:
            continue
        done, total = int(match[1]), int(match[2])
        bar = bar or tqdm(total=total, unit="job", desc="replication", disable=None)
        bar.update(done - bar.n)
        now = time.monotonic()
        if bar.disable and (now - reported > REPORT_EVERY or done == total):
            bar.n, reported = done, now
            left = (now - started) / done * (total - done)
            print(
                f"{done} of {total} jobs, {(now - started) / 60:.1f} min, about {left / 60:.1f} min left",
                flush=True,
            )
    if bar is not None:
        bar.close()
    return bar is not None


def engine(slurm: bool, cores: int | None) -> list[str]:
    """Options of Snakemake: how many jobs run at a time, here or on Slurm."""
    if not slurm:
        return ["--cores", str(cores or CORES)]
    return ["--profile", str(PROFILE), *([] if cores is None else ["--jobs", str(cores)])]


def supervise(
    command: list[str], environment: dict[str, str], log: Path, lock: IO[str], place: Path = ROOT
) -> Ended:
    """Run a command to its end, or until Ctrl-C or SIGTERM; whatever it started ends with this process.

    Args:
        log: what the command says goes there.
        lock: held until the last job has ended, even if this process is killed.
        place: checkout in which it runs.
    """
    require_replaceable(log)  # what it names is emptied
    with log.open("w", encoding="utf-8", errors="backslashreplace") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "workflow.lifeline", *command],
            cwd=place,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="backslashreplace",
            start_new_session=True,
            pass_fds=[lock.fileno()],
        )
        assert process.stdin is not None and process.stdout is not None
        try:
            worked, interrupted = follow(process.stdout, file), False
        except KeyboardInterrupt:
            worked = interrupted = True
            print("reproduce.sh: stopping …", flush=True)
        finally:
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, signal.SIG_IGN)  # it ends soon
            process.stdin.close()
            process.stdout.read()  # to its end: then no job is left
            status = process.wait()
    return Ended(status, worked, interrupted)


def note_time(config: dict[str, Any], options: argparse.Namespace, minutes: float) -> None:
    """Add the minutes of a sitting to those of the results, with what the trainings took."""
    place = {"cores": "Slurm" if options.slurm else options.cores or CORES, "steps": config["steps"]}
    place |= spent(ROOT / "results" / config["cells"], None if config["study"] else config["seeds"])
    add_time(ROOT / "results" / config["name"] / TIME, minutes, **place)


def tell(name: str) -> int:
    """Render the documents that tell of these results; returns the exit status."""
    from replication.documents import refresh  # reads what the run has written, and takes a second to import

    try:
        for document in refresh(name):
            print(f"Rendered anew: {document}")
    except ResultError as error:
        print(f"reproduce.sh: verdict and report are not up to date: {error}", file=sys.stderr)
        return 1
    return 0


def say_what_would_run(command: list[str], config: dict[str, Any], environment: dict[str, str]) -> int:
    """Snakemake's dry run; nothing is written but a temporary file. Returns its exit status."""
    with tempfile.TemporaryDirectory() as place:
        write_json(file := Path(place, "workflow.json"), config)
        options = [str(file), "--dry-run", "--quiet", "rules", "reason"]
        return subprocess.run([*command, *options], cwd=ROOT, env=environment).returncode


def run_workflow(
    config: dict[str, Any], options: argparse.Namespace, environment: dict[str, str], lock: IO[str]
) -> int:
    """Run Snakemake, whose jobs end with this driver, and return its exit status.

    Args:
        config: of `plan`; ``options``: the command line; ``environment``: of Snakemake and its jobs.
        lock: held until the last job has ended, even if this driver is killed.

    Raises:
        ResultError: a result was damaged.
    """
    name, folder = config["name"], ROOT / "results" / config["name"]
    snakemake = "snakemake" if options.slurm else "workflow.scheduler"
    command = [sys.executable, "-m", snakemake, config["study"] or "all"]
    command += [*engine(options.slurm, options.cores), "--keep-going", "--rerun-incomplete", "--nolock"]
    command += ["--scheduler", "greedy", "--configfile"]
    environment = environment | {LIMIT_VARIABLE: str(options.limit)}
    if options.dry_run:
        return say_what_would_run(command, config, environment)
    write_json(folder / "workflow.json", config)
    command.append(str(folder / "workflow.json"))
    for made in ("results", "figures", "notebooks/executed"):
        remove_unfinished(ROOT / made)
    executed = ROOT / "notebooks" / "executed"
    require_undamaged([executed / config[key] for key in ("name", "look", "cells")], ROOT)
    font_cache = [sys.executable, "-c", "import matplotlib.pyplot"]
    subprocess.run(font_cache, env=environment, check=True)
    started = time.monotonic()
    ended = supervise(command, environment, folder / "snakemake.log", lock)
    minutes = (time.monotonic() - started) / 60
    if ended.worked:
        note_time(config, options, minutes)
    if ended.interrupted:
        print("reproduce.sh: stopped. Start again to go on.")
        return INTERRUPTED
    if ended.status:
        log = f"results/{name}/snakemake.log"
        print(f"reproduce.sh: jobs failed ({minutes:.1f} min): {log} says which. Start again to go on.")
        return ended.status
    if config["only"]:
        print(f"Done in {minutes:.1f} min: notebook {config['only']}, figures in figures/{config['look']}/")
        return 0
    kept = {key: value for key, value in config.items() if key != "only"}
    write_json(ROOT / "figures" / name / "workflow.json", kept)
    for made in {name, config["look"]}:
        write_digests(ROOT / "figures" / made)
    print(f"Done in {minutes:.1f} min: figures/{name}/ and notebooks/executed/{name}/")
    return tell(name)
