"""Copies of the sources in which tests run the driver, with this environment as their ``.venv``."""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import _CacheLocator

from srlrepro import pendulum

ROOT = Path(__file__).parent.parent


def _share_compiled(checkout: Path) -> None:
    """Let a copy use the compiled code of this checkout, which numba names by the folder of the sources."""
    name = _CacheLocator.get_suitable_cache_subpath
    kept = Path(numba.config.CACHE_DIR)
    here = kept / name(pendulum.__file__)
    package = checkout / "srlrepro"
    there = package / "__pycache__" / kept.name / name(str(package / "pendulum.py"))
    here.mkdir(parents=True, exist_ok=True)
    there.parent.mkdir(parents=True)
    there.symlink_to(here)


def copy_sources(folder: Path) -> Path:
    """Make a checkout in an empty folder."""
    for name in ("srlrepro", "notebooks", "profiles", "rules"):
        ignored = shutil.ignore_patterns("executed", "__pycache__")
        shutil.copytree(ROOT / name, folder / name, ignore=ignored)
    shutil.copy(ROOT / "Snakefile", folder)
    (folder / ".venv").symlink_to(sys.prefix)
    _share_compiled(folder)
    return folder


def start(
    checkout: Path, *options: str, environment: Mapping[str, str] = os.environ, **process: Any
) -> subprocess.Popen[bytes]:
    """The driver with these options in a checkout."""
    command = [str(checkout / ".venv" / "bin" / "python"), "-m", "srlrepro.reproduce", *options]
    variables = {**environment, "PYTHONPATH": str(checkout)}
    return subprocess.Popen(command, cwd=checkout, env=variables, **process)


def tables(checkout: Path, name: str) -> dict[str, bytes]:
    """{path below the results or figures of that name: bytes} of every table of results.

    The records (times, memory) of what made them are no results.
    """
    folders = (checkout / "results" / name, checkout / "figures" / name)
    found = {str(p.relative_to(f)): p.read_bytes() for f in folders for p in f.rglob("*.csv")}
    found.pop("records.csv", None)
    return found
