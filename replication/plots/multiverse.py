"""Specification curves: a claim over all universes, and the choices behind each (Simonsohn et al., 2020)."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from replication.evidence.claims import NUMBERS, Claim
from replication.plots.style import BACKGROUND, DEFAULT_UNIVERSE, GRID, GUIDE, INK, LEVELS, PAPERS_NUMBER
from replication.studies.multiverse import ALONE, RANDOM, TIES, Choice

SHAPES = {ALONE: "o", RANDOM: "^"}
TITLE_WIDTH, ROW_WIDTH = 70, 80  # characters that fit above the axes, and beside those of the shares
FAR = 20.0  # times the median distance from the line: values beyond are drawn on a logarithmic scale


def curve_table(claim: Claim, results: pd.DataFrame, universes: pd.DataFrame) -> pd.DataFrame:
    """The universes that can evaluate the claim, by rising value: id, value, holds, design, levels."""
    own = results[(results["claim"] == claim.id) & results["holds"].notna()]
    own = own.join(universes, on="id").drop(columns=["claim", "margin", "why"])
    order = own["value"].round(TIES).argsort(kind="stable")  # values that differ by rounding alone are equal
    return own.assign(holds=own["holds"].astype(bool)).iloc[order].reset_index(drop=True)


def constant_claims(results: pd.DataFrame) -> set[str]:
    """The claims whose value is the same in every universe, as of `outcomes`: they say nothing of choices."""
    values = results.dropna(subset="value").groupby("claim")["value"]
    return set(values.agg(lambda v: v.round(TIES).nunique())[lambda n: n == 1].index)


def plot_curve(
    claim: Claim, table: pd.DataFrame, total: int, choices: Sequence[Choice], effects: Mapping[str, float]
) -> Figure:
    """A claim's value in every universe of `curve_table`, of ``total`` there are; below, their levels.

    The line is the paper's number with its tolerance, or the zero margin above which the claim holds.

    effects: {choice: the share of the ranks' variance that is its}; the rows are in their order.
    """
    choices = sorted(choices, key=lambda c: -effects.get(c.id, 0.0))
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
    distances = table["value"].abs()
    if not near and distances.max() > FAR * distances.median() > 0:
        top.set_yscale("symlog", linthresh=10.0 ** round(np.log10(distances.median())))
    top.set_ylabel(name if near else f"margin of\n{name}")
    held = int(table["holds"].sum())
    counts = f"holds in {held} of {len(table)} universes; {total - len(table)} not evaluable"
    top.set_title(f"{textwrap.fill(claim.statement, TITLE_WIDTH)}\n{counts}")
    levels = [[entry.level for entry in c.levels] for c in choices]
    codes = [table[c.id].map(names.index) for c, names in zip(choices, levels, strict=True)]
    picture = np.array(codes, float).reshape(len(choices), len(table))
    colors = mpl.colors.ListedColormap(LEVELS)
    bottom.imshow(picture, colors, aspect="auto", interpolation="none", vmin=-0.5, vmax=len(LEVELS) - 0.5)
    labels = [
        f"{c.id}:  {' · '.join(names)}" + (f"   {effects[c.id]:.2f}" if c.id in effects else "")
        for c, names in zip(choices, levels, strict=True)
    ]
    bottom.set_yticks(range(len(choices)), labels, fontsize=7)
    bottom.set_yticks(np.arange(len(choices) + 1) - 0.5, minor=True)
    bottom.grid(axis="y", which="minor", color=BACKGROUND, linewidth=1.5)
    bottom.tick_params(which="minor", length=0)
    bottom.set_xlabel("universes, by value; equal values in the order of the design")
    bottom.set_title("choice:  its levels   share of the ranks' variance", loc="right", x=-0.02, fontsize=7)
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


def plot_shares(
    table: pd.DataFrame, statements: Mapping[str, str], chance: Mapping[str, float], constant: set[str]
) -> Figure:
    """The `shares` of universes in which each claim holds, by design, with intervals, where there are any.

    Args:
        statements: {claim: what it says}.
        chance: {claim: the share in which it would hold if each of its contrasts were the toss of a coin}.
        constant: of `constant_claims`, which stand below the others, with open markers.
    """
    table = table.dropna(subset="share")
    order = list(dict.fromkeys(table["claim"]))[::-1]  # from below
    names = [name for name in order if name in constant] + [name for name in order if name not in constant]
    texts = [textwrap.fill(statements[name], ROW_WIDTH) for name in names]
    same, varied = table[table["claim"].isin(constant)], table[~table["claim"].isin(constant)]
    figure, ax = plt.subplots(figsize=(9.5, 0.3 * len(names) + 1.4))
    for shift, (kind, shape) in zip((0.14, -0.14), SHAPES.items(), strict=True):
        for fill, part in ((INK, varied), (BACKGROUND, same)):
            own = part[part["design"] == kind]
            reach = np.maximum([own["share"] - own["low"], own["high"] - own["share"]], 0)
            look: dict[str, Any] = {"fmt": shape, "color": INK, "markerfacecolor": fill, "markersize": 4}
            text = kind if part is varied else None
            ax.errorbar(own["share"], own["claim"].map(names.index) + shift, xerr=reach, label=text, **look)
    known = [(chance[name], i) for i, name in enumerate(names) if name in chance and name not in constant]
    ax.plot(*np.reshape(known, (-1, 2)).T, "|", color=GUIDE, markersize=9, label="by chance")
    count = sum(name in constant for name in names)
    if 0 < count < len(names):
        ax.axhline(
            count - 0.5, color=GUIDE, linestyle=":", linewidth=1, label="below: the same in every universe"
        )
    ax.set_yticks(range(len(names)), texts, fontsize=7)
    ax.set(xlim=(-0.03, 1.03), ylim=(-0.7, len(names) - 0.3))
    ax.set_xlabel("share of the evaluable universes in which the claim holds")
    ax.grid(axis="x", color=GRID)
    ax.set_axisbelow(True)
    figure.legend(loc="outside lower center", ncols=4)
    return figure
