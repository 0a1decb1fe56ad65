"""The paper's figures, panel by panel."""

from collections.abc import Iterable, Mapping

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from replication.plots import style
from replication.plots.style import ANY_CONDITION, BACKGROUND, GUIDE, INK, color, label
from srlrepro.dynamics.closed_loop import Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.safety_map import RegionArrays
from srlrepro.settings.config import Config

# The three terms of Theorem 1: text, strength of the colour, hatch.
BOUND_TERMS = (
    (r"$\epsilon_n(h, l_n)$", 1.0, ""),
    (r"$\frac{1}{2} d$, smallest class", 0.55, "///"),
    (r"$\min\{\mathrm{E}_1, \mathrm{E}_2\}$", 0.25, "..."),
)


def plot_states(ax: Axes, x: Floats, z: Labels, config: Config) -> None:
    """Fig. 2 (a)-(c): joint angle and velocity of the first link, by label."""
    high, links = config.paper.state_max, config.paper.links
    _plot_labels(ax, x[:, [0, links]], z)
    angle, rate = high[0], high[links]
    ax.add_patch(Rectangle((-angle, -rate), 2 * angle, 2 * rate, fill=False, linestyle=":", color=GUIDE))
    ax.set(xlim=(-1.15 * angle, 1.15 * angle), ylim=(-1.6 * rate, 1.6 * rate))
    ax.set(xlabel=r"$\theta_1$ / rad", ylabel=r"$\dot\theta_1$ / (rad/s)")


def plot_embedding(ax: Axes, y: Floats, z: Labels, region: RegionArrays) -> None:
    """Fig. 2 (d)-(f): the simplified states y_i, by label, on the plane that Γ covers."""
    _plot_labels(ax, y, z)
    left, right, bottom, top = _extent(region)
    ax.set(xlabel="$y_1$", ylabel="$y_2$", xlim=(left, right), ylim=(bottom, top), aspect="equal")


def plot_gamma(ax: Axes, region: RegionArrays, p_t: float, origin: Floats) -> AxesImage:
    """Fig. 2 (g)-(i): Γ over the y-plane in colours, the border of S_y (Γ = p_t) and Ψ(0) (origin [2]).

    Returns the picture, for a bar of its colours.
    """
    extent, colors = _extent(region), style.GAMMA_MAP
    picture = ax.imshow(region.gamma.T, colors, origin="lower", extent=extent, vmin=0, vmax=1)
    centres = region.cell * (np.arange(region.gamma.shape[0]) + 0.5)
    if region.gamma.min() < p_t < region.gamma.max():
        first, second = region.origin[:, None] + centres
        ax.contour(first, second, region.gamma.T, [p_t], colors=style.BORDER, linewidths=1.4)
    ax.plot([], [], color=style.BORDER, label=r"border of $\mathcal{S}_y$")
    ax.plot(*origin, "x", color=INK, markersize=8, markeredgewidth=2, label=r"$\Psi(0)$")
    ax.set(xlabel="$y_1$", ylabel="$y_2$")
    return picture


def _extent(region: RegionArrays) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of the y-plane that Γ covers."""
    (left, bottom), side = region.origin, region.cell * region.gamma.shape[0]
    return left, left + side, bottom, bottom + side


def _plot_labels(ax: Axes, points: Floats, labels: Labels) -> None:
    for value, name, tint, marker in ((0, "unsafe", style.UNSAFE, "x"), (1, "safe", style.SAFE, "o")):
        first, second = points[labels == value].T
        ax.scatter(first, second, s=9, c=tint, marker=marker, linewidths=0.7, label=name, rasterized=True)


def plot_learning(ax: Axes, curves: pd.DataFrame, column: str) -> None:
    """Fig. 3 (a)-(c): a learning curve per condition; thin lines are seeds, thick ones their mean.

    curves: columns alpha, seed, step and ``column``.
    """
    for name, group in curves.groupby("alpha", sort=True):
        table, alpha = group.pivot_table(index="step", columns="seed", values=column), str(name)
        ax.plot(table.index, table, color=color(alpha), linewidth=0.6, alpha=0.5)
        (mean,) = ax.plot(table.mean(axis=1), color=color(alpha), linewidth=1.8, label=label(alpha))
        mean.set(marker=style.MARKERS.get(alpha, "."), markersize=4, markevery=max(1, len(table) // 8))
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
            ax.bar(place, mean, width, hatch=hatch, facecolor=fill, edgecolor=BACKGROUND)
            ax.plot(place + _spread(group, 0.25) * width, group[column], "o", color=INK, markersize=2.5)
    _name_conditions(ax, names)


def _spread(seeds: pd.DataFrame, reach: float) -> Floats:
    return np.linspace(-reach, reach, len(seeds)) if len(seeds) > 1 else np.zeros(1)


def counts_legend(kinds: Mapping[str, str]) -> list[Artist]:
    """Entries of the legend of `plot_counts`; kinds: {text: hatch}."""
    return [Patch(facecolor=ANY_CONDITION, hatch=h, edgecolor=BACKGROUND, label=t) for t, h in kinds.items()]


def _name_conditions(ax: Axes, names: list[str]) -> None:
    """Name the conditions below their bars, upright where there are many."""
    ax.set_xticks(range(len(names)), [label(n) for n in names])
    ax.tick_params(axis="x", labelsize=7, labelrotation=90 if len(names) > 4 else 0)


def plot_bound(ax: Axes, table: pd.DataFrame, stacked: str, marked: Mapping[str, str]) -> None:
    """Theorem 1: the three terms of the bound as stacked bars, means over seeds; dots are the seeds.

    table: as `theorem.term_table`, with alpha. Filled dots: the true error; open dots: the bound. stacked:
    the class of the bars; marked: {class: marker} of further classes, whose bounds are marks.
    """
    names = sorted(table["alpha"].unique())
    for i, name in enumerate(names):
        cells = table[table["alpha"] == name]
        group, bottom = cells[cells["class"] == stacked], 0.0
        terms = (group["source_error"], group["half_divergence"], group[["e1", "e2"]].min(axis=1))
        for term, (_, strength, hatch) in zip(terms, BOUND_TERMS, strict=True):
            fill = mpl.colors.to_rgba(color(name), strength)
            ax.bar(i, term.mean(), 0.6, bottom, hatch=hatch, facecolor=fill, edgecolor=BACKGROUND)
            bottom += term.mean()
        spread = _spread(group, 0.12)
        ax.plot(i + spread, group["bound"], "o", color=INK, markersize=3.5, markerfacecolor="none")
        ax.plot(i + spread, group["error"], "o", color=INK, markersize=4, markeredgecolor=BACKGROUND)
        for other, marker in marked.items():
            bounds = cells.loc[cells["class"] == other, "bound"]
            ax.plot(i + spread, bounds, marker, color=color(name), markersize=4)
    ax.axhline(1.0, color=GUIDE, linestyle=":", linewidth=1.0)
    _name_conditions(ax, names)


def bound_legend(marked: Mapping[str, str]) -> list[Artist]:
    """Entries of the legend of `plot_bound`."""
    bars = [Patch(fc=(ANY_CONDITION, c), hatch=h, ec=BACKGROUND, label=t) for t, c, h in BOUND_TERMS]
    dots = [("o", INK, INK, "true error"), ("o", INK, "none", "bound, smallest class")]
    dots += [(m, ANY_CONDITION, ANY_CONDITION, f"bound, {name}") for name, m in marked.items()]
    marks = [Line2D([], [], ls="", marker=m, c=edge, mfc=fill, ms=4, label=t) for m, edge, fill, t in dots]
    return [*bars, *marks]
