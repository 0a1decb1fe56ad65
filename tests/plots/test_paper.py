"""The paper's figures: what is drawn of the data, and what the legends say."""

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from learned import Learned

from replication.plots.paper import (
    bound_legend,
    counts_legend,
    plot_bound,
    plot_counts,
    plot_embedding,
    plot_gamma,
    plot_learning,
)
from replication.plots.style import CONDITIONS, panels


def test_every_seed_and_the_mean_are_drawn() -> None:
    cells = {
        "alpha": ["0", "0"] * 2,
        "seed": [0, 0, 1, 1],
        "step": [1, 2] * 2,
        "mean_return": [1.0, 2.0, 3.0, 4.0],
    }
    _, axes = panels(1)
    plot_learning(axes[0], pd.DataFrame(cells), "mean_return")
    drawn = [tuple(line.get_ydata()) for line in axes[0].lines if line.get_color() == CONDITIONS["0"]]
    assert sorted(drawn) == [(1.0, 2.0), (2.0, 3.0), (3.0, 4.0)]


def test_bars_are_means_and_dots_are_seeds() -> None:
    counts = pd.DataFrame({"alpha": ["0", "0"], "seed": [0, 1], "activations": [10, 20]})
    _, axes = panels(1)
    plot_counts(axes[0], counts, [("activations", "")])
    assert [bar.get_height() for bar in axes[0].patches] == [15.0]
    assert list(axes[0].lines[0].get_ydata()) == [10, 20]
    assert [entry.get_label() for entry in counts_legend({"activations of K": ""})] == ["activations of K"]


def test_the_names_of_many_conditions_do_not_overlap() -> None:
    alphas = ["0", "0.25", "0.5", "0.75", "1", "none"]
    figure, axes = panels(1)
    plot_counts(axes[0], pd.DataFrame({"alpha": alphas, "seed": 0, "falls": 1}), [("falls", "")])
    figure.canvas.draw()
    places = sorted((t.get_window_extent() for t in axes[0].get_xticklabels()), key=lambda box: float(box.x0))
    assert all(a.x1 <= b.x0 for a, b in pairwise(places))


def test_a_bound_is_stacked_from_its_terms() -> None:
    """Two seeds: bars of the means, dots of both errors and both bounds, and the marks of another class."""
    cells = {"alpha": ["0"] * 4, "class": ["small", "small", "large", "large"], "source_error": [0.1] * 4}
    cells |= {"half_divergence": [0.2, 0.4, 0.9, 0.8], "e1": [0.1] * 4, "e2": [0.3, 0.05, 0.3, 0.05]}
    cells |= {"error": [0.01, 0.02, 0.01, 0.02], "bound": [0.4, 0.55, 1.1, 0.95]}
    _, axes = panels(1)
    plot_bound(axes[0], pd.DataFrame(cells), "small", {"large": "^"})
    assert [bar.get_height() for bar in axes[0].patches] == pytest.approx([0.1, 0.3, 0.075])
    drawn = [list(line.get_ydata()) for line in axes[0].lines]
    assert drawn == [[0.4, 0.55], [0.01, 0.02], [1.1, 0.95], [1.0, 1.0]]
    assert [entry.get_label() for entry in bound_legend({"large": "^"})][3:] == [
        "true error",
        "bound, smallest class",
        "bound, large",
    ]


def test_embedding_and_gamma_show_the_same_plane_and_name_line_and_cross(small: Learned) -> None:
    region = small[1]
    origin = region.transform(np.zeros((1, 6)))[0]
    figure, (points, gamma) = panels(2)
    plot_embedding(points, region.embedding_, region.labels_, region.arrays_)
    plot_gamma(gamma, region.arrays_, region.p_t, origin)
    figure.canvas.draw()
    assert points.get_xlim() == gamma.get_xlim() and points.get_ylim() == gamma.get_ylim()
    low, high = np.array([points.get_xlim(), points.get_ylim()]).T
    assert (low <= region.embedding_).all() and (region.embedding_ <= high).all()
    cross = dict(zip(*gamma.get_legend_handles_labels()[::-1], strict=True))[r"$\Psi(0)$"]
    assert list(cross.get_xydata()[0]) == list(origin)
