"""Intervals: closed forms, scipy as second method, and how often they cover the truth, by simulation."""

import math
from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from numpy.random import Generator
from scipy import stats

from replication.evidence.statistics import (
    LEVEL,
    contrast_interval,
    final_performance,
    half_width,
    interquartile_mean,
    prediction_interval,
    share_interval,
    stratified_bootstrap,
)
from srlrepro.dynamics.pendulum import Floats

SAMPLES, RESAMPLES = 1500, 600
Draw = Callable[[Generator, tuple[int, int]], Floats]
# (draw, mean): normal; two-humped, as where some runs learn; skewed, as of rates near 1
SHAPES: dict[str, tuple[Draw, float]] = {
    "normal": (lambda rng, size: rng.normal(size=size), 0.0),
    "two-humped": (
        lambda rng, size: np.where(rng.random(size) < 0.7, 0.2, 0.9) + 0.04 * rng.normal(size=size),
        0.41,
    ),
    "skewed": (lambda rng, size: rng.beta(9.5, 0.5, size=size), 0.95),
}


def t_interval(x: Floats) -> tuple[Floats, Floats]:
    """Of each row of x [S, n]."""
    half = half_width(x.std(1, ddof=1), x.shape[1])
    return x.mean(1) - half, x.mean(1) + half


def bootstrap(x: Floats, rng: Generator, method: str) -> tuple[Floats, Floats]:
    """Of each row of x [S, n]: the percentile bootstrap, or bias-corrected and accelerated (Efron, 1987)."""
    n = x.shape[1]
    means = x[:, rng.integers(n, size=(RESAMPLES, n))].mean(-1)
    ends = np.tile([(1 - LEVEL) / 2, (1 + LEVEL) / 2], (len(x), 1))
    if method == "BCa":
        middle = x.mean(1, keepdims=True)
        share = (means < middle).mean(1) + 0.5 * (means == middle).mean(1)
        bias = stats.norm.ppf(np.clip(share, 1 / RESAMPLES, 1 - 1 / RESAMPLES))[:, None]
        deviation = x - middle  # of the leave-one-out means, but for a factor that cancels
        skew = (deviation**3).sum(1) / (6 * (deviation**2).sum(1) ** 1.5)
        z = bias + stats.norm.ppf(ends)
        ends = stats.norm.cdf(bias + z / (1 - skew[:, None] * z))
    low, high = (
        np.array([np.quantile(m, e) for m, e in zip(means, column, strict=True)]) for column in ends.T
    )
    return low, high


def coverage(shape: str, n: int, method: str) -> float:
    """Share of samples of n values whose interval contains the true mean."""
    rng = np.random.default_rng([n, 8])
    draw, mean = SHAPES[shape]
    x = draw(rng, (SAMPLES, n))
    low, high = t_interval(x) if method == "t" else bootstrap(x, rng, method)
    return float(((low <= mean) & (mean <= high)).mean())


@pytest.mark.parametrize("n", [3, 10])
def test_the_t_interval_keeps_its_level_and_no_bootstrap_does(n: int) -> None:
    """Why means have t-intervals: at n = 3 the percentile bootstrap is little more than [min, max]."""
    assert coverage("normal", n, "t") == pytest.approx(LEVEL, abs=0.015)
    for method in ("percentile", "BCa"):
        assert coverage("normal", n, method) < (0.80 if n == 3 else 0.91)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("n", [3, 10])
def test_the_t_interval_is_the_best_of_the_three_for_other_shapes(shape: str, n: int) -> None:
    """Or as good as the best, up to the error of the simulation."""
    t, *others = (coverage(shape, n, method) for method in ("t", "percentile", "BCa"))
    assert t > max(others) - 0.02


def test_no_interval_of_three_seeds_knows_a_second_hump() -> None:
    """Seven of ten runs alike: in 0.7³ + 0.3³ = 37 % of the cases three seeds show one kind only."""
    for method in ("t", "percentile", "BCa"):
        assert coverage("two-humped", 3, method) < 0.70
    assert coverage("two-humped", 10, "t") > 0.93


def test_interval_of_a_mean_by_scipy() -> None:
    values = np.array([1.0, 2.0, 6.0])
    expected = stats.ttest_1samp(values, 0.0).confidence_interval(0.9)
    found = contrast_interval([values], [1.0], level=0.9)
    assert found == pytest.approx((3.0, expected.low, expected.high))
    assert found[2] - found[0] == pytest.approx(float(half_width(values.std(ddof=1), 3, 0.9)))
    assert half_width(1.0, 3) == pytest.approx(4.303 / math.sqrt(3), abs=1e-3)
    assert contrast_interval([np.full(5, 1.0)], [-1.0], constant=2.0) == (-3.0, -3.0, -3.0)


def test_interval_of_a_difference_by_scipy() -> None:
    one, other = np.array([1.0, 2.0, 6.0, 7.0]), np.array([0.5, 0.4, 0.9])
    expected = stats.ttest_ind(one, other, equal_var=False).confidence_interval()
    found = contrast_interval([one, other], [1.0, -1.0])
    assert found == pytest.approx((3.4, expected.low, expected.high))
    halved = contrast_interval([one, other], [0.5, -0.5])
    assert halved == pytest.approx([end / 2 for end in found])


def test_a_group_without_spread_or_without_values_has_no_interval() -> None:
    some = np.array([1.0, 2.0])
    estimate, low, high = contrast_interval([some, some[:1]], [1.0, -1.0])
    assert estimate == pytest.approx(0.5) and math.isnan(low) and math.isnan(high)
    assert all(map(math.isnan, contrast_interval([some, some[:0]], [1.0, -1.0])))
    assert all(map(math.isnan, prediction_interval(some[:1])))


def runs_on(datasets: float, learners: float, rng: Generator, size: tuple[int, ...]) -> Floats:
    """Values of runs with a dataset each: their variance is that of the datasets and of the learners."""
    return datasets * rng.normal(size=size) + learners * rng.normal(size=size)


# standard deviations of (datasets, learners) of the groups, and the weights of a contrast of their means
GROUPS = {
    "alike": ([(1.0, 1.0), (1.0, 1.0)], [1, -1]),
    "one hardly varies": ([(2.0, 1.0), (0.1, 0.05)], [1, -1]),
    "a gap that grows": ([(2.0, 0.5), (0.5, 0.5), (0.2, 1.0), (0.0, 0.3)], [1, -1, -1, 1]),
}


@pytest.mark.parametrize("groups", GROUPS)
def test_contrasts_over_datasets_and_learners_keep_their_level(groups: str) -> None:
    """Ten runs, each with its own dataset and learner: Welch, with Satterthwaite's degrees of freedom."""
    rng = np.random.default_rng(3)
    spreads, weights = GROUPS[groups]
    values = [runs_on(*spread, rng, (SAMPLES, 10)) for spread in spreads]
    ends = np.array([contrast_interval([v[i] for v in values], weights) for i in range(SAMPLES)])
    covered = (ends[:, 1] <= 0) & (ends[:, 2] >= 0)
    assert covered.mean() == pytest.approx(LEVEL, abs=0.015)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_the_prediction_interval_contains_the_mean_of_three_runs_on_one_new_dataset(share: float) -> None:
    """With the dataset's true share of the variance at its level; with all of it, at its level or more.

    An interval of the mean, which is for the mean of many datasets, would miss such a number often.
    """
    rng = np.random.default_rng(4)
    datasets, learners = math.sqrt(share), math.sqrt(1 - share)
    known = runs_on(datasets, learners, rng, (SAMPLES, 10))
    new = datasets * rng.normal(size=SAMPLES) + learners * rng.normal(size=(SAMPLES, 3)).mean(1)
    exact, widest = (np.array([prediction_interval(x, share=s) for x in known]) for s in (share, 1.0))
    covered = [((low <= new) & (new <= high)).mean() for low, high in (exact.T, widest.T, t_interval(known))]
    assert covered[0] == pytest.approx(LEVEL, abs=0.015)
    assert covered[1] >= covered[0] and (share == 1 or covered[1] > 0.97)
    assert covered[2] < 0.80


def test_the_prediction_interval_in_closed_form() -> None:
    values = np.array([1.0, 2.0, 3.0])
    low, high = prediction_interval(values)
    assert (low + high) / 2 == pytest.approx(2.0) and high - 2 == pytest.approx(
        4.303 * (4 / 3) ** 0.5, abs=1e-3
    )
    assert prediction_interval(values, share=0.0)[1] - 2 == pytest.approx(
        4.303 * (2 / 3) ** 0.5, abs=1e-3
    )  # three further runs that share nothing: 1/3 + 1/3


def test_interval_of_a_share_in_closed_form() -> None:
    """All of n: the low end p has pⁿ = 2.5 %; any share is covered in 95 % of the cases or more."""
    for n in (3, 10):
        low, high = share_interval(n, n)
        assert (low, high) == pytest.approx((0.025 ** (1 / n), 1.0))
        assert share_interval(0, n) == pytest.approx((1 - high, 1 - low))
    assert all(math.isnan(end) for end in share_interval(0, 0))
    for share in (0.1, 0.5, 0.9):
        bounds = [share_interval(k, 10) for k in range(11)]
        covered = sum(
            stats.binom.pmf(k, 10, share) for k, (low, high) in enumerate(bounds) if low <= share <= high
        )
        assert covered >= LEVEL


def test_interquartile_mean_by_hand() -> None:
    """The middle half of eight values, in any order, whatever the ends are."""
    assert interquartile_mean([100.0, 3, 4, 5, 6, 7, -50, 0]) == pytest.approx((3 + 4 + 5 + 6) / 4)
    assert interquartile_mean(np.arange(16.0).reshape(8, 2), axis=0).shape == (2,)
    assert interquartile_mean([1.0, 2.0, 6.0]) == pytest.approx(3.0)  # of three values it is the mean


def test_the_bootstrap_draws_within_cells(rng: Generator) -> None:
    """Cells that lie far apart but do not vary leave no uncertainty; pooled, they would."""
    cells = [np.full(10, 0.0), np.full(10, 1.0), np.full(10, 2.0)]
    with np.errstate(invalid="ignore"):
        assert stratified_bootstrap(cells, rng) == pytest.approx((1.0, 1.0))


def test_the_bootstrap_over_cells_covers_the_interquartile_mean() -> None:
    """Three cells of ten runs with the same mean: near its level; of three runs: below it, and said so."""
    rng = np.random.default_rng(5)
    for n, least, most in ((10, 0.88, 0.97), (3, 0.75, 0.92)):
        bounds = [stratified_bootstrap(list(rng.normal(size=(3, n))), rng) for _ in range(150)]
        assert least < np.mean([low <= 0 <= high for low, high in bounds]) < most


def test_the_bootstrap_is_repeated_by_its_seed() -> None:
    cells = np.random.default_rng(0).normal(size=(3, 10))
    first, again = (stratified_bootstrap(list(cells), np.random.default_rng(1)) for _ in range(2))
    assert first == again


def test_the_final_performance_is_the_interquartile_mean_over_all_cells() -> None:
    rows = [("final_return", "0", d, s, 100.0 * s) for d in (1.1, 4.0) for s in range(4)]
    rows += [("policy_return_share", "1", 1.1, 0, 0.5), ("falls", "1", 1.1, 0, 7.0)]
    table = pd.DataFrame(rows, columns=["measure", "alpha", "delta", "seed", "value"])
    found = final_performance(table, 1000.0).set_index(["measure", "condition"])
    assert found.index.tolist() == [("final return", "0"), ("policy return share", "1")]
    first, second = found.to_dict("records")
    assert first["runs"] == 8 and first["IQM"] == pytest.approx(0.15)  # of 0, 0, 0.1, 0.1, 0.2, 0.2, 0.3, 0.3
    assert 0 <= first["low"] < first["IQM"] < first["high"] <= 0.3
    assert second["IQM"] == 0.5 and math.isnan(second["low"])
