"""The clock changed: files seem to come from the future or from long ago. Contents decide, not times."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import grid
import pytest
from checkouts import tables

from workflow.sources import HOUSES

YEAR = 365.25 * 86400


@contextmanager
def shifted(folders: list[Path], seconds: float) -> Iterator[None]:
    """Let all files below folders seem to have been written that much later than now, for a while."""
    files = [p for folder in folders for p in folder.rglob("*") if p.is_file()]
    times = [(p.stat().st_atime_ns, p.stat().st_mtime_ns) for p in files]
    for path in files:
        os.utime(path, (time.time() + seconds,) * 2)
    try:
        yield
    finally:
        for path, old in zip(files, times, strict=True):
            os.utime(path, ns=old)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("which", "years"),
    [("sources", 1), ("results", -1), ("results", 1)],
    ids=["sources of the future", "results of the past", "results of the future"],
)
def test_nothing_is_made_again(checkout: Path, which: str, years: int, count: list[bool]) -> None:
    names = (*HOUSES, "notebooks") if which == "sources" else ("results", "figures")
    with shifted([checkout / name for name in names], years * YEAR):
        before, runs = tables(checkout, "whole"), grid.finished_runs(checkout, "whole")
        done = grid.run(checkout, "whole")
        assert done.returncode == 0 and "of 7 jobs" not in done.stdout, done.stdout
        assert tables(checkout, "whole") == before
        assert runs and grid.finished_runs(checkout, "whole") == runs
    count.append(True)
