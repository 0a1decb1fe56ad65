"""What the study of joints shows: where a low dimension pays, every hypothesis, coverage, and learners."""

import textwrap
from itertools import product

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from replication.plots.style import (
    BACKGROUND,
    GRID,
    GUIDE,
    INK,
    MARKERS,
    OTHER_MARKER,
    color,
    delta_colors,
    label,
)
from replication.studies.designs import ENDS_OF_ALPHA, WHOLE_STATE
from replication.studies.joints.answer import PAIRS, RECALL
from replication.studies.joints.cells import LAWS, LEARNERS, MIXED
from replication.studies.joints.rungs import CEILING, MAPS, RUNGS, WHOLE
from replication.studies.joints.training import CONTRASTS, MAP, OUTCOMES
from srlrepro.settings.condition import NONE

PANELS = (
    ("visits", 1.1),
    ("visits", 4.0),
    ("UD", 1.1),
    (LEARNERS, 1.1),
)  # law of the test states, Δ of labels
OF_LAW = {"UD": "1", "MND": "0", "visits": NONE, LEARNERS: NONE}  # conditions that have their colours
WHERE = {"UD": "UD", "MND": "MND", "visits": "random policy", LEARNERS: "free learners"}
K_MAP, RUNG_MAP, WHOLE_MAP = "viridis", "tab10", "Dark2"  # of k, of maps, of the whole state
SHIFT = 0.08  # between lines side by side, in joints
MARKS, CEILING_MARK = (*MARKERS.values(), OTHER_MARKER), "P"
WRAP = 24  # characters of a line beside a panel
ENOUGH, MARGIN = 3, 0.05  # datasets of an interval that is shown whole; room beside it, of all that is shown
BARS = f"bars: 95 % over datasets; where there are fewer than {ENOUGH}, the edge may cut them"
FALSE = f"false_positives_{RECALL:g}"


def ladder(means: pd.DataFrame) -> pd.DataFrame:
    """The rows of `averaged` for `plot_ladder`: of the k with most hypotheses, at α = `MIXED`."""
    mixed = means[means["alpha"].astype(str) == MIXED]
    counts = mixed.groupby("k")["hypothesis"].nunique()
    rows: pd.DataFrame = mixed[mixed["k"] == counts[counts == counts.max()].index.max()]
    columns = ["links", "k", "law", "delta", "hypothesis", "datasets", FALSE, f"{FALSE}_half"]
    return rows[columns].reset_index(drop=True)


def coverage(means: pd.DataFrame) -> pd.DataFrame:
    """The rows of `averaged` that `plot_coverage` draws: of an SVM, of the k that `ladder` shows."""
    k = ladder(means)["k"].iloc[0]
    rows: pd.DataFrame = means[(means["hypothesis"] == "svm") & (means["k"] == k)]
    columns = ["links", "k", "alpha", "law", "delta", "datasets", "safe", FALSE, f"{FALSE}_half"]
    return rows[columns].reset_index(drop=True)


def plot_advantages(found: pd.DataFrame) -> Figure:
    """The advantage of a low dimension against n: a line for each k, a row of panels for each pair.

    found: of `advantages`. Bars are 95 % intervals over datasets; there is none of a single dataset.
    """
    figure, axes = plt.subplots(len(PAIRS), len(PANELS), figsize=(11.0, 5.2), sharex=True, sharey="row")
    ks = sorted(found["k"].unique())
    shown = found[[place in PANELS for place in zip(found["law"], found["delta"], strict=True)]]
    shades = [mpl.colors.to_hex(mpl.colormaps[K_MAP](v)) for v in np.linspace(0.1, 0.85, len(ks))]
    for row, (pair, (_, _, text)) in zip(axes, PAIRS.items(), strict=True):
        for ax, (law, delta) in zip(row, PANELS, strict=True):
            own = found[(found["pair"] == pair) & (found["law"] == law) & (found["delta"] == delta)]
            ax.axhline(0, color=GUIDE, linewidth=0.8)
            for i, (k, shade) in enumerate(zip(ks, shades, strict=True)):
                line = own[own["k"] == k]
                place = line["links"] + SHIFT * (i - (len(ks) - 1) / 2)
                width = [line["advantage"] - line["low"], line["high"] - line["advantage"]]
                look = {"color": shade, "marker": MARKS[i % len(MARKS)], "markersize": 4, "linewidth": 1}
                ax.errorbar(place, line["advantage"], np.nan_to_num(width), label=f"k = {k}", **look)
        words = text.split(" against ")
        row[0].set_ylabel(f"advantage of {words[0]}\nover {words[1]}", fontsize=8)
        row[0].set_ylim(_limits(shown[shown["pair"] == pair], "advantage"))
    for ax, (law, delta) in zip(axes[0], PANELS, strict=True):
        ax.set_title(rf"{WHERE[law]}, $\Delta = {delta:g}$")
    _joints(axes[-1])
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(ks), title=BARS)
    return figure


def plot_ladder(rows: pd.DataFrame) -> Figure:
    """Share of the unsafe states that each hypothesis accepts at equal recall; rows: of `ladder`."""
    figure, axes = plt.subplots(2, len(PANELS), figsize=(11.0, 5.6), sharex=True, sharey=True)
    kinds = (("a map", MAPS, RUNG_MAP), ("the whole state", WHOLE, WHOLE_MAP))
    for line, (title, names, tints) in zip(axes, kinds, strict=True):
        shown = [*names, *([CEILING] if CEILING not in names else [])]
        for ax, (law, delta) in zip(line, PANELS, strict=True):
            own = rows[(rows["law"] == law) & (rows["delta"] == delta)]
            for i, name in enumerate(shown):
                part = own[own["hypothesis"] == name].sort_values("links")
                tint = INK if name == CEILING else mpl.colors.to_hex(mpl.colormaps[tints](i))
                marker = CEILING_MARK if name == CEILING else MARKS[i % len(MARKS)]
                look = {"marker": marker, "color": tint, "markersize": 3.5, "linewidth": 1}
                ax.plot(part["links"], part[FALSE], label=RUNGS[name].text, **look)
            ax.axhline(RECALL, color=GUIDE, linewidth=0.6, linestyle=":")
        line[0].set_ylabel(f"by {title}: unsafe states\naccepted at a recall of {RECALL:g}", fontsize=8)
        line[-1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=7)
    for ax, (law, delta) in zip(axes[0], PANELS, strict=True):
        ax.set_title(rf"{WHERE[law]}, $\Delta = {delta:g}$")
    _joints(axes[-1])
    return figure


def plot_coverage(rows: pd.DataFrame) -> Figure:
    """Left: the share of safe states by law, nominal. Right: what an SVM accepts of visited states, by α.

    rows: of `coverage`.
    """
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 2.9), sharex=True)
    for i, law in enumerate((*LAWS, LEARNERS)):
        own = rows[(rows["law"] == law) & (rows["delta"] == 1.0) & (rows["alpha"].astype(str) == MIXED)]
        tint = color(OF_LAW[law])
        style = ":" if law == "visits" else "-"
        left.plot(
            own["links"], own["safe"], style, marker=MARKS[i], markersize=4, color=tint, label=WHERE[law]
        )
    visited = rows[(rows["law"] == "visits") & (rows["delta"] == PANELS[0][1])]
    for alpha, own in visited.groupby(visited["alpha"].astype(str)):
        width = own[f"{FALSE}_half"].fillna(0)
        look = {"marker": MARKERS.get(str(alpha), OTHER_MARKER), "color": color(str(alpha)), "markersize": 4}
        right.errorbar(own["links"], own[FALSE], width, label=label(str(alpha)), **look)
    right.axhline(RECALL, color=GUIDE, linewidth=0.6, linestyle=":")
    left.set(ylabel="safe states, nominal", ylim=(0, 1))
    right.set(ylabel=f"unsafe visits that an SVM\naccepts at a recall of {RECALL:g}", ylim=(0, 1))
    for ax in (left, right):
        ax.legend(fontsize=7)
        ax.grid(axis="y", color=GRID)
        ax.set_axisbelow(True)
    _joints([left, right])
    return figure


def plot_learners(runs: pd.DataFrame) -> Figure:
    """Every outcome against n, a column for each Δ: dots are datasets, a line joins their means.

    runs: of `learners`. The map is filled, the whole state hollow.
    """
    deltas = sorted(runs["delta"].unique())
    figure, axes = plt.subplots(
        len(OUTCOMES), len(deltas), figsize=(3.8 * len(deltas), 8.2), sharex=True, sharey="row", squeeze=False
    )
    series = [(kind, alpha) for kind in (MAP, WHOLE_STATE) for alpha in ENDS_OF_ALPHA] + [(NONE, NONE)]
    for line, (outcome, words) in zip(axes, OUTCOMES.items(), strict=True):
        line[0].set_ylabel(textwrap.fill(words, WRAP), fontsize=7)
        for ax, delta in zip(line, deltas, strict=True):
            for i, (kind, alpha) in enumerate(series):
                own = runs[(runs["delta"] == delta) & (runs["hypothesis"] == kind) & (runs["alpha"] == alpha)]
                own = own.dropna(subset=outcome)
                shift = SHIFT * (i - (len(series) - 1) / 2)
                face = BACKGROUND if kind == WHOLE_STATE else color(alpha)
                look = {"marker": MARKERS[alpha], "color": color(alpha), "markerfacecolor": face}
                ax.plot(own["links"] + shift, own[outcome], linestyle="", markersize=2.5, **look)
                mean = own.groupby("links")[outcome].mean()
                name = label(alpha) + ("" if alpha == NONE else ", map" if kind == MAP else ", whole state")
                style = "--" if kind == WHOLE_STATE else "-"
                ax.plot(mean.index + shift, mean, style, markersize=4.5, linewidth=1, label=name, **look)
            ax.grid(axis="y", color=GRID)
    for ax, delta in zip(axes[0], deltas, strict=True):
        ax.set_title(rf"$\Delta = {delta:g}$")
    _joints(axes[-1])
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
    return figure


def plot_frontier(runs: pd.DataFrame) -> Figure:
    """Violations against the final return: a panel for each n and Δ, a mark for each learner.

    runs: of `learners`. Better is to the right and below.
    """
    deltas, links = sorted(runs["delta"].unique()), sorted(runs["links"].unique())
    size = 2.4 * len(links), 2.2 * len(deltas) + 0.4
    figure, axes = plt.subplots(
        len(deltas), len(links), figsize=size, sharex=True, sharey=True, squeeze=False
    )
    for (line, delta), (column, n) in product(zip(axes, deltas, strict=True), enumerate(links)):
        ax = line[column]
        for (kind, alpha), own in runs[(runs["delta"] == delta) & (runs["links"] == n)].groupby(
            ["hypothesis", "alpha"]
        ):
            name = label(str(alpha)) + ("" if alpha == NONE else ", map" if kind == MAP else ", whole state")
            face = BACKGROUND if kind == WHOLE_STATE else color(str(alpha))
            look = {"marker": MARKERS[str(alpha)], "color": color(str(alpha)), "markerfacecolor": face}
            ax.plot(
                own["return_share"], own["log_violations"], linestyle="", markersize=4, label=name, **look
            )
        ax.set_title(rf"$n = {n}$, $\Delta = {delta:g}$", fontsize=8)
        ax.grid(color=GRID)
    for ax in axes[-1]:
        ax.set_xlabel("final return / perfect", fontsize=7)
    for ax in axes[:, 0]:
        ax.set_ylabel("ln of violations", fontsize=7)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=7)
    return figure


def plot_contrasts(found: pd.DataFrame) -> Figure:
    """Every contrast against n: a row for each, a column for each outcome; bars are 95 % over datasets.

    found: of `contrasts`.
    """
    deltas = sorted(found["delta"].unique())
    size = 2.1 * len(OUTCOMES), 1.7 * len(CONTRASTS) + 0.4
    figure, axes = plt.subplots(len(CONTRASTS), len(OUTCOMES), figsize=size, sharex=True, sharey="col")
    for (line, contrast), (column, outcome) in product(
        zip(axes, CONTRASTS, strict=True), enumerate(OUTCOMES)
    ):
        ax = line[column]
        ax.axhline(0, color=GUIDE, linewidth=0.8)
        for i, (delta, tint) in enumerate(zip(deltas, delta_colors(len(deltas)), strict=True)):
            own = found[
                (found["contrast"] == contrast) & (found["outcome"] == outcome) & (found["delta"] == delta)
            ]
            place = own["links"] + SHIFT * (i - (len(deltas) - 1) / 2)
            width = [own["estimate"] - own["low"], own["high"] - own["estimate"]]
            look = {"marker": MARKS[i], "color": tint, "markersize": 4, "linewidth": 1}
            ax.errorbar(place, own["estimate"], np.nan_to_num(width), label=rf"$\Delta = {delta:g}$", **look)
    for ax, words in zip(axes[0], OUTCOMES.values(), strict=True):
        ax.set_title(textwrap.fill(words, WRAP), fontsize=7)
    for ax, contrast in zip(axes[:, 0], CONTRASTS, strict=True):
        ax.set_ylabel(textwrap.fill(contrast, WRAP), fontsize=7)
    _joints(axes[-1])
    for outcome, ax in zip(OUTCOMES, axes[0], strict=True):
        ax.set_ylim(_limits(found[found["outcome"] == outcome], "estimate"))
    for ax in axes.flat:
        if not any(len(bars[0].get_xdata()) for bars in ax.containers):
            ax.text(0.5, 0.85, "it has no K", ha="center", fontsize=7, color=GUIDE, transform=ax.transAxes)
    entries = axes[0, 0].get_legend_handles_labels()
    figure.legend(*entries, loc="outside lower center", ncols=len(deltas), title=BARS)
    return figure


def _limits(rows: pd.DataFrame, value: str) -> tuple[float, float]:
    """Of an axis that shows every value, and the intervals (low, high) of `ENOUGH` datasets whole."""
    many = rows[rows["datasets"] >= ENOUGH]
    shown = [rows[value].to_numpy(), *many[["low", "high"]].to_numpy().T, [0.0]]
    low, high = np.nanmin(np.concatenate(shown)), np.nanmax(np.concatenate(shown))
    room = MARGIN * (high - low) or 1.0
    return float(low - room), float(high + room)


def _joints(axes: "list[Axes] | np.ndarray") -> None:
    for ax in axes:
        ax.set_xlabel("joints $n$")
        ax.xaxis.set_major_locator(mpl.ticker.MaxNLocator(integer=True))
