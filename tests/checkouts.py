"""Copies of the sources in which tests run the driver, with this environment as their ``.venv``."""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent


def copy_sources(folder: Path) -> Path:
    """Make a checkout in an empty folder; it shares the compiled code of this one."""
    for name in ("srlrepro", "notebooks", "profiles"):
        ignored = shutil.ignore_patterns("executed", "__pycache__")
        shutil.copytree(ROOT / name, folder / name, ignore=ignored)
    shutil.copy(ROOT / "Snakefile", folder)
    compiled = ROOT / "srlrepro" / "__pycache__"
    compiled.mkdir(exist_ok=True)
    (folder / "srlrepro" / "__pycache__").symlink_to(compiled)
    (folder / ".venv").symlink_to(sys.prefix)
    return folder


def start(
    checkout: Path, *options: str, environment: Mapping[str, str] = os.environ, **process: Any
) -> subprocess.Popen[bytes]:
    """The driver with these options in a checkout."""
    command = [str(checkout / ".venv" / "bin" / "python"), "-m", "srlrepro.reproduce", *options]
    variables = {**environment, "PYTHONPATH": str(checkout)}
    return subprocess.Popen(command, cwd=checkout, env=variables, **process)


def tables(checkout: Path, name: str) -> dict[str, bytes]:
    """{path below the results or figures of that name: bytes} of every table."""
    folders = (checkout / "results" / name, checkout / "figures" / name)
    return {str(p.relative_to(f)): p.read_bytes() for f in folders for p in f.rglob("*.csv")}
