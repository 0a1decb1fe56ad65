r"""Theorem 1's advice: training data from a D_n that is nearer to the D of the learner. What comes of it?

By eq. (11) the true error is bounded by the error on D_n, half a divergence of D_n from D, and the
discrepancy of the systems. D_n is the designer's choice; α as the paper uses it moves it away from D. Here it
moves towards D, in the `VARIANTS` of `designs`. All hypotheses are asked about the states of the same free
learners, and about those that their own learner visited.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from replication.evidence.measures import classification, labelled
from replication.evidence.predictions import FAILS, state_of
from replication.evidence.results import DATA, RECORD, REGION, TrainedRun, read_run
from replication.evidence.statistics import contrast_interval
from replication.studies.designs import AS_WRITTEN, LAW, REFITTED, VARIANTS, WEIGHTED, free_runs, tells
from replication.studies.divergence import DOMAIN_CLASSIFIERS, domain_classifier
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.safe_region import SafeRegion
from srlrepro.samplers import TrainingData, density_ratios

DOMAIN = "boosted trees"  # the sharpest of the classifiers that tell D from D_n
SHOWN = {  # measures, and what a figure calls them
    "distance": "½ d of $\\mathcal{D}_n$ and $\\mathcal{D}$,\nown learner",
    "free_error": "error on the\nfree learner's states",
    "free_false_positives": "false positives on the\nfree learner's states",
    "success_log_odds": "log odds that\nK succeeds",
    "violations_per_1000_steps": "violations\nper 1000 steps",
    "policy_alone_share": "final policy alone,\nshare of a perfect return",
}
LEARNED = (  # measures of the learner beside them
    "success_log_odds",
    "success_rate",
    "violations_per_1000_steps",
    "policy_alone_share",
    "final_return",
    "activated_share",
)
RUN = ["variant", "delta", "dataset"]
DECIMALS = 4  # of a difference in words
# By notebook 18, before any run of full length: a variant, and a measure of it against the data as written.
EXPECTED = (
    (REFITTED, "distance", "below", "least", "is nearest to D"),
    (REFITTED, "free_error", "below", "least", "has the smallest error on free states"),
    (LAW, "distance", "below", "", "is nearer to D than the data as written"),
    (WEIGHTED, "free_error", "above", "", "does not help: its error there is larger"),
)


def measure_shift(
    data: TrainingData, region: SafeRegion, run: TrainedRun, free: TrainedRun
) -> dict[str, float]:
    """How far D_n is from D, and what that does to h.

    Returns:
        ``distance``, ``distance_free``: `distance` of the training states from those that the run, and the
        free one, visited; ``free_error``, ``free_false_positives``: of h on the free learner's states, eqs.
        (9) and (12); ``outside``: share of the visited states outside the ranges of App. C;
        ``outside_activated``: the same of the states in which K took over, NaN if there are none;
        ``effective_states``: (Σ w)² / Σ w² of the weights w of the evidence, the number of states where there
        are none.
    """
    config, real = run.config, ClosedLoop.from_config(run.config, run.condition.delta)
    x, high = run.visited(), np.array(run.config.paper.state_max)
    common = classification(region, *labelled(free.visited(), real, free.steps))
    taken = (region.predict(x) == 0) & (np.abs(x[:, 0]) < high[0])  # above the ground, as for `promise_gap`
    outside = np.asarray((np.abs(x) > high).any(axis=1))
    weights = np.ones(len(data.x))
    if config.choices.gamma_weights != "none":
        weights = density_ratios(data, config, data.x)
    return {
        "distance": distance(x, data.x),
        "distance_free": distance(free.visited(), data.x),
        "free_error": common["error"],
        "free_false_positives": common["false_positives"],
        "outside": float(outside.mean()),
        "outside_activated": float(outside[taken].mean()) if taken.any() else float("nan"),
        "effective_states": float(weights.sum() ** 2 / np.square(weights).sum()),
    }


def distance(visited: Floats, x: Floats) -> float:
    """½ d between as many visited states as there are training states x [k, 2n], and these, by `DOMAIN`.

    The first half of the visited states is one fold and the second the other, so that no trial is in both.
    """
    chosen = visited[np.linspace(0, len(visited) - 1, min(len(x), len(visited))).astype(int)]
    folds = (np.arange(len(chosen)) * 2) // len(chosen)
    return domain_classifier(DOMAIN_CLASSIFIERS[DOMAIN], chosen, x, folds).value


def measure_universes(folders: Mapping[str, Path], measures: pd.DataFrame) -> pd.DataFrame:
    """`measure_shift` of every supervised run of universes, and what came of it: `RUN`, measure, value.

    Args:
        folders: of the universes, by their ids. measures: theirs, gathered; those that are `LEARNED` are
        kept.

    Raises:
        ResultError: a product is missing or damaged.
    """
    rows, free = [], free_runs(folders)
    for name, folder in folders.items():
        variant, dataset = tells(name)["variant"], int(tells(name)["dataset"])
        learned = folder / f"alpha_{VARIANTS[variant][0]}"
        for record in sorted((folder / "runs").glob(f"{learned.name}__*/{RECORD}")):
            run = read_run(record)
            data, region = TrainingData.load(learned / DATA), SafeRegion.load(learned / REGION)
            found = measure_shift(data, region, run, free[run.condition.delta, dataset])
            rows += [(variant, run.condition.delta, dataset, *pair) for pair in found.items()]
    alphas = measures["variant"].map({variant: alpha for variant, (alpha, _) in VARIANTS.items()})
    kept = measures[(measures["alpha"] == alphas) & measures["measure"].isin(LEARNED)]
    columns = [*RUN, "measure", "value"]
    return pd.concat([pd.DataFrame(rows, columns=columns), kept[columns]], ignore_index=True)


def contrasts(table: pd.DataFrame) -> pd.DataFrame:
    """Every variant against the data as written, by Welch's interval over datasets.

    Args:
        table: `RUN`, measure, value.

    Returns:
        measure, delta, variant, n (datasets), mean, written (the mean as written), difference, low and
        high, of 95 %. What too few datasets leave unknown is NaN, as of `contrast_interval`.
    """
    rows = []
    for (measure, delta), own in table.dropna(subset="value").groupby(["measure", "delta"], sort=False):
        by = {name: own.loc[own["variant"] == name, "value"].to_numpy() for name in VARIANTS}
        before = by.pop(AS_WRITTEN)
        for variant, after in by.items():
            if len(after) and len(before):
                interval = contrast_interval([after, before], [1, -1])
                rows.append((measure, delta, variant, len(after), after.mean(), before.mean(), *interval))
    columns = ["measure", "delta", "variant", "n", "mean", "written", "difference", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def sentences(found: pd.DataFrame) -> list[str]:
    """What `contrasts` says of the measures in `SHOWN`, a sentence for each variant and Δ."""
    said = []
    chosen = found[found["measure"].isin(SHOWN)]
    for (variant, delta), own in chosen.groupby(["variant", "delta"], sort=False):
        parts = []
        for row in own.to_dict("records"):
            sign = "more" if row["low"] > 0 else "less" if row["high"] < 0 else "open"
            estimate = round(row["difference"], DECIMALS) + 0.0  # equal means differ by the rounding of sums
            interval = f"{estimate:+.3g} [{row['low']:.3g}, {row['high']:.3g}]"
            parts.append(f"{str(row['measure']).replace('_', ' ')} {interval}, {sign}")
        said.append(f"{variant} against {AS_WRITTEN}, Δ = {delta:g}: {'; '.join(parts)}.")
    return said


def predicted(found: pd.DataFrame) -> list[tuple[str, dict[str, str]]]:
    """Every prediction of `EXPECTED` with its state at each Δ; found: as of `contrasts`.

    By the interval against the data as written. What shall be the least fails where another mean is less.
    """
    said = []
    for variant, measure, expected, rank, text in EXPECTED:
        states = {}
        for delta, own in found[found["measure"] == measure].groupby("delta"):
            rows = own.set_index("variant")
            if variant in rows.index:
                state = state_of(expected, 0.0, rows["low"][variant], rows["high"][variant])
                least = min(rows["mean"].min(), rows["written"].min())
                state = FAILS if rank and least < rows["mean"][variant] else state
                states[f"Δ = {delta:g}"] = state
        said.append((f"{variant} {text}", states))
    return said


def agreement(found: pd.DataFrame) -> tuple[int, int]:
    """(In how many, of how many) variants and Δ the violations move as the error on the free states does."""
    index = ["variant", "delta"]
    moved = [
        np.sign(found[found["measure"] == name].set_index(index)["difference"])
        for name in ("free_error", "violations_per_1000_steps")
    ]
    both = pd.concat(moved, axis=1).dropna()
    return int((both.iloc[:, 0] == both.iloc[:, 1]).sum()), len(both)
