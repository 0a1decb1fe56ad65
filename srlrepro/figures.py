"""The paper's figures: one look, one colour per condition, and beside each figure the table it draws."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle

from srlrepro.assessment import RegionArrays
from srlrepro.config import Config
from srlrepro.files import beside, write_table
from srlrepro.labels import Labels
from srlrepro.pendulum import Floats

COLORS = {"0": "#0072B2", "0.5": "#009E73", "1": "#D55E00", "none": "#4D4D4D"}  # Okabe and Ito
MARKERS = {"0": "o", "0.5": "s", "1": "^", "none": "D"}
SAFE, UNSAFE = "#56B4E9", "#AA4499"
GAMMA_MAP = "cividis"
BOUND_HATCHES = ("", "///", "...")  # of the three terms of Theorem 1


def use_style() -> None:
    """Set matplotlib's defaults for every figure of the replication."""
    import seaborn as sns  # here, since it is slow to import and a training run draws without it

    sns.set_theme(context="paper", style="ticks", font_scale=1.0)
    mpl.rcParams.update(
        {
            "figure.dpi": 100,
            "savefig.dpi": 160,
            "pdf.fonttype": 42,
            "svg.hashsalt": "srlrepro",
            "legend.frameon": False,
            "axes.titlesize": 10,
            "figure.constrained_layout.use": True,
        }
    )


def color(name: str) -> str:
    """The colour of a condition; other values of α lie between those of the paper."""
    if name in COLORS:
        return COLORS[name]
    return mpl.colors.to_hex(mpl.colormaps["viridis"](0.15 + 0.7 * float(name)))


def label(name: str) -> str:
    """The legend's text of a condition."""
    return "no supervisor" if name == "none" else rf"$\alpha = {name}$"


def save_figure(figure: Figure, folder: str | Path, name: str, table: pd.DataFrame) -> None:
    """Write ``name``.pdf, ``name``.png and ``name``.csv, the table that the figure draws."""
    for suffix, metadata in (
        (".pdf", {"CreationDate": None, "Producer": None}),
        (".png", {"Software": None}),
    ):
        with beside(Path(folder) / f"{name}{suffix}") as temporary:
            figure.savefig(temporary, metadata=metadata)
    write_table(Path(folder) / f"{name}.csv", table, digits=6)


def panels(
    count: int, height: float = 2.9, width: float = 3.1, letters: str = "abc"
) -> tuple[Figure, list[Axes]]:
    """A row of panels, lettered as in the paper."""
    figure, axes = plt.subplots(1, count, figsize=(width * count, height), squeeze=False)
    row = list(axes[0])
    for ax, letter in zip(row, letters, strict=False):
        ax.set_title(f"({letter})", loc="left", fontweight="bold")
    return figure, row


def mark_reduced(figure: Figure, note: str) -> None:
    """Say on the figure that it does not show the full experiment; an empty note says nothing."""
    if note:
        figure.suptitle(note, color="#B00000", fontsize=9, fontweight="bold")


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
