"""The driver behind ``reproduce.sh``: command line, set-up of ``.venv``, then the workflow or the tests.

Up to the set-up only the standard library is used: a wrong command line is refused, in one line, before
anything is written. The driver then starts itself again with the Python of ``.venv``.
"""

import argparse
import fcntl
import hashlib
import json
import os
import re
import subprocess
import sys
import time
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NoReturn

from srlrepro.config import Config, ParameterError, check, parse_settings

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
ALPHAS, DELTAS, SEEDS = ["0", "0.5", "1", "none"], [1.1, 1.5, 4.0], 3  # Sec. IV
THREADS = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
DONE = re.compile(r"^(\d+) of (\d+) steps \(")
REPORT_EVERY = 30.0  # s between two progress lines where there is no terminal


class Parser(argparse.ArgumentParser):
    """Refuses a wrong command line with one line and exit status 2."""

    def error(self, message: str) -> NoReturn:
        """Print the message and leave."""
        self.exit(2, f"{self.prog}: {message}\n")


def make_parser() -> argparse.ArgumentParser:
    """The command line of ``reproduce.sh``."""
    parser = Parser(
        prog="reproduce.sh",
        allow_abbrev=False,
        description="Regenerate every figure of the paper. What is up to date is not run again.",
        epilog="./reproduce.sh test [PYTEST OPTIONS] runs the tests instead.",
    )
    parser.add_argument(
        "--quick", action="store_true", help="the same grid with few training steps (minutes, not hours)"
    )
    parser.add_argument(
        "--alphas",
        nargs="+",
        default=ALPHAS,
        metavar="A",
        help="shares of UD in [0, 1], or none for no supervisor (default: %(default)s)",
    )
    parser.add_argument(
        "--deltas",
        nargs="+",
        type=float,
        default=DELTAS,
        metavar="D",
        help="mass mismatches Δ > 0 (default: %(default)s)",
    )
    parser.add_argument(
        "--seeds", type=int, default=SEEDS, metavar="N", help="number of seeds (default: %(default)s)"
    )
    parser.add_argument(
        "--steps",
        type=int,
        metavar="N",
        help="training steps of a run (default: total_steps, or quick_steps with --quick)",
    )
    parser.add_argument(
        "--set",
        dest="settings",
        nargs="+",
        default=[],
        metavar="NAME=VALUE",
        help="vary any parameter; python -m srlrepro choices lists them",
    )
    parser.add_argument(
        "--name",
        help="folder name of the results (default: full or quick; custom if anything is varied)",
    )
    parser.add_argument(
        "--cores",
        type=int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="jobs at a time (default: all cores, %(default)s)",
    )
    parser.add_argument("--dry-run", action="store_true", help="say what would be run, and run nothing")
    return parser


def plan(arguments: argparse.Namespace) -> dict[str, Any]:
    """The workflow's configuration for a command line.

    Raises:
        ParameterError: a value that is not allowed.
    """
    alphas = []
    for text in arguments.alphas:
        try:
            value = None if text == "none" else float(text)
        except ValueError:
            value = -1.0
        check(value is None or 0 <= value <= 1, "--alphas", text, "numbers in [0, 1], or none")
        alphas.append("none" if value is None else f"{value:g}")
    for delta in arguments.deltas:
        check(0 < delta < float("inf"), "--deltas", delta, "finite numbers > 0")
    deltas = [float(f"{delta:g}") for delta in arguments.deltas]
    for name, values in (("--alphas", alphas), ("--deltas", deltas)):
        check(len(set(values)) == len(values), name, " ".join(map(str, values)), "different from each other")
    check(
        alphas != ["none"],
        "--alphas",
        "none",
        "joined by at least one number, for the figures of the regions",
    )
    check(arguments.seeds >= 1, "--seeds", arguments.seeds, "a whole number in [1, inf)")
    check(arguments.cores >= 1, "--cores", arguments.cores, "a whole number in [1, inf)")
    config = Config().with_values(**(settings := parse_settings(arguments.settings)))
    usual = config.choices.quick_steps if arguments.quick else config.choices.total_steps
    steps = usual if arguments.steps is None else arguments.steps
    check(steps >= 1, "--steps", steps, "a whole number in [1, inf)")
    default = (alphas, deltas, arguments.seeds, steps, settings) == (ALPHAS, DELTAS, SEEDS, usual, {})
    name = arguments.name or (("quick" if arguments.quick else "full") if default else "custom")
    check(
        re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", name) is not None,
        "--name",
        name,
        "letters, digits, '_', '-' and '.'",
    )
    check(
        default or name not in ("full", "quick"),
        "--name",
        name,
        "another name if the grid or a parameter is varied",
    )
    full = config.choices.total_steps
    note = f"reduced: {steps} of {full} training steps" if steps < full else ""
    return {
        "name": name,
        "alphas": alphas,
        "deltas": deltas,
        "seeds": list(range(arguments.seeds)),
        "steps": steps,
        "settings": settings,
        "values": config.as_dict(),
        "note": note,
    }


def set_up(test: bool) -> None:
    """Make ``.venv`` and install the requirements, unless that has been done with the same requirements."""
    names = ["requirements.txt", *(["requirements-test.txt"] if test else [])]
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
def only_one() -> Iterator[None]:
    """Hold the lock of this checkout; a second driver leaves at once. A killed driver's lock is released."""
    (ROOT / "results").mkdir(exist_ok=True)
    with (ROOT / "results" / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            sys.exit("reproduce.sh: another ./reproduce.sh is running in this folder")
        yield


def follow(lines: IO[str], log: IO[str]) -> None:
    """Copy Snakemake's output to the log and show one overall progress with the time left."""
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


def machine() -> dict[str, Any]:
    """Where a time was measured."""
    from srlrepro.provenance import processor

    return {"processor": processor(), "processor_cores": os.cpu_count()}


def run_workflow(config: dict[str, Any], cores: int, dry_run: bool) -> int:
    """Run Snakemake on the configuration; returns its exit status."""
    folder = ROOT / "results" / config["name"]
    fresh = not (folder / "runs").exists()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "workflow.json").write_text(json.dumps(config, indent=1, ensure_ascii=False) + "\n")
    command = [
        sys.executable,
        "-m",
        "snakemake",
        "--cores",
        str(cores),
        "--configfile",
        str(folder / "workflow.json"),
    ]
    command += ["--keep-going", "--rerun-incomplete", "--nolock", "--scheduler", "greedy"]
    environment = os.environ | THREADS | {"MPLCONFIGDIR": str(VENV / "matplotlib"), "PYTHONUTF8": "1"}
    if dry_run:
        return subprocess.run([*command, "--dry-run", "--quiet"], cwd=ROOT, env=environment).returncode
    subprocess.run(
        [sys.executable, "-c", "import matplotlib.pyplot"], env=environment, check=True
    )  # its font cache
    started = time.monotonic()
    with (folder / "snakemake.log").open("w") as log:
        process = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        assert process.stdout is not None
        follow(process.stdout, log)
        status = process.wait()
    minutes = (time.monotonic() - started) / 60
    if status == 0 and fresh:  # an interrupted run has no time of its own
        timing = {"minutes": round(minutes, 1), "cores": cores, "steps": config["steps"], **machine()}
        (ROOT / "figures" / config["name"] / "run_time.json").write_text(json.dumps(timing, indent=1) + "\n")
    if status:
        log_name = f"results/{config['name']}/snakemake.log"
        print(f"reproduce.sh: jobs failed ({minutes:.1f} min): {log_name} says which. Start again to go on.")
    else:
        print(
            f"Done in {minutes:.1f} min: figures/{config['name']}/ and notebooks/executed/{config['name']}/"
        )
    return status


def run_tests(options: list[str]) -> int:
    """Lint, types and tests; returns the first exit status that is not zero."""
    environment = os.environ | THREADS | {"MPLCONFIGDIR": str(VENV / "matplotlib"), "PYTHONUTF8": "1"}
    started = time.monotonic()
    checks = [["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"]]
    checks.append(["pytest", "-n", str(min(2, os.cpu_count() or 1)), *options])
    results = [
        subprocess.run([sys.executable, "-m", *c], cwd=ROOT, env=environment).returncode for c in checks
    ]
    if not any(results) and not options:
        timing = {"minutes": round((time.monotonic() - started) / 60, 1), **machine()}
        (ROOT / "results" / "test_time.json").write_text(json.dumps(timing, indent=1) + "\n")
    return next((status for status in results if status), 0)


def main(arguments: list[str]) -> int:
    """Run the command line; returns the exit status."""
    test = arguments[:1] == ["test"]
    options = argparse.Namespace()
    if not test:
        parser = make_parser()
        options = parser.parse_args(arguments)
        try:
            config = plan(options)
        except ParameterError as error:
            parser.error(str(error))
    if Path(sys.prefix) != VENV:
        set_up(test)
        python = str(VENV / "bin" / "python")
        os.execv(python, [python, "-m", "srlrepro.reproduce", *arguments])
    with only_one():
        return run_tests(arguments[1:]) if test else run_workflow(config, options.cores, options.dry_run)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
