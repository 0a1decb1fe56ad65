"""The measures of joined claims: by hand, on small runs and regions that say what they are told."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from replication.evidence.joined_measures import (
    SATISFYING,
    common_errors,
    learning_measures,
    new_state_purity,
    promise_gap,
    success_log_odds,
)
from srlrepro.settings.config import Config
from srlrepro.storage.files import ResultError, write_json, write_table

CONFIG = Config().as_dict()
BEST = CONFIG["reward_constant"] * CONFIG["trial_length"] / CONFIG["control_period"]


class Stub:
    """A region whose Γ is the second coordinate, and whose y are the first two."""

    p_t = 0.8
    state_max = Config().paper.state_max

    def safety(self, x: np.ndarray) -> np.ndarray:
        return x[:, 1]

    def transform(self, x: np.ndarray) -> np.ndarray:
        return x[:, :2]


class Truth:
    """Labels that stand in the third coordinate."""

    def predict(self, x: np.ndarray) -> np.ndarray:
        return x[:, 2].astype(int)


REGION: Any = Stub()
REAL: Any = Truth()


def states(*rows: tuple[float, float, float]) -> np.ndarray:
    return np.pad(np.array(rows), ((0, 0), (0, 3)))


def run(folder: Path, *curve: float, alone: float = 0.25) -> Path:
    """A run of 1000 steps whose curve, and whose policy alone, have the given shares of a perfect trial."""
    final = {"no supervisor": {"return": BEST * alone}}
    write_json(folder / "run.json", {"config": CONFIG, "steps_done": 1000, "final_policy": final})
    steps = np.linspace(1000 / len(curve), 1000, len(curve))
    write_table(folder / "curve.csv", pd.DataFrame({"step": steps, "mean_return": BEST * np.array(curve)}))
    return folder


def test_when_a_run_has_learned(tmp_path: Path) -> None:
    """The first time counts, though it is lost again."""
    assert learning_measures(run(tmp_path / "a", 0.1, SATISFYING, 0.2, 0.9)) == pytest.approx(
        {"training_left": 0.5, "policy_alone_share": 0.25}
    )
    assert learning_measures(run(tmp_path / "b", 0.1, SATISFYING - 0.01))["training_left"] == 0.0
    assert learning_measures(run(tmp_path / "c", 0.9, alone=-3.0))["policy_alone_share"] == 0.0
    with pytest.raises(ResultError, match="missing result"):
        learning_measures(tmp_path / "none")


def test_log_odds() -> None:
    """Antisymmetric, finite at the ends, and ln(p / (1 - p)) of many cases."""
    assert success_log_odds(997_000, 3_000) == pytest.approx(math.log(0.997 / 0.003), abs=1e-3)
    assert success_log_odds(3, 8) == pytest.approx(-success_log_odds(8, 3))
    assert success_log_odds(10, 0) == pytest.approx(math.log(21))


def test_errors_on_common_states_by_hand() -> None:
    x = states((0, 0.9, 0), (0, 0.9, 1), (0, 0.1, 1), (0, 0.1, 1))
    assert common_errors(REGION, x, REAL.predict(x)) == {"common_error": 0.75, "common_false_positives": 0.25}


def test_the_promise_is_kept_where_k_takes_over() -> None:
    """Γ at the stops is 0.6 and 0.8, of which one is safe; accepted states and falls do not count."""
    stops = states((0, 0.6, 0), (0, 0.8, 1))
    others = states((0, 0.95, 0), (2.0, 0.1, 0), (-1.6, 0.1, 0))
    assert promise_gap(REGION, np.concatenate([stops, others]), REAL) == pytest.approx(0.5 - 0.7)
    assert math.isnan(promise_gap(REGION, others, REAL))


def test_purity_of_new_states() -> None:
    """Two clusters far apart with a label each are pure; with labels drawn by lot they are half so."""
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.normal(size=(200, 6)), rng.normal(size=(200, 6)) + 50.0])
    clusters = np.repeat([0, 1], 200)
    lot = rng.integers(0, 2, 400)
    assert new_state_purity(REGION, {"UD": (x, clusters), "MND": (x, clusters)}, 0, 400) == 1.0
    assert new_state_purity(REGION, {"UD": (x, lot), "MND": (x, clusters)}, 400, 400) == pytest.approx(
        0.5, abs=0.06
    )
