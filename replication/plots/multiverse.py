"""Specification curves: a claim over all universes, and the choices behind each (Simonsohn et al., 2020)."""

import textwrap
from collections.abc import Sequence

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from replication.evidence.claims import NUMBERS, Claim
from replication.plots.style import BACKGROUND, DEFAULT_UNIVERSE, GRID, INK, LEVELS, PAPERS_NUMBER
from replication.studies.multiverse import ALONE, RANDOM, Choice

SHAPES = {ALONE: "o", RANDOM: "^"}
TITLE_WIDTH = 70  # characters that fit above the axes


def curve_table(claim: Claim, results: pd.DataFrame, universes: pd.DataFrame) -> pd.DataFrame:
    """The universes that can evaluate the claim, by rising value: id, value, holds, design, levels."""
    own = results[(results["claim"] == claim.id) & results["holds"].notna()]
    own = own.join(universes, on="id").drop(columns=["claim", "margin", "why"])
    return own.assign(holds=own["holds"].astype(bool)).sort_values("value", kind="stable", ignore_index=True)


def plot_curve(claim: Claim, table: pd.DataFrame, total: int, choices: Sequence[Choice]) -> Figure:
    """A claim's value in every universe of `curve_table`, of ``total`` there are; below, their levels.

    The line is the paper's number with its tolerance, or the zero margin above which the claim holds.
    """
    figure, (top, bottom) = plt.subplots(2, 1, sharex=True, figsize=(8.0, 7.6), height_ratios=(1.0, 2.0))
    for kind, shape in SHAPES.items():
        part = table[table["design"] == kind]
        fills = np.where(part["holds"], INK, BACKGROUND)
        top.scatter(part.index, part["value"], 22, fills, marker=shape, edgecolors=INK, linewidths=0.7)
    default = table.loc[table["id"] == "default", "value"]
    top.scatter(default.index, default, 130, "none", marker="s", edgecolors=DEFAULT_UNIVERSE, linewidths=1.5)
    near, name = claim.kind in NUMBERS, claim.measure.replace("_", " ")
    top.axhline(claim.value if near else 0.0, color=PAPERS_NUMBER, linewidth=1)
    if near:
        low, high = claim.value - claim.tolerance, claim.value + claim.tolerance
        top.axhspan(low, high, color=PAPERS_NUMBER, alpha=0.1, linewidth=0)
    top.set_ylabel(name if near else f"margin of\n{name}")
    held = int(table["holds"].sum())
    counts = f"holds in {held} of {len(table)} universes; {total - len(table)} not evaluable"
    top.set_title(f"{textwrap.fill(claim.statement, TITLE_WIDTH)}\n{counts}")
    levels = [[entry.level for entry in c.levels] for c in choices]
    codes = [table[c.id].map(names.index) for c, names in zip(choices, levels, strict=True)]
    picture = np.array(codes, float).reshape(len(choices), len(table))
    colors = mpl.colors.ListedColormap(LEVELS)
    bottom.imshow(picture, colors, aspect="auto", interpolation="none", vmin=-0.5, vmax=len(LEVELS) - 0.5)
    labels = [f"{c.id}:  {' · '.join(names)}" for c, names in zip(choices, levels, strict=True)]
    bottom.set_yticks(range(len(choices)), labels, fontsize=7)
    bottom.set_yticks(np.arange(len(choices) + 1) - 0.5, minor=True)
    bottom.grid(axis="y", which="minor", color=BACKGROUND, linewidth=1.5)
    bottom.tick_params(which="minor", length=0)
    bottom.set_xlabel("universes, by value")
    line = "paper's number and tolerance" if near else "above: the claim holds"
    handles = [
        *(Line2D([], [], ls="", marker=m, color=INK, label=k) for k, m in SHAPES.items()),
        Line2D([], [], ls="", marker="o", mfc=BACKGROUND, mec=INK, label="does not hold"),
        Line2D([], [], ls="", marker="s", mfc="none", mec=DEFAULT_UNIVERSE, markersize=9, label="default"),
        Line2D([], [], color=PAPERS_NUMBER, label=line),
        *(Patch(color=c, label=n) for c, n in zip(LEVELS, ("1st level", "2nd", "3rd"), strict=True)),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def plot_shares(table: pd.DataFrame) -> Figure:
    """The `shares` of universes in which each claim holds, by design, with intervals, where there are any."""
    table = table.dropna(subset="share")
    names = list(dict.fromkeys(table["claim"]))[::-1]
    figure, ax = plt.subplots(figsize=(7.0, 0.32 * len(names) + 1.2))
    for shift, (kind, shape) in zip((0.14, -0.14), SHAPES.items(), strict=True):
        part = table[table["design"] == kind]
        place = part["claim"].map(names.index) + shift
        reach = [part["share"] - part["low"], part["high"] - part["share"]]
        ax.errorbar(part["share"], place, xerr=reach, fmt=shape, color=INK, markersize=4, label=kind)
    ax.set_yticks(range(len(names)), names)
    ax.set(xlim=(-0.03, 1.03), ylim=(-0.7, len(names) - 0.3))
    ax.set_xlabel("share of the evaluable universes in which the claim holds")
    ax.grid(axis="x", color=GRID)
    ax.set_axisbelow(True)
    figure.legend(loc="outside lower center", ncols=2)
    return figure
