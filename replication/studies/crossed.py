r"""Which share of the variance between runs is the dataset's? Datasets crossed with learner seeds.

With one run for each of I datasets and J learner seeds, a measure is v_ij = μ + D_i + L_j + e_ij. Its parts
are independent and normal with the variances σ²_D, σ²_L and σ²_e; e_ij holds the interaction too. The mean
squares

    MS_D = J Σ_i (v_i. − v_..)² / (I − 1),   MS_L = I Σ_j (v_.j − v_..)² / (J − 1),
    MS_e = Σ_ij (v_ij − v_i. − v_.j + v_..)² / ((I − 1)(J − 1))

have the expectations J σ²_D + σ²_e, I σ²_L + σ²_e and σ²_e. The share of the dataset is
ρ = σ²_D / (σ²_D + σ²_L + σ²_e). Its interval is a generalised one (Weerahandi, 1993): every sum of squares
over a draw of its χ² stands for its expectation, and the ends are quantiles of ρ over many draws.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.random import Generator
from numpy.typing import ArrayLike

from replication.evidence.predictions import state_of
from replication.evidence.statistics import LEVEL
from srlrepro.dynamics.pendulum import Floats
from srlrepro.settings.fields import check

JUDGED = {  # measures of a run, and what a figure calls them
    "success_log_odds": "log odds\nthat K succeeds",
    "activated_share": "share of trials with K",
    "violations_per_1000_steps": "violations\nper 1000 steps",
    "final_return": "final return",
    "policy_alone_share": "final policy alone,\nshare of a perfect return",
}
DRAWS = 20_000  # of the three sums of squares: an end is known to about a hundredth
SEED = 17  # of the draws
PARTS = ("dataset", "learner", "residual")
HALF = 0.5  # of the variance
# By notebook 17, before any run: a measure, whose share lies above or below `HALF`, at which α.
EXPECTED = (
    ("success_log_odds", "above", ("0", "0.5")),
    ("policy_alone_share", "below", ("0", "0.5", "1")),
)


class Components(NamedTuple):
    """Estimates of σ²_D, σ²_L, σ²_e (at least 0), of ρ, and the ends of its 95 % interval."""

    dataset: float
    learner: float
    residual: float
    share: float
    low: float
    high: float


def components(values: ArrayLike, rng: Generator) -> Components:
    """Variance components of a crossed design.

    Args:
        values: [I, J] of I datasets and J learner seeds, at least two of each; not all are equal.
    """
    v = np.asarray(values, np.float64)
    fits = v.ndim == 2 and min(v.shape) > 1 and bool(np.isfinite(v).all()) and v.min() < v.max()
    check(fits, "values", f"of shape {v.shape}", "finite numbers [I, J], I and J > 1, not all equal")
    rows, columns = v.shape
    by_row, by_column, mean = v.mean(axis=1), v.mean(axis=0), v.mean()
    rest = v - by_row[:, None] - by_column[None, :] + mean
    of_rows, of_columns = np.square(by_row - mean).sum(), np.square(by_column - mean).sum()
    squares = np.array([columns * of_rows, rows * of_columns, np.square(rest).sum()])
    freedom = np.array([rows - 1, columns - 1, (rows - 1) * (columns - 1)])
    found = _variances(squares / freedom, rows, columns)
    drawn = _variances(squares / rng.chisquare(freedom, (DRAWS, 3)), rows, columns)
    low, high = np.quantile(drawn[:, 0] / drawn.sum(axis=1), [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    d, l, e = map(float, found)
    return Components(d, l, e, d / (d + l + e), float(low), float(high))


def _variances(mean_squares: Floats, rows: int, columns: int) -> Floats:
    """(σ²_D, σ²_L, σ²_e) [.., 3] of what stands for the expectations of the mean squares [.., 3]."""
    d, l, e = np.moveaxis(mean_squares, -1, 0)
    return np.stack([np.maximum(0, d - e) / columns, np.maximum(0, l - e) / rows, e], axis=-1)


def component_table(measures: pd.DataFrame) -> pd.DataFrame:
    """The variance components of every measure in `JUDGED`, by α.

    A dataset that lacks a run of one learner, or a measure of it, is left out: the design is balanced.

    Args:
        measures: columns measure, alpha, dataset, seed, value.

    Returns:
        measure, alpha, datasets and learners (that were compared), mean, and the fields of `Components`.
        These are NaN where fewer than two datasets are left, or all values are equal.
    """
    rows = []
    chosen = measures[measures["measure"].isin(JUDGED)]
    for (measure, alpha), runs in chosen.groupby(["measure", "alpha"], sort=False):
        v = runs.pivot_table(index="dataset", columns="seed", values="value").dropna().to_numpy()
        varies = min(v.shape) > 1 and v.min() < v.max()
        found = components(v, np.random.default_rng(SEED)) if varies else Components(*[np.nan] * 6)
        rows.append((measure, alpha, *v.shape, v.mean() if v.size else np.nan, *found))
    columns = ["measure", "alpha", "datasets", "learners", "mean", *Components._fields]
    return pd.DataFrame(rows, columns=columns)


def sentences(table: pd.DataFrame) -> list[str]:
    """What a table of components says, a sentence for each measure."""
    said = []
    for measure, text in JUDGED.items():
        rows = table[table["measure"] == measure].dropna(subset="share").to_dict("records")
        parts = [f"α = {r['alpha']}: {r['share']:.0%} [{r['low']:.0%}, {r['high']:.0%}]" for r in rows]
        name = " ".join(text.split())
        said.append(f"The dataset's share of the variance of the {name}: {', '.join(parts) or 'not known'}.")
    return said


def predicted(table: pd.DataFrame) -> list[tuple[str, dict[str, str]]]:
    """Every prediction of `EXPECTED` with its state at each α; table: as of `component_table`."""
    rows = table.set_index(["measure", "alpha"])[["low", "high"]].to_dict("index")
    unknown = {"low": np.nan, "high": np.nan}
    said = []
    for measure, expected, alphas in EXPECTED:
        ends = {alpha: rows.get((measure, alpha), unknown) for alpha in alphas}
        states = {f"α = {a}": state_of(expected, HALF, own["low"], own["high"]) for a, own in ends.items()}
        more = "more" if expected == "above" else "less"
        said.append((f"{more} than half for the {' '.join(JUDGED[measure].split())}", states))
    return said
