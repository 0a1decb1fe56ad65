"""The paper's figures, panel by panel."""

from collections.abc import Iterable, Mapping

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle

from replication.plots.style import MARKERS, SAFE, UNSAFE, color, label
from srlrepro.dynamics.closed_loop import Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.safety_map import RegionArrays
from srlrepro.settings.config import Config

GAMMA_MAP = "cividis"
BOUND_HATCHES = ("", "///", "...")  # of the three terms of Theorem 1


def plot_states(ax: Axes, x: Floats, z: Labels, config: Config) -> None:
    """Fig. 2 (a)-(c): joint angle and velocity of the first link, by label."""
    for value, name, tint, marker in ((0, "unsafe", UNSAFE, "x"), (1, "safe", SAFE, "o")):
        shown = x[z == value]
        ax.scatter(
            shown[:, 0], shown[:, 3], s=9, c=tint, marker=marker, linewidths=0.7, label=name, rasterized=True
        )
    high = np.array(config.paper.state_max)
    ax.set(xlim=(-1.15 * high[0], 1.15 * high[0]), ylim=(-1.6 * high[3], 1.6 * high[3]))
    ax.add_patch(
        Rectangle((-high[0], -high[3]), 2 * high[0], 2 * high[3], fill=False, linestyle=":", color="#777777")
    )
    ax.set(xlabel=r"$\theta_1$ / rad", ylabel=r"$\dot\theta_1$ / (rad/s)")


def plot_embedding(ax: Axes, y: Floats, z: Labels) -> None:
    """Fig. 2 (d)-(f): the simplified states y_i, by label."""
    for value, name, tint, marker in ((0, "unsafe", UNSAFE, "x"), (1, "safe", SAFE, "o")):
        shown = y[z == value]
        ax.scatter(
            shown[:, 0], shown[:, 1], s=9, c=tint, marker=marker, linewidths=0.7, label=name, rasterized=True
        )
    ax.set(xlabel="$y_1$", ylabel="$y_2$", aspect="equal", adjustable="datalim")


def plot_gamma(ax: Axes, region: RegionArrays, p_t: float) -> AxesImage:
    """Fig. 2 (g)-(i): Γ over the y-plane in colours, and the border of S_y (Γ = p_t)."""
    side = region.cell * region.gamma.shape[0]
    (left, bottom), (right, top) = region.origin, region.origin + side
    picture = ax.imshow(
        region.gamma.T, origin="lower", extent=(left, right, bottom, top), cmap=GAMMA_MAP, vmin=0, vmax=1
    )
    centres = region.cell * (np.arange(region.gamma.shape[0]) + 0.5)
    if region.gamma.min() < p_t < region.gamma.max():
        ax.contour(
            region.origin[0] + centres,
            region.origin[1] + centres,
            region.gamma.T,
            [p_t],
            colors="#D55E00",
            linewidths=1.4,
        )
    ax.set(xlabel="$y_1$", ylabel="$y_2$")
    return picture


def plot_learning(ax: Axes, curves: pd.DataFrame, column: str) -> None:
    """Fig. 3 (a)-(c): a learning curve per condition; thin lines are seeds, thick ones their mean.

    curves: columns alpha, seed, step and ``column``.
    """
    for name, group in curves.groupby("alpha", sort=True):
        table = group.pivot_table(index="step", columns="seed", values=column)
        ax.plot(table.index, table, color=color(str(name)), linewidth=0.6, alpha=0.5)
        ax.plot(
            table.index,
            table.mean(axis=1),
            color=color(str(name)),
            linewidth=1.8,
            label=label(str(name)),
            marker=MARKERS.get(str(name), "."),
            markersize=4,
            markevery=max(1, len(table) // 8),
        )
    ax.set(xlabel="training step")


def plot_counts(ax: Axes, counts: pd.DataFrame, columns: Iterable[tuple[str, str]]) -> None:
    """Fig. 3 (d)-(f): bars of counts per condition, the mean over seeds; dots are the seeds.

    counts: columns alpha, seed and the counted ones; columns: (column, hatch) side by side.
    """
    names, pairs = sorted(counts["alpha"].unique()), list(columns)
    width = 0.8 / len(pairs)
    for i, name in enumerate(names):
        group = counts[counts["alpha"] == name]
        for j, (column, hatch) in enumerate(pairs):
            place = i + (j - (len(pairs) - 1) / 2) * width
            mean, fill = group[column].mean(), mpl.colors.to_rgba(color(name), 0.75 if hatch else 1.0)
            ax.bar(place, mean, width, hatch=hatch, facecolor=fill, edgecolor="white")
            spread = np.linspace(-0.25, 0.25, len(group)) * width if len(group) > 1 else np.zeros(1)
            ax.plot(place + spread, group[column], "o", color="black", markersize=2.5)
    ax.set_xticks(range(len(names)), [label(n) for n in names])
    ax.tick_params(axis="x", labelsize=7)


def plot_bound(ax: Axes, table: pd.DataFrame, stacked: str, marked: Mapping[str, str]) -> None:
    """Theorem 1: the three terms of the bound as stacked bars, means over seeds; dots are the seeds.

    table: a row per α (``alpha``), seed and class H (``class``), with the columns of `theorem.evaluate`.
    Filled dots: the true error; open dots: the bound. stacked: the class of the bars; marked: {class: marker}
    of further classes, whose bounds are marks.
    """
    names = sorted(table["alpha"].unique())
    for i, name in enumerate(names):
        cells = table[table["alpha"] == name]
        group, bottom = cells[cells["class"] == stacked], 0.0
        terms = (group["source_error"], group["half_divergence"], group[["e1", "e2"]].min(axis=1))
        for term, strength, hatch in zip(terms, (1.0, 0.55, 0.25), BOUND_HATCHES, strict=True):
            fill = mpl.colors.to_rgba(color(name), strength)
            ax.bar(i, term.mean(), 0.6, bottom, hatch=hatch, facecolor=fill, edgecolor="white")
            bottom += term.mean()
        spread = np.linspace(-0.12, 0.12, len(group)) if len(group) > 1 else np.zeros(1)
        ax.plot(i + spread, group["bound"], "o", color="black", markersize=3.5, markerfacecolor="none")
        ax.plot(i + spread, group["error"], "o", color="black", markersize=4, markeredgecolor="white")
        for other, marker in marked.items():
            bounds = cells.loc[cells["class"] == other, "bound"]
            ax.plot(i + spread, bounds, marker, color=color(name), markersize=4)
    ax.axhline(1.0, color="#777777", linestyle=":", linewidth=1.0)
    ax.set_xticks(range(len(names)), [label(n) for n in names])
