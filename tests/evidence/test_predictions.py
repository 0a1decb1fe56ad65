"""Predictions: where an interval lies, and the table of their states."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from replication.evidence.predictions import EXPECTED, FAILS, HOLDS, OPEN, judge, state_of


@pytest.mark.parametrize(
    ("low", "high", "states"),
    [
        (0.05, 0.15, [OPEN, OPEN, OPEN]),  # on both sides of the bound
        (-0.3, 0.05, [FAILS, HOLDS, OPEN]),
        (0.2, 0.3, [HOLDS, FAILS, FAILS]),
        (-0.05, 0.05, [FAILS, HOLDS, HOLDS]),
        (0.1, 0.1, [HOLDS, HOLDS, HOLDS]),
        (np.nan, np.nan, [OPEN, OPEN, OPEN]),  # a single dataset has no interval
    ],
)
def test_an_interval_holds_where_all_of_it_lies_as_expected(
    low: float, high: float, states: list[str]
) -> None:
    assert [state_of(expected, 0.1, low, high) for expected in EXPECTED] == states


def test_the_table_has_the_t_interval_of_the_mean() -> None:
    values = np.array([0.3, 0.5, 0.7, 0.4])
    told = SimpleNamespace(id="a", statement="it is above 0", expected="above", bound=0.0)
    (row,) = judge([(told, values)]).to_dict("records")
    ends = stats.t.interval(0.95, 3, values.mean(), stats.sem(values))
    assert (row["id"], row["prediction"], row["datasets"], row["state"]) == ("a", "it is above 0", 4, HOLDS)
    assert (row["estimate"], row["low"], row["high"]) == pytest.approx((values.mean(), *ends))
    (row,) = judge([(told, values[:0])]).to_dict("records")
    assert row["datasets"] == 0 and row["state"] == OPEN and np.isnan(row["estimate"])
