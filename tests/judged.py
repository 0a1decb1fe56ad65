"""Made-up measures of runs, as the paper says or with its α's turned round, and what follows from them."""

import itertools
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.special import logit

from replication.evidence.claims import GRID, MEASURE_COLUMNS, judge_claims, load_claims
from replication.evidence.verdicts import POLICIES, by_budget, matrix
from srlrepro.storage.files import write_table

SEEDS = 10
DATA = {  # by α
    "near_origin_share": (0.7, 0.5, 0.25),
    "corner_share": (0.0, 0.06, 0.125),
    "safe_share": (0.85, 0.7, 0.57),
    "embedding_purity": (1.0, 1.0, 1.0),
    "new_state_purity": (0.97, 0.97, 0.97),
    "accepted_share": (0.8, 0.6, 0.4),
}
SUCCESS = {1.1: (0.808, 0.91, 0.997), 1.5: (0.75, 0.88, 0.9935), 4.0: (0.5, 0.7, 0.99)}
LEFT = {1.1: 0.5, 1.5: 0.4, 4.0: 0.2}  # of the training, where a free learner tracks well
RUNS = {  # by α, the free learner last
    "common_error": (0.01, 0.03, 0.1),
    "common_false_positives": (0.03, 0.02, 0.001),
    "final_return": (700.0, 690.0, 300.0, 600.0),
    "activated_share": (0.1, 0.4, 0.9),
    "violations_per_1000_steps": (0.5, 0.2, 0.01, 3.0),
    "promise_gap": (0.0, 0.0, 0.0),
}
BUDGETS = (500, 1000)  # steps
JUDGED = ("claims.csv", "contrasts.csv", "verdict.csv", "verdict_by_step.csv")  # what `write_judged` writes


def measures(turned: bool = False) -> pd.DataFrame:
    """A table of measures of ten seeds, which differ little; turned: α = 0 and 1 have changed places."""
    alphas = [*(GRID["alpha"][::-1] if turned else GRID["alpha"]), "none"]
    cells = [
        (name, alpha, None, value)
        for name, own in DATA.items()
        for alpha, value in zip(alphas, own, strict=False)
    ]
    for delta in GRID["delta"]:
        runs: dict[str, tuple[float, ...]] = RUNS | {"success_rate": SUCCESS[delta]}
        runs |= {
            "success_log_odds": tuple(logit(SUCCESS[delta])),
            "training_left": (0.6, 0.6, 0.1, LEFT[delta]),
        }
        runs["policy_alone_share"] = (0.95, 0.94, 0.4, 0.94 - LEFT[1.1] + LEFT[delta])
        cells += [
            (name, alpha, delta, value)
            for name, own in runs.items()
            for alpha, value in zip(alphas, own, strict=False)
        ]
    rows = [
        (name, alpha, delta, seed, value + 0.001 * (seed - (SEEDS - 1) / 2))
        for (name, alpha, delta, value), seed in itertools.product(cells, range(SEEDS))
    ]
    return pd.DataFrame(rows, columns=list(MEASURE_COLUMNS))


def budgets() -> pd.DataFrame:
    """Measures of what is learned by the `BUDGETS`: turned round at first."""
    tables = [measures(turned=step == BUDGETS[0]).assign(step=step) for step in BUDGETS]
    table = pd.concat(tables, ignore_index=True)
    return table[table["measure"].isin(POLICIES)]


def write_judged(folder: Path, table: pd.DataFrame) -> None:
    """Write the tables that follow from measures and from the `budgets` to a folder."""
    claims = load_claims()
    summary, contrasts = judge_claims(claims, table)
    write_table(folder / "claims.csv", summary)
    write_table(folder / "contrasts.csv", contrasts, digits=4)
    write_table(folder / "verdict.csv", matrix(claims, contrasts))
    papers = [claim for claim in claims if claim.layer == "a"]
    write_table(folder / "verdict_by_step.csv", by_budget(papers, budgets()))


def write_studies(figures: Path) -> None:
    """What the documents read of the studies beside the grid: crossed, caution and shift."""
    parts = ("success_log_odds", "policy_alone_share")
    shares = [(m, a, 4, 4, 0.6, 0.2, 0.9) for m, a in itertools.product(parts, ("0", "0.5", "1"))]
    columns = ["measure", "alpha", "datasets", "learners", "share", "low", "high"]
    write_table(figures / "crossed" / "crossed_components.csv", pd.DataFrame(shares, columns=columns))
    equal = itertools.product(("tsne", "svm"), ("0", "1"), (1.1, 4.0), range(3), (0.5, 0.8), (0.25,))
    columns = ["hypothesis", "alpha", "delta", "dataset", "recall", "false_positives"]
    write_table(figures / "caution" / "caution_recall.csv", pd.DataFrame(equal, columns=columns))
    kinds = itertools.product((1.1, 4.0), ("log_violations", "success_log_odds", "policy_alone_share"))
    states = {"caution": "", "0.5": "practically nothing", "1": "open", "svm": "matters"}
    found = [(*place, e, 3, -0.8, -0.9, -0.7, s) for place in kinds for e, s in states.items()]
    found.remove((1.1, "success_log_odds", "0.5", 3, -0.8, -0.9, -0.7, states["0.5"]))  # where none overlap
    columns = ["delta", "outcome", "effect", "datasets", "estimate", "low", "high", "state"]
    write_table(figures / "caution" / "caution_effects.csv", pd.DataFrame(found, columns=columns))
    rows = itertools.product(("tsne", "svm"), (0.5, 0.8, 0.95), (1.1, 4.0), range(3))
    trained = pd.DataFrame(rows, columns=["hypothesis", "p_t", "delta", "dataset"])
    trained["log_violations"] = np.log(
        10 * trained["delta"] / trained["p_t"] * trained["hypothesis"].map({"tsne": 1, "svm": 5}) + 0.5
    )
    write_table(figures / "caution" / "caution_frontier.csv", trained)
    names = ("distance", "free_error", "violations_per_1000_steps")
    moved = [
        (name, delta, variant, 5, 0.1, 0.3, -0.2, -0.3, 0.1 if variant == "refitted" else -0.1)
        for name, delta, variant in itertools.product(names, (1.1, 4.0), ("learners-law", "refitted"))
    ]
    columns = ["measure", "delta", "variant", "n", "mean", "written", "difference", "low", "high"]
    write_table(figures / "shift" / "shift_contrasts.csv", pd.DataFrame(moved, columns=columns))
    for name in ("crossed", "caution", "shift"):
        write_table(figures / name / "measures.csv", measures())
