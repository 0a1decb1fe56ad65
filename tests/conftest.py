"""What the tests share. Every number is drawn from a seed or follows from a formula; none is read from a file."""

import os
from collections.abc import Callable

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pytest

from srlrepro.config import Config
from srlrepro.labels import ClosedLoop
from srlrepro.pendulum import Floats
from srlrepro.safe_region import SafeRegion
from srlrepro.sampling import TrainingData, generate

Fitted = tuple[TrainingData, Floats, SafeRegion]


def pytest_configure(config: pytest.Config) -> None:
    """Make the marker known where the project's settings are not read."""
    config.addinivalue_line("markers", "slow: takes more than about five seconds")


def fit(alpha: float, config: Config, seed: int = 0) -> Fitted:
    """Training data, their trajectories at the instants that ω compares, and the region fitted to them."""
    data = generate(alpha, config, seed)
    choices = config.choices
    loop = ClosedLoop.from_config(config.with_values(recovery_horizon=choices.omega_horizon))
    paths = loop.rollout(data.x).paths[:, :: round(choices.omega_step / choices.control_period)]
    return data, paths, SafeRegion.from_config(config, seed).fit(data.x, data.z, paths)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)


@pytest.fixture(scope="session")
def draw() -> Callable[..., Floats]:
    """draw(n, seed): n states, uniform over the state space of the paper."""
    high = np.array(Config().paper.state_max)
    return lambda n, seed=0: np.random.default_rng(seed).uniform(-high, high, (n, 6))


@pytest.fixture(scope="session")
def small_config() -> Config:
    return Config().with_values(k=200, random_rollouts=200)


@pytest.fixture(scope="session")
def small(small_config: Config) -> Fitted:
    return fit(0.5, small_config)


@pytest.fixture(scope="session")
def full() -> dict[float, Fitted]:
    """The regions of the replication, for every α of the paper."""
    return {alpha: fit(alpha, Config()) for alpha in (0.0, 0.5, 1.0)}
