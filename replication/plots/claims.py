"""The claims as signs, by Δ or by the steps of a training; and how often K fails beside the paper's rates."""

import textwrap
from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from scipy.special import expit

from replication.evidence.claims import LAYERS, Claim
from replication.evidence.verdicts import AS_WRITTEN, CALIBRATED, OVERALL, SIGNS, mean_failure
from replication.plots.style import BACKGROUND, CONTRADICTS, INK, PAPERS_NUMBER, SUPPORTS, UNRESOLVED, color

TINTS = {SIGNS["reproduced"]: SUPPORTS, SIGNS["not reproduced"]: CONTRADICTS}
TINTS |= {SIGNS["practically nothing"]: CONTRADICTS}  # the others are grey
TITLE_WIDTH = 66  # characters of a statement in a line
LINE = 0.16  # in, of a statement
ROW = 0.09  # in, between two statements
CELL = 0.62  # in, the width of a column of signs
TITLES = 4.3  # in, of the statements
ARMS = {AS_WRITTEN: (True, -0.12), CALIBRATED: (False, 0.12)}  # whether dots are filled, and their shift


def plot_signs(ax: Axes, table: pd.DataFrame, titles: list[str]) -> None:
    """A row for each title, its signs (columns of the table) beside it; both in the table's order."""
    lines = [title.count("\n") + 1 for title in titles]
    heights = np.array(lines) * LINE + ROW
    middles = np.cumsum(heights) - heights / 2
    for place, signs in zip(middles, table.to_numpy(), strict=True):
        for column, shown in enumerate(signs):
            tint = TINTS.get(shown, UNRESOLVED)
            if shown:
                corner = column - 0.42, place - 0.1
                ax.add_patch(Rectangle(corner, 0.84, 0.2, color=tint, alpha=0.13, linewidth=0))
                ax.text(column, place, shown, color=tint, ha="center", va="center", fontsize=9)
    ax.set(xlim=(-0.5, table.shape[1] - 0.5), ylim=(heights.sum(), 0))
    ax.set_yticks(middles, titles, fontsize=7)
    ax.set_xticks(range(table.shape[1]), table.columns, fontsize=7)
    ax.xaxis.tick_top()
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)


def _titles(rows: pd.Series) -> list[str]:
    kept = (row.rstrip(".").replace(" = ", "\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}") for row in rows)
    return [textwrap.fill(row, TITLE_WIDTH) for row in kept]


def _height(titles: list[str]) -> float:
    return sum((title.count("\n") + 1) * LINE + ROW for title in titles)


def _legend(figure: Figure, handles: list[Line2D]) -> None:
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=7)


def _signs() -> list[Line2D]:
    """The legend of the signs."""
    words = {"reproduced": "holds", "not reproduced": "does not hold"}
    return [
        Line2D([], [], linestyle="", marker=f"${shown}$", color=TINTS.get(shown, UNRESOLVED), label=text)
        for text, shown in ((words.get(name, name), shown) for name, shown in SIGNS.items())
    ]


def plot_matrix(signs: pd.DataFrame) -> Figure:
    """The claims by Δ as a matrix of signs, a block for each layer; signs: of `verdicts.matrix`."""
    parts = {str(layer): part for layer, part in signs.groupby("layer")}
    titles = {layer: _titles(part["row"]) for layer, part in parts.items()}
    heights = [_height(titles[layer]) for layer in parts]
    columns = [name for name in signs if name not in ("layer", "row")]
    size = TITLES + CELL * len(columns), sum(heights) + 0.55 * len(parts) + 0.4
    figure, axes = plt.subplots(len(parts), 1, figsize=size, height_ratios=heights, squeeze=False)
    for ax, (layer, part) in zip(axes[:, 0], parts.items(), strict=True):
        names = {name: name if name == OVERALL else f"Δ = {name}" for name in columns}
        plot_signs(ax, part[columns].rename(columns=names), titles[layer])
        ax.set_title(f"{layer}: {LAYERS[layer]}", loc="right", fontsize=8, fontweight="bold")
    _legend(figure, _signs())
    return figure


def plot_budgets(table: pd.DataFrame) -> Figure:
    """The claims about what is learned by the steps of a training; table: of `verdicts.by_budget`."""
    about = table["delta"].map(" (Δ = {:g})".format).where(table["delta"].notna(), "")
    rows = table["row"].str.rstrip(".") + about
    wide = table.assign(row=rows).pivot_table("sign", "row", "step", aggfunc="first", sort=False)
    titles = _titles(wide.index.to_series())
    wide.columns = [f"{step / 1e6:.3g} M" if step >= 1e5 else f"{step}" for step in map(int, wide.columns)]
    figure, ax = plt.subplots(figsize=(TITLES + CELL * wide.shape[1], _height(titles) + 0.7))
    plot_signs(ax, wide, titles)
    ax.set_title("steps of the training", fontsize=8)
    _legend(figure, _signs())
    return figure


def _arm(ax: Axes, arm: str, runs: pd.DataFrame, place: int) -> None:
    """The runs of one condition in one arm: dots, and their mean with its interval."""
    filled, shift = ARMS[arm]
    tint, middle_at = color(str(runs["alpha"].iloc[0])), place + shift
    spread = np.linspace(-0.06, 0.06, len(runs)) if len(runs) > 1 else np.zeros(1)
    face = tint if filled else "none"
    rates = runs["failure_rate"]
    ax.scatter(middle_at + spread, rates, s=9, facecolor=face, edgecolor=tint, linewidth=0.7, alpha=0.6)
    middle, low, high = mean_failure(runs)
    ax.plot([middle_at, middle_at], [low, high], color=INK, linewidth=0.9)
    ax.plot(middle_at, middle, "o", color=INK, markerfacecolor=INK if filled else BACKGROUND, markersize=4)


def plot_failures(rates: pd.DataFrame, papers: Sequence[Claim], predictions: pd.DataFrame) -> Figure:
    """How often K fails against α, a panel for each Δ, on a log axis; a dot is a run on a dataset of its own.

    Args:
        rates: of `verdicts.failure_rates`, with a column arm (one of `ARMS`).
        papers: the claims that give the paper's rates, each for one α and one Δ.
        predictions: contrasts of these claims, whose intervals are drawn beside the paper's numbers.
    """
    deltas, alphas = sorted(rates["delta"].unique()), sorted(rates["alpha"].unique(), key=float)
    figure, axes = plt.subplots(1, len(deltas), figsize=(3.1 * len(deltas), 3.2), sharey=True, squeeze=False)
    for ax, delta in zip(axes[0], deltas, strict=True):
        for (arm, alpha), runs in rates[rates["delta"] == delta].groupby(["arm", "alpha"]):
            _arm(ax, arm, runs, alphas.index(alpha))
        for claim in papers:
            (alpha,), (told,) = claim.where["alpha"], claim.only
            if told == delta and alpha in alphas:
                place = alphas.index(alpha) - 0.32
                own = predictions[predictions["id"] == claim.id]
                ends = expit(-(claim.value + own[["low", "high"]].to_numpy(float)[0]))
                ax.plot([place, place], ends, color=PAPERS_NUMBER, linewidth=1, linestyle=":")
                ax.plot(place, expit(-claim.value), "D", color=PAPERS_NUMBER, markersize=5)
        ax.set(yscale="log", title=f"Δ = {delta:g}", xlim=(-0.6, len(alphas) - 0.4))
        ax.set_xticks(range(len(alphas)), [f"α = {alpha}" for alpha in alphas])
    axes[0, 0].set_ylabel("share of activations in which K fails")
    handles = [
        Line2D(
            [], [], marker="o", color=INK, markerfacecolor=INK if filled else BACKGROUND, label=f"{arm}: mean"
        )
        for arm, (filled, _) in ARMS.items()
        if arm in set(rates["arm"])
    ]
    text = "the paper, and where its mean of three runs is to be expected"
    handles.append(Line2D([], [], linestyle=":", marker="D", color=PAPERS_NUMBER, label=text))
    _legend(figure, handles)
    return figure
