"""The hypotheses side by side: how well they predict, and how learners fare under their supervision."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.random import Generator

from srlrepro.config import Config
from srlrepro.evaluation import TEST_STATES, classification, test_states
from srlrepro.figures import COLORS, label
from srlrepro.files import read_arrays
from srlrepro.hypotheses import ORACLES, learn
from srlrepro.labels import ClosedLoop, Labels
from srlrepro.pendulum import Floats
from srlrepro.sampling import TrainingData, generate
from srlrepro.training import VISITED_FORMAT, Run

ANY = "any"  # stands for α where a hypothesis knows the system and learns from no data
PALETTE = {**COLORS, ANY: "#CC79A7"}
DODGED = 0.8  # of the distance between hypotheses, by seaborn, over the values of α
SCORES = ("precision", "recall", "brier")
FREE = "visited, free"  # states that no hypothesis has influenced
FOLLOWED = ("final_return", "success_rate", "violations_per_1000_steps")


def visited(
    folder: Path, alphas: Iterable[str], delta: float, seeds: Sequence[int], rng: Generator
) -> Floats:
    """`TEST_STATES` of the states [B, 6] that the learners of a universe (its folder) visited, all seeds."""
    names = [Run(None if a == "none" else float(a), delta, s, 1).name for a in alphas for s in seeds]
    files = [folder / "runs" / name / "visited.npz" for name in names]
    states = np.concatenate([read_arrays(file, VISITED_FORMAT, ("x",))["x"] for file in files])
    return rng.choice(states.astype(np.float64), TEST_STATES)


def judged_states(
    data: Mapping[str, TrainingData],
    config: Config,
    paper: Path,
    deltas: Iterable[float],
    seeds: Sequence[int],
    rng: Generator,
) -> Iterator[tuple[str, float, str, Floats, Labels]]:
    """(states, Δ, α that they belong to, x [B, 6], labels [B]) of everything that hypotheses are judged on.

    UD and MND, labelled on the nominal system (Δ = 1); states that the free learner and the learner under the
    paper's region visited, labelled on the real one. Those under the region are of the region's α, and for a
    hypothesis without α (`ANY`) of all. ``paper`` is the folder of the paper's universe.
    """
    for name, (x, labels) in test_states(next(iter(data.values())).mnd, config, rng).items():
        for alpha in (*data, ANY):
            yield name, 1.0, alpha, x, labels
    for delta in deltas:
        real, free = ClosedLoop.from_config(config, delta), visited(paper, ["none"], delta, seeds, rng)
        of_free = real.predict(free)
        for alpha in (*data, ANY):
            yield FREE, delta, alpha, free, of_free
            x = visited(paper, list(data) if alpha == ANY else [alpha], delta, seeds, rng)
            yield "visited, supervised", delta, alpha, x, real.predict(x)


def classify(
    kinds: Iterable[str],
    alphas: Iterable[str],
    config: Config,
    paper: Path,
    deltas: Iterable[float],
    seeds: Sequence[int],
    data_seed: int,
) -> pd.DataFrame:
    """One row per hypothesis, α and set of `judged_states`: hypothesis, alpha, states, delta, scores."""
    data = {alpha: generate(float(alpha), config, data_seed) for alpha in alphas}
    sets = list(judged_states(data, config, paper, deltas, seeds, np.random.default_rng([data_seed, 15])))
    rows = []
    for kind in kinds:
        varied = config.with_values(hypothesis=kind)
        conditions: Mapping[str, TrainingData | None] = {ANY: None} if kind in ORACLES else data
        fitted = {alpha: learn(d, varied, data_seed) for alpha, d in conditions.items()}
        for states, delta, alpha, x, labels in sets:
            if alpha in fitted:
                h = learn(None, varied, delta=delta) if kind == "real" else fitted[alpha]
                cell = {"hypothesis": kind, "alpha": alpha, "states": states, "delta": delta}
                rows.append(cell | classification(h, x, labels))
    return pd.DataFrame(rows)


def ranks(scores: pd.DataFrame, learned: pd.DataFrame) -> pd.DataFrame:
    """Spearman's rank correlation of each score on the states `FREE` with what learners got, for each Δ.

    Columns: delta, score, cells (compared pairs of a hypothesis and an α), `FOLLOWED`. Hypotheses that know
    the system are left out, as they learn from no data.

    Args:
        scores: as of `classify`.
        learned: hypothesis, alpha, delta and `FOLLOWED`, means over seeds, of what was trained.
    """
    judged = scores[(scores["states"] == FREE) & (scores["alpha"] != ANY)]
    joined = judged.merge(learned, on=["hypothesis", "alpha", "delta"])
    rows = [
        {"delta": delta, "score": score, "cells": len(cells)}
        | {name: cells[score].corr(cells[name], method="spearman") for name in FOLLOWED}
        for delta, cells in joined.groupby("delta")
        for score in SCORES
    ]
    return pd.DataFrame(rows, columns=["delta", "score", "cells", *FOLLOWED])


def plot_scores(scores: pd.DataFrame) -> Figure:
    """Precision, recall and Brier score of each hypothesis (columns as of `classify`), by states and α."""
    alphas = [alpha for alpha in PALETTE if alpha in set(scores["alpha"])]
    names = list(scores["hypothesis"].unique())
    groups = list(scores.groupby(["states", "delta"], sort=False))
    figure, axes = plt.subplots(
        len(SCORES), len(groups), sharex=True, sharey="row", figsize=(1.9 * len(groups) + 0.8, 6.4)
    )
    axes = np.reshape(axes, (len(SCORES), len(groups)))
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
        figsize=(4.2 * len(deltas), 1.8 * len(shown) + 0.8),
    )
    axes = np.reshape(axes, (len(shown), len(deltas)))
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
    ax.grid(axis="y", color="#E5E5E5")
    ax.set_axisbelow(True)


def _legend(figure: Figure, shown: list[str]) -> None:
    text = {ANY: "knows the system"}
    handles = [
        Line2D([], [], ls="", marker="o", color=PALETTE[a], label=text.get(a) or label(a)) for a in shown
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(shown))
