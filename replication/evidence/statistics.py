"""Estimates and 95 % intervals for few runs; the run (or the dataset) is the unit, never what happens in it.

Three seeds leave two degrees of freedom. The simulations in ``tests/evidence/test_statistics.py`` decided
which interval is used. The t-interval covers the mean of 3 or of 10 normal values in 95 % of the cases; the
percentile bootstrap does so in 3 of 4 cases at n = 3, and it and BCa in 9 of 10 at n = 10. Where values are
skewed the t-interval misses its level too, but by less. For two-humped values (some runs learn, others do
not) no interval of three seeds keeps its level: three runs of one kind say nothing of the other. So means
have t-intervals at every n; the bootstrap is left to statistics over many cells, which have no formula.
"""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import pandas as pd
from numpy.random import Generator
from numpy.typing import ArrayLike
from scipy import stats

from srlrepro.dynamics.pendulum import Floats

LEVEL = 0.95
RESAMPLES = 5000  # an end of an interval is the 125th of the ordered resamples

Bounds = tuple[float, float]


def half_width(spread: ArrayLike, n: ArrayLike, level: float = LEVEL) -> Floats:
    """Half of the width of Student's t-interval of a mean of n values.

    spread: their sample standard deviation. Value by value; NaN for fewer than two values, which tell nothing
    of their spread.
    """
    count = np.asarray(n, np.float64)
    return np.asarray(stats.t.ppf((1 + level) / 2, count - 1) * np.asarray(spread) / count**0.5)


def contrast_interval(
    groups: Sequence[Floats], weights: Sequence[float], constant: float = 0.0, level: float = LEVEL
) -> tuple[float, float, float]:
    """(estimate, low, high) of a weighted sum of the means of independent groups, less a constant.

    Welch's interval with Satterthwaite's degrees of freedom: the groups may differ in spread and in size. For
    one group it is the t-interval. Without an interval (NaN) if a group has one value, and without an
    estimate if one has none.

    Args:
        groups: the values of each group, [n] each.
        weights: one for each group.
    """
    if min(map(len, groups)) == 0:
        return math.nan, math.nan, math.nan
    estimate = sum(w * float(g.mean()) for w, g in zip(weights, groups, strict=True)) - constant
    if min(map(len, groups)) == 1:
        return estimate, math.nan, math.nan
    count = np.array([len(g) for g in groups])
    parts = np.square(weights) * np.array([g.var(ddof=1) for g in groups]) / count
    if not parts.any():  # no group varies
        return estimate, estimate, estimate
    freedom = parts.sum() ** 2 / (parts**2 / (count - 1)).sum()
    half = float(stats.t.ppf((1 + level) / 2, freedom) * parts.sum() ** 0.5)
    return estimate, estimate - half, estimate + half


def prediction_interval(values: Floats, level: float = LEVEL, share: float = 1.0, runs: int = 3) -> Bounds:
    """(low, high) in which the mean of further runs, all on one new dataset, is to be expected.

    Args:
        values: [n], one for each of n runs, each with a dataset of its own.
        share: of their variance, ρ, that is the dataset's. With all of it (1), which n such values cannot
            rule out, the interval is the widest: further runs on one dataset do not average it out.
        runs: how many the mean is of; the paper's is of three.

    Returns:
        mean ± t s √(ρ + (1 − ρ) / runs + 1/n), t of n − 1 degrees of freedom; NaN for fewer than two values.
    """
    n = len(values)
    if n < 2:
        return math.nan, math.nan
    spread = float(values.std(ddof=1)) * math.sqrt(share + (1 - share) / runs + 1 / n)
    half = float(stats.t.ppf((1 + level) / 2, n - 1)) * spread
    return float(values.mean()) - half, float(values.mean()) + half


def share_interval(
    successes: int, n: int, level: float = LEVEL, method: Literal["exact", "wilson"] = "exact"
) -> Bounds:
    """(low, high) of a share of n, by Clopper and Pearson (1934) or Wilson (1927), nearer to the level."""
    if n < 1:
        return float("nan"), float("nan")
    interval = stats.binomtest(successes, n).proportion_ci(level, method=method)
    return float(interval.low), float(interval.high)


def interquartile_mean(values: ArrayLike, axis: int = 0) -> Floats:
    """Mean of the middle half of the values along an axis (Agarwal et al., 2021); no few runs decide it."""
    return np.asarray(stats.trim_mean(np.asarray(values), 0.25, axis=axis))


def stratified_bootstrap(cells: Sequence[ArrayLike], rng: Generator) -> Bounds:
    """95 % interval of the interquartile mean over all cells, by the percentile bootstrap.

    Runs are drawn within each cell. cells: the values [n] of the runs of each condition; NaN if a cell has
    fewer than two.
    """
    if min(map(np.size, cells)) < 2:
        return float("nan"), float("nan")

    def over_cells(*samples: Floats, axis: int = -1) -> Floats:
        return interquartile_mean(np.concatenate(samples, axis=axis), axis=axis)

    data = tuple(map(np.asarray, cells))
    found = stats.bootstrap(
        data, over_cells, n_resamples=RESAMPLES, confidence_level=LEVEL, method="percentile", axis=-1, rng=rng
    ).confidence_interval
    return float(found.low), float(found.high)


def final_performance(measures: pd.DataFrame, best: float) -> pd.DataFrame:
    """Interquartile means over all cells of each condition, with the intervals of `stratified_bootstrap`.

    Args:
        measures: a table of measures, as of `claims`.
        best: return of a perfect trial, in shares of which all are given.

    Returns:
        measure (in words), condition, runs, IQM, low, high: of the final return, and of the final policy's.
    """
    rows = []
    units = {"final_return": best, "policy_return_share": 1.0, "policy_alone_share": 1.0}
    for measure, unit in units.items():
        for alpha, runs in measures[measures["measure"] == measure].groupby("alpha"):
            cells = [values.to_numpy() / unit for _, values in runs.groupby("delta")["value"]]
            bounds = stratified_bootstrap(cells, np.random.default_rng(0))
            middle = float(interquartile_mean(np.concatenate(cells)))
            rows.append((measure.replace("_", " "), alpha, len(runs), middle, *bounds))
    return pd.DataFrame(rows, columns=["measure", "condition", "runs", "IQM", "low", "high"])
