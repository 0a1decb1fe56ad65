"""The hypotheses side by side: how well they predict, and how learners fare under their supervision."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from replication.plots.style import CONDITIONS, GRID, KNOWS_SYSTEM, label
from replication.studies.hypotheses import ANY, SCORES

PALETTE = {**CONDITIONS, ANY: KNOWS_SYSTEM}
DODGED = 0.8  # of the distance between hypotheses, by seaborn, over the values of α


def plot_scores(scores: pd.DataFrame) -> Figure:
    """Precision, recall and Brier score of each hypothesis (columns as of `classify`), by states and α."""
    groups = scores.groupby(["states", "delta"], sort=False)
    figure, axes = _panels(scores, len(SCORES), len(groups), (1.9 * len(groups) + 0.8, 6.4))
    for column, ((states, delta), table) in zip(axes.T, groups, strict=True):
        system = "nominal" if delta == 1 else rf"$\Delta = {delta:g}$"
        column[0].set_title(f"{states}\n{system}")
        for ax, score in zip(column, SCORES, strict=True):
            _strip(ax, scores, table, score)
    for ax, score in zip(axes[:, 0], SCORES, strict=True):
        ax.set_ylabel("Brier score" if score == "brier" else score)
    return figure


def plot_learning_under(measures: pd.DataFrame, shown: Mapping[str, str]) -> Figure:
    """Measures (name: axis label) of learners under each hypothesis, by Δ and α; a dot per seed, a bar: mean.

    measures: columns hypothesis, measure, alpha, delta, seed, value.
    """
    deltas = sorted(measures["delta"].dropna().unique())
    size = 4.2 * len(deltas), 1.8 * len(shown) + 0.8
    figure, axes = _panels(measures, len(shown), len(deltas), size)
    for row, (measure, text) in zip(axes, shown.items(), strict=True):
        for ax, delta in zip(row, deltas, strict=True):
            here = (measures["measure"] == measure) & (measures["delta"] == delta)
            _strip(ax, measures, measures[here], "value")
        row[0].set_ylabel(text)
    for ax, delta in zip(axes[0], deltas, strict=True):
        ax.set_title(rf"$\Delta = {delta:g}$")
    return figure


def _alphas(table: pd.DataFrame) -> list[str]:
    return [alpha for alpha in PALETTE if alpha in set(table["alpha"])]


def _panels(table: pd.DataFrame, rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, Any]:
    """A figure (of a size in inches) and its axes [rows, columns], with a legend of the table's α's."""
    figure, axes = plt.subplots(rows, columns, sharex=True, sharey="row", squeeze=False, figsize=size)
    names = {a: "knows the system" if a == ANY else label(a) for a in _alphas(table)}
    handles = [Line2D([], [], ls="", marker="o", color=PALETTE[a], label=text) for a, text in names.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(names))
    return figure, axes


def _strip(ax: Axes, whole: pd.DataFrame, part: pd.DataFrame, y: str) -> None:
    """Dots of a part of a table by α, side by side at each hypothesis, and a bar at the mean of each α."""
    import seaborn as sns  # here, since it is slow to import

    alphas, names = _alphas(whole), whole["hypothesis"].unique()
    common = {"data": part, "x": "hypothesis", "y": y, "order": names, "ax": ax, "legend": False}
    common |= {"hue": "alpha", "hue_order": alphas, "palette": [PALETTE[alpha] for alpha in alphas]}
    sns.stripplot(**common, dodge=True, jitter=False, size=3.5)
    apart = DODGED * (1 - 1 / len(alphas)) if len(alphas) > 1 else False
    sns.pointplot(**common, dodge=apart, errorbar=None, marker="_", markersize=9, linestyle="none")
    ax.tick_params(axis="x", labelrotation=90)
    ax.set(xlabel="", ylabel="")
    ax.grid(axis="y", color=GRID)
    ax.set_axisbelow(True)
