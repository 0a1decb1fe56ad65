"""What the tests share. Every number is drawn from a seed or follows from a formula."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

from srlrepro.pins import pins

os.environ.update(pins(), MPLBACKEND="Agg")  # before numpy is loaded

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from judged import JUDGED, measures, write_judged
from learned import Learned
from matplotlib.backends.backend_agg import FigureCanvasAgg

from replication.documents import FIGURES
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.safe_region import learn_region
from srlrepro.samplers import generate
from srlrepro.settings.config import Config
from srlrepro.storage.files import write_table


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)


@pytest.fixture(scope="session")
def draw() -> Callable[..., Floats]:
    """draw(n, seed): n states, uniform over the state space of the paper."""
    high = np.array(Config().paper.state_max)
    return lambda n, seed=0: np.random.default_rng(seed).uniform(-high, high, (n, 6))


@pytest.fixture
def example(draw: Callable[..., Floats]) -> tuple[Floats, Floats, Floats]:
    """States [30, 6], labels and simplified states [30, 2], unrelated to each other."""
    rng = np.random.default_rng(4)
    return draw(30, 8), rng.integers(0, 2, 30), rng.normal(size=(30, 2))


@pytest.fixture(scope="session")
def small_config() -> Config:
    return Config().with_values(k=200, random_rollouts=200)


@pytest.fixture(scope="session")
def small(small_config: Config) -> Learned:
    """A region of few training states, which takes about a second."""
    data = generate(0.5, small_config, seed=0)
    return data, learn_region(data, small_config)


@pytest.fixture(scope="session")
def full() -> dict[float, Learned]:
    """The regions of the replication, for every α of the paper."""
    sets = {alpha: generate(alpha, Config(), seed=0) for alpha in (0.0, 0.5, 1.0)}
    return {alpha: (data, learn_region(data, Config())) for alpha, data in sets.items()}


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The folders of small runs that nothing interrupted and that wrote no checkpoints, by name."""
    from runs import CASES

    folders = {case.name: tmp_path_factory.mktemp("whole") for case in CASES}
    for case in CASES:
        case.train(folders[case.name])
    return folders


@pytest.fixture
def window(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the off-screen figures pass for windows; none is open."""
    plt.close("all")
    plt.switch_backend("Agg")
    monkeypatch.setattr(FigureCanvasAgg, "required_interactive_framework", "some toolkit")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """End the report with how many bad inputs were tried, surface by surface."""
    passed = terminalreporter.stats.get("passed", [])
    rows = [value for report in passed for name, value in report.user_properties if name == "cases"]
    if rows:
        terminalreporter.write_line(pd.DataFrame(rows).to_string(index=False))


@pytest.fixture(scope="session")
def made_up(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Figures with the kept tables of the grid, and ten made-up seeds of it, by which the paper holds."""
    folder, table = tmp_path_factory.mktemp("figures"), measures()
    for name in ("full", "seeds_10"):
        (folder / name).mkdir()
        for path in (FIGURES / "full").glob("*.[cj]s*"):
            shutil.copy(path, folder / name)
    write_judged(folder / "full", table)
    for name in JUDGED:
        shutil.copy(folder / "full" / name, folder / "seeds_10")
    write_table(folder / "seeds_10" / "measures.csv", table)
    return folder


@pytest.fixture
def larger(made_up: Path, tmp_path: Path) -> Path:
    """A copy of `made_up` for a test to change."""
    shutil.copytree(made_up, tmp_path / "figures")
    return tmp_path / "figures"
