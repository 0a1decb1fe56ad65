"""What REPORT.md is filled with: each section's numbers from the tables of the results.

A long run that is not there leaves its section empty (None), and the template then says so.
"""

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

from replication import readme
from replication.documents import FIGURES, TEMPLATES, Document
from replication.evidence import claims
from replication.evidence.verdicts import LONG, THREE, is_there, judged, resting, rows
from replication.studies import multiverse
from replication.studies.alternatives import ORACLES
from replication.studies.hypotheses import FOLLOWED
from replication.studies.theorem import POOLED, SMALLEST
from srlrepro.settings.choices import Choices
from srlrepro.settings.paper import Paper
from srlrepro.storage.files import read_json, read_table
from workflow.command_line import STUDIES

COMPUTING, ROUNDING = TEMPLATES / "computing.csv", TEMPLATES / "rounding.csv"
DRAWS = ("dataset", "learner")  # the choices of the multiverse that are none (multiverse.toml)
NEAREST = 3  # universes shown of those that come nearest to the paper's rates
HALVED = 0.5
SELDOM = 0.25  # share of the random universes up to which a claim holds seldom; often is 1 less this
Rows = list[dict[Any, Any]]


def _theorem(folder: Path) -> dict[str, Any]:
    """Theorem 1 over all trainings of a grid: its steps, its looseness, what its class needs, its orders."""
    bounds = ("(15) for h, l", "(15) for h, l_n", "(11) minimum")
    table = read_table(folder / "theorem_divergence.csv", ("seed", "class", "error", "bound", *bounds))
    single = table[table["seed"] != POOLED]
    smallest = single[single["class"] == SMALLEST]
    terms = read_table(folder / "theorem_terms.csv", ("class", "source_error", "half_divergence", "e1", "e2"))
    terms = terms[terms["class"] == SMALLEST].assign(third=terms[["e1", "e2"]].min(axis=1))
    ratio = (
        (smallest["bound"] / smallest["error"]).groupby(smallest["visited_by"]).agg(["min", "median", "max"])
    )
    classes = [
        {"class": name, "of": len(part), "low": part["bound"].min(), "high": part["bound"].max()}
        | {"vacuous": int((part["bound"] >= 1).sum()), "fails": [int((part[b] < 0).sum()) for b in bounds]}
        for name, part in single.groupby("class", sort=False)
    ]
    orders = read_table(folder / "theorem_orders.csv", ("visited_by", "delta", "quantity", "order of α"))
    orders["delta"] = orders["delta"].map("{:g}".format)
    orders["text"] = orders["order of α"] + " (" + orders["seeds"].astype(str) + ")"
    wide = orders.pivot_table(
        index=["visited_by", "delta"],
        columns="quantity",
        values=["order of α", "text"],
        aggfunc="first",
        sort=False,
    )
    return {
        "steps": read_table(folder / "theorem_steps.csv", ("step", "holds", "of")).to_dict("records"),
        "ratio": ratio.to_dict("index"),
        "shares": (
            terms[["source_error", "half_divergence", "third"]].mean() / terms["bound"].mean()
        ).to_dict(),
        "classes": classes,
        "orders": wide["text"].reset_index().to_dict("records"),
        "same_order": int((wide["order of α"]["bound"] == wide["order of α"]["error"]).sum()),
        "mnd_first": int(wide["order of α"]["bound"].str.startswith("0 <").sum()),
    }


def _multiverse(folder: Path) -> dict[str, Any]:
    """Shares of universes per claim, what decides them, and the universes nearest to the paper's rates."""
    shares = read_table(
        folder / "shares.csv", ("claim", "design", "held", "universes", "share", "low", "high")
    )
    flips = read_table(folder / "flips.csv", ("claim", "choice", "level"))
    effects = read_table(folder / "main_effects.csv", ("claim", "choice", "effect", "q"))
    effects = effects[effects["q"] < multiverse.LEVEL].sort_values("effect", ascending=False)
    usual = {choice.id: choice.levels[0].level for choice in multiverse.load()}
    rates = read_table(folder / "papers_rates.csv", ("id", *claims.RATES, "margin"), text=tuple(usual))
    tested = []
    for claim in claims.load():
        own = shares[shares["claim"] == claim.id].set_index("design")
        decided = own["universes"] - own["violated"] - own["unmeasured"]
        row: dict[str, Any] = {"statement": claim.statement, "ill_posed": claim.ill_posed}
        row["alone"], row["random"] = (
            f"{own['held'][d]} of {decided[d]}" for d in (multiverse.ALONE, multiverse.RANDOM)
        )
        row["share"], row["low"], row["high"] = own.loc[multiverse.RANDOM, ["share", "low", "high"]]
        row["decided"] = decided[multiverse.RANDOM]
        row["deciding"] = effects.loc[effects["claim"] == claim.id, "choice"].tolist()
        flipping = set(flips.loc[flips["claim"] == claim.id, "choice"])
        row |= {"chance": bool(flipping & set(DRAWS)), "flipping": sorted(flipping - set(DRAWS))}
        tested.append(row)
    posed = [row["share"] for row in tested if row["decided"] and not row["ill_posed"]]
    nearest = rates.head(NEAREST)
    differs = [
        ", ".join(f"{n} = {row[n]}" for n in usual if row[n] != usual[n])
        for row in nearest.to_dict("records")
    ]
    return {
        "claims": tested,
        "posed": len(posed),
        "quarter": SELDOM,
        "often": sum(share >= 1 - SELDOM for share in posed),
        "seldom": sum(share <= SELDOM for share in posed),
        "steps": STUDIES["multiverse"].steps,
        "level": multiverse.LEVEL,
        "universes": int(shares.groupby("design")["universes"].max().sum()),
        "violated": int(shares.groupby("design")["violated"].max().sum()),
        "deciding": effects["choice"].value_counts().to_dict(),
        "rates_decided_by": {r: effects.loc[effects["claim"] == r, "choice"].tolist() for r in claims.RATES},
        "hits": int((rates["margin"] >= 0).sum()),
        "rated": len(rates),
        "nearest": nearest.assign(differs=differs).to_dict("records"),
    }


def _hypotheses(folder: Path) -> dict[str, Any]:
    """Brier scores as multiples of the paper's region, how learners fare, which hypotheses cannot guard."""
    names = ("hypothesis", "alpha", "states", "delta", "brier")
    scores = read_table(folder / "hypotheses_classification.csv", names, text=("alpha",))
    learning = read_table(
        folder / "hypotheses_summary.csv", ("hypothesis", "alpha", "delta", "success_rate"), text=("alpha",)
    )
    brier = scores.pivot_table(
        index=["states", "delta", "alpha"], columns="hypothesis", values="brier", sort=False
    )
    means = brier.groupby(level=["states", "delta"], sort=False).mean()
    ratio = means.div(means[Choices.hypothesis], axis=0)
    perceptron = (brier["mlp"] / brier[Choices.hypothesis]).dropna()
    classified, trained = (t[["hypothesis", "alpha"]].drop_duplicates() for t in (scores, learning))
    never = classified.merge(trained, how="left", indicator=True).query("_merge == 'left_only'")
    better = read_table(folder / "hypotheses_better.csv", ("hypothesis",))
    return {
        "ratio": ratio.reset_index().to_dict("records"),
        "columns": list(ratio.columns),
        "perceptron": {
            "cells": len(perceptron),
            "better": int((perceptron < 1).sum()),
            "halved": int((perceptron <= HALVED).sum()),
        },
        "untrained": never.groupby("hypothesis", sort=False)["alpha"].agg(list).to_dict(),
        "better": better.to_dict("split"),
        "svm": better[better["hypothesis"] == "svm"].to_dict("records"),
        "ranks": read_table(folder / "hypotheses_ranks.csv", ("delta", "score", "cells", *FOLLOWED)).to_dict(
            "records"
        ),
        "oracles": learning[learning["hypothesis"].isin(ORACLES)].to_dict("records"),
    }


def _discrepancy(folder: Path) -> dict[str, Any]:
    """Early measures of the discrepancy beside what was learned, their ranks, and the best α of each Δ."""
    names = ("delta", "alpha", "unexplained", "final_return", "success_rate")
    table = read_table(folder / "discrepancy_outcomes.csv", names)
    kept = table[table["success_rate"] >= Paper.p_t]
    best = kept.loc[kept.groupby("delta")["final_return"].idxmax()]
    return {
        "outcomes": table.to_dict("records"),
        "best": best.to_dict("records"),
        "ranks": read_table(folder / "discrepancy_ranks.csv", ("measure",)).to_dict("split"),
    }


def computing(figures: Path) -> Rows:
    """The ledger of computing; rows that name results take what these say of their own time, if complete."""
    ledger = read_table(COMPUTING, ("what", "times", "beyond", "trainings", "core_hours", "kept")).astype(
        object
    )
    found = []
    for row in ledger.where(ledger.notna(), None).to_dict("records"):
        if row["times"]:
            file = figures / row["times"] / "run_time.json"
            complete = row["times"] not in LONG or is_there(figures, row["times"])
            time = read_json(file) if complete and file.exists() else {}
            counted = read_json(figures / row["beyond"] / "run_time.json") if row["beyond"] else {}
            for name in ("trainings", "core_hours"):
                row[name] = time[name] - counted.get(name, 0) if name in time else None
            row |= {"steps": time.get("steps"), "minutes": time.get("minutes"), "ran": bool(time)}
        most = row["minutes"] * row["cores"] / 60 if row["cores"] else None  # all cores busy all the time
        found.append({"ran": True, "most_core_hours": most} | row)
    return found


def _learned(figures: Path, grid: Path) -> dict[str, Any]:
    """Numbers behind what was learned: rounding, the evidence of Γ, the weights of K, what Γ promises."""
    rounding = read_table(ROUNDING, ("measure", "alpha", "delta", "before", "after"))
    returns = rounding[rounding["measure"] == "final_return"]
    returns = returns.assign(moved=(returns["after"] - returns["before"]).abs())
    calibration = read_table(figures / THREE / "choices_calibration.csv", ("variation", "mean"))
    stability = read_table(figures / THREE / "choices_stability.csv", ("variation", "Δ = 4"))
    measures = read_table(grid / "measures.csv", ("measure", "alpha", "delta", "value"))
    gaps = (
        measures[measures["measure"] == "promise_gap"]
        .groupby(["delta", "alpha"])["value"]
        .mean()
        .reset_index()
    )
    gaps["text"] = gaps["value"].map("{:.2f}".format)
    return {
        "moved": returns.nlargest(1, "moved").to_dict("records")[0],
        "median_moved": returns["moved"].median(),
        "brier": calibration.set_index("variation")["mean"].to_dict(),
        "radius": stability.set_index("variation")["Δ = 4"].to_dict(),
        "gaps": gaps.to_dict("records"),
    }


def context(figures: Path = FIGURES) -> dict[str, Any]:
    """What the template is filled with, from the results in a folder of figures.

    Raises:
        ResultError: a table of the paper's grid is missing, or one of another run that is there.
    """
    judgement, grid = judged(figures), figures / resting(figures)
    return judgement | {
        "grid": grid.name,
        "rows": rows(figures, judgement),
        "performance": read_table(grid / "final_performance.csv", ("measure", "IQM")).to_dict("records"),
        "theorem": _theorem(grid),
        "multiverse": _multiverse(figures / "multiverse") if is_there(figures, "multiverse") else None,
        "hypotheses": _hypotheses(figures / "hypotheses") if is_there(figures, "hypotheses") else None,
        "discrepancy": _discrepancy(grid),
        "computing": computing(figures),
        "learned": _learned(figures, grid),
        "stated": len(fields(Paper)),
        "chosen": len(fields(Choices)),
        "varied": len(multiverse.load()) - len(DRAWS),
        "p_t": Paper.p_t,
    }


DOCUMENT = Document("REPORT.md", "report", context)


def refresh(name: str) -> Iterator[str]:
    """Render README.md and REPORT.md, if they tell of the results of this name; yields what was rendered.

    Raises:
        ResultError: a table of the results is missing.
    """
    for document in (readme.DOCUMENT, DOCUMENT) if name in (THREE, *LONG) else ():
        document.write()
        yield document.name
