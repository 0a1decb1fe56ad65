r"""Is α anything that p_t is not? Hypotheses compared at equal recall, and learners at equal caution.

The *caution* of a hypothesis h is the share of the free learner's states that it rejects, P(h(x) = 0): known
without any training under h, and on the same states for all. A larger p_t raises it, and so can a larger α.

Without training: at one recall P(h = 1 | l = 1), the rate of false positives P(h = 1 | l = 0).
With training: within each dataset and Δ, an outcome v of the learners is fitted by least squares to

    v = a + b ln(caution) + Σ_α β_α [α] + γ [SVM],

with β_0 = 0 for the paper's α = 0. β_α is what α does to the outcome at equal caution, γ what the whole state
does. A dataset gives one estimate of each, so that the datasets are the unit of the intervals.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import product

import numpy as np
import pandas as pd
from sklearn.metrics import roc_curve

from replication.evidence.measures import Labelled
from replication.evidence.predictions import state_of
from replication.evidence.statistics import contrast_interval
from replication.studies.alternatives import learn_hypothesis
from replication.studies.designs import HYPOTHESES, THRESHOLDS
from srlrepro.dynamics.closed_loop import Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.samplers import generate
from srlrepro.settings.condition import NONE
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check

SHARES = ("0", "0.25", "0.5", "0.75", "1")  # α: those of the paper, and between
RECALLS = (0.5, 0.8)
GRID = (*np.round(np.arange(0.02, 1.0, 0.02), 2).tolist(), 0.99, 0.995)  # of p_t
CELL = ["hypothesis", "alpha", "delta", "dataset"]
BESIDE = (  # measures of a learner beside its caution
    "violations_per_1000_steps",
    "success_log_odds",
    "policy_alone_share",
    "activated_share",
    "final_return",
)
OUTCOMES = {  # of learners: their unit, and from which effect on one matters
    "log_violations": ("ln of violations", float(np.log(2))),  # twice or half as many
    "success_log_odds": ("log odds that K succeeds", float(np.log(2))),  # twice or half as good odds
    "policy_alone_share": ("policy alone, share of a perfect return", 0.1),
}
SLOPE, SVM = "caution", "svm"  # names of the effects b and γ; that of α has its text
STATES = MATTERS, NOTHING, OPEN = "matters", "practically nothing", "open"  # of the others
LEAST = 0.5  # of a violation, added where there may be none


def scored(
    states: Mapping[tuple[float, int], Labelled], config: Config, alphas: Iterable[str] = SHARES
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """What every hypothesis says of the free learner's states, for every p_t.

    Args:
        states: (x [N, 2n], l(x) [N]) by (Δ, dataset).

    Returns:
        Two tables with `CELL`. The first has p_t, true_positives (the recall) and false_positives, each of
        the states with that label, and caution; the second recall and false_positives, at `RECALLS`.
    """
    curves, equal = [], []
    for hypothesis, alpha, delta, dataset, labels, safety in _asked(states, config, list(alphas)):
        cell = dict(zip(CELL, (hypothesis, alpha, delta, dataset), strict=True))
        for p_t in sorted({*GRID, *THRESHOLDS}):
            h = safety > p_t  # eq. (5)
            rates = {"true_positives": h[labels == 1].mean(), "false_positives": h[labels == 0].mean()}
            curves.append(cell | {"p_t": p_t} | rates | {"caution": 1 - h.mean()})
        at = at_recall(labels, safety)
        equal += [cell | {"recall": recall, "false_positives": rate} for recall, rate in at.items()]
    return pd.DataFrame(curves), pd.DataFrame(equal)


def _asked(
    states: Mapping[tuple[float, int], Labelled], config: Config, alphas: list[str]
) -> Iterator[tuple[str, str, float, int, Labels, Floats]]:
    """Hypothesis, α, Δ, dataset, labels [N] and P(l(x) = 1) [N]; each hypothesis is learned once."""
    for dataset, alpha in product(sorted({dataset for _, dataset in states}), alphas):
        data = generate(float(alpha), config, dataset)
        for kind in HYPOTHESES:
            h = learn_hypothesis(data, config.with_values(hypothesis=kind), dataset)
            for (delta, own), (x, labels) in states.items():
                if own == dataset:
                    yield kind, alpha, delta, dataset, labels, h.safety(x)


def at_recall(labels: Labels, safety: Floats) -> dict[float, float]:
    """{recall: rate of false positives} at `RECALLS`, by the ROC curve and the lines between its corners.

    labels: l(x) [N], of both kinds; safety: P(l(x) = 1) [N].
    """
    false, true, _ = roc_curve(labels, safety, drop_intermediate=False)
    return {recall: float(np.interp(recall, true, false)) for recall in RECALLS}


def learners(measures: pd.DataFrame, curves: pd.DataFrame) -> pd.DataFrame:
    """Supervised learners beside the caution of their hypothesis, a row for each.

    Args:
        measures: gathered ones, with columns hypothesis, threshold and dataset.
        curves: as of `scored`.

    Returns:
        `CELL`, p_t, caution, log_violations (half a violation is added) and the measures `BESIDE`.

    Raises:
        ParameterError: the curves lack a hypothesis that learners had.
    """
    index = [*CELL, "p_t"]
    runs = measures[measures["delta"].notna() & (measures["alpha"] != NONE)]
    runs = runs.rename(columns={"threshold": "p_t"})
    table = runs.pivot_table(index=index, columns="measure", values="value")
    table = table.reindex(columns=[*BESIDE, "failures", "falls"]).reset_index()
    table["log_violations"] = np.log(table["failures"] + table["falls"] + LEAST)  # of equally many steps
    table = table.merge(curves[[*index, "caution"]], how="left", on=index)
    check(bool(table["caution"].notna().all()), "curves", "of other hypotheses", "of every trained one")
    return table[[*index, "caution", "log_violations", *BESIDE]].sort_values(index, ignore_index=True)


def fitted(runs: pd.DataFrame, outcome: str) -> dict[str, float]:
    """The slope b (`SLOPE`), β_α (by α) and γ (`SVM`) of the module's model, for the learners of one cell.

    Empty where the learners do not tell them apart: too few, or all of one kind. An effect between learners
    whose ranges of caution do not overlap is left out: none of them were equally cautious. A hypothesis that
    rejects nothing has no logarithm of its caution, and is left out.
    """
    own = runs[runs["caution"] > 0].dropna(subset=outcome)
    names = sorted({*own["alpha"]} - {"0"})
    groups = {alpha: (own["alpha"] == alpha, own["alpha"] == "0") for alpha in names}
    groups[SVM] = own["hypothesis"] == SVM, own["hypothesis"] != SVM
    columns = {"": np.ones(len(own)), SLOPE: np.log(own["caution"])}
    columns |= {name: member.astype(float) for name, (member, _) in groups.items()}
    x = np.column_stack(list(columns.values()))
    if len(own) <= x.shape[1] or np.linalg.matrix_rank(x) < x.shape[1]:
        return {}
    found = np.linalg.lstsq(x, own[outcome].to_numpy(np.float64), rcond=None)[0]
    apart = {n for n, (a, b) in groups.items() if not _overlap(own.loc[a, "caution"], own.loc[b, "caution"])}
    pairs = zip(columns, found, strict=True)
    return {name: float(value) for name, value in pairs if name and name not in apart}


def _overlap(a: pd.Series, b: pd.Series) -> bool:
    return bool(max(a.min(), b.min()) < min(a.max(), b.max()))


def effects(runs: pd.DataFrame) -> pd.DataFrame:
    """The estimates of `fitted` over the datasets, by Δ and outcome; runs: as of `learners`.

    Returns:
        delta, outcome, effect, datasets, estimate (their mean), low, high (95 %) and state: "practically
        nothing" (the interval lies within the bound of `OUTCOMES`), "matters" (it leaves out 0 otherwise) or
        "open". The slope of caution has no state.
    """
    rows = [
        (delta, outcome, effect, estimate)
        for (delta, _), own in runs.groupby(["delta", "dataset"], sort=False)
        for outcome in OUTCOMES
        for effect, estimate in fitted(own, outcome).items()
    ]
    table = pd.DataFrame(rows, columns=["delta", "outcome", "effect", "estimate"])
    found = []
    for (delta, outcome, effect), own in table.groupby(["delta", "outcome", "effect"], sort=False):
        mean, low, high = contrast_interval([own["estimate"].to_numpy()], [1])
        state = "" if effect == SLOPE else judge(low, high, OUTCOMES[str(outcome)][1])
        found.append((delta, outcome, effect, len(own), mean, low, high, state))
    columns = ["delta", "outcome", "effect", "datasets", "estimate", "low", "high", "state"]
    return pd.DataFrame(found, columns=columns)


def judge(low: float, high: float, bound: float) -> str:
    """The state of an effect that matters from a bound on; low, high: of its interval, NaN for one
    dataset."""
    if -bound < low and high < bound:
        return NOTHING
    return MATTERS if low > 0 or high < 0 else OPEN


def sentences(equal: pd.DataFrame, found: pd.DataFrame) -> list[str]:
    """What both parts say; equal: the second table of `scored`; found: as of `effects`."""
    said, recall = [], max(RECALLS)
    rates = equal[equal["recall"] == recall].groupby(["delta", "hypothesis", "alpha"], sort=False)
    means = rates["false_positives"].mean().reset_index()
    for (delta, kind), own in means.groupby(["delta", "hypothesis"]):
        rows = own.to_dict("records")
        part = ", ".join(f"{row['false_positives']:.3f} at α = {row['alpha']}" for row in rows)
        said.append(f"Δ = {delta:g}: at a recall of {recall:g}, {kind} accepts {part} of the unsafe states.")
    for (delta, outcome), own in found.groupby(["delta", "outcome"], sort=False):
        parts = []
        for row in own.to_dict("records"):
            name = {SVM: "SVM", SLOPE: "e times the caution"}.get(row["effect"], f"α = {row['effect']}")
            interval = f"{row['estimate']:+.2f} [{row['low']:.2f}, {row['high']:.2f}]"
            parts.append(f"{name} {interval}" + (f", {row['state']}" if row["state"] else ""))
        said.append(f"Δ = {delta:g}: in the fit of the {OUTCOMES[str(outcome)][0]}: {'; '.join(parts)}.")
    return said


def at_recall_differences(equal: pd.DataFrame, recall: float = max(RECALLS)) -> pd.DataFrame:
    """Differences of the rate of false positives at equal recall, within datasets, with 95 % intervals.

    equal: the second table of `scored`.

    Returns:
        delta, what ("α = 1 − α = 0" of the region; "SVM − region", the mean over α), datasets, estimate, low
        and high.
    """
    rates = equal[equal["recall"] == recall].astype({"alpha": str})
    rows = []
    for delta, own in rates.groupby("delta"):
        wide = own.pivot_table("false_positives", "dataset", ["hypothesis", "alpha"])
        region, svm = (wide[kind] for kind in HYPOTHESES)
        values = {
            "α = 1 − α = 0": region["1"] - region["0"],
            "SVM − region": pd.DataFrame(svm - region).mean(axis=1),
        }
        for what, each in values.items():
            known = each.dropna().to_numpy()
            rows.append((delta, what, len(known), *contrast_interval([known], [1])))
    return pd.DataFrame(rows, columns=["delta", "what", "datasets", "estimate", "low", "high"])


def predicted(equal: pd.DataFrame, found: pd.DataFrame) -> list[tuple[str, dict[str, str]]]:
    """What notebook 15 predicted before any run, with its state by the interval at each Δ.

    equal: the second table of `scored`; found: as of `effects`.
    """
    recalled, said = at_recall_differences(equal), []
    for what, expected, text in (
        ("α = 1 − α = 0", "above", "at equal recall α = 1 accepts no fewer unsafe states than α = 0"),
        ("SVM − region", "below", "at equal recall the SVM accepts fewer than the region"),
    ):
        own = recalled[recalled["what"] == what]
        said.append((text, _states(own, expected, 0.0)))
    violations = found[(found["outcome"] == "log_violations") & (found["effect"] != SLOPE)]
    for effect, own in violations.groupby("effect"):
        text, expected, bound = "the SVM has fewer violations than the region", "below", 0.0
        if effect != SVM:
            text, expected = f"α = {effect} changes violations by less than a factor of two", "within"
            bound = OUTCOMES["log_violations"][1]
        said.append((f"at equal caution {text}", _states(own, expected, bound)))
    return said


def _states(rows: pd.DataFrame, expected: str, bound: float) -> dict[str, str]:
    """The state of every row, by its Δ."""
    return {
        f"Δ = {row['delta']:g}": state_of(expected, bound, row["low"], row["high"])
        for row in rows.to_dict("records")
    }
