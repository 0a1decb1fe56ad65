"""What was predicted before a run, and whether the intervals say so.

A prediction says where an interval will lie: above or below a bound, or within ± it. It *holds* where the
whole interval lies there, *fails* where the whole interval lies elsewhere, and is *open* otherwise.
"""

from collections.abc import Iterable
from typing import Protocol

import numpy as np
import pandas as pd

from replication.evidence.statistics import contrast_interval
from srlrepro.dynamics.pendulum import Floats

EXPECTED = ("above", "below", "within")
HOLDS, FAILS, OPEN = "holds", "fails", "open"


class Predicted(Protocol):
    """A prediction: its id, its statement, and on which side (`EXPECTED`) of which bound it lies."""

    @property
    def id(self) -> str: ...
    @property
    def statement(self) -> str: ...
    @property
    def expected(self) -> str: ...
    @property
    def bound(self) -> float: ...


def state_of(expected: str, bound: float, low: float, high: float) -> str:
    """Whether an interval lies above or below a bound, or within ± it; `OPEN` if neither, or without one."""
    least = {"above": bound, "below": -np.inf, "within": -bound}[expected]
    most = {"above": np.inf, "below": bound, "within": bound}[expected]
    if least <= low and high <= most:
        return HOLDS
    return FAILS if high < least or low > most else OPEN


def judge(found: Iterable[tuple[Predicted, Floats]]) -> pd.DataFrame:
    """Predictions, each with its values [datasets], as a table with the 95 % t-intervals of their means.

    Returns:
        id, prediction, datasets, estimate, low, high, state.
    """
    rows = []
    for p, values in found:
        estimate, low, high = contrast_interval([values], [1.0])
        state = state_of(p.expected, p.bound, low, high)
        rows.append((p.id, p.statement, len(values), estimate, low, high, state))
    columns = ["id", "prediction", "datasets", "estimate", "low", "high", "state"]
    return pd.DataFrame(rows, columns=columns)
