"""What README and report say of the claims: the verdicts of the paper's three seeds and of a larger set."""

import itertools
from pathlib import Path
from typing import Any

import pandas as pd

from replication.evidence.claims import STATES, Claim, load_claims, margins
from srlrepro.storage.files import read_table

THREE, LARGER = "full", "seeds_10"  # results of the paper's three seeds, and those on which verdicts rest
LONG = {  # a run beyond the paper's grid: the table that shows that it is complete, and what it gives
    LARGER: ("claims.csv", "verdicts on a larger set of seeds"),
    "multiverse": ("shares.csv", "the multiverse"),
    "hypotheses": ("hypotheses_better.csv", "learners under other hypotheses"),
}
DECIDED = ("supports", "contradicts")  # of the states of a contrast
AGAINST = ("contradicts", "unresolved", "supports", "not measured")  # states of a contrast, the worst first
COLUMNS = ("id", "statement", "place", "paper", "estimates", "n", "points", "verdict", "ill_posed", "joins")
CONTRASTS = ("id", "contrast", "estimate", "low", "high", "least", "most", "n", "state", "state_of_three")


def is_there(figures: Path, name: str) -> bool:
    """Whether a run of `LONG` has left its results in a folder of figures."""
    return (figures / name / LONG[name][0]).exists()


def resting(figures: Path) -> str:
    """The name of the results on which the verdicts rest, of those in a folder of figures."""
    return LARGER if is_there(figures, LARGER) else THREE


def weakest(claim: Claim, contrasts: pd.DataFrame) -> dict[str, str]:
    """The contrast of a claim that speaks most against it: its name, and its estimate.

    One that contradicts comes before one that is unresolved, and this before one that supports; of the same
    state, the one that lies least within the range where the claim holds. The estimate is in words, with its
    interval; in units of the measure where the claim compares with a number, else the difference, positive
    towards the claim.
    """
    margin = margins(contrasts)
    if margin.isna().all():
        return {"contrast": "", "estimate": "not measured"}
    ranked = contrasts.assign(margin=margin, rank=contrasts["state"].map(AGAINST.index))
    row = ranked.sort_values(["rank", "margin"]).iloc[0]
    value, low, high = row[["estimate", "low", "high"]]
    if claim.kind in ("at_least", "near"):  # `claims` subtracts the number
        value, low, high = claim.value + value, claim.value + low, claim.value + high
    elif claim.kind == "at_most":  # and turns this kind round
        value, low, high = claim.value - value, claim.value - high, claim.value - low
    words = f"{value:.3g} [{low:.3g}, {high:.3g}]"
    if claim.paper.endswith("%"):
        words = f"{100 * value:.4g} [{100 * low:.4g}, {100 * high:.4g}] %"
    return {"contrast": row["contrast"], "estimate": words}


def rows(figures: Path) -> list[dict[str, Any]]:
    """The claims in order, each followed by those that join it, with the verdict and the weakest contrast.

    ``verdict_of_three``: beside that of the larger set, if there is one; ``contrasts``, ``open``: how many,
    and how many undecided; ``lost``: names of those that these seeds decide, and three with the same mean and
    spread would not. `ResultError`: a table is missing.
    """
    folder = figures / resting(figures)
    claims = read_table(folder / "claims.csv", COLUMNS)
    contrasts = read_table(folder / "contrasts.csv", CONTRASTS)
    if resting(figures) == LARGER:
        three = read_table(figures / THREE / "claims.csv", COLUMNS)[["id", "verdict"]]
        claims = claims.merge(three.rename(columns={"verdict": "verdict_of_three"}), on="id", how="left")
    told: list[Any] = claims.fillna("").to_dict("records")
    tests, found = {claim.id: claim for claim in load_claims()}, []
    groups = [[c, *(j for j in told if j["joins"] == c["id"])] for c in told if not c["joins"]]
    for claim in itertools.chain(*groups):
        own = contrasts[contrasts["id"] == claim["id"]]
        counts = own["state"].value_counts().reindex(STATES, fill_value=0)
        states = " · ".join(str(counts[state]) for state in ("supports", "contradicts", "unresolved"))
        lost = own["state"].isin(DECIDED) & (own["state_of_three"] == "unresolved")
        row = {"states": states, "contrasts": len(own), "open": counts["unresolved"]}
        row["lost"] = own.loc[lost, "contrast"].tolist()
        found.append(claim | weakest(tests[claim["id"]], own) | row)
    return found
