r"""What the cells of the study of joints say: the advantage of a low dimension, predictions, the answer.

At equal recall, let FP be the share of the unsafe states that a hypothesis accepts. The *advantage* of a map
over a hypothesis of the whole state is FP(whole) − FP(map): above 0, the low dimension pays. The best map and
the best of the whole state are chosen for each dataset on the *other* datasets, so that no choice is scored
on what it was chosen on. Datasets are the unit of all 95 % t-intervals.
"""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from replication.evidence.predictions import EXPECTED, judge
from replication.evidence.statistics import contrast_interval, half_width
from replication.studies.joints.cells import CELL, LEARNERS, MIXED, SCORES
from replication.studies.joints.rungs import MAPS, RUNGS, WHOLE
from srlrepro.dynamics.pendulum import Floats
from srlrepro.settings.fields import check

PREDICTIONS = Path(__file__).with_name("predictions.toml")
RECALL = 0.8  # at which hypotheses are compared, of `RECALLS`
BEST = {"best_map": tuple(MAPS), "best_whole": tuple(WHOLE)}
PAIRS = {  # a map, a hypothesis of the whole state, and how they are called
    "as written": ("tsne", "svm", "the map as written against an SVM"),
    "best": ("best_map", "best_whole", "the best map against the best of the whole state"),
}
PLACE = ["links", "k", "law", "delta"]
ASKED, DELTA = ("visits", "UD"), 1.1  # laws of the test states of the answer, and its Δ
STATES = {
    "visits": "that a random policy visits",
    "UD": "of UD",
    "MND": "of the MND",
    LEARNERS: "that free learners visit",
}


def averaged(scores: pd.DataFrame) -> pd.DataFrame:
    """Means over datasets with half the width of their 95 % intervals: columns NAME and NAME_half.

    scores: of all cells, as of `run_job`. Also ``datasets``: so many have enough states of both labels.
    """
    by = ["links", "k", "alpha", "law", "delta", "hypothesis"]
    groups = scores.groupby(by, sort=False)[["safe", *SCORES]]
    mean, spread, count = groups.mean(), groups.std(), groups.count()
    half = pd.DataFrame(half_width(spread, count), mean.index, mean.columns).add_suffix("_half")
    columns = ["safe", *(c for name in SCORES for c in (name, f"{name}_half"))]
    found = mean.join(half)[columns].assign(datasets=count[SCORES[0]])
    return found.reset_index()


def at_equal_recall(scores: pd.DataFrame) -> pd.DataFrame:
    """Share of the unsafe states accepted at `RECALL`: a row per cell, law and Δ, a column per hypothesis.

    ``safe`` is the share of safe states. A hypothesis that was not learned in a cell is NaN there.
    """
    keys = [*CELL, "law", "delta"]
    found = scores[[*keys, "safe"]].drop_duplicates(keys)
    for name in (name for name in RUNGS if name in set(scores["hypothesis"])):
        own = scores.loc[scores["hypothesis"] == name, [*keys, f"false_positives_{RECALL:g}"]]
        found = found.merge(own.set_axis([*keys, name], axis=1), how="left", on=keys)
    return found


def with_best(table: pd.DataFrame) -> pd.DataFrame:
    """The table of `at_equal_recall` with columns best_map and best_whole: see the module.

    Chosen for each n, k, law and Δ by the mean over α and the other datasets, among what was learned in all
    cells there. NaN for a single dataset.
    """
    chosen = {column: pd.Series(np.nan, table.index) for column in BEST}
    for _, rows in table.groupby(PLACE):
        for column, names in BEST.items():
            own = rows[[name for name in names if name in rows]].dropna(axis=1)
            for dataset, part in rows.groupby("dataset"):
                others = own[rows["dataset"] != dataset]
                if others.size:
                    chosen[column].loc[part.index] = own[others.mean().idxmin()]
    return table.assign(**chosen)


def advantages(table: pd.DataFrame) -> pd.DataFrame:
    """The advantage of the low dimension at α = `MIXED`, of every pair, n, k, law and Δ.

    Args:
        table: of `at_equal_recall`.

    Returns:
        pair, links, k, law, delta, datasets, advantage, low, high; a row where a dataset has both.
    """
    best, rows = with_best(table), []
    mixed = best[best["alpha"].astype(str) == MIXED]
    for pair, (low, whole, _) in PAIRS.items():
        if low in mixed:
            for place, own in mixed.groupby(PLACE):
                values = (own[whole] - own[low]).dropna().to_numpy()
                if len(values):
                    rows.append((pair, *place, len(values), *contrast_interval([values], [1.0])))
    return pd.DataFrame(rows, columns=["pair", *PLACE, "datasets", "advantage", "low", "high"])


@dataclass(frozen=True)
class Prediction:
    """An entry of predictions.toml, which says what each field is."""

    id: str
    statement: str
    of: str
    expected: str
    bound: float
    where: Mapping[str, Any]
    against: str = ""
    than: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        known = ("safe", *RUNGS, *BEST)
        check(self.expected in EXPECTED, "expected", self.expected, f"one of {', '.join(EXPECTED)}")
        for name in filter(None, (self.of, self.against)):
            check(name in known, "of", name, f"one of {', '.join(known)}")
        for name in (*self.where, *self.than):
            check(name in (*CELL, "law", "delta"), "where", name, "a column of the cells")

    def differences(self, best: pd.DataFrame) -> Floats:
        """What is predicted, in each dataset that has all of it; best: of `with_best`."""
        first = self._by_dataset(best, self.where)
        if self.than:
            first = first - self._by_dataset(best, {**self.where, **self.than})
        return first.dropna().to_numpy()

    def _by_dataset(self, best: pd.DataFrame, where: Mapping[str, Any]) -> pd.Series:
        rows = np.ones(len(best), bool)
        for name, values in where.items():
            column = best[name].astype(float) if name == "alpha" else best[name]
            rows &= column.isin(values if isinstance(values, list) else [values]).to_numpy()
        if not {self.of, self.against} - {""} <= set(best):
            return pd.Series(dtype=float)
        own = best[rows]
        value = own[self.against] - own[self.of] if self.against else own[self.of]
        return value.groupby(own["dataset"]).mean()


@cache
def load_predictions() -> tuple[Prediction, ...]:
    """The predictions, in their order.

    Raises:
        ParameterError: one names no hypothesis or no column.
    """
    told = tomllib.loads(PREDICTIONS.read_text(encoding="utf-8"))
    return tuple(Prediction(**entry) for entry in told["prediction"])


def judged(table: pd.DataFrame, predictions: Iterable[Prediction] | None = None) -> pd.DataFrame:
    """Every prediction with its estimate, interval and state, see `judge`.

    table: of `at_equal_recall`.
    """
    best = with_best(table)
    told = load_predictions() if predictions is None else predictions
    return judge((p, p.differences(best)) for p in told)


def takeaway(found: pd.DataFrame, pair: str = "best") -> str:
    """In how many cases of n and k a map accepts fewer unsafe states, and in how many more, for each law.

    found: of `advantages`; an interval that holds 0 is neither.
    """
    own, parts = found[(found["pair"] == pair) & (found["delta"] == DELTA)], []
    for law in ASKED:
        rows = own[own["law"] == law]
        pays, costs = (rows["low"] > 0).sum(), (rows["high"] < 0).sum()
        parts.append(f"in {pays} of {len(rows)} cases (more in {costs}) on states {STATES[law]}")
    low, whole = PAIRS[pair][2].split(" against ")
    joints = listed(own["links"].unique())
    return f"With {joints} joints, {low} accepts fewer unsafe states than {whole} {' and '.join(parts)}."


def sentence(found: pd.DataFrame, pair: str = "as written", law: str = "visits", delta: float = DELTA) -> str:
    """Where a low dimension pays and where it costs; found: of `advantages`."""
    own = found[(found["pair"] == pair) & (found["law"] == law) & (found["delta"] == delta)]
    parts = []
    for k, rows in own.groupby("k"):
        pays, costs = rows.loc[rows["low"] > 0, "links"], rows.loc[rows["high"] < 0, "links"]
        said = [f"{word} at n = {listed(n)}" for word, n in (("pays", pays), ("costs", costs)) if len(n)]
        undecided = len(rows) - len(pays) - len(costs)
        said += [f"is undecided at {undecided} of {len(rows)} n"] if undecided else []
        parts.append(f"learned from {k} states it " + ", ".join(said))
    start = f"On states {STATES[law]}, at Δ = {delta:g} and a recall of {RECALL:g}, {PAIRS[pair][2]}: "
    return start + ("; ".join(parts) or "nothing was measured") + "."


def listed(numbers: Iterable[int]) -> str:
    """1, 2, 3 and 5 as "1–3, 5"."""
    runs: list[list[int]] = []
    for n in sorted(numbers):
        if runs and n == runs[-1][-1] + 1:
            runs[-1].append(n)
        else:
            runs.append([n])
    return ", ".join(f"{run[0]}–{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)
