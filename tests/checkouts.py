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

from srlrepro.dynamics import pendulum  # noqa: F401  (says where compiled code is kept)

ROOT = Path(__file__).parent.parent


def _share_compiled(checkout: Path) -> None:
    """Let a copy use the compiled code of this checkout, which numba names by the folder of the sources."""
    name = _CacheLocator.get_suitable_cache_subpath
    kept = Path(numba.config.CACHE_DIR)
    package = checkout / "srlrepro"
    for source in sorted({path.parent for path in package.rglob("*.py") if "@jit" in path.read_text()}):
        here = kept / name(str(ROOT / source.relative_to(checkout) / "module.py"))
        there = package / "__pycache__" / kept.name / name(str(source / "module.py"))
        here.mkdir(parents=True, exist_ok=True)
        there.parent.mkdir(parents=True, exist_ok=True)
        there.symlink_to(here)


def copy_sources(folder: Path) -> Path:
    """Make a checkout in an empty folder."""
    for name in ("srlrepro", "replication", "workflow", "notebooks"):
        ignored = shutil.ignore_patterns("executed", "__pycache__")
        shutil.copytree(ROOT / name, folder / name, ignore=ignored)
    (folder / "docs").mkdir()
    shutil.copy(ROOT / "docs" / "figures.toml", folder / "docs")
    (folder / ".venv").symlink_to(sys.prefix)
    _share_compiled(folder)
    return folder


def start(
    checkout: Path, *options: str, environment: Mapping[str, str] = os.environ, **process: Any
) -> subprocess.Popen[bytes]:
    """The driver with these options in a checkout."""
    command = [str(checkout / ".venv" / "bin" / "python"), "-m", "workflow.driver", *options]
    variables = {**environment, "PYTHONPATH": str(checkout)}
    return subprocess.Popen(command, cwd=checkout, env=variables, **process)


def tables(checkout: Path, name: str) -> dict[str, bytes]:
    """{path below the results or figures of that name: bytes} of every table of results."""
    folders = (checkout / "results" / name, checkout / "figures" / name)
    return {str(p.relative_to(f)): p.read_bytes() for f in folders for p in f.rglob("*.csv")}
