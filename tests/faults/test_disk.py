"""A disk that is full or cannot be written: one clear line, and no half file taken for a whole one."""

import os
import resource
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import grid
import numpy as np
import pandas as pd
import pytest
from checkouts import copy_sources

from srlrepro.storage.files import ResultError, beside, write_arrays, write_json, write_table

SMALL = 256 * 1024  # bytes of the disk
LARGE = np.random.default_rng(0).normal(size=2 * SMALL // 8)  # does not compress

needs_root = pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("mount") is None, reason="only root can mount a disk"
)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of `SMALL` bytes in memory."""
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={SMALL}", "faults", tmp_path], capture_output=True, text=True
    )
    if mounted.returncode:
        pytest.skip(mounted.stderr)
    yield tmp_path
    subprocess.run(["umount", tmp_path], check=True)


def a_text(path: Path) -> None:
    with beside(path) as temporary:
        temporary.write_bytes(LARGE.tobytes())


WRITERS: dict[str, Callable[[Path], None]] = {
    "a.json": lambda path: write_json(path, LARGE.tolist()),
    "a.csv": lambda path: write_table(path, pd.DataFrame({"x": LARGE})),
    "a.npz": lambda path: write_arrays(path, "test", x=LARGE),
    "a.png": a_text,
}


@needs_root
@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_is_told_and_leaves_the_old_file(name: str, disk: Path, count: list[bool]) -> None:
    path = disk / name
    path.write_text("old")
    with pytest.raises(ResultError, match=f"cannot write .*{name}: No space left on device"):
        WRITERS[name](path)
    assert path.read_text() == "old" and list(disk.iterdir()) == [path]
    count.append(True)


@pytest.mark.parametrize("name", WRITERS)
def test_a_limit_on_sizes_is_told_and_leaves_no_file(name: str, tmp_path: Path, count: list[bool]) -> None:
    """As a full disk, and for everyone: no file of this process may grow beyond a size."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (SMALL, limits[1]))
    try:
        with pytest.raises(ResultError, match=f"cannot write .*{name}: File too large"):
            WRITERS[name](tmp_path / name)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []
    count.append(True)


@needs_root
def test_a_folder_that_cannot_be_written_is_told(disk: Path, count: list[bool]) -> None:
    subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
    for name, write in WRITERS.items():
        with pytest.raises(ResultError, match=f"cannot write to {disk}: Read-only file system"):
            write(disk / name)
        count.append(True)


@needs_root
@pytest.mark.slow
@pytest.mark.parametrize("option", [f"size={SMALL}", "ro"], ids=["full", "read-only"])
def test_the_driver_tells_of_its_disk(
    option: str, disk: Path, tmp_path_factory: pytest.TempPathFactory, count: list[bool]
) -> None:
    """With its results on that disk: exit status 1 and the reason, and nothing that counts as finished."""
    checkout = copy_sources(tmp_path_factory.mktemp("checkout"))
    grid.shorten(checkout)
    (checkout / "results").symlink_to(disk)
    if option == "ro":
        subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
    else:
        (disk / "filler").write_bytes(bytes(SMALL - 4096))
    done = grid.run(checkout, "whole")
    log = disk / "whole" / "snakemake.log"
    told = done.stderr + (log.read_text() if log.exists() else "")
    assert done.returncode == 1 and ("No space left" in told or "Read-only file system" in told), told
    assert "Traceback" not in done.stderr and done.stderr.count("\n") == 1
    assert grid.finished_runs(checkout, "whole") == {} and grid.alive(checkout) == []
    count.append(True)
