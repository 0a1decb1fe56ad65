"""kill -9 at random moments: what is finished is not made again, and in the end all is as without a fault.

Moments are drawn by what the workflow has reached, so that they meet every stage on fast and slow machines.
"""

import subprocess
import time
from contextlib import suppress
from pathlib import Path

import grid
import numpy as np
import psutil
import pytest
from checkouts import start, tables
from runs import products

VICTIMS = ("kernel", "notebook", "workflow", "driver")  # the kernel is what trains
SEED = 7
# what is waited for: a kernel starts, a training writes a checkpoint or its result, a notebook is executed
STAGES = {
    "kernel": "",
    "checkpoint": "results/{name}/checkpoints/*.zip",
    "result": "results/{name}/runs/*/run.json",
    "notebook": "notebooks/executed/{name}/**/[!.]*.ipynb",
}
LATER = 3.0  # s at most between that and the kill
SITTINGS = (
    4  # in which a grid that is no longer disturbed has to end; one is spent on what the last kill left
)


def kill(victim: str, checkout: Path) -> bool:
    """Kill all processes of a kind; False if there is none just now."""
    found = grid.processes(checkout)[victim]
    for process in found:
        try:
            process.kill()
        except psutil.NoSuchProcess:
            continue
    return bool(found)


def as_the_whole(checkout: Path, name: str) -> bool:
    """Whether tables, states, policies and counts of a grid are those of the undisturbed one, bit for bit."""
    runs = [checkout / "results" / each / "runs" for each in (name, "whole")]
    there, here = (sorted(folder.name for folder in each.iterdir()) for each in runs)
    same = there == here and tables(checkout, name) == tables(checkout, "whole")
    return same and all(products(runs[0] / run) == products(runs[1] / run) for run in here)


class Disturbed:
    """Grids, one after the other, that are killed; what was finished is watched whenever nothing runs."""

    def __init__(self, checkout: Path) -> None:
        self.checkout, self.grids = checkout, 0
        self.compared: list[bool] = []
        self._begin()

    def _begin(self) -> None:
        self.grids += 1
        self.name, self.finished = f"grid_{self.grids}", dict[str, tuple[int, int]]()
        self._start()

    def _start(self) -> None:
        options = ["--name", self.name, *grid.OPTIONS]
        self.driver = start(self.checkout, *options, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def go_on(self) -> bool:
        """See that the driver runs; if it has ended, whether all ended in time and nothing was made again."""
        if self.driver.poll() is None:
            return True
        grid.seconds_until(lambda: grid.alive(self.checkout) == [], grid.ENDING)
        now = grid.finished_runs(self.checkout, self.name)
        kept = self.finished.items() <= now.items()
        self.finished = now
        if self.driver.returncode:
            self._start()
        else:
            self.compared.append(as_the_whole(self.checkout, self.name))
            self._begin()
        return kept

    def reached(self, stage: str) -> set[tuple[str, int]]:
        """What there is at a stage; another set after each time that the stage is reached."""
        if stage == "kernel":
            return {("kernel", process.pid) for process in grid.processes(self.checkout)["kernel"]}
        found = set()
        for path in self.checkout.glob(STAGES[stage].format(name=self.name)):
            with suppress(FileNotFoundError):  # removed just now
                found.add((str(path), path.stat().st_mtime_ns))
        return found

    def end(self) -> bool:
        """Let the grid end undisturbed; whether it did, and nothing was made again."""
        before, kept = self.grids, True
        for _ in range(SITTINGS):
            self.driver.wait(grid.LIMIT)
            kept = self.go_on() and kept
            if self.grids > before:
                self.driver.kill()  # the next grid is not wanted
                grid.seconds_until(lambda: grid.alive(self.checkout) == [], grid.ENDING)
                return kept
        return False


@pytest.mark.slow
def test_killed_at_random_moments_nothing_is_lost(
    checkout: Path, request: pytest.FixtureRequest, count: list[bool]
) -> None:
    rng, disturbed = np.random.default_rng(SEED), Disturbed(checkout)
    print(f"moments drawn from seed {SEED}")
    for n in range(request.config.getoption("--kills", default=4)):
        victim, stage, later = VICTIMS[n % len(VICTIMS)], rng.choice(list(STAGES)), rng.uniform(0.0, LATER)
        before, kept, killed = disturbed.reached(stage), True, False
        until = time.monotonic() + grid.LIMIT
        while disturbed.reached(stage) <= before:
            assert time.monotonic() < until, f"the stage {stage} is never reached"
            kept = disturbed.go_on() and kept
            time.sleep(0.2)
        time.sleep(later)
        while not killed:
            assert time.monotonic() < until, f"there is no {victim} to kill"
            kept = disturbed.go_on() and kept
            killed = kill(victim, checkout)
            time.sleep(0.2)
        when = f"{later:.1f} s after the stage {stage}, {len(disturbed.finished)} runs finished before"
        print(f"{n + 1}: {victim} of {disturbed.name} killed {when}", flush=True)
        if victim in ("workflow", "driver"):
            disturbed.driver.wait(grid.ENDING)
        count.append(kept)
    assert disturbed.end() and all(count)
    assert disturbed.compared == [True] * len(disturbed.compared) and disturbed.compared
    print(f"{len(disturbed.compared)} grids ended, each as if it had not been killed")
