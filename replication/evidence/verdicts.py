"""What is told of the claims: by Δ, by the steps of a training, of a second arm; the verdicts of a set."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd
from scipy.special import expit, logit

from replication.evidence.claims import (
    STATES,
    VERDICTS,
    Claim,
    contrasts_of,
    judge_claims,
    load_claims,
    margins,
    verdict,
)
from replication.evidence.measures import read_measures
from replication.evidence.statistics import contrast_interval
from srlrepro.settings.condition import NONE
from srlrepro.storage.files import read_table

THREE, LARGER = "full", "seeds_10"  # results of the paper's three seeds, and those on which verdicts rest
CALIBRATED = "calibrated"  # the arm whose evidence of Γ lies where held-out calibration puts it
AS_WRITTEN = "as written"  # the other: at the y_i, in the paper's words
LONG = {  # a run beyond the paper's grid: the table that shows that it is complete, and what it gives
    LARGER: ("claims.csv", "verdicts on a larger set of seeds"),
    "multiverse": ("shares.csv", "the multiverse"),
    CALIBRATED: ("measures.csv", "the arm with calibrated evidence"),
    "crossed": ("measures.csv", "datasets crossed with learners"),
    "caution": ("measures.csv", "thresholds p_t beside α"),
    "shift": ("measures.csv", "training data nearer to where learners go"),
    "joints": ("joints_predictions.csv", "more joints"),
}
AGAINST = ("contradicts", "practically nothing", "open", "supports", "not measured")  # the worst first
SIGNS = dict(zip((*VERDICTS, "practically nothing"), "✓±✗○–≈", strict=True))  # of a claim, as of its verdict
OVERALL = "overall"  # the column of claims that are not about one Δ
POLICIES = ("final_return", "policy_alone_share", "training_left")  # measures of what has been learned so far
UNIVERSES = "random"  # the design of the multiverse whose shares are counted
SELDOM = 0.25  # share of the random universes up to which a claim holds seldom; often is 1 less this
COLUMNS = ("id", "layer", "statement", "place", "paper", "estimates", "n", "verdict", "verdict_of_three")
CONTRASTS = ("id", "contrast", "delta", "estimate", "low", "high", "least", "most", "n", "state")


def sign(states: pd.Series) -> str:
    """One of `SIGNS` for some contrasts of a claim: that of their verdict, or ≈ where all are nothing."""
    if set(states) == {"practically nothing"}:
        return SIGNS["practically nothing"]
    return SIGNS[verdict(states)]


def matrix(claims: Iterable[Claim], contrasts: pd.DataFrame) -> pd.DataFrame:
    """The signs of claims by Δ: columns layer, row (in words), one for each Δ, and `OVERALL`.

    contrasts: of `judge_claims`. A cell is empty where the claim says nothing of that Δ.
    """
    claims = list(claims)
    columns = [f"{delta:g}" for delta in sorted(contrasts["delta"].dropna().unique())] + [OVERALL]
    place = contrasts["delta"].map("{:g}".format).where(contrasts["delta"].notna(), OVERALL)
    rows: dict[tuple[str, str], dict[str, str]] = {}
    for claim in claims:
        own = contrasts["id"] == claim.id
        signs = contrasts[own].groupby(place[own], sort=False)["state"].agg(sign)
        row = rows.setdefault((claim.layer, claim.row), dict.fromkeys(columns, ""))
        row |= {str(column): shown for column, shown in signs.items()}
    return pd.DataFrame([{"layer": layer, "row": row} | signs for (layer, row), signs in rows.items()])


def by_budget(claims: Iterable[Claim], budgets: pd.DataFrame) -> pd.DataFrame:
    """The signs of claims about what is learned, as if the trainings had ended at several steps.

    Columns: step, row (in words), delta (empty for claims that are not about one Δ), sign. Claims on other
    measures are left out. budgets: measures with a column step.
    """
    found = []
    for step, measures in budgets.groupby("step"):
        for claim in claims:
            if claim.measure in POLICIES:
                signs = contrasts_of(claim, measures).groupby("delta", dropna=False)["state"].agg(sign)
                found += [(step, claim.row, delta, shown) for delta, shown in signs.items()]
    return pd.DataFrame(found, columns=["step", "row", "delta", "sign"])


def of_arm(measures: pd.DataFrame, arm: pd.DataFrame) -> pd.DataFrame:
    """Measures of a second arm with the free runs of the first, on which no arm depends."""
    columns = list(measures)
    return pd.concat([arm[columns], measures[measures["alpha"] == NONE]], ignore_index=True)


def failure_rates(measures: pd.DataFrame) -> pd.DataFrame:
    """How often K fails in each run: alpha, delta, seed, failure_rate (never 0, as of the log odds)."""
    rates = measures[measures["measure"] == "success_log_odds"]
    found = rates[["alpha", "delta", "seed"]].assign(failure_rate=expit(-rates["value"]))
    return found.reset_index(drop=True)


def failures(measures: pd.DataFrame) -> pd.DataFrame:
    """Per alpha and delta: runs, and mean (of the rates), least and most: how often K fails."""
    rates = measures[measures["measure"] == "success_rate"]
    grouped = (1 - rates["value"]).groupby([rates["delta"], rates["alpha"]])
    found = grouped.agg(["count", "mean", "min", "max"]).reset_index()
    return found.set_axis(["delta", "alpha", "runs", "mean", "least", "most"], axis=1)


def mean_failure(rates: pd.DataFrame) -> tuple[float, float, float]:
    """(middle, low, high) of `failure_rates`, with its t-interval; mean and interval are of the log odds."""
    odds = logit(rates["failure_rate"].to_numpy())
    middle, low, high = expit(contrast_interval([odds], [1.0]))
    return float(middle), float(low), float(high)


def is_there(figures: Path, name: str) -> bool:
    """Whether a run of `LONG` has left its results in a folder of figures."""
    return (figures / name / LONG[name][0]).exists()


def resting(figures: Path) -> str:
    """The name of the results on which the verdicts rest, of those in a folder of figures."""
    return LARGER if is_there(figures, LARGER) else THREE


def under_determined(figures: Path, claims: Iterable[Claim]) -> dict[str, float]:
    """{id: share} of the claims that neither hold nor fail in nearly all random universes.

    They do either in more than `SELDOM` of them: choices that the paper leaves open, each as defensible,
    decide. Claims about what is learned are left out, as the trainings of a universe are too short; so are
    claims that no universe was asked about.
    """
    if not is_there(figures, "multiverse"):
        return {}
    table = read_table(figures / "multiverse" / "shares.csv", ("claim", "design", "share"))
    shares = table[table["design"] == UNIVERSES].set_index("claim")["share"].to_dict()
    asked = [claim.id for claim in claims if claim.id in shares and claim.measure not in POLICIES]
    return {name: shares[name] for name in asked if SELDOM < shares[name] < 1 - SELDOM}


def weakest(claim: Claim, contrasts: pd.DataFrame) -> dict[str, str]:
    """The contrast of a claim that speaks most against it: its name, and its estimate.

    By its state, in the order of `AGAINST`; of the same state, the one that lies least within the range where
    the claim holds. The estimate is in words, with its interval: that of a difference, positive towards the
    claim; in units of the measure where the claim compares with a number, and in % where that is a rate of
    the paper, whose interval is one of prediction.
    """
    margin = margins(contrasts)
    if margin.isna().all():
        return {"contrast": "", "estimate": "not measured"}
    ranked = contrasts.assign(margin=margin, rank=contrasts["state"].map(AGAINST.index))
    row = ranked.sort_values(["rank", "margin"]).iloc[0]
    value, low, high = row[["estimate", "low", "high"]]
    if claim.kind in ("at_least", "near", "predicts"):  # `claims` subtracts the number
        value, low, high = claim.value + value, claim.value + low, claim.value + high
    elif claim.kind == "at_most":  # and turns this kind round
        value, low, high = claim.value - value, claim.value - high, claim.value - low
    words = f"{value:.3g} [{low:.3g}, {high:.3g}]"
    if claim.kind == "predicts":
        words = "{:.4g} [{:.4g}, {:.4g}] %".format(*(100 * expit([value, low, high])))
    return {"contrast": row["contrast"], "estimate": words}


def rows(figures: Path) -> list[dict[str, Any]]:
    """The claims in order, with the verdicts, the weakest contrast, and whether open choices decide them.

    ``states``: how many contrasts are in each of the first four `STATES`, in words; ``contrasts``, ``open``:
    how many, and how many open; ``under_determined``: the share of universes in which it holds, if it is so,
    else None. `ResultError`: a table is missing.
    """
    folder = figures / resting(figures)
    claims = read_table(folder / "claims.csv", COLUMNS).fillna("")
    contrasts = read_table(folder / "contrasts.csv", CONTRASTS)
    tests, found = {claim.id: claim for claim in load_claims()}, []
    open_choices = under_determined(figures, tests.values())
    told: Any = claims[claims["id"].isin(tests)].to_dict("records")
    for claim in told:
        own = contrasts[contrasts["id"] == claim["id"]]
        counts = own["state"].value_counts().reindex(STATES, fill_value=0)
        row: dict[str, Any] = {"states": "/".join(str(counts[state]) for state in STATES[:4])}
        row |= {"contrasts": len(own), "open": counts["open"]}
        row |= {"under_determined": open_choices.get(claim["id"])}
        test = tests[claim["id"]]
        row |= {"row": test.row, "measure": test.measure, "sharpens": test.sharpens}
        found.append(claim | weakest(test, own) | row)
    return found


def judged_arm(figures: Path, name: str) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Verdicts and contrasts, as of `judge_claims`, of an arm whose measures lie in a folder of figures."""
    grid, arm = (read_measures(figures / folder / "measures.csv") for folder in (resting(figures), name))
    return judge_claims(load_claims(), of_arm(grid, arm))
