"""The driver behind ``reproduce.sh``: command line, set-up of ``.venv``, then workflow, tests or site.

Up to the set-up only the standard library is used: a wrong command line is refused, in one line, before
anything is written. The driver then starts itself again with the Python of ``.venv``.
"""

import argparse
import fcntl
import hashlib
import os
import re
import signal
import subprocess
import sys
import time
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NoReturn

from srlrepro.config import ParameterError
from srlrepro.limit import VARIABLE
from srlrepro.plan import CORES, make_parser, plan

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PROFILE = ROOT / "profiles" / "slurm"
THREADS = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
DONE = re.compile(r"^(\d+) of (\d+) steps \(")
INTERRUPTED = 130  # exit status after Ctrl-C
REPORT_EVERY = 30.0  # s between two progress lines where there is no terminal


def set_up(names: list[str]) -> None:
    """Make ``.venv`` and install these requirements, unless that has been done with the same ones."""
    for name in names:
        sources = [ROOT / name, ROOT / "constraints.txt", ROOT / "pyproject.toml"]
        wanted = hashlib.sha256(b"".join(s.read_bytes() for s in sources) + sys.version.encode()).hexdigest()
        stamp = VENV / f"{name}.sha256"
        if stamp.exists() and stamp.read_text() == wanted:
            continue
        print(f"Installing {name} into .venv (some minutes, once) …", flush=True)
        if not (VENV / "bin" / "python").exists():
            venv.create(VENV, with_pip=True)
        command = [str(VENV / "bin" / "python"), "-m", "pip", "install", "--quiet", "-r", name]
        started = time.monotonic()
        if subprocess.run([*command, "--disable-pip-version-check"], cwd=ROOT).returncode:
            sys.exit(f"reproduce.sh: pip could not install {name}; its message stands above")
        stamp.write_text(wanted)
        print(f"Installed in {(time.monotonic() - started) / 60:.1f} min", flush=True)


@contextmanager
def only_one() -> Iterator[IO[str]]:
    """Hold the lock of this checkout; a second driver leaves at once.

    Who is given the file shares the lock. The system releases it when all of them have ended, however.
    """
    (ROOT / "results").mkdir(exist_ok=True)
    with (ROOT / "results" / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            sys.exit("reproduce.sh: another ./reproduce.sh is running in this folder, or coming to its end")
        yield file


def follow(lines: IO[str], log: IO[str]) -> bool:
    """Copy Snakemake's output to the log, show one progress with the time left; True if a job was done."""
    from tqdm import tqdm

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
    """Options of Snakemake: run jobs on so many cores here, or so many at a time on Slurm."""
    if not slurm:
        return ["--cores", str(cores or CORES)]
    return ["--profile", str(PROFILE), *([] if cores is None else ["--jobs", str(cores)])]


def tell(name: str) -> int:
    """Render the documents that tell of these results; returns the exit status."""
    from srlrepro.files import ResultError
    from srlrepro.report import refresh

    try:
        for document in refresh(name):
            print(f"Rendered anew: {document}")
    except ResultError as error:
        print(f"reproduce.sh: verdict and report are not up to date: {error}", file=sys.stderr)
        return 1
    return 0


def run_workflow(config: dict[str, Any], options: argparse.Namespace, lock: IO[str]) -> int:
    """Run Snakemake, whose jobs end with this driver, and return its exit status.

    Args:
        lock: held until the last job has ended, even if this driver is killed.

    Raises:
        ResultError: a result was damaged.
    """
    from srlrepro.costs import add_time, spent
    from srlrepro.files import remove_unfinished, write_json
    from srlrepro.notebooks import require_undamaged
    from srlrepro.records import file_of, keep

    folder = ROOT / "results" / config["name"]
    write_json(folder / "workflow.json", config)
    command = [
        sys.executable,
        "-m",
        "snakemake",
        config["study"] or "all",
        *engine(options.slurm, options.cores),
        "--configfile",
        str(folder / "workflow.json"),
    ]
    command += ["--keep-going", "--rerun-incomplete", "--nolock", "--scheduler", "greedy"]
    environment = os.environ | THREADS | {"MPLCONFIGDIR": str(VENV / "matplotlib"), "PYTHONUTF8": "1"}
    environment |= {VARIABLE: str(options.limit)}
    if options.dry_run:
        command += ["--dry-run", "--quiet", "rules", "reason"]
        return subprocess.run(command, cwd=ROOT, env=environment).returncode
    for name in ("results", "figures", "notebooks/executed"):
        remove_unfinished(ROOT / name)
    require_undamaged([ROOT / "notebooks" / "executed" / config[key] for key in ("name", "cells")], ROOT)
    font_cache = [sys.executable, "-c", "import matplotlib.pyplot"]
    subprocess.run(font_cache, env=environment, check=True)
    started = time.monotonic()
    with (folder / "snakemake.log").open("w") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "srlrepro.lifeline", *command],
            cwd=ROOT,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            pass_fds=[lock.fileno()],
        )
        assert process.stdin is not None and process.stdout is not None
        try:
            worked, interrupted = follow(process.stdout, log), False
        except KeyboardInterrupt:
            worked = interrupted = True
            print("reproduce.sh: stopping …", flush=True)
        finally:
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, signal.SIG_IGN)  # it ends soon
            process.stdin.close()
            process.stdout.read()  # to its end: then no job is left
            status = process.wait()
    minutes = (time.monotonic() - started) / 60
    if worked:
        place = {"cores": "Slurm" if options.slurm else options.cores or CORES, "steps": config["steps"]}
        timing = add_time(folder / "run_time.json", minutes, **place)
        timing |= spent(ROOT / "results" / config["cells"], None if config["study"] else config["seeds"])
        shown = ROOT / "figures" / config["name"] / "run_time.json"
        write_json(shown, timing)
    if interrupted:
        print("reproduce.sh: stopped. Start again to go on.")
        return INTERRUPTED
    if status == 0 and (worked or not file_of(config["name"]).exists()):
        keep(config)
    if status:
        log_name = f"results/{config['name']}/snakemake.log"
        print(f"reproduce.sh: jobs failed ({minutes:.1f} min): {log_name} says which. Start again to go on.")
    else:
        name = config["name"]
        print(f"Done in {minutes:.1f} min: figures/{name}/ and notebooks/executed/{name}/")
        return tell(name)
    return status


def run_tests(options: list[str]) -> int:
    """Lint, types and tests; returns the first exit status that is not zero."""
    from srlrepro.costs import machine
    from srlrepro.files import write_json

    environment = os.environ | THREADS | {"MPLCONFIGDIR": str(VENV / "matplotlib"), "PYTHONUTF8": "1"}
    started = time.monotonic()
    checks = [["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"]]
    checks.append(["pytest", "-n", str(min(2, os.cpu_count() or 1)), *options])
    results = [
        subprocess.run([sys.executable, "-m", *c], cwd=ROOT, env=environment).returncode for c in checks
    ]
    minutes = (time.monotonic() - started) / 60
    if not any(results) and not options:
        write_json(ROOT / "results" / "test_time.json", {"minutes": round(minutes, 1), **machine()})
    return next((status for status in results if status), 0)


def make_site() -> int:
    """Write the pages of README and executed notebooks; returns the exit status.

    Raises:
        ResultError: a page cannot be made.
    """
    from srlrepro.site import SITE, Site

    Site(ROOT).write(SITE)
    print(f"Done: {(SITE / 'index.html').relative_to(ROOT)}")
    return 0


def main(arguments: list[str]) -> int:
    """Run the command line; returns the exit status."""
    test, site = arguments[:1] == ["test"], arguments == ["site"]
    options = argparse.Namespace(slurm=False)
    if not test and not site:
        parser = make_parser()
        options = parser.parse_args(arguments)
        try:
            config = plan(options)
        except ParameterError as error:
            parser.error(str(error))
    if Path(sys.prefix) != VENV:
        wanted = "test" if test else "slurm" if options.slurm else ""
        set_up(["requirements.txt", *([f"requirements-{wanted}.txt"] if wanted else [])])
        python = str(VENV / "bin" / "python")
        os.execv(python, [python, "-m", "srlrepro.reproduce", *arguments])
    from srlrepro.files import ResultError

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C, which `nohup … &` lets nobody hear
    try:
        with only_one() as lock:
            if site:
                return make_site()
            return run_tests(arguments[1:]) if test else run_workflow(config, options, lock)
    except ResultError as error:
        message = str(error)
    except OSError as error:
        message = f"cannot write {error.filename or 'results'}: {error.strerror}"
    print(f"reproduce.sh: {message}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
