"""What README and report say of the claims: the verdicts of the paper's three seeds and of a larger set."""

from pathlib import Path
from typing import Any

import pandas as pd

from srlrepro.claims import STATES, VERDICTS, Claim, load
from srlrepro.config import Choices, Paper
from srlrepro.files import read_json, read_table
from srlrepro.multiverse import RATES

THREE, LARGER = "full", "seeds_10"  # results of the paper's three seeds, and those on which verdicts rest
LONG = {  # a run beyond the paper's grid: the table that shows that it is complete, and what it gives
    LARGER: ("claims.csv", "verdicts on a larger set of seeds"),
    "multiverse": ("shares.csv", "the multiverse"),
    "hypotheses": ("hypotheses_better.csv", "learners under other hypotheses"),
}
DECIDED = ("supports", "contradicts")  # of the states of a contrast
COLUMNS = ("id", "statement", "place", "paper", "estimates", "n", "points", "verdict", "ill_posed", "joins")
CONTRASTS = (
    *("id", "contrast", "estimate", "low", "high", "least", "most", "n"),
    *("state", "half_width_of_three", "state_of_three"),
)


def is_there(figures: Path, name: str) -> bool:
    """Whether a run of `LONG` has left its results in a folder of figures."""
    return (figures / name / LONG[name][0]).exists()


def resting(figures: Path) -> str:
    """The name of the results on which the verdicts rest, of those in a folder of figures."""
    return LARGER if is_there(figures, LARGER) else THREE


def judged(figures: Path) -> dict[str, Any]:
    """The claims, their verdicts and what these rest on, for the templates.

    ``claims``: of three seeds; ``larger``: of the larger set with, beside its verdict, that of three seeds,
    empty without that set; ``unresolvable``: contrasts that the larger set decides and three seeds with its
    spread would not; ``papers``: success rates that the paper gives, as it writes them; ``best``: the return
    of a perfect trial.

    Raises:
        ResultError: a table is missing.
    """
    claims = read_table(figures / THREE / "claims.csv", COLUMNS)
    cells = read_table(figures / THREE / "measures.csv", ("alpha", "delta", "seed", "value"))
    cells = cells.dropna(subset=["alpha", "delta"])[["alpha", "delta", "seed"]].drop_duplicates()
    larger, unresolvable = pd.DataFrame(columns=claims.columns), pd.DataFrame(columns=list(CONTRASTS))
    if resting(figures) == LARGER:
        three = claims[["id", "verdict"]].rename(columns={"verdict": "verdict_of_three"})
        larger = read_table(figures / LARGER / "claims.csv", COLUMNS).merge(three, on="id", how="left")
        contrasts = read_table(figures / LARGER / "contrasts.csv", CONTRASTS)
        found = contrasts["state"].isin(DECIDED) & (contrasts["state_of_three"] == "unresolved")
        unresolvable = contrasts[found]
    return {
        "verdicts": VERDICTS,
        "claims": claims.fillna("").to_dict("records"),
        "larger": larger.fillna("").to_dict("records"),
        "unresolvable": unresolvable.to_dict("records"),
        "run": read_json(figures / THREE / "run_time.json"),
        "runs": len(cells),
        "seeds": cells["seed"].nunique(),
        "papers": [claim.paper for claim in load() if claim.id in RATES],
        "best": Paper.reward_constant * round(Choices.trial_length / Choices.control_period),
        "missing": [text for name, (_, text) in LONG.items() if not is_there(figures, name)],
        "conditions": len(cells[["alpha", "delta"]].drop_duplicates()),
    }


def weakest(claim: Claim, contrasts: pd.DataFrame) -> dict[str, str]:
    """The contrast of a claim that lies least within the range where it holds: its name, and its estimate.

    The estimate is in words, with its interval; in units of the measure where the claim compares with a
    number, else the difference, positive towards the claim.
    """
    reach = contrasts["estimate"] - contrasts["least"], contrasts["most"] - contrasts["estimate"]
    margin = pd.concat(reach, axis=1).min(axis=1, skipna=False)
    if margin.isna().all():
        return {"contrast": "", "estimate": "not measured"}
    row = contrasts.assign(margin=margin).nsmallest(1, "margin").to_dict("records")[0]
    value, low, high = row["estimate"], row["low"], row["high"]
    if claim.kind in ("at_least", "near"):  # `claims` subtracts the number
        value, low, high = claim.value + value, claim.value + low, claim.value + high
    elif claim.kind == "at_most":  # and turns this kind round
        value, low, high = claim.value - value, claim.value - high, claim.value - low
    if claim.paper.endswith("%"):
        words = f"{100 * value:.4g} [{100 * low:.4g}, {100 * high:.4g}] %"
    else:
        words = f"{value:.3g} [{low:.3g}, {high:.3g}]"
    return {"contrast": row["contrast"], "estimate": words}


def rows(figures: Path, judgement: dict[str, Any]) -> list[dict[str, Any]]:
    """The claims of `judged` in order, each followed by those that join it, with its weakest contrast."""
    contrasts = read_table(figures / resting(figures) / "contrasts.csv", CONTRASTS)
    told = judgement["larger"] or judgement["claims"]
    tests = {claim.id: claim for claim in load()}
    groups = [[c, *(j for j in told if j["joins"] == c["id"])] for c in told if not c["joins"]]
    found = []
    for claim in (entry for group in groups for entry in group):
        own = contrasts[contrasts["id"] == claim["id"]]
        counts = own["state"].value_counts().reindex(STATES, fill_value=0)
        states = " · ".join(str(counts[state]) for state in ("supports", "contradicts", "unresolved"))
        found.append(
            claim
            | weakest(tests[claim["id"]], own)
            | {"states": states, "contrasts": len(own), "open": counts["unresolved"]}
        )
    return found
