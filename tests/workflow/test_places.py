"""Where a checkout lies is nobody's business: no path is read as a command, none makes a job run again."""

import subprocess
from pathlib import Path

import pytest
from checkouts import copy_sources, start, tables

ONLY = ["--only", "fig2_abc_training_data", "--seeds", "1", "--steps", "64"]
SMALL = ["--set", "k=20", "random_rollouts=50"]


def run(checkout: Path) -> str:
    """The driver on one figure, to its end; what it says."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with start(checkout, *ONLY, *SMALL, **pipes) as driver:
        said, _ = driver.communicate(timeout=600)
    assert driver.returncode == 0, said
    return str(said)


@pytest.mark.slow
def test_a_path_is_no_command_and_a_moved_checkout_runs_nothing_again(tmp_path: Path) -> None:
    """A path with a space ran no job, one with $(…) ran that command, and a moved checkout ran all jobs."""
    place = tmp_path / "a $(touch made) 'b' \"c\""
    place.mkdir()
    run(copy_sources(place))
    assert not list(tmp_path.rglob("made"))
    (figure,) = (place / "figures").rglob("fig2_abc_training_data.csv")
    name = figure.parent.name
    made = tables(place, name)
    moved = place.rename(tmp_path / "moved")
    executed = next((moved / "notebooks" / "executed").rglob("02_training_data.ipynb"))
    before = executed.stat().st_mtime_ns
    run(moved)
    assert executed.stat().st_mtime_ns == before and tables(moved, name) == made
