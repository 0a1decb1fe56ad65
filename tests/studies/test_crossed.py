"""Variance components: closed forms, and their estimator and interval on simulated designs."""

import numpy as np
import pandas as pd
import pytest

from replication.evidence.predictions import FAILS, HOLDS, OPEN
from replication.studies.crossed import JUDGED, component_table, components, predicted, sentences
from srlrepro.settings.fields import ParameterError

RNG = np.random.default_rng


def test_effects_without_a_residual_have_the_variances_of_their_means() -> None:
    """v_ij = a_i + b_j: the sample variances of a and of b, exactly."""
    a, b = np.array([0.0, 3.0, 9.0]), np.array([1.0, 2.0, 2.5, 6.0])
    found = components(a[:, None] + b[None, :], RNG(0))
    assert found[:3] == pytest.approx((a.var(ddof=1), b.var(ddof=1), 0), abs=1e-12)
    assert found.share == pytest.approx(a.var(ddof=1) / (a.var(ddof=1) + b.var(ddof=1)))
    turned = components((a[:, None] + b[None, :]).T, RNG(0))
    assert turned[:2] == pytest.approx(found[1::-1])


def test_the_share_keeps_its_value_where_the_unit_changes() -> None:
    values = RNG(1).normal(size=(4, 4))
    assert components(7 - 3 * values, RNG(0))[3:] == pytest.approx(components(values, RNG(0))[3:])


@pytest.mark.parametrize(
    "values", [np.zeros((4, 4)), np.ones(4), np.arange(4.0)[None, :], np.full((2, 2), np.nan)]
)
def test_what_cannot_be_told_apart_is_refused(values: np.ndarray) -> None:
    with pytest.raises(ParameterError, match="values"):
        components(values, RNG(0))


@pytest.mark.parametrize("variances", [(0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (4.0, 1.0, 1.0), (0.2, 2.0, 1.0)])
def test_estimates_are_right_on_average_and_intervals_keep_their_level(
    variances: tuple[float, float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """400 designs of 4 × 4: mean squares within 4 standard errors; ρ is covered in 93 of 100 at least."""
    monkeypatch.setattr("replication.studies.crossed.DRAWS", 1000)
    rng, (d, l, e) = RNG(5), np.sqrt(variances)
    share, covered, squares = variances[0] / sum(variances), 0, []
    for _ in range(400):
        v = rng.normal(0, d, (4, 1)) + rng.normal(0, l, (1, 4)) + rng.normal(0, e, (4, 4))
        found = components(v, rng)
        covered += found.low <= share <= found.high
        squares.append((found.residual, 4 * v.mean(axis=1).var(ddof=1), 4 * v.mean(axis=0).var(ddof=1)))
    expected = variances[2], 4 * variances[0] + variances[2], 4 * variances[1] + variances[2]
    mean, error = np.mean(squares, axis=0), np.std(squares, axis=0) / 20
    assert (np.abs(mean - expected) < 4 * error).all()
    assert covered >= 372


def test_the_table_leaves_out_a_dataset_that_lacks_a_run() -> None:
    values = RNG(3).normal(size=(4, 4))
    rows = [("final_return", "0", d, s, values[d, s]) for d in range(4) for s in range(4) if (d, s) != (1, 2)]
    rows += [("policy_alone_share", "0", d, s, 1.0) for d in range(4) for s in range(4)]
    rows += [("safe_share", "0", 0, 0, 0.5)]
    table = component_table(pd.DataFrame(rows, columns=["measure", "alpha", "dataset", "seed", "value"]))
    assert table["measure"].tolist() == ["final_return", "policy_alone_share"]
    assert table["datasets"].tolist() == [3, 4] and table["learners"].tolist() == [4, 4]
    three = components(values[[0, 2, 3]], RNG(17))
    assert table.loc[0, "share"] == three.share and table.loc[0, "high"] == three.high
    assert np.isnan(table.loc[1, "share"]) and table.loc[1, "mean"] == 1
    said = sentences(table)
    assert len(said) == len(JUDGED) and f"α = 0: {three.share:.0%} [" in said[3] and "not known" in said[4]


def test_predictions_about_half_of_the_variance_are_judged_by_the_interval() -> None:
    ends = {
        ("success_log_odds", "0"): (0.6, 0.9),
        ("success_log_odds", "0.5"): (0.4, 0.9),
        ("policy_alone_share", "0"): (0.0, 0.4),
        ("policy_alone_share", "0.5"): (0.6, 0.9),
    }
    rows = [(*cell, low, high) for cell, (low, high) in ends.items()]
    told = predicted(pd.DataFrame(rows, columns=["measure", "alpha", "low", "high"]))
    assert [list(states.values()) for _, states in told] == [[HOLDS, OPEN], [HOLDS, FAILS, OPEN]]
    assert told[0][0] == "more than half for the log odds that K succeeds"
    assert list(told[1][1]) == ["α = 0", "α = 0.5", "α = 1"]  # the last was not measured
