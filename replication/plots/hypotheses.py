"""The hypotheses side by side: how well they predict, and how learners fare under their supervision."""

from collections.abc import Mapping

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
    alphas = [alpha for alpha in PALETTE if alpha in set(scores["alpha"])]
    names = list(scores["hypothesis"].unique())
    groups = list(scores.groupby(["states", "delta"], sort=False))
    figure, axes = plt.subplots(
        len(SCORES),
        len(groups),
        sharex=True,
        sharey="row",
        squeeze=False,
        figsize=(1.9 * len(groups) + 0.8, 6.4),
    )
    for column, ((states, delta), table) in zip(axes.T, groups, strict=True):
        system = "nominal" if delta == 1 else rf"$\Delta = {delta:g}$"
        column[0].set_title(f"{states}\n{system}")
        for ax, score in zip(column, SCORES, strict=True):
            _strip(ax, table, score, names, alphas)
    for ax, score in zip(axes[:, 0], SCORES, strict=True):
        ax.set_ylabel("Brier score" if score == "brier" else score)
    _legend(figure, alphas)
    return figure


def plot_learning_under(measures: pd.DataFrame, shown: Mapping[str, str]) -> Figure:
    """Measures (name: axis label) of learners under each hypothesis, by Δ and α; a dot per seed, a bar: mean.

    measures: columns hypothesis, measure, alpha, delta, seed, value.
    """
    alphas = [alpha for alpha in PALETTE if alpha in set(measures["alpha"])]
    names = list(measures["hypothesis"].unique())
    deltas = sorted(measures["delta"].dropna().unique())
    figure, axes = plt.subplots(
        len(shown),
        len(deltas),
        sharex=True,
        sharey="row",
        squeeze=False,
        figsize=(4.2 * len(deltas), 1.8 * len(shown) + 0.8),
    )
    for row, (measure, text) in zip(axes, shown.items(), strict=True):
        for ax, delta in zip(row, deltas, strict=True):
            here = (measures["measure"] == measure) & (measures["delta"] == delta)
            _strip(ax, measures[here], "value", names, alphas)
        row[0].set_ylabel(text)
    for ax, delta in zip(axes[0], deltas, strict=True):
        ax.set_title(rf"$\Delta = {delta:g}$")
    _legend(figure, alphas)
    return figure


def _strip(ax: Axes, table: pd.DataFrame, y: str, names: list[str], alphas: list[str]) -> None:
    """Dots by α, side by side at each hypothesis, and a bar at the mean of each α."""
    import seaborn as sns  # here, since it is slow to import

    common = {"data": table, "x": "hypothesis", "y": y, "order": names, "ax": ax, "legend": False}
    common |= {"hue": "alpha", "hue_order": alphas, "palette": [PALETTE[alpha] for alpha in alphas]}
    sns.stripplot(**common, dodge=True, jitter=False, size=3.5)
    apart = DODGED * (1 - 1 / len(alphas)) if len(alphas) > 1 else False
    sns.pointplot(**common, dodge=apart, errorbar=None, marker="_", markersize=9, linestyle="none")
    ax.tick_params(axis="x", labelrotation=90)
    ax.set(xlabel="", ylabel="")
    ax.grid(axis="y", color=GRID)
    ax.set_axisbelow(True)


def _legend(figure: Figure, shown: list[str]) -> None:
    text = {ANY: "knows the system"}
    handles = [
        Line2D([], [], ls="", marker="o", color=PALETTE[a], label=text.get(a) or label(a)) for a in shown
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(shown))
