r"""Theorem 1 and its proof (App. B), term by term and step by step.

    ε(h, l) ≤ ε_n(h, l_n) + ½ d_HΔH(D, D_n) + min{E_1, E_2}                                     (eq. 11)

An error compares two labellings of the same states, so that a sample of D and one of D_n with the labels of
h, l and l_n hold everything but the divergence, which depends on a class H. D is the law of the states that
a training visited, D_n the law αUD + (1 − α)MND that training states are drawn from: fresh states estimate
it, since h knows the training states themselves.

A proof step is an inequality, and its slack the right side minus the left. The samples are distributions
themselves: what App. B says of every pair of distributions must hold for them exactly, and a negative slack
is a failure of the step, not of the estimate. What a slack says of the populations has a sampling error.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from replication.evidence.statistics import half_width
from replication.studies.divergence import DOMAIN_CLASSIFIERS, HalfDivergence, domain_classifier, finite_class
from srlrepro.dynamics.closed_loop import Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.hypothesis import Hypothesis

LABELS = ["l", "l_n"]  # names of the labelling functions of the real and of the nominal system
SMALLEST = "{h, l, l_n}"  # the smallest class for which both halves of the proof go through
REGIONS, REGIONS_AND_LABELS = "regions", "regions, l, l_n"
POOLED = "pooled"
CELL = ["visited_by", "delta", "alpha", "seed"]
DIGITS = 12  # of a slack: a sum of a few shares that is 0 may come out as −1e-17

# The steps of the proof: what each says, what it needs, and whether the paper says that it needs it.
CONSIDERED = "yes: l is considered as a hypothesis"
INSERTED = "nothing: two terms added and subtracted"
TRIANGLE = "two labels, and the same {} in all three; nothing of H"
IN_ONE = "h, l and l_n in one H, with one d for (16) and (17)"
STEPS = pd.DataFrame(
    [
        ("(14) insert", "ε ≤ ε_n(h, l_n) + |ε_n(h, l) − ε_n(h, l_n)| + |ε(h, l) − ε_n(h, l)|", INSERTED, "-"),
        ("(14) triangle", "|ε_n(h, l) − ε_n(h, l_n)| ≤ E_1", TRIANGLE.format("D_n"), "-"),
        ("(15) for h, l", "|ε(h, l) − ε_n(h, l)| ≤ ½ d", "h and l in H", CONSIDERED),
        ("(17) insert", "ε ≤ ε_n(h, l_n) + |ε(h, l) − ε(h, l_n)| + |ε(h, l_n) − ε_n(h, l_n)|", INSERTED, "-"),
        ("(17) triangle", "|ε(h, l) − ε(h, l_n)| ≤ E_2", TRIANGLE.format("D"), "-"),
        ("(15) for h, l_n", "|ε(h, l_n) − ε_n(h, l_n)| ≤ ½ d", "h and l_n in H", "no"),
        ("(11) minimum", "ε ≤ ε_n(h, l_n) + ½ d + min{E_1, E_2}", IN_ONE, "only l"),
    ],
    columns=["step", "inequality", "needs", "stated"],
)


class Sample(NamedTuple):
    """States and what each labelling function says of them."""

    x: Floats  # [N, 2n] rad and rad/s
    labels: pd.DataFrame  # [N, M], a column per labelling function; among them those of `LABELS`

    @classmethod
    def of(cls, x: Floats, functions: Mapping[str, Hypothesis]) -> "Sample":
        """The states x [N, 2n], labelled by every function."""
        return cls(x, pd.DataFrame({name: f.predict(x) for name, f in functions.items()}))


def disagreement(a: pd.Series | Labels, b: pd.Series | Labels) -> float:
    """E[I(a(x) ≠ b(x))], the error of one labelling measured by the other."""
    return float(np.mean(np.asarray(a) != np.asarray(b)))


def terms(target: pd.DataFrame, source: pd.DataFrame, h: str) -> dict[str, float]:
    """Every expectation of Theorem 1 and App. B, from the labels [N, M] of states of D and [N', M] of D_n.

    The column h is the hypothesis. ``unsafe`` is the error of the one that calls every state safe.
    """
    d, d_n = target, source
    return {
        "error": disagreement(d[h], d["l"]),  # eq. (9)
        "false_positives": float(np.mean((d[h] == 1) & (d["l"] == 0))),  # eq. (12), first line
        "false_negatives": float(np.mean((d[h] == 0) & (d["l"] == 1))),  # eq. (12), second line
        "unsafe": float(np.mean(d["l"] == 0)),
        "source_error": disagreement(d_n[h], d_n["l_n"]),  # eq. (10)
        "source_error_real": disagreement(d_n[h], d_n["l"]),  # ε_n(h, l) of App. B
        "error_nominal": disagreement(d[h], d["l_n"]),  # ε(h, l_n) of App. B
        "e1": disagreement(d_n["l"], d_n["l_n"]),
        "e2": disagreement(d["l"], d["l_n"]),
    }


def bound(table: pd.DataFrame) -> pd.Series:
    """The right side of eq. (11), row by row; columns as of `terms`, and half_divergence."""
    return table["source_error"] + table["half_divergence"] + table[["e1", "e2"]].min(axis=1)  # eq. (11)


def slacks(table: pd.DataFrame) -> pd.DataFrame:
    """The slack of every step of `STEPS`, row by row; columns as of `bound`.

    Those of (14) and of (15) for h, l add up to the slack of eq. (16); the others to that of eq. (17).
    """
    t, half = table, table["half_divergence"]
    labels_n = (t["source_error_real"] - t["source_error"]).abs()  # under D_n, l against l_n
    domains = (t["error"] - t["source_error_real"]).abs()  # for h and l, D against D_n
    labels = (t["error"] - t["error_nominal"]).abs()  # under D, l against l_n
    domains_nominal = (t["error_nominal"] - t["source_error"]).abs()  # for h and l_n, D against D_n
    columns = [
        t["source_error"] + labels_n + domains - t["error"],  # eq. (14), second line
        t["e1"] - labels_n,  # eq. (14), third line
        half - domains,  # eq. (15)
        t["source_error"] + labels + domains_nominal - t["error"],
        t["e2"] - labels,
        half - domains_nominal,  # eq. (15)
        bound(t) - t["error"],
    ]
    return pd.concat(columns, axis=1, keys=STEPS["step"].tolist()).round(DIGITS) + 0.0  # no −0


def finite_divergences(target: pd.DataFrame, source: pd.DataFrame, h: str) -> dict[str, HalfDivergence]:
    """½ d for three finite classes: `SMALLEST`, all regions, and all regions with l and l_n."""
    regions = [name for name in target if name not in LABELS]
    members = {SMALLEST: [h, *LABELS], REGIONS: regions, REGIONS_AND_LABELS: [*regions, *LABELS]}
    return {name: finite_class(target[m], source[m]) for name, m in members.items()}


def term_table(targets: Mapping[Any, Sample], source: Sample, h: str) -> pd.DataFrame:
    """Theorem 1 for one hypothesis: a row per training and class H, and with several trainings their pool.

    The domain classifiers of one training are measured on the half of its states that they do not know,
    those of the pool on a training that they do not know.

    Args:
        targets: for each seed states that its training visited, in random order and equally many.
        source: states of D_n; h: the hypothesis, a column of the labels.
    """
    folds = {seed: np.arange(len(target.x)) % 2 for seed, target in targets.items()}
    samples = dict(targets)
    if len(targets) > 1:
        x, labels = zip(*targets.values(), strict=True)
        samples[POOLED] = Sample(np.concatenate(x), pd.concat(labels, ignore_index=True))
        folds[POOLED] = np.repeat(np.arange(len(targets)), list(map(len, x)))
    rows = []
    for seed, target in samples.items():
        found = finite_divergences(target.labels, source.labels, h)
        thin = slice(None, None, len(targets) if seed == POOLED else 1)  # as many states as of D_n
        for name, classifier in DOMAIN_CLASSIFIERS.items():
            found[name] = domain_classifier(classifier, target.x[thin], source.x, folds[seed][thin])
        values = terms(target.labels, source.labels, h)
        for name, (half, error) in found.items():
            row = {"seed": str(seed), "class": name} | values
            rows.append(row | {"half_divergence": half, "standard_error": error})
    table = pd.DataFrame(rows)
    return table.assign(bound=bound(table))


def step_table(table: pd.DataFrame) -> pd.DataFrame:
    """A row per step of the proof: what it needs, in how many rows of the table it holds, and its slack."""
    slack = slacks(table)
    steps = STEPS.assign(holds=(slack >= 0).sum().to_numpy(), of=len(table))
    ends = {"smallest slack": slack.min(), "mean slack": slack.mean(), "largest slack": slack.max()}
    return steps.assign(**{name: values.to_numpy() for name, values in ends.items()})


def class_table(table: pd.DataFrame) -> pd.DataFrame:
    """A row per class: where eqs. (15) and (11) fail with its ½ d, the bound's range, and where it is ≥ 1."""
    slack, bounds = slacks(table), table.groupby("class", sort=False)["bound"]
    failed = slack.loc[:, slack.columns.str.startswith(("(15)", "(11)"))] < 0
    summary = failed.groupby(table["class"], sort=False).sum().add_prefix("fails: ")
    columns = {"of": bounds.size(), "smallest bound": bounds.min(), "largest bound": bounds.max()}
    return summary.assign(**columns, vacuous=(table["bound"] >= 1).groupby(table["class"], sort=False).sum())


def orders(table: pd.DataFrame, quantities: Sequence[str]) -> pd.DataFrame:
    """The α's by increasing mean of a quantity, per Δ and origin of D; ``seeds``: those with that order."""
    rows = []
    for (visited_by, delta), group in table.groupby(["visited_by", "delta"], sort=False):
        for quantity in quantities:
            values = group.pivot_table(index="seed", columns="alpha", values=quantity)
            order = list(values.mean().sort_values(kind="stable").index)
            same = int((values[order].diff(axis=1).iloc[:, 1:] >= 0).all(axis=1).sum())
            rows.append((visited_by, delta, quantity, " < ".join(order), same, len(values)))
    return pd.DataFrame(rows, columns=["visited_by", "delta", "quantity", "order of α", "seeds", "of"])


def across_runs(table: pd.DataFrame, by: Sequence[str], columns: Sequence[str]) -> pd.DataFrame:
    """Means over trainings, and beside each the half width of its 95 % t-interval (NaN for one training)."""
    groups = table.groupby(list(by), sort=False)[list(columns)]
    width = groups.std().combine(groups.count(), half_width)
    return groups.mean().join(width.add_suffix(" ±"))[[c for name in columns for c in (name, f"{name} ±")]]
