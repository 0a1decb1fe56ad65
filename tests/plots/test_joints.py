"""The figures of the study of joints: a line for each k, a panel for each pair, law and Δ."""

from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from replication.plots.joints import (
    PANELS,
    coverage,
    ladder,
    plot_advantages,
    plot_contrasts,
    plot_coverage,
    plot_frontier,
    plot_ladder,
    plot_learners,
)
from replication.studies.joints.answer import PAIRS
from replication.studies.joints.cells import ALPHAS, DELTAS, LAWS, SCORES
from replication.studies.joints.rungs import MAPS, RUNGS, WHOLE
from replication.studies.joints.training import CELL, CONTRASTS, OUTCOMES, contrasts


def test_every_pair_law_and_number_of_states_is_drawn_with_its_interval() -> None:
    rows = [
        (p, n, k, law, d, 5, 0.1 * n, 0.1 * n - 0.05, 0.1 * n + 0.05)
        for p, n, k, (law, d) in product(PAIRS, (2, 3), (250, 1000), PANELS)
    ]
    columns = ["pair", "links", "k", "law", "delta", "datasets", "advantage", "low", "high"]
    figure = plot_advantages(pd.DataFrame(rows, columns=columns))
    assert len(figure.axes) == len(PAIRS) * len(PANELS)
    for ax in figure.axes:
        assert [c.get_label() for c in ax.containers] == ["k = 250", "k = 1000"]
        (line, _, (bars,)) = ax.containers[0]
        assert np.allclose(line.get_ydata(), [0.2, 0.3])
        assert np.allclose([s[1, 1] - s[0, 1] for s in bars.get_segments()], 0.1)
    plt.close(figure)


def test_a_wide_interval_of_two_datasets_does_not_set_the_scale() -> None:
    rows = [("best", 2, 250, law, delta, 5, 0.2, 0.1, 0.3) for law, delta in PANELS]
    rows.append(("best", 3, 250, *PANELS[0], 2, -0.1, -9.0, 9.0))
    columns = ["pair", "links", "k", "law", "delta", "datasets", "advantage", "low", "high"]
    figure = plot_advantages(pd.DataFrame(rows, columns=columns))
    low, high = figure.axes[-1].get_ylim()
    assert -0.2 < low < -0.1 and 0.3 < high < 0.4
    plt.close(figure)


def means() -> pd.DataFrame:
    """Of two k, of which the smaller has one hypothesis less."""
    rows = []
    for n, k, alpha, law, d, name in product((2, 3), (250, 1000), ALPHAS, LAWS, DELTAS, RUNGS):
        if (k, name) != (250, "nca"):
            rows.append((n, k, alpha, law, d, name, 5, 0.5, *(0.2,) * len(SCORES), *(0.1,) * len(SCORES)))
    halves = [f"{name}_half" for name in SCORES]
    columns = ["links", "k", "alpha", "law", "delta", "hypothesis", "datasets", "safe", *SCORES, *halves]
    return pd.DataFrame(rows, columns=columns)


def test_the_ladder_is_of_the_k_with_all_hypotheses() -> None:
    shown = ladder(means())
    assert set(shown["k"]) == {1000} and len(shown) == 2 * len(LAWS) * len(DELTAS) * len(RUNGS)
    figure = plot_ladder(shown)
    of_maps, of_whole = figure.axes[0], figure.axes[len(PANELS)]
    assert len(of_maps.lines) == len(MAPS) + 2 and len(of_whole.lines) == len(WHOLE) + 2  # simulation, recall
    assert all(len(line.get_xdata()) == 2 for line in of_maps.lines)
    plt.close(figure)


def test_coverage_has_a_line_for_each_law_and_for_each_share() -> None:
    rows = coverage(means())
    assert set(rows["k"]) == {1000} and len(rows) == 2 * len(ALPHAS) * len(LAWS) * len(DELTAS)
    figure = plot_coverage(rows)
    left, right = figure.axes
    assert [len(line.get_xdata()) for line in left.lines] == [2] * len(LAWS) + [0]  # no learner was trained
    assert len(right.containers) == len(ALPHAS)
    plt.close(figure)


def learners() -> pd.DataFrame:
    rows = []
    of = [("tsne", "0"), ("tsne", "1"), ("svm", "0"), ("svm", "1"), ("none", "none")]
    for n, (kind, alpha), delta, d in product((2, 3), of, (1.1, 4.0), (0, 1)):
        rows.append((n, kind, alpha, delta, d, 0.9, 10.0, *[0.1 * n + 0.01 * d] * len(OUTCOMES)))
    return pd.DataFrame(rows, columns=[*CELL, "p_t", "activations", *OUTCOMES])


def test_every_learner_is_drawn_and_joined_over_the_joints() -> None:
    runs = learners()
    figure = plot_learners(runs)
    assert len(figure.axes) == 2 * len(OUTCOMES)
    for ax in figure.axes:
        dots, means = ax.lines[::2], ax.lines[1::2]
        assert len(dots) == len(means) == 5 and all(len(line.get_xdata()) == 4 for line in dots)
        assert all(np.allclose(line.get_ydata(), [0.205, 0.305]) for line in means)
    plt.close(figure)
    figure = plot_frontier(runs)
    assert [len(ax.lines) for ax in figure.axes] == [5] * 4
    plt.close(figure)


def test_every_contrast_has_a_panel_for_each_outcome() -> None:
    found = contrasts(learners())
    figure = plot_contrasts(found)
    assert len(figure.axes) == len(CONTRASTS) * len(OUTCOMES)
    numbers = [[len(c[0].get_xdata()) for c in ax.containers] for ax in figure.axes]
    assert numbers.count([2, 2]) == len(numbers) - 3 and numbers.count([0, 0]) == 3  # free learners have no K
    plt.close(figure)
