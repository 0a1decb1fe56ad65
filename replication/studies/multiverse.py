r"""A multiverse over what the paper leaves open (``multiverse.toml``): which claims depend on which choices?

A *universe* takes one level of every choice. Two designs (Steegen et al., 2016):

- one at a time: the default universe, and one universe for every alternative level. A claim *flips* where it
  holds in one of the two and not in the other;
- random: a Latin hypercube of levels, so that every level of a choice is taken (up to one) equally often,
  whatever the others are. Over it, a choice's main effect on a claim is tested by Kruskal and Wallis on the
  claim's margins, with Benjamini and Hochberg's correction over the choices.

The *margin* of a claim is how far its estimates lie, at least, within the range where it holds (see
`claims`). Two of the "choices" draw the training data and the learner anew, and so measure chance.
"""

import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import false_discovery_control, kruskal
from scipy.stats.qmc import LatinHypercube

from replication.evidence.claims import NUMBERS, RATES, Claim, Grid, contrasts_of, margins, points
from replication.evidence.statistics import share_interval

Tables = Mapping[str, pd.DataFrame]  # by the id of the universe
DESIGN_SEED = 0
DRAWN = 48  # random universes: about as many as alternatives, at least 16 for each level of a choice
ALONE, RANDOM = "one at a time", "random"
TIES = 9  # decimals of a value: those that are equal but for the order of a sum have the same rank
LEVEL = 0.05  # of q, the p of a main effect corrected for the number of choices
VIOLATED = "set-up condition violated: "
FEW = 6  # universes of a quick multiverse, at most


@dataclass(frozen=True)
class Level:
    """One value of a choice: its name, its settings (none: the default), and its reason."""

    level: str
    set: Mapping[str, Any]
    reason: str


@dataclass(frozen=True)
class Choice:
    """One open choice; the first level is the default."""

    id: str
    levels: tuple[Level, ...]


def load_choices() -> list[Choice]:
    """The choices, in the order of the file."""
    data = tomllib.loads(files("replication.studies").joinpath("multiverse.toml").read_text(encoding="utf-8"))
    return [
        Choice(c["id"], (Level(c["default"], {}, "choices.py"), *(Level(**a) for a in c["alternatives"])))
        for c in data["choice"]
    ]


def design(choices: Iterable[Choice], drawn: int = DRAWN, seed: int = DESIGN_SEED) -> pd.DataFrame:
    """The universes: index id (fit for file names), columns design and one per choice with the level's name.

    The default comes first, then one universe per alternative, then as many as ``drawn`` of random levels.
    """
    choices = list(choices)
    default = {c.id: c.levels[0].level for c in choices}
    rows = {"default": {"design": ALONE} | default}
    for c in choices:
        for entry in c.levels[1:]:
            name = f"{c.id}__{re.sub(r'[^A-Za-z0-9.]+', '-', entry.level).strip('-')}"
            rows[name] = {"design": ALONE} | default | {c.id: entry.level}
    for i, point in enumerate(LatinHypercube(len(choices), rng=seed).random(drawn)):
        taken = {c.id: c.levels[int(u * len(c.levels))].level for c, u in zip(choices, point, strict=True)}
        rows[f"random_{i:03d}"] = {"design": RANDOM} | taken
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("id")


def settings(choices: Iterable[Choice], universe: Mapping[Any, str]) -> dict[str, Any]:
    """{name: value} of everything in which a row of the design differs from the default."""
    taken = [level.set for c in choices for level in c.levels if level.level == universe[c.id]]
    return {name: value for values in taken for name, value in values.items()}


def jobs(alphas: list[str], few: bool) -> dict[str, dict[str, Any]]:
    """{id of a universe: the parameters of its notebook that differ between universes}, as of `design`.

    Args:
        alphas: conditions of the grid, as texts.
        few: only some universes, spread over the design.
    """
    choices = load_choices()
    universes = design(choices)
    if few:
        universes = universes.iloc[:: -(-len(universes) // FEW)]
    found = {}
    for name, levels in universes.iterrows():
        values = settings(choices, levels.to_dict())
        drawn = {"DATA_SEED": values.pop("data_seed", 0), "SEEDS": [values.pop("seed", 0)]}
        found[str(name)] = {"ID": str(name), "ALPHAS": alphas, "SETTINGS": values} | drawn
    return found


def outcomes(claims: Iterable[Claim], measures: Tables, conditions: Tables, grid: Grid) -> pd.DataFrame:
    """One row per universe and claim: id, claim, value, margin, holds, why.

    ``value``: what the claim measures, if it compares one cell with a number, else the margin. ``holds`` and
    ``margin`` are empty where the claim cannot be evaluated, and ``why`` says so: a violated condition, or a
    cell that was not measured.
    """
    rows = []
    for name, table in measures.items():
        broken = conditions[name].loc[~conditions[name]["met"], "condition"]
        for claim in claims:
            contrasts = contrasts_of(claim, table, grid=grid)
            margin = float(margins(contrasts).min(skipna=False))
            value, held = margin, points(contrasts)
            why = "not measured" if held is None else ""
            if claim.kind in NUMBERS:  # the measure itself
                value = contrasts["estimate"].mean() + claim.value
            if len(broken):
                value, margin, held, why = np.nan, np.nan, None, VIOLATED + "; ".join(broken)
            rows.append((name, claim.id, value, margin, held, why))
    return pd.DataFrame(rows, columns=["id", "claim", "value", "margin", "holds", "why"])


def shares(results: pd.DataFrame, universes: pd.DataFrame) -> pd.DataFrame:
    """Per claim and design: universes, violated, unmeasured, held, share, and its 95 % interval (Wilson)."""
    rows = []
    joined = results.join(universes["design"], on="id")
    for (claim, kind), group in joined.groupby(["claim", "design"], sort=False):
        violated = int(group["why"].str.startswith(VIOLATED).sum())
        decided = group["holds"].dropna().astype(bool)
        n, held = len(decided), int(decided.sum())
        counts = len(group), violated, len(group) - n - violated, held
        interval = share_interval(held, n, method="wilson")
        rows.append((claim, kind, *counts, held / n if n else np.nan, *interval))
    columns = ["claim", "design", "universes", "violated", "unmeasured", "held", "share", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def flips(results: pd.DataFrame, universes: pd.DataFrame) -> pd.DataFrame:
    """The alternatives that, alone, turn a claim of the default universe: claim, choice, level, holds."""
    rows = []
    alone = universes[universes["design"] == ALONE].drop(columns="design")
    decided = results.dropna(subset="holds").set_index("id")[["claim", "holds"]]
    before = dict(decided[decided.index == "default"].to_numpy())
    for name, levels in alone.drop(index="default").iterrows():
        (choice,) = levels.index[levels != alone.loc["default"]]
        for claim, held in decided[decided.index == name].to_numpy():
            if held != before.get(claim, held):
                rows.append((claim, choice, levels[choice], held))
    return pd.DataFrame(rows, columns=["claim", "choice", "level", "holds"])


def main_effects(results: pd.DataFrame, universes: pd.DataFrame) -> pd.DataFrame:
    """Which choices move the value of a claim (as of `outcomes`) over the random design.

    Not its margin: that of a claim about a number falls on both sides of it, and hides what a choice moves
    from one side to the other.

    Columns: claim, choice, levels ("level: share held (n)", in words), spread (of the shares held), effect
    (ε² = H / (n − 1), the share of the ranks' variance), p (Kruskal and Wallis), q (p corrected over the
    choices of a claim). A choice with fewer than two levels measured twice is left out.
    """
    rows: list[tuple[Any, ...]] = []
    drawn = universes[universes["design"] == RANDOM]
    for claim, group in results.dropna(subset="value").groupby("claim", sort=False):
        table = group.assign(value=group["value"].round(TIES)).set_index("id").join(drawn, how="inner")
        found: list[tuple[Any, ...]] = []
        for choice in drawn.columns.drop("design"):
            levels = {str(level): part for level, part in table.groupby(choice, sort=False) if len(part) > 1}
            if len(levels) < 2 or table["value"].nunique() < 2:
                continue
            h, p = kruskal(*(part["value"] for part in levels.values()))
            held = {level: part["holds"].astype(float).mean() for level, part in levels.items()}
            words = ", ".join(f"{level}: {held[level]:.2f} ({len(part)})" for level, part in levels.items())
            spread = max(held.values()) - min(held.values())
            found.append((claim, choice, words, spread, h / (len(table) - 1), p))
        if found:
            corrected = false_discovery_control([row[-1] for row in found])
            rows += [(*row, q) for row, q in zip(found, corrected, strict=True)]
    return pd.DataFrame(rows, columns=["claim", "choice", "levels", "spread", "effect", "p", "q"])


def papers_rates(results: pd.DataFrame, universes: pd.DataFrame) -> pd.DataFrame:
    """How near each universe comes to the paper's three success rates at once, the nearest first.

    Columns: id, the rates by claim, margin (the smallest of the three: not negative if all lie within their
    tolerances), design and levels.
    """
    rates = results[results["claim"].isin(RATES)].dropna(subset="margin")
    table = rates.pivot_table(index="id", columns="claim", values="value").reindex(columns=list(RATES))
    table = table.dropna().assign(margin=rates.groupby("id")["margin"].min())
    return table.join(universes).sort_values("margin", ascending=False).reset_index()
