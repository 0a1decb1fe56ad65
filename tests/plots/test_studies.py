"""Figures of the studies: every run is drawn, where its table has it."""

from itertools import product

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from replication.plots.studies import (
    plot_caution,
    plot_crossed,
    plot_effects,
    plot_frontier,
    plot_roc,
    plot_shift,
)
from replication.studies import caution, crossed, shift
from replication.studies.designs import HYPOTHESES, THRESHOLDS, VARIANTS

RNG = np.random.default_rng(0)
DELTAS = (1.1, 4.0)


def drawn(ax: Axes, marker: str) -> int:
    """How many points of lines with a marker there are."""
    return sum(len(np.atleast_1d(line.get_xdata())) for line in ax.lines if line.get_marker() == marker)


def learners() -> pd.DataFrame:
    cells = product(HYPOTHESES, ("0", "1"), DELTAS, range(3), THRESHOLDS)
    runs = pd.DataFrame(cells, columns=[*caution.CELL, "p_t"])
    runs["caution"] = runs["p_t"] / 4
    for name in ("log_violations", *caution.BESIDE):
        runs[name] = RNG.uniform(0, 1, len(runs))
    return runs


def test_every_crossed_run_is_a_mark_and_the_parts_of_a_variance_fill_its_bar() -> None:
    cells = product(crossed.JUDGED, ("0", "1"), range(3), range(4))
    measures = pd.DataFrame(cells, columns=["measure", "alpha", "dataset", "seed"])
    measures["value"] = RNG.normal(size=len(measures))
    figure = plot_crossed(measures, crossed.component_table(measures))
    top, bottom = figure.axes[: len(crossed.JUDGED)], figure.axes[len(crossed.JUDGED) :]
    for ax in top:
        assert drawn(ax, "o") == drawn(ax, "^") == 12 and drawn(ax, "_") == 6
    for ax in bottom:
        heights = np.array([bar.get_height() for bar in ax.patches]).reshape(3, 2)
        np.testing.assert_allclose(heights.sum(axis=0), 1)


def test_a_study_without_a_variance_is_drawn() -> None:
    cells = product(crossed.JUDGED, ("0",), (0, 1), (0,), (1.0,))
    measures = pd.DataFrame(cells, columns=["measure", "alpha", "dataset", "seed", "value"])
    figure = plot_crossed(measures, crossed.component_table(measures))
    assert all(bar.get_height() == 0 for ax in figure.axes for bar in ax.patches)


def test_each_hypothesis_and_mismatch_has_a_panel_with_its_learners_and_their_means() -> None:
    figure = plot_frontier(learners())
    assert [ax.get_title()[-14:] for ax in figure.axes[:2]] == [r"$\Delta = 1.1$", r", $\Delta = 4$"]
    assert len(figure.axes) == len(HYPOTHESES) * len(DELTAS)
    for ax in figure.axes:
        assert drawn(ax, "o") == drawn(ax, "^") == 3 * len(THRESHOLDS) + len(THRESHOLDS)
        told = [text.get_text() for text in ax.texts]
        assert told == 2 * [f"{p_t:g}" for p_t in (THRESHOLDS[0], THRESHOLDS[-1])]


def test_curves_are_marked_at_the_trained_thresholds() -> None:
    cells = product(HYPOTHESES, ("0", "0.25"), DELTAS, range(2), (0.1, *THRESHOLDS))
    curves = pd.DataFrame(cells, columns=[*caution.CELL, "p_t"])
    curves["true_positives"] = curves["false_positives"] = 1 - curves["p_t"]
    for ax in plot_roc(curves).axes:
        assert drawn(ax, ".") == drawn(ax, "o") == 2 * len(THRESHOLDS)
        assert ax.get_xscale() == "symlog" and ax.get_xlim() == (0, 1)


def test_outcomes_and_effects_stand_beside_what_matters() -> None:
    runs = learners()
    figure = plot_caution(runs)
    assert len(figure.axes) == len(caution.OUTCOMES) * len(DELTAS)
    for ax in figure.axes:
        assert sum(len(points.get_offsets()) for points in ax.collections) == len(runs) / len(DELTAS)
    figure = plot_effects(caution.effects(runs))
    for ax, (_, bound) in zip(figure.axes, caution.OUTCOMES.values(), strict=True):
        left, right = ax.patches[0].get_window_extent().transformed(ax.transData.inverted()).intervalx
        np.testing.assert_allclose((left, right), (-bound, bound))


def test_every_variant_has_its_datasets() -> None:
    cells = product(VARIANTS, DELTAS, range(5), shift.SHOWN)
    table = pd.DataFrame(cells, columns=[*shift.RUN, "measure"]).assign(value=1.0)
    figure = plot_shift(table)
    for ax in figure.axes:
        assert drawn(ax, "o") == len(VARIANTS) * len(DELTAS) * 5
    assert [label.get_text() for label in figure.axes[-1].get_xticklabels()] == list(VARIANTS)
