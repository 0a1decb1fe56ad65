"""The forest plot of the claims: every contrast with its interval and its seeds."""

import textwrap

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from replication.plots.style import CONTRADICTS, INK, SUPPORTS, UNRESOLVED

COLORS = {"supports": SUPPORTS, "contradicts": CONTRADICTS, "unresolved": UNRESOLVED}
SHAPES = {"supports": "o", "contradicts": "X", "unresolved": "s"}
HEAD = 3.4  # height of a panel's title and axis, in rows
ROW = 0.17  # in
LABEL_WIDTH = 56  # characters of a contrast's name in a line
TITLE_WIDTH = 84  # characters of a panel's title in a line


def plot_contrasts(ax: Axes, contrasts: pd.DataFrame) -> None:
    """One claim, a contrast a row: seeds (dots), mean (marker) and interval (line), coloured by state.

    The claim holds in the shaded range. contrasts: of one claim, as `claims.contrasts_of` gives them.
    """
    for place, row in enumerate(contrasts.to_dict("records")):
        if row["n"] == 0:
            ax.text(row["least"], place, " not measured", va="center", fontsize=6, color=UNRESOLVED)
            continue
        tint, marker = COLORS[row["state"]], SHAPES[row["state"]]
        seeds = np.array(str(row["values"]).split(), dtype=float)
        ax.plot(seeds, np.full(len(seeds), place + 0.28), "|", color=tint, markersize=3, alpha=0.7)
        ax.plot([row["low"], row["high"]], [place, place], color=tint, linewidth=1.6)
        ax.plot(row["estimate"], place, marker, color=tint, markersize=4.5, markeredgewidth=0)
    least, most = contrasts[["least", "most"]].iloc[0]
    low, high = ax.get_xlim()
    low, high = min(low, least), max(high, most if np.isfinite(most) else least)
    margin = 0.04 * (high - low)
    ax.axvspan(least, min(most, high + margin), color=SUPPORTS, alpha=0.07, linewidth=0)
    for border in (least, most):
        ax.axvline(border, color=INK, linewidth=0.8)
    ax.set(xlim=(low - margin, high + margin), ylim=(len(contrasts) - 0.4, -0.6))
    ax.set_yticks(range(len(contrasts)), contrasts["contrast"].str.wrap(LABEL_WIDTH))
    ax.tick_params(labelsize=6, length=2)


def plot_verdicts(summary: pd.DataFrame, contrasts: pd.DataFrame, columns: int = 2) -> Figure:
    """The forest plot of all claims, in columns of about the same height; both tables by `judge_claims`."""
    sizes = contrasts.groupby("id", sort=False).size() + HEAD
    groups = sizes.groupby((columns * (sizes.cumsum() - sizes / 2) / sizes.sum()).astype(int))
    figure = plt.figure(figsize=(5.4 * columns, ROW * groups.sum().max()))
    for part, (_, part_sizes) in zip(figure.subfigures(1, columns, squeeze=False)[0], groups, strict=True):
        axes = part.subplots(len(part_sizes), 1, height_ratios=part_sizes, squeeze=False)[:, 0]
        for ax, name in zip(axes, part_sizes.index, strict=True):
            claim = summary.set_index("id").loc[name]
            plot_contrasts(ax, contrasts[contrasts["id"] == name])
            note = " (cannot decide the claim)" if claim["ill_posed"] else ""
            title = textwrap.fill(f"{claim['statement'].rstrip('.')}: {claim['verdict']}{note}", TITLE_WIDTH)
            ax.set_title(title, fontsize=6.5, loc="right", fontweight="bold")
            ax.set_xlabel(f"contrast in {claim['measure'].replace('_', ' ')}", fontsize=6, labelpad=1)
    handles = [Line2D([], [], color=COLORS[s], marker=SHAPES[s], label=s) for s in COLORS]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=7)
    return figure
