"""The paper's figures, panel by panel."""

from collections.abc import Iterable, Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray

from replication.evidence.statistics import share_interval
from replication.plots import style
from replication.plots.style import ANY_CONDITION, BACKGROUND, GUIDE, INK, color, label
from srlrepro.dynamics.closed_loop import Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.safe_region import SafeRegion
from srlrepro.region.safety_map import RegionArrays
from srlrepro.samplers import TrainingData
from srlrepro.settings.config import Config

STATE_SIZE, EVIDENCE_SIZE = 9, 3  # of a marker in Fig. 2, points²
SMOOTHED, START = 0.02, 0.02  # shares of the steps of a training: a window of the curves, and the inset
MARKS = 8  # on a curve
BELOW, MARGIN = 0.45, 0.04  # of the frame of Fig. 3 (a)-(c), below zero for the inset, and above the top

# The three terms of Theorem 1: text, strength of the colour, hatch.
BOUND_TERMS = (
    (r"$\epsilon_n(h, l_n)$", 1.0, ""),
    (r"$\frac{1}{2} d$, smallest class", 0.55, "///"),
    (r"$\min\{\mathrm{E}_1, \mathrm{E}_2\}$", 0.25, "..."),
)


def plot_states(ax: Axes, data: TrainingData, config: Config) -> None:
    """Fig. 2 (a)-(c): joint angle and velocity of the first link, by label and by the law of the state."""
    high, links = config.paper.state_max, config.paper.links
    marks = np.where(np.arange(len(data.x)) < data.n_ud, style.LAWS["UD"], style.LAWS["MND"])
    _plot_labels(ax, data.x[:, [0, links]], data.z, marks, STATE_SIZE)
    angle, rate = high[0], high[links]
    ax.add_patch(Rectangle((-angle, -rate), 2 * angle, 2 * rate, fill=False, linestyle=":", color=GUIDE))
    ax.set(xlim=(-1.15 * angle, 1.15 * angle), ylim=(-1.6 * rate, 1.6 * rate))
    ax.set(xlabel=r"$\theta_1$ / rad", ylabel=r"$\dot\theta_1$ / (rad/s)")


def states_legend(laws: bool = True) -> list[Artist]:
    """Entries of the legend of `plot_states`; without ``laws``, of `plot_embedding`."""
    entries: list[Artist] = [
        _mark("o", style.SAFE, style.SAFE, "safe, $z = 1$"),
        _mark("o", style.UNSAFE, "none", "unsafe, $z = 0$"),
    ]
    return entries + [_mark(m, INK, "none", f"from {law}") for law, m in style.LAWS.items() if laws]


def _mark(marker: str, edge: str, fill: str, text: str) -> Line2D:
    return Line2D([], [], ls="", marker=marker, c=edge, mfc=fill, ms=4, label=text)


def plot_embedding(ax: Axes, y: Floats, z: Labels, region: RegionArrays) -> None:
    """Fig. 2 (d)-(f): the simplified states y_i, by label, on the plane that Γ covers."""
    _plot_labels(ax, y, z, np.full(len(y), "o"), STATE_SIZE)
    _show_plane(ax, region)


def plot_gamma(ax: Axes, region: SafeRegion, origin: Floats) -> AxesImage:
    """Fig. 2 (g)-(i): Γ over the y-plane in colours, the border of S_y (Γ = p_t) and Ψ(0) (origin [2]).

    Over it the evidence of Γ: a dot at each e_i, by label. Returns the picture, for a bar of its colours.
    """
    arrays, p_t = region.arrays_, region.p_t
    extent, colors = _extent(arrays), style.GAMMA_MAP
    picture = ax.imshow(arrays.gamma.T, colors, origin="lower", extent=extent, vmin=0, vmax=1)
    centres = arrays.cell * (np.arange(arrays.gamma.shape[0]) + 0.5)
    _plot_labels(ax, region.evidence_, region.labels_, np.full(len(region.evidence_), "o"), EVIDENCE_SIZE)
    if arrays.gamma.min() < p_t < arrays.gamma.max():
        first, second = arrays.origin[:, None] + centres
        ax.contour(first, second, arrays.gamma.T, [p_t], colors=style.BORDER, linewidths=1.4)
    ax.plot(*origin, "x", color=BACKGROUND, markersize=9, markeredgewidth=4)  # seen on every colour
    ax.plot([], [], color=style.BORDER, label=r"border of $\mathcal{S}_y$")
    ax.plot(*origin, "x", color=INK, markersize=8, markeredgewidth=2, label=r"$\Psi(0)$")
    _show_plane(ax, arrays)
    return picture


def _show_plane(ax: Axes, region: RegionArrays) -> None:
    left, right, bottom, top = _extent(region)
    ax.set(xlabel="$y_1$", ylabel="$y_2$", xlim=(left, right), ylim=(bottom, top), aspect="equal")


def _extent(region: RegionArrays) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of the y-plane that Γ covers."""
    (left, bottom), side = region.origin, region.cell * region.gamma.shape[0]
    return left, left + side, bottom, bottom + side


def _plot_labels(ax: Axes, points: Floats, z: Labels, marks: NDArray[np.str_], size: float) -> None:
    """Points [B, 2] by label: filled where safe, open where not, which are few and lie above."""
    for label_of, tint, fill in ((1, style.SAFE, style.SAFE), (0, style.UNSAFE, "none")):
        for mark in np.unique(marks):
            first, second = points[(z == label_of) & (marks == mark)].T
            look: dict[str, Any] = {"marker": str(mark), "edgecolors": tint, "linewidths": 0.5, "alpha": 0.7}
            ax.scatter(first, second, size, fill, rasterized=True, **look)


def plot_learning(ax: Axes, curves: pd.DataFrame, column: str, top: float) -> None:
    """Fig. 3 (a)-(c): per condition the median over the seeds, the band of the middle half, and each seed.

    All are means over a window of `SMOOTHED` of the steps. The frame ends at zero, where all curves come so
    far; below it an inset shows the first `START` of the steps as they are, if the curves have points there.

    Args:
        curves: columns alpha, seed, step and ``column``.
        top: what a perfect learner has.
    """
    window = 1 + 2 * round(SMOOTHED * curves["step"].nunique() / 2)  # odd, so that it has a middle
    tables = {
        str(name): group.pivot_table(index="step", columns="seed", values=column)
        for name, group in curves.groupby("alpha", sort=True)
    }
    smooth = {name: t.rolling(window, center=True, min_periods=1).mean() for name, t in tables.items()}
    for name, table in smooth.items():
        _plot_seeds(ax, name, table, max(1, len(table) // MARKS))
    ax.axhline(top, color=GUIDE, linestyle=":", linewidth=1.0)
    ax.xaxis.set_major_formatter(EngFormatter(sep=""))
    ax.locator_params(axis="x", nbins=4)
    ax.set(xlabel="training step")
    if min(float(t.median(axis=1).max()) for t in smooth.values()) < 0:  # so short that all is the start
        return
    start = {name: table[table.index <= START * curves["step"].max()] for name, table in tables.items()}
    shown = all(len(table) > 1 for table in start.values())
    below = BELOW if shown else MARGIN
    ax.set(ylim=(-below * top, (1 + MARGIN) * top), yticks=np.linspace(0, top, 5))
    if not shown:
        return
    ax.axhline(0, color=GUIDE, linewidth=0.8)
    height = (BELOW - 0.12) / (1 + BELOW + MARGIN)  # 0.12: room for the inset's labels
    inset = ax.inset_axes((0.42, 0.08, 0.53, height))
    for name, table in start.items():
        _plot_seeds(inset, name, table, 0)
    inset.xaxis.set_major_formatter(EngFormatter(sep=""))
    inset.tick_params(labelsize=5, length=2, pad=1)
    inset.locator_params(nbins=3)
    inset.text(0.97, 0.08, "the start", transform=inset.transAxes, ha="right", fontsize=6)


def _plot_seeds(ax: Axes, name: str, table: pd.DataFrame, every: int) -> None:
    """Seeds [steps, seeds] of a condition, their middle half, and their median, marked ``every`` so often."""
    tint, low, high = color(name), *(table.quantile(q, axis=1) for q in (0.25, 0.75))
    ax.plot(table.index, table, color=tint, linewidth=0.4, alpha=0.35)
    ax.fill_between(table.index, low, high, color=tint, alpha=0.2, linewidth=0)
    (median,) = ax.plot(table.median(axis=1), color=tint, linewidth=1.6, label=label(name))
    if every:
        median.set(marker=style.marker(name), markersize=4, markevery=every)


def plot_counts(ax: Axes, counts: pd.DataFrame, kinds: Mapping[str, str]) -> None:
    """Fig. 3 (d)-(f): counts per condition on a logarithmic axis from 1, with 0 below; a line at each median.

    counts: columns alpha, seed and the counted ones, empty where there is nothing to count; kinds: {column:
    marker}, side by side.
    """
    names, width = sorted(counts["alpha"].unique()), 0.8 / len(kinds)
    for i, name in enumerate(names):
        group = counts[counts["alpha"] == name]
        for j, (column, marker) in enumerate(kinds.items()):
            found, place = group[column].dropna(), i + (j - (len(kinds) - 1) / 2) * width
            if len(found):
                spread = place + _spread(len(found), 0.3) * width
                ax.plot(spread, found, marker, color=color(name), markersize=4, alpha=0.7, markeredgewidth=0)
                half = 0.45 * width
                ax.plot([place - half, place + half], [found.median()] * 2, color=INK, linewidth=1.2)
    ax.set_yscale("symlog", linthresh=1)
    most = float(np.nanmax(counts[list(kinds)].to_numpy(np.float64), initial=10.0))
    top = max(10 ** np.ceil(np.log10(2 * most)), ax.get_ylim()[1])  # of all panels, with whole markers
    ax.set_ylim(-0.3, top)
    ax.grid(axis="y", color=style.GRID)
    ax.set_axisbelow(True)
    _name_conditions(ax, names)


def _spread(number: int, reach: float) -> Floats:
    return np.linspace(-reach, reach, number) if number > 1 else np.zeros(1)


def counts_legend(kinds: Mapping[str, str]) -> list[Artist]:
    """Entries of the legend of `plot_counts`; kinds: {text: marker}."""
    seeds = [_mark(marker, ANY_CONDITION, ANY_CONDITION, text) for text, marker in kinds.items()]
    return [*seeds, Line2D([], [], color=INK, linewidth=1.2, label="median of the seeds")]


def _name_conditions(ax: Axes, names: list[str]) -> None:
    """Name the conditions below their values, upright where there are many."""
    ax.set_xticks(range(len(names)), [label(n) for n in names])
    ax.tick_params(axis="x", labelsize=7, labelrotation=90 if len(names) > 4 else 0)


def plot_reliability(ax: Axes, table: pd.DataFrame, name: str, p_t: float) -> None:
    """Observed share of safe states against the predicted Γ, in bins, for the region of one condition.

    The interval of a share is Wilson's, at 95 %; the area of a marker grows with the share of the states.

    table: columns predicted, observed (shares) and states (their number in the bin).
    """
    n = table["states"]
    held = (n * table["observed"]).round().astype(int)
    low, high = np.array([share_interval(a, b, method="wilson") for a, b in zip(held, n, strict=True)]).T
    reach = np.maximum([table["observed"] - low, high - table["observed"]], 0)
    ax.plot([0, 1], [0, 1], ":", color=GUIDE, zorder=0)
    ax.axvline(p_t, color=GUIDE, linewidth=0.8, zorder=0)
    bars: dict[str, Any] = {"fmt": "none", "ecolor": color(name), "elinewidth": 0.8}
    ax.errorbar(table["predicted"], table["observed"], yerr=reach, **bars)
    look: dict[str, Any] = {
        "marker": style.marker(name),
        "color": color(name),
        "alpha": 0.8,
        "clip_on": False,
    }
    ax.scatter(table["predicted"], table["observed"], _area(n / n.sum()), **look)
    ax.set(xlim=(0, 1), ylim=(0, 1), aspect="equal", xlabel=r"predicted $\Gamma(\Psi(x))$")


def _area(share: pd.Series) -> pd.Series:
    return 4 + 60 * share


def reliability_legend(names: Iterable[str]) -> list[Artist]:
    """Entries of the legend of `plot_reliability`: the conditions, and two sizes of markers."""
    entries: list[Artist] = [_mark(style.marker(n), color(n), color(n), label(n)) for n in names]
    for share in (0.01, 0.5):
        size = float(_area(pd.Series([share]))[0]) ** 0.5
        text = f"{100 * share:g} % of the states"
        entries.append(Line2D([], [], ls="", marker="o", c=ANY_CONDITION, ms=size, label=text))
    return [*entries, Line2D([], [], color=GUIDE, linewidth=0.8, label="$p_t$")]


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
        spread = _spread(len(group), 0.12)
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
    dots = [_mark("o", INK, INK, "true error"), _mark("o", INK, "none", "bound, smallest class")]
    return [*bars, *dots, *(_mark(m, ANY_CONDITION, ANY_CONDITION, f"bound, {n}") for n, m in marked.items())]
