"""The measures: classification errors, shares, and what is read of runs."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from replication.evidence.claims import MEASURE_COLUMNS
from replication.evidence.measures import (
    LAST_SHARE,
    classification,
    first_link_shares,
    measure_rows,
    read_measures,
    read_runs,
    reliability,
    run_measures,
    write_measures,
)
from srlrepro.samplers import sample_uniform
from srlrepro.settings.config import Config
from srlrepro.storage.files import ResultError

CONFIG = Config()


class Stub:
    """A region whose Γ is the first coordinate."""

    p_t = 0.8

    def safety(self, x: np.ndarray) -> np.ndarray:
        return x[:, 0]


def states(*gamma: float) -> np.ndarray:
    x = np.zeros((len(gamma), 6))
    x[:, 0] = gamma
    return x


def test_errors_of_a_hypothesis_by_hand() -> None:
    scores: dict[str, Any] = classification(Stub(), states(0.9, 0.9, 0.1, 0.8), np.array([1, 0, 1, 0]))  # type: ignore[arg-type]
    expected = {"error": 0.5, "false_positives": 0.25, "false_negatives": 0.25, "accepted": 0.5, "safe": 0.5}
    expected |= {"precision": 0.5, "recall": 0.5, "brier": (0.01 + 0.81 + 0.81 + 0.64) / 4}
    assert scores == pytest.approx(expected)


def test_ratios_of_nothing_are_nan() -> None:
    scores = classification(Stub(), states(0.1, 0.2), np.array([0, 0]))  # type: ignore[arg-type]
    assert np.isnan(scores["precision"]) and np.isnan(scores["recall"]) and scores["error"] == 0


def test_a_calibrated_region_lies_on_the_diagonal() -> None:
    rng = np.random.default_rng(0)
    gamma = rng.uniform(size=50_000)
    table = reliability(Stub(), states(*gamma), (rng.uniform(size=50_000) < gamma).astype(int))  # type: ignore[arg-type]
    assert len(table) == 10
    assert np.allclose(table["predicted"], table["observed"], atol=0.03)


def test_shares_of_the_first_links_plane() -> None:
    """Under UD, 1/4 lies near the origin and 1/8 in the two corners of opposite signs."""
    x = sample_uniform(100_000, CONFIG.paper.state_max, np.random.default_rng(0))
    shares = first_link_shares(x, CONFIG)
    assert shares["near_origin_share"] == pytest.approx(1 / 4, abs=0.01)
    assert shares["corner_share"] == pytest.approx(1 / 8, abs=0.01)
    corner = np.array(
        [[1.5, 0, 0, -9, 0, 0], [1.5, 0, 0, 9, 0, 0], [-1.5, 0, 0, 9, 0, 0], [0, 0, 0, 0, 0, 0]]
    )
    assert first_link_shares(corner, CONFIG) == {"near_origin_share": 0.25, "corner_share": 0.5}


def test_measures_round_trip(tmp_path: Path) -> None:
    """α stays text, also "none" and "0.5"."""
    write_measures(tmp_path / "a.csv", measure_rows({"m": 1.0}, "none", 1.1, 0))
    write_measures(tmp_path / "b.csv", measure_rows({"m": 2.0, "n": 3.0}, "0.5", seed=1))
    table = read_measures(tmp_path)
    assert tuple(table.columns) == MEASURE_COLUMNS
    assert table["alpha"].tolist() == ["none", "0.5", "0.5"] and table["value"].tolist() == [1.0, 2.0, 3.0]
    assert read_measures(tmp_path / "empty").empty


def test_measures_of_a_run_by_hand() -> None:
    steps = 100 * LAST_SHARE
    trials = pd.DataFrame({"step": [10, steps - 50, steps], "return": [-1000.0, 100.0, 300.0]})
    counts = {"activations": 5, "recovered": 3, "hit_the_ground": 1, "not_recovered_in_time": 0, "falls": 2}
    config = CONFIG.as_dict()
    best = config["reward_constant"] * config["trial_length"] / config["control_period"]
    result = {
        "counts": counts,
        "steps_done": steps,
        "config": config,
        "final_policy": {"own condition": {"return": best / 2}},
    }
    measures = run_measures(result, trials)
    assert measures == pytest.approx(
        {
            "final_return": 200.0,
            "violations_per_1000_steps": 3.0,
            "policy_return_share": 0.5,
            "success_rate": 0.75,
        }
    )
    free = result | {"counts": counts | {"recovered": 0, "hit_the_ground": 0}}
    measures = run_measures(free, trials)  # with 5 activations where K was not tried
    assert "success_rate" not in measures and measures["violations_per_1000_steps"] == 2.0


def test_a_missing_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="missing result"):
        read_runs(tmp_path, ["alpha_0__delta_1.1__seed_0"])
