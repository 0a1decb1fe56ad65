"""What the studies of full length show: variance by dataset, outcomes against caution, data that move."""

from collections.abc import Iterable
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import NullFormatter

from replication.plots.style import BACKGROUND, GRID, GUIDE, INK, MARKERS, color, delta_colors, label
from replication.studies import caution, crossed, shift
from replication.studies.designs import HYPOTHESES, THRESHOLDS, VARIANTS

PARTS = {"dataset": INK, "learner": GUIDE, "residual": GRID}  # of the variance
KINDS = {"tsne": "the paper's region", "svm": "SVM of the whole state"}
BESIDE_BAR = 0.42  # from the middle of a bar to its interval
CAUTIONS = (0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 1.0)  # that an axis names
FEW_UNSAFE = 0.01  # share of the unsafe states that are accepted, above which an axis is logarithmic
FALSE_POSITIVES = (0.0, FEW_UNSAFE, 0.1, 1.0)  # that it names
SPREAD = 0.22  # between α's or Δ's side by side, in units of the axis


def plot_crossed(measures: pd.DataFrame, components: pd.DataFrame) -> Figure:
    """Every run by dataset and α, a measure in each column; below, the parts of the variance.

    measures: gathered ones; components: as of `crossed.component_table`.
    """
    count, alphas = len(crossed.JUDGED), list(components["alpha"].unique())
    figure, axes = plt.subplots(2, count, figsize=(2.5 * count, 5.2), squeeze=False)
    for (top, bottom), (measure, text) in zip(axes.T, crossed.JUDGED.items(), strict=True):
        top.set(title=text, xlabel="dataset", xticks=sorted(measures["dataset"].unique()))
        for place, alpha in zip(_beside(len(alphas)), alphas, strict=True):
            own = measures[(measures["measure"] == measure) & (measures["alpha"] == alpha)]
            look = {"marker": MARKERS.get(alpha, "."), "color": color(alpha), "markersize": 4}
            top.plot(own["dataset"] + place, own["value"], ls="none", alpha=0.6, **look)
            means = own.groupby("dataset")["value"].mean()
            top.plot(means.index + place, means, ls="none", marker="_", color=color(alpha), markersize=11)
        rows = components[components["measure"] == measure].set_index("alpha").reindex(alphas)
        whole, low = rows[list(PARTS)].sum(axis=1), np.zeros(len(alphas))
        for part, shade in PARTS.items():
            high = low + (rows[part] / whole).fillna(0).to_numpy()
            bottom.bar(alphas, high - low, 0.6, low, color=shade, edgecolor=INK, linewidth=0.5)
            low = high
        known = rows.dropna(subset="share")
        places = [alphas.index(alpha) + BESIDE_BAR for alpha in known.index]
        ends = [known["share"] - known["low"], known["high"] - known["share"]]
        bottom.errorbar(places, known["share"], ends, fmt="D", color=INK, markersize=4, capsize=2)
        bottom.set(xlabel=r"$\alpha$", ylim=(0, 1.02))
    axes[1, 0].set_ylabel("share of the variance")
    handles: list[Any] = [
        Line2D([], [], ls="", marker=MARKERS.get(a, "."), color=color(a), label=label(a)) for a in alphas
    ]
    handles += [Patch(facecolor=shade, edgecolor=INK, label=part) for part, shade in PARTS.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def plot_roc(curves: pd.DataFrame) -> Figure:
    """Recall against false positives, by Δ and hypothesis: a line per α and dataset, marked at THRESHOLDS.

    The axis of the false positives is linear up to `FEW_UNSAFE`, and logarithmic from there.
    """
    figure, axes = _by_kind(curves["delta"].unique())
    for ax, own in _panels(axes, curves):
        for (alpha, _), line in own.groupby(["alpha", "dataset"], sort=False):
            ax.plot(line["false_positives"], line["true_positives"], color=color(str(alpha)), linewidth=0.9)
            marked = line[line["p_t"].isin(THRESHOLDS)]
            look: dict[str, Any] = {"marker": MARKERS.get(str(alpha), "."), "color": color(str(alpha))}
            ax.plot(marked["false_positives"], marked["true_positives"], ls="none", markersize=3, **look)
        for recall in caution.RECALLS:
            ax.axhline(recall, color=GUIDE, linewidth=0.6, linestyle=":")
        ax.set_xscale("symlog", linthresh=FEW_UNSAFE)
        ax.set(xlim=(0, 1), ylim=(0, 1))
        ax.set_xticks(FALSE_POSITIVES, [f"{x:g}" for x in FALSE_POSITIVES])
    _name(axes, "false positives,\nshare of the unsafe states", "recall,\nshare of the safe states")
    _legend(figure, curves["alpha"].unique())
    return figure


def plot_frontier(runs: pd.DataFrame) -> Figure:
    """Return of the policy alone against violations, by Δ and hypothesis; a line per α over p_t.

    A small mark is a learner, a large one the mean over datasets; the ends of a line tell their p_t.
    runs: of `caution.learners`.
    """
    figure, axes = _by_kind(runs["delta"].unique())
    shown = runs.assign(count=np.exp(runs["log_violations"]))
    for ax, own in _panels(axes, shown):
        for alpha, part in own.groupby("alpha"):
            look: dict[str, Any] = {"marker": MARKERS.get(str(alpha), "."), "color": color(str(alpha))}
            ax.plot(part["count"], part["policy_alone_share"], ls="none", alpha=0.4, markersize=3, **look)
            means = part.groupby("p_t")[["log_violations", "policy_alone_share"]].mean()
            x, y = np.exp(means["log_violations"]), means["policy_alone_share"]
            ax.plot(x, y, markersize=6, linewidth=1, **look)
            for end in (means.index[0], means.index[-1]):
                ax.annotate(f"{end:g}", (x[end], y[end]), (3, 4), textcoords="offset points", fontsize=6)
        ax.set(xscale="log", ylim=(-0.05, 1.05))
    _name(axes, "violations in the training, and ½", "final policy alone,\nshare of a perfect return")
    _legend(figure, runs["alpha"].unique())
    return figure


def plot_caution(runs: pd.DataFrame) -> Figure:
    """Outcomes of every learner against the caution of its hypothesis, by Δ.

    runs: as of `caution.learners`.
    """
    deltas = sorted(runs["delta"].unique())
    size = 3.6 * len(deltas), 2.3 * len(caution.OUTCOMES) + 0.6
    figure, axes = plt.subplots(
        len(caution.OUTCOMES), len(deltas), sharex=True, sharey="row", squeeze=False, figsize=size
    )
    for row, (outcome, (text, _)) in zip(axes, caution.OUTCOMES.items(), strict=True):
        counted = outcome == "log_violations"
        row[0].set_ylabel("violations in the training, and ½" if counted else text.replace(", ", ",\n"))
        for ax, delta in zip(row, deltas, strict=True):
            for (kind, alpha), own in runs[runs["delta"] == delta].groupby(["hypothesis", "alpha"]):
                filled = color(str(alpha)) if kind == HYPOTHESES[0] else BACKGROUND
                look = {"marker": MARKERS.get(str(alpha), "."), "edgecolors": color(str(alpha))}
                values = np.exp(own[outcome]) if counted else own[outcome]
                ax.scatter(own["caution"], values, 18, filled, linewidths=0.9, **look)
            ax.set(xscale="log", yscale="log" if counted else "linear")
            shown = ax.get_xlim()  # which ticks would widen
            ax.set_xticks(CAUTIONS, [f"{c:g}" for c in CAUTIONS])
            ax.set_xlim(shown)
            ax.xaxis.set_minor_formatter(NullFormatter())
    for ax, delta in zip(axes[0], deltas, strict=True):
        ax.set_title(rf"$\Delta = {delta:g}$")
    for ax in axes[-1]:
        ax.set_xlabel("caution: share of the free learner's\nstates that $h$ rejects")
    _legend(figure, runs["alpha"].unique(), both=True)
    return figure


def plot_effects(found: pd.DataFrame) -> Figure:
    """What α, and the whole state, do at equal caution; an interval within the grey is practically nothing.

    found: as of `caution.effects`.
    """
    shown = found[found["effect"] != caution.SLOPE]
    names, deltas = list(shown["effect"].unique()), sorted(shown["delta"].unique())
    figure, axes = plt.subplots(1, len(caution.OUTCOMES), sharey=True, squeeze=False, figsize=(9.0, 2.6))
    for ax, (outcome, (text, bound)) in zip(axes[0], caution.OUTCOMES.items(), strict=True):
        ax.axvspan(-bound, bound, color=GRID)
        ax.axvline(0, color=GUIDE, linewidth=0.8)
        for place, delta, shade in zip(_beside(len(deltas)), deltas, delta_colors(len(deltas)), strict=True):
            own = shown[(shown["outcome"] == outcome) & (shown["delta"] == delta)]
            y = own["effect"].map(names.index) + place
            width = [own["estimate"] - own["low"], own["high"] - own["estimate"]]
            ax.errorbar(
                own["estimate"],
                y,
                xerr=width,
                fmt="o",
                color=shade,
                markersize=4,
                label=rf"$\Delta = {delta:g}$",
            )
        ax.set(xlabel=text.replace(", ", ",\n"), title=rf"grey: within $\pm${bound:.2g}")
    axes[0, 0].set_yticks(range(len(names)), [KINDS.get(n, rf"$\alpha = {n}$ against 0") for n in names])
    axes[0, 0].invert_yaxis()
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(deltas))
    return figure


def plot_shift(table: pd.DataFrame) -> Figure:
    """Every measure that `shift` shows, by variant of the data and Δ; a dot per dataset, a bar at their mean.

    table: columns variant, delta, dataset, measure, value.
    """
    deltas = sorted(table["delta"].dropna().unique())
    figure, axes = plt.subplots(2, -(-len(shift.SHOWN) // 2), sharex=True, squeeze=False, figsize=(8.6, 5.4))
    for ax, (measure, text) in zip(axes.flat, shift.SHOWN.items(), strict=False):
        for place, delta, shade in zip(_beside(len(deltas)), deltas, delta_colors(len(deltas)), strict=True):
            own = table[(table["measure"] == measure) & (table["delta"] == delta)]
            x = own["variant"].map(list(VARIANTS).index) + place
            ax.plot(
                x, own["value"], "o", color=shade, markersize=3.5, alpha=0.7, label=rf"$\Delta = {delta:g}$"
            )
            means = own["value"].groupby(x).mean()
            ax.plot(means.index, means, "_", color=shade, markersize=12)
        ax.set_ylabel(text)
        ax.set_xticks(range(len(VARIANTS)), list(VARIANTS), rotation=30, ha="right")
        ax.set_xlim(-0.5, len(VARIANTS) - 0.5)
        ax.grid(axis="y", color=GRID)
        ax.set_axisbelow(True)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(deltas))
    return figure


def _beside(count: int) -> list[float]:
    """Places of things side by side, about 0."""
    return [SPREAD * (i - (count - 1) / 2) for i in range(count)]


def _by_kind(deltas: Iterable[float]) -> tuple[Figure, dict[tuple[str, float], Axes]]:
    """A figure with a row of axes per hypothesis and a column per Δ; the axes by both."""
    columns = sorted(deltas)
    size = 3.4 * len(columns), 2.7 * len(HYPOTHESES) + 0.4
    figure, axes = plt.subplots(
        len(HYPOTHESES), len(columns), sharex=True, sharey=True, squeeze=False, figsize=size
    )
    found = {
        (kind, d): ax
        for kind, row in zip(HYPOTHESES, axes, strict=True)
        for d, ax in zip(columns, row, strict=True)
    }
    for (kind, delta), ax in found.items():
        ax.set_title(rf"{KINDS[kind]}, $\Delta = {delta:g}$")
    return figure, found


def _panels(axes: dict[tuple[str, float], Axes], table: pd.DataFrame) -> list[tuple[Axes, pd.DataFrame]]:
    of = [
        ((table["hypothesis"] == kind) & (table["delta"] == delta), ax) for (kind, delta), ax in axes.items()
    ]
    return [(ax, table[rows]) for rows, ax in of]


def _name(axes: dict[tuple[str, float], Axes], x: str, y: str) -> None:
    """Name the axes at the left and at the bottom."""
    for ax in axes.values():
        place = ax.get_subplotspec()
        if place is not None and place.is_last_row():
            ax.set_xlabel(x)
        if place is not None and place.is_first_col():
            ax.set_ylabel(y)


def _legend(figure: Figure, alphas: Iterable[str], both: bool = False) -> None:
    """A legend of the α's, and of filled and open markers if both hypotheses are in one panel."""
    handles = [
        Line2D([], [], ls="", marker=MARKERS.get(a, "o"), color=color(a), markersize=5, label=label(a))
        for a in sorted(alphas)
    ]
    for kind, filled in zip(HYPOTHESES if both else (), (GUIDE, BACKGROUND), strict=False):
        handles.append(
            Line2D(
                [], [], ls="", marker="o", markerfacecolor=filled, markeredgecolor=GUIDE, label=KINDS[kind]
            )
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
