"""What a supervisor does on other systems: trials over time, and where K takes over in a plane of states."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from replication.plots.style import BORDER, CORRECTIVE, GUIDE, INK, LINK, SAFE, UNSAFE
from srlrepro.dynamics.pendulum import Floats

RECOVERED = "K: recovered"  # an end of a `Walk`; of the others, those that start with "K" are failures of K


class Walk(NamedTuple):
    """A trial under a supervisor: how it ended, its states [T, d] under π and [S, d] under K, if it acted."""

    end: str
    states: Floats
    recovery: Floats


def plot_walks(
    walks: Sequence[Walk], coordinate: int, bound: float, dt: float
) -> tuple[Figure, pd.DataFrame]:
    """A coordinate of the state over time, while π acts and then K; a failure lies beyond ±bound.

    dt: s of a step.

    Returns:
        The figure, and its table: trial, t in s, the coordinate, who acts from then on, and the trial's end.
    """
    figure, ax = plt.subplots(figsize=(6.4, 3.2))
    rows = []
    for trial, (end, states, recovery) in enumerate(walks):
        value = np.concatenate([states, recovery])[:, coordinate]
        t, last = dt * np.arange(len(value)), len(states) - 1
        ax.plot(t[: last + 1], value[: last + 1], color=LINK, linewidth=1)
        ax.plot(t[last:], value[last:], color=CORRECTIVE if end == RECOVERED else UNSAFE, linewidth=1)
        acts = np.where((np.arange(len(t)) >= last) & end.startswith("K"), "K", "π")
        rows.append(pd.DataFrame({"trial": trial, "t / s": t, "value": value, "acts": acts, "end": end}))
    for side in (-bound, bound):
        ax.axhline(side, color=GUIDE, linestyle=":")
    words = {LINK: "π acts", CORRECTIVE: "K acts and recovers", UNSAFE: "K acts and fails"}
    handles = [Line2D([], [], color=shade, label=text) for shade, text in words.items()]
    figure.legend(handles=handles, fontsize=7, loc="outside lower center", ncols=len(handles))
    ax.set_xlabel("t / s")
    return figure, pd.concat(rows, ignore_index=True)


def plot_plane(plane: pd.DataFrame, p_t: float, walks: Sequence[Walk]) -> tuple[Figure, pd.DataFrame]:
    """Labels and Γ over a plane of states, and the states at which K took over.

    Args:
        plane: the nodes of a grid, sorted, a state in the first two columns, then ``l_n`` (labels of the
            model), ``l`` (of the real system) and ``gamma``.
        p_t: S_y lies where ``gamma`` exceeds it.

    Returns:
        The figure, and its table: the plane, and rows with an ``end`` for the states at which K took over.
    """
    names = list(plane.columns[:2])
    x, y = (np.unique(plane[name]) for name in names)
    level = {name: plane[name].to_numpy().reshape(len(x), len(y)).T for name in ("l_n", "l", "gamma")}
    figure, ax = plt.subplots(figsize=(5.4, 4.2))
    ax.contourf(x, y, level["l"], [0.5, 1.5], colors=[SAFE], alpha=0.35)
    ax.contour(x, y, level["l_n"], [0.5], colors=[GUIDE], linestyles="--")
    ax.contour(x, y, level["gamma"], [p_t], colors=[BORDER])
    taken = [(*walk.states[-1], walk.end) for walk in walks if walk.end.startswith("K")]
    marks = pd.DataFrame(taken, columns=[*names, "end"])
    outline: dict[str, Any] = {"ls": "", "markeredgecolor": INK, "markeredgewidth": 0.5, "markersize": 5}
    for recovers, shade, look in ((True, SAFE, "o"), (False, UNSAFE, "X")):
        own = marks[(marks["end"] == RECOVERED) == recovers]
        text = f"K takes over and {'recovers' if recovers else 'fails'}"
        ax.plot(own[names[0]], own[names[1]], marker=look, color=shade, label=text, **outline)
    handles = [
        *ax.get_legend_handles_labels()[0],
        Line2D([], [], color=BORDER, label=r"border of $S_y$"),
        Line2D([], [], color=GUIDE, ls="--", label="border of what K recovers in the model"),
        Patch(color=SAFE, alpha=0.35, label="what K recovers in the real system"),
    ]
    figure.legend(handles=handles, fontsize=7, loc="outside lower center", ncols=2)
    return figure, pd.concat([plane, marks], ignore_index=True)
