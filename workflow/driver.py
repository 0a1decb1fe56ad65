"""The driver behind ``reproduce.sh``: command line, set-up of ``.venv``, then the workflow, tests or site.

Up to the set-up only the standard library is used: a command line of the wrong form is refused, in one line,
before anything is written. The driver then starts itself again with the Python of ``.venv``, which checks the
values.
"""

import argparse
import fcntl
import hashlib
import io
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from srlrepro import pins
from workflow import ROOT
from workflow.command_line import TESTS, make_parser, make_verify_parser

VENV = ROOT / ".venv"


def set_up(names: list[str]) -> None:
    """Make ``.venv`` and install these requirements, unless that has been done with the same ones."""
    for name in names:
        sources = [*sorted(ROOT.glob("requirements*.txt")), ROOT / "constraints.txt", ROOT / "pyproject.toml"]
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


def pin_kernels() -> None:
    """Give the pins to the notebooks' kernel in ``.venv``, so that Jupyter started by hand has them too."""
    from srlrepro.storage.files import read_json, write_json

    file = VENV / "share" / "jupyter" / "kernels" / "python3" / "kernel.json"
    found = read_json(file) if file.exists() else {}
    if found and found.get("env") != pins.pins():
        write_json(file, found | {"env": pins.pins()})


@contextmanager
def only_one() -> Iterator[IO[str]]:
    """Hold the lock of this checkout; a second driver leaves at once.

    Who is given the file shares the lock. The system releases it when all of them have ended, however.
    """
    from srlrepro.storage.files import require_replaceable

    (ROOT / "results").mkdir(exist_ok=True)
    require_replaceable(path := ROOT / "results" / ".lock")  # what it names is emptied
    with path.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            sys.exit("reproduce.sh: another ./reproduce.sh is running in this folder, or coming to its end")
        yield file


def environment() -> dict[str, str]:
    """The variables under which everything runs: the pins, and nothing of the user's own."""
    own = {name: value for name, value in os.environ.items() if name != "MATPLOTLIBRC"}
    return own | pins.pins() | {"MPLCONFIGDIR": str(VENV / "matplotlib"), "PYTHONUTF8": "1"}


def run_tests(options: list[str]) -> int:
    """Lint, types and tests; returns the first exit status that is not zero."""
    from srlrepro.storage.files import write_json
    from workflow.engine import TIME, machine

    started = time.monotonic()
    checks = [["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"]]
    checks.append(["pytest", "-n", str(min(2, os.cpu_count() or 1)), "--dist", "worksteal", *options])
    results = [
        subprocess.run([sys.executable, "-m", *c], cwd=ROOT, env=environment()).returncode for c in checks
    ]
    minutes = (time.monotonic() - started) / 60
    if not any(results) and not options:
        write_json(ROOT / "results" / TESTS / TIME, {"minutes": round(minutes, 1), **machine()})
    return next((status for status in results if status), 0)


def make_site() -> int:
    """Write README, REPORT and executed notebooks as pages; returns the exit status."""
    command = [sys.executable, "-m", "sphinx", "-c", "docs", "-b", "html", "-q", "-W", "--keep-going", "."]
    with tempfile.TemporaryDirectory(prefix=".site-", dir=ROOT) as place:
        made = Path(place, "site")
        status = subprocess.run([*command, str(made)], cwd=ROOT, env=environment()).returncode
        if status == 0:
            shutil.rmtree(ROOT / "site", ignore_errors=True)
            made.rename(ROOT / "site")
    print("Done: site/index.html" if status == 0 else "reproduce.sh: the site was not made; see above")
    return status


def main(arguments: list[str]) -> int:
    """Run the command line; returns the exit status."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # letters that the locale lacks
    test, site, verify = arguments[:1] == ["test"], arguments == ["site"], arguments[:1] == ["verify"]
    parser, options = make_parser(), argparse.Namespace(slurm=False)
    if verify:
        parser = make_verify_parser()
        options = argparse.Namespace(slurm=False, **vars(parser.parse_args(arguments[1:])))
    elif not test and not site:
        options = parser.parse_args(arguments)
    pins.pin("reproduce.sh")
    if sys.prefix != str(VENV):
        wanted = "test" if test else "site" if site else "slurm" if options.slurm else ""
        set_up(["requirements.txt", *([f"requirements-{wanted}.txt"] if wanted else [])])
        python = str(VENV / "bin" / "python")
        os.execv(python, [python, "-m", "workflow.driver", *arguments])
    if not pins.is_covered():
        print("reproduce.sh: not an x86-64 processor with AVX2 and FMA: last bits of results may differ")
    from srlrepro.settings.fields import ParameterError
    from srlrepro.storage.files import ResultError
    from workflow.engine import run_workflow
    from workflow.plan import plan

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C, which `nohup … &` lets nobody hear
    try:
        pin_kernels()
        if verify:
            from workflow import verify as verifying  # slow to import, as it makes tables anew

            return verifying.main(options, environment())
        config = plan(options) if not test and not site else {}
        with only_one() as lock:
            if site:
                return make_site()
            if test:
                return run_tests(arguments[1:])
            return run_workflow(config, options, environment(), lock)
    except ParameterError as error:
        parser.error(str(error))
    except ResultError as error:
        message = str(error)
    except OSError as error:
        message = f"cannot write {error.filename or 'results'}: {error.strerror}"
    print(f"reproduce.sh: {message}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
