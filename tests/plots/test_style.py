"""Figures: same colours everywhere, each with its table, the same bytes for the same data."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from PIL import Image

from replication.plots.paper import plot_bound, plot_counts, plot_learning
from replication.plots.pendulum import animate
from replication.plots.style import CONDITIONS, color, panels, save_figure
from srlrepro.dynamics.pendulum import ThreeLinkPendulum
from srlrepro.settings.config import Config

CURVES = pd.DataFrame(
    {
        "alpha": ["0", "0", "none", "none"] * 2,
        "seed": [0] * 4 + [1] * 4,
        "step": [1, 2] * 4,
        "mean_return": [1.0, 2.0, 3.0, 4.0, 3.0, 4.0, 5.0, 6.0],
    }
)


@pytest.fixture(autouse=True)
def close_figures() -> None:
    plt.close("all")


def test_a_figure_is_vector_raster_and_table_and_deterministic(tmp_path: Path) -> None:
    files = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        figure, axes = panels(1)
        plot_learning(axes[0], CURVES, "mean_return")
        save_figure(figure, folder, "fig", CURVES, "reduced")
        files.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert sorted(files[0]) == ["fig.csv", "fig.pdf", "fig.png"]
    assert files[0] == files[1]


def test_conditions_have_distinct_colours() -> None:
    assert len(set(CONDITIONS.values())) == len(CONDITIONS)
    assert color("0.25") not in CONDITIONS.values()


def test_every_seed_and_the_mean_are_drawn() -> None:
    _, axes = panels(1)
    plot_learning(axes[0], CURVES, "mean_return")
    drawn = [tuple(line.get_ydata()) for line in axes[0].lines if line.get_color() == CONDITIONS["0"]]
    assert sorted(drawn) == [(1.0, 2.0), (2.0, 3.0), (3.0, 4.0)]


def test_bars_are_means_and_dots_are_seeds() -> None:
    counts = pd.DataFrame({"alpha": ["0", "0"], "seed": [0, 1], "activations": [10, 20]})
    _, axes = panels(1)
    plot_counts(axes[0], counts, [("activations", "")])
    assert [bar.get_height() for bar in axes[0].patches] == [15.0]
    assert list(axes[0].lines[0].get_ydata()) == [10, 20]


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


def test_animation_has_a_frame_per_stride_and_holds_its_end(tmp_path: Path) -> None:
    x = np.zeros((21, 6))
    x[:, 0] = np.linspace(0, 0.5, 21)
    clip = ("leaning", ThreeLinkPendulum().joints(x), "black")
    animate(tmp_path / "a.gif", [clip], Config().paper, period=0.05)
    with Image.open(tmp_path / "a.gif") as picture:
        assert picture.n_frames >= 21
