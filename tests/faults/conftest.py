"""What the fault tests share: one checkout with an uninterrupted grid, and the tally that ends the run."""

from collections.abc import Iterator
from pathlib import Path

import grid
import pytest
from checkouts import copy_sources

TALLY = pytest.StashKey[dict[str, tuple[int, int]]]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--kills", type=int, default=4, help="how often the workflow is killed")
    parser.addoption("--cuts", type=int, default=200, help="how often the power is cut")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker("faults")


@pytest.fixture
def count(request: pytest.FixtureRequest) -> Iterator[list[bool]]:
    """A list to which a test appends, for each fault that it tried, whether nothing was lost."""
    survived: list[bool] = []
    yield survived
    tally = request.config.stash.setdefault(TALLY, {})
    tally[request.node.name] = len(survived), sum(survived)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    tally = config.stash.get(TALLY, {})
    if not tally:
        return
    terminalreporter.section("faults: tried, survived")
    for name, (tried, survived) in tally.items():
        terminalreporter.line(f"{tried:6d} {survived:6d}  {name}")
    tried, survived = (sum(numbers) for numbers in zip(*tally.values(), strict=True))
    terminalreporter.line(f"{tried:6d} {survived:6d}  all")


@pytest.fixture(scope="session")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A checkout in which the grid named ``whole`` ran without a fault; at the end nothing runs in it."""
    folder = copy_sources(tmp_path_factory.mktemp("checkout"))
    grid.shorten(folder)
    done = grid.run(folder, "whole")
    assert done.returncode == 0, done.stdout + done.stderr
    yield folder
    assert grid.alive(folder) == []
