"""The measures: of hypotheses, of data and regions, and of trained runs; by hand where that is possible."""

import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from learned import Learned

from replication.__main__ import main
from replication.evidence.claims import MEASURE_COLUMNS
from replication.evidence.measures import (
    BUDGETS,
    LAST_SHARE,
    SATISFYING,
    classification,
    errors,
    first_link_shares,
    held_out_states,
    labelled,
    learning,
    log_odds,
    measure_budgets,
    measure_data,
    measure_hypothesis,
    measure_regions,
    measure_rows,
    measure_run,
    new_state_purity,
    promise_gap,
    read_measures,
    recoveries,
    reliability,
    write_measures,
)
from replication.evidence.results import TrainedRun, read_run_measures
from replication.studies.alternatives import learn_hypothesis
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.samplers import sample_uniform
from srlrepro.settings.condition import Condition
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError
from srlrepro.storage.files import ResultError

CONFIG = Config()
BEST = 800.0  # 2 for each of the 400 control periods of a trial
SUPERVISED, FREE = Condition(0.5, 4.0, 1), Condition(None, 4.0, 1)
WriteRun = Callable[..., TrainedRun]


class Stub:
    """A region whose Γ is the first coordinate within [0, 1], and whose y are the first two."""

    p_t = 0.8
    arrays_ = SimpleNamespace(scale=np.array(Config().paper.state_max))

    def safety(self, x: np.ndarray) -> np.ndarray:
        return np.clip(x[:, 0], 0, 1)

    def transform(self, x: np.ndarray) -> np.ndarray:
        return x[:, :2]

    def digest(self) -> str:
        return "stub"


class Truth:
    """Labels that stand in the third coordinate."""

    def predict(self, x: np.ndarray) -> np.ndarray:
        return x[:, 2].astype(int)


REGION: Any = Stub()
REAL: Any = Truth()


def states(*gamma: float) -> np.ndarray:
    x = np.zeros((len(gamma), 6))
    x[:, 0] = gamma
    return x


def test_errors_of_a_hypothesis_by_hand() -> None:
    scores: dict[str, Any] = classification(REGION, states(0.9, 0.9, 0.2, 0.8), np.array([1, 0, 1, 0]))
    expected = {"error": 0.5, "false_positives": 0.25, "false_negatives": 0.25, "accepted": 0.5, "safe": 0.5}
    expected |= {"precision": 0.5, "recall": 0.5, "brier": (0.01 + 0.81 + 0.64 + 0.64) / 4}
    assert scores == pytest.approx(expected)


def test_ratios_of_nothing_are_nan() -> None:
    scores = classification(REGION, states(0.1, 0.2), np.array([0, 0]))
    assert np.isnan(scores["precision"]) and np.isnan(scores["recall"]) and scores["error"] == 0


def test_a_calibrated_region_lies_on_the_diagonal() -> None:
    rng = np.random.default_rng(0)
    gamma = rng.uniform(size=50_000)
    table = reliability(REGION, states(*gamma), (rng.uniform(size=50_000) < gamma).astype(int))
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


def test_purity_of_new_states() -> None:
    """Two clusters far apart with a label each are pure; with labels drawn by lot they are half so."""
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.normal(size=(200, 6)), rng.normal(size=(200, 6)) + 50.0])
    clusters, lot = np.repeat([0, 1], 200), rng.integers(0, 2, 400)
    assert new_state_purity(REGION, {"UD": (x, clusters), "MND": (x, clusters)}, 0, 400) == 1.0
    by_lot = new_state_purity(REGION, {"UD": (x, lot), "MND": (x, clusters)}, 400, 400)
    assert by_lot == pytest.approx(0.5, abs=0.06)


def test_data_and_regions_are_measured_on_the_same_fresh_states(small: Learned, small_config: Config) -> None:
    """Every value is a share; the rows are those of the single functions, on states that the seed draws."""
    data, region = small
    rows = measure_regions({"0.5": small, "1": small}, small_config, 3)
    assert {row[1:4] for row in rows} == {("0.5", None, 3), ("1", None, 3)}
    found = {row[0]: row[4] for row in rows if row[1] == "0.5"}
    assert found == {row[0]: row[4] for row in rows if row[1] == "1"}
    assert all(0 <= value <= 1 for value in found.values())
    assert {"state_purity", "embedding_purity", "new_state_purity"} < found.keys()
    fresh = held_out_states(data.mnd, small_config, np.random.default_rng([3, 1]))
    of_hypothesis = measure_hypothesis(data, region, fresh, small_config)
    assert (
        measure_data(data, small_config).items() <= found.items() and of_hypothesis.items() <= found.items()
    )
    scores = [classification(region, *fresh[source]) for source in ("UD", "MND")]
    assert found["accepted_share"] == pytest.approx((scores[0]["accepted"] + scores[1]["accepted"]) / 2)
    assert found["recall_MND"] == scores[1]["recall"]
    assert measure_regions({}, small_config, 0) == []


def test_how_well_a_run_has_learned_by_hand(write_run: WriteRun) -> None:
    """The last tenth of the steps counts for the return, and the first time that a curve is high enough."""
    steps = 100 * LAST_SHARE
    trials = {"step": [10, steps - 50, steps], "return": [-1000.0, 100.0, 300.0]}
    curve = BEST * np.array([0.1, SATISFYING, 0.2, 0.9])
    returns = {"own condition": BEST / 2, "no supervisor": BEST / 4}
    assert learning(write_run(trials=trials, curve=curve, returns=returns)) == pytest.approx(
        {
            "final_return": 200.0,
            "policy_return_share": 0.5,
            "policy_alone_share": 0.25,
            "training_left": 0.5,
            "last_mean_length": 4.0,
        }
    )
    never = learning(write_run(curve=[BEST * (SATISFYING - 0.01)], returns={"no supervisor": -3 * BEST}))
    assert never["training_left"] == 0.0 and never["policy_alone_share"] == 0.0


def test_a_run_is_judged_as_if_it_had_ended_sooner(write_run: WriteRun, tmp_path: Path) -> None:
    """Six budgets of 100 steps each: the last tenth of each, and the first evaluation from its end on."""
    trials = {"step": [95, 100, 101, 199, 600], "return": [1.0, 3.0, 100.0, 5.0, 7.0]}
    curve = BEST * np.array([0.1, 0.9, 0.2])  # at steps 200, 400 and 600
    evaluations = {"step": [110, 210, 600], "return": [-BEST, BEST / 2, BEST]}
    run = write_run(steps=600, trials=trials, curve=curve, evaluations=evaluations)
    rows = pd.DataFrame(measure_budgets(run), columns=["measure", "alpha", "delta", "seed", "step", "value"])
    found = rows.pivot_table(index="step", columns="measure", values="value", dropna=False)
    assert found.index.tolist() == [100, 200, 300, 400, 500, 600] and BUDGETS == 6
    np.testing.assert_array_equal(found["final_return"], [2.0, 5.0, np.nan, np.nan, np.nan, 7.0])
    np.testing.assert_allclose(found["policy_alone_share"], [0.0, 0.5, 1.0, 1.0, 1.0, 1.0])
    np.testing.assert_allclose(found["training_left"], [0, 0, 0, 0, 1 / 5, 1 / 3])
    out = tmp_path / "budgets.csv"
    assert main(["budgets", str(run.folder), "--out", str(out)]) == 0
    pd.testing.assert_frame_equal(
        pd.read_csv(out, keep_default_na=False, na_values=""), rows, check_dtype=False
    )


def test_what_k_had_to_do_by_hand(write_run: WriteRun) -> None:
    counts = {"trials": 20, "activations": 5, "recovered": 3, "hit_the_ground": 1, "falls": 2}
    expected = {"activations": 5, "failures": 1, "falls": 2, "violations_per_1000_steps": 3.0}
    expected |= {"activated_share": 0.25}
    rates = {"success_rate": 0.75, "success_log_odds": math.log(3.5 / 1.5)}
    assert recoveries(write_run(counts=counts)) == pytest.approx(expected | rates)
    untried = recoveries(write_run(counts=counts | {"recovered": 0, "hit_the_ground": 0}))
    assert "success_rate" not in untried and untried["violations_per_1000_steps"] == 2.0
    assert untried["success_log_odds"] == 0.0 and "success_log_odds" not in recoveries(write_run())


def test_log_odds() -> None:
    """Antisymmetric, finite at the ends, and ln(p / (1 - p)) of many cases."""
    assert log_odds(997_000, 3_000) == pytest.approx(math.log(0.997 / 0.003), abs=1e-3)
    assert log_odds(3, 8) == pytest.approx(-log_odds(8, 3))
    assert log_odds(10, 0) == pytest.approx(math.log(21))


@pytest.mark.parametrize(("apart", "every"), [(75, 1), (25, 1), (12, 2), (7, 3), (1, 25)])
def test_labelled_states_are_spread_over_the_training(apart: int, every: int) -> None:
    """One in ``every`` of states that were kept ``apart`` steps from each other, with their labels."""
    visited = sample_uniform(100, CONFIG.paper.state_max, np.random.default_rng(0))
    real = ClosedLoop.from_config(CONFIG, 4.0)
    x, labels = labelled(visited, real, 100 * apart)
    assert np.array_equal(x, visited[::every]) and np.array_equal(labels, real.predict(visited)[::every])


def test_the_promise_is_kept_where_k_takes_over() -> None:
    """Γ at the stops is 0.6 and 0.8, of which one is safe; accepted states and falls do not count."""
    x = states(0.6, 0.8, 0.95, -1.6, -2.0)
    x[1, 2] = 1.0
    assert promise_gap(REGION, x, REAL) == pytest.approx(0.5 - 0.7)
    assert math.isnan(promise_gap(REGION, x[2:], REAL))


def test_errors_are_of_the_real_system_on_own_and_on_common_states(write_run: WriteRun) -> None:
    """Labels are those of the run's own Δ, on the states of the run itself and of the free one."""
    own, other = (sample_uniform(40, CONFIG.paper.state_max, np.random.default_rng(i)) for i in (1, 2))
    run, free = write_run(SUPERVISED, visited=own), write_run(FREE, visited=other)
    real = ClosedLoop.from_config(CONFIG, 4.0)
    assert (real.predict(own) != ClosedLoop.from_config(CONFIG).predict(own)).any()
    scores, common = (classification(REGION, r.visited(), real.predict(r.visited())) for r in (run, free))
    expected = {"generalization_error": scores["error"], "false_positives": scores["false_positives"]}
    assert errors(run, REGION, None) == expected | {"brier": scores["brier"]}
    assert errors(run, REGION, free).items() - errors(run, REGION, None).items() == {
        ("common_error", common["error"]),
        ("common_false_positives", common["false_positives"]),
    }


def test_a_run_is_measured_with_its_own_region_and_free_run(write_run: WriteRun) -> None:
    safe = np.full((8, 6), 0.01)
    run, free = write_run(SUPERVISED, region="stub", visited=safe), write_run(FREE, visited=safe)
    rows = measure_run(run, REGION, free)
    assert {row[1:4] for row in rows} == {("0.5", 4.0, 1)}
    assert {"final_return", "activations", "brier", "common_error"} < {row[0] for row in rows}
    assert {row[1] for row in measure_run(free)} == {"none"}
    for message, refused in {
        "region = None": (run, None, None),
        "common": (free, None, free),
        "exactly if alpha": (free, REGION, None),
        "region = stub: must be other": (write_run(SUPERVISED, region="other"), REGION, None),
        "common = alpha_0.5": (run, REGION, run),
        "common = alpha_none__delta_4__seed_2": (run, REGION, write_run(Condition(None, 4.0, 2))),
    }.items():
        with pytest.raises(ParameterError, match=message):
            measure_run(*refused)
    with pytest.raises(ResultError, match="steps = 500, not with 1000"):
        measure_run(run, REGION, write_run(FREE, steps=500))


def test_the_command_measures_a_run(
    write_run: WriteRun, small: Learned, small_config: Config, tmp_path: Path
) -> None:
    """With the region of a file, and for another hypothesis with what is learned of the data beside it."""
    data, region = small
    region.save(tmp_path / "region.npz")
    data.save(tmp_path / "training_data.npz")
    free = write_run(FREE, config=small_config)
    run = write_run(SUPERVISED, config=small_config, region=region.digest())
    out = run.folder / "measures.csv"
    given = ["--region", str(tmp_path / "region.npz")]
    assert main(["measure", str(run.folder), "--out", str(out), *given, "--common", str(free.folder)]) == 0
    table = read_run_measures(tmp_path, [SUPERVISED.name]).set_index("measure")["value"]
    assert {"common_error", "promise_gap"} < set(table.index)
    assert main(["measure", str(free.folder / "run.json"), "--out", str(tmp_path / "free.csv")]) == 0
    known = small_config.with_values(hypothesis="nominal")
    write_run(SUPERVISED, config=known, region=learn_hypothesis(None, known).digest())
    assert main(["measure", str(run.folder), "--out", str(out), *given]) == 0
    write_run(SUPERVISED, config=small_config, region="other")
    with pytest.raises(SystemExit, match="2"):
        main(["measure", str(run.folder), "--out", str(out), *given])


def test_measures_round_trip(tmp_path: Path) -> None:
    """α stays text, also "none" and "0.5"; a place is a table or a folder."""
    write_measures(tmp_path / "a.csv", measure_rows({"m": 1.0}, "none", 1.1, 0))
    write_measures(tmp_path / "b.csv", measure_rows({"m": 2.0, "n": 3.0}, "0.5", seed=1))
    table = read_measures(tmp_path)
    assert tuple(table.columns) == MEASURE_COLUMNS
    assert table["alpha"].tolist() == ["none", "0.5", "0.5"] and table["value"].tolist() == [1.0, 2.0, 3.0]
    assert read_measures(tmp_path / "b.csv", tmp_path / "a.csv")["value"].tolist() == [2.0, 3.0, 1.0]
    (tmp_path / "empty").mkdir()
    assert read_measures(tmp_path / "empty").empty
    with pytest.raises(ResultError, match="missing result"):
        read_measures(tmp_path / "c.csv")
