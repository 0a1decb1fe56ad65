"""How a workflow ends: two at once, Ctrl-C, SIGTERM, a killed driver, a kernel that hangs."""

import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import grid
import pytest
from checkouts import start

from srlrepro.storage.files import UNFINISHED

STOPPED = 130


@contextmanager
def training(checkout: Path, name: str, nohup: bool) -> Iterator[subprocess.Popen[bytes]]:
    """A driver in a session of its own, which has a kernel at work; with nohup SIGINT is ignored."""

    def treat() -> None:
        """Whatever this process ignores itself, as one in the background does."""
        for number in (signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN if nohup else signal.SIG_DFL)

    options = ["--name", name, *grid.OPTIONS]
    own = {"start_new_session": True, "preexec_fn": treat, "stdout": subprocess.DEVNULL}
    with start(checkout, *options, **own) as driver:
        try:
            grid.seconds_until(lambda: bool(grid.processes(checkout)["kernel"]), grid.LIMIT)
            yield driver
        finally:
            driver.kill()
            grid.seconds_until(lambda: grid.alive(checkout) == [], grid.ENDING)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "nohup"),
    [(signal.SIGINT, False), (signal.SIGTERM, False), (signal.SIGTERM, True), (signal.SIGKILL, True)],
    ids=["Ctrl-C", "SIGTERM", "SIGTERM under nohup", "SIGKILL under nohup"],
)
def test_all_ends_with_the_driver(
    checkout: Path, number: signal.Signals, nohup: bool, count: list[bool]
) -> None:
    with training(checkout, "ended", nohup) as driver:
        driver.send_signal(number)
        took = grid.seconds_until(
            lambda: driver.poll() is not None and grid.alive(checkout) == [], grid.ENDING
        )
        print(f"{number.name}: ended in {took:.1f} s")
        assert driver.returncode == (-number if number == signal.SIGKILL else STOPPED)
    left = [path for path in checkout.rglob(f".*{UNFINISHED}*") if number != signal.SIGKILL]
    assert left == []
    count.append(True)


@pytest.mark.slow
def test_the_second_of_two_leaves_at_once(checkout: Path, count: list[bool]) -> None:
    """Also where the first is killed, until what it started has ended."""
    with training(checkout, "first", False) as driver:
        second = grid.run(checkout, "second")
        assert second.returncode == 1 and "another ./reproduce.sh is running" in second.stderr
        assert second.stderr.count("\n") == 1 and not (checkout / "results" / "second").exists()
        assert driver.poll() is None
    count.append(True)


@pytest.mark.slow
def test_a_start_removes_what_a_killed_one_left(checkout: Path, count: list[bool]) -> None:
    """A notebook under way, and a table: neither is ever taken for a result."""
    left = [
        checkout / "notebooks" / "executed" / "whole" / f".06{UNFINISHED}abc.ipynb",
        checkout / "results" / "whole" / f".trials{UNFINISHED}abc.csv",
    ]
    for path in left:
        path.write_text("half")
    assert grid.run(checkout, "whole").returncode == 0
    assert not any(path.exists() for path in left)
    count.append(True)


@pytest.mark.slow
def test_a_kernel_that_hangs_is_ended(checkout: Path, count: list[bool]) -> None:
    """At a limit so short that some cell of every notebook seems to hang."""
    done = grid.run(checkout, "hung", "--limit", "0.0003")
    log = (checkout / "results" / "hung" / "snakemake.log").read_text()
    assert done.returncode == 1 and "A cell timed out" in log and "jobs failed" in done.stdout
    assert grid.finished_runs(checkout, "hung") == {} and grid.alive(checkout) == []
    count.append(True)
