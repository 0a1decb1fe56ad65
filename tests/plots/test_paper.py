"""The paper's figures: what is drawn of the data, and what the legends say."""

from dataclasses import replace
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
    plot_reliability,
    plot_states,
    reliability_legend,
    states_legend,
)
from replication.plots.style import CONDITIONS, panels
from srlrepro.settings.config import Config


def curves(columns: int, rows: int = 100) -> pd.DataFrame:
    """Curves of α = 0 that rise from -500 to 700; each seed lies 10 above the one before."""
    step = np.arange(1, rows + 1)
    rise = np.linspace(-500.0, 700.0, rows)
    seeds = [
        pd.DataFrame({"alpha": "0", "seed": s, "step": step, "mean_return": rise + 10 * s})
        for s in range(columns)
    ]
    return pd.concat(seeds, ignore_index=True)


def test_every_seed_and_the_median_are_drawn() -> None:
    """Of five parallel lines; a moving mean of a line is that line, but at its ends."""
    _, axes = panels(1)
    plot_learning(axes[0], curves(5), "mean_return", 800.0)
    drawn = [np.asarray(line.get_ydata()) for line in axes[0].lines if line.get_color() == CONDITIONS["0"]]
    inner, rise = slice(1, -1), curves(1)["mean_return"].to_numpy()
    found = [float((y - rise)[inner].mean()) for y in drawn]
    assert found == pytest.approx([0.0, 10.0, 20.0, 30.0, 40.0, 20.0])
    assert all(np.ptp((y - rise)[inner]) < 1e-9 for y in drawn)


def test_the_band_holds_the_middle_half_of_the_seeds() -> None:
    _, axes = panels(1)
    plot_learning(axes[0], curves(5), "mean_return", 800.0)
    band = axes[0].collections[0].get_paths()[0].vertices
    middle = band[band[:, 0] == 50.0, 1]
    assert np.ptp(middle) == pytest.approx(20.0)  # from the second to the fourth of five


def test_the_frame_ends_at_zero_and_an_inset_shows_the_start() -> None:
    _, axes = panels(1)
    plot_learning(axes[0], curves(3), "mean_return", 800.0)
    assert list(axes[0].get_yticks()) == [0, 200, 400, 600, 800] and axes[0].get_ylim()[1] > 800
    (inset,) = axes[0].child_axes
    assert {float(x) for line in inset.lines for x in line.get_xdata()} == {1.0, 2.0}  # two per cent of 100


def test_without_points_at_the_start_there_is_no_inset() -> None:
    _, axes = panels(1)
    plot_learning(axes[0], curves(3, rows=20), "mean_return", 800.0)
    assert not axes[0].child_axes and -100 < axes[0].get_ylim()[0] < 0


def test_curves_that_never_come_to_zero_keep_their_own_range() -> None:
    _, axes = panels(1)
    low = curves(2).assign(mean_return=lambda t: t["mean_return"] - 1000)
    plot_learning(axes[0], low, "mean_return", 800.0)
    assert axes[0].get_ylim()[0] < -1400 and not axes[0].child_axes


def test_markers_are_seeds_and_lines_their_medians_where_there_is_something_to_count() -> None:
    cells = {"alpha": ["0"] * 3 + ["none"] * 3, "seed": [0, 1, 2] * 2, "falls": [0, 3, 5, 900, 1000, 4000]}
    cells["activations"] = [10, 20, 60, np.nan, np.nan, np.nan]
    figure, axes = panels(1)
    plot_counts(axes[0], pd.DataFrame(cells), {"activations": "o", "falls": "v"})
    assert [list(line.get_ydata()) for line in axes[0].lines] == [
        [10, 20, 60],
        [20, 20],
        [0, 3, 5],
        [3, 3],
        [900, 1000, 4000],
        [1000, 1000],
    ]
    figure.canvas.draw()
    heights = axes[0].transData.transform([(0, v) for v in (0, 1, 10, 100, 10000)])[:, 1]
    steps = np.diff(heights)
    assert (steps > 0).all() and steps[3] == pytest.approx(2 * steps[2])  # a decade is a decade
    assert [e.get_label() for e in counts_legend({"falls": "v"})] == ["falls", "median of the seeds"]


def test_the_largest_count_of_all_panels_is_whole_on_their_axis() -> None:
    _, axes = panels(2, sharey=True)
    for ax, most in zip(axes, (90_000, 40), strict=True):
        plot_counts(ax, pd.DataFrame({"alpha": "0", "seed": range(2), "falls": [1, most]}), {"falls": "v"})
    assert all(ax.get_ylim() == (-0.3, 1e6) for ax in axes)


def test_the_names_of_many_conditions_do_not_overlap() -> None:
    alphas = ["0", "0.25", "0.5", "0.75", "1", "none"]
    figure, axes = panels(1)
    plot_counts(axes[0], pd.DataFrame({"alpha": alphas, "seed": 0, "falls": 1}), {"falls": "v"})
    figure.canvas.draw()
    places = sorted((t.get_window_extent() for t in axes[0].get_xticklabels()), key=lambda box: float(box.x0))
    assert all(a.x1 <= b.x0 for a, b in pairwise(places))


def test_reliability_shows_each_bin_with_its_interval_and_its_share_of_the_states() -> None:
    """Wilson's interval of k of n, in closed form; markers of 10 and 90 % of the states."""
    table = pd.DataFrame({"predicted": [0.2, 0.8], "observed": [0.5, 1.0], "states": [10, 90]})
    _, axes = panels(1)
    plot_reliability(axes[0], table, "0", 0.8)
    bars, markers = axes[0].collections
    z2 = 1.959964**2
    expected = []
    for share, n in ((0.5, 10), (1.0, 90)):
        centre = (share + z2 / (2 * n)) / (1 + z2 / n)
        half = np.sqrt(z2 * (share * (1 - share) / n + z2 / (4 * n**2))) / (1 + z2 / n)
        expected.append([centre - half, centre + half])
    assert np.array([s[:, 1] for s in bars.get_segments()]) == pytest.approx(np.array(expected), abs=1e-5)
    assert markers.get_offsets().tolist() == [[0.2, 0.5], [0.8, 1.0]]
    small_area, large_area = markers.get_sizes()
    assert large_area > 5 * small_area
    names = [entry.get_label() for entry in reliability_legend(["0", "1"])]
    assert names[0] == r"$\alpha = 0$" and names[2:] == ["1 % of the states", "50 % of the states", "$p_t$"]


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


def test_states_are_told_apart_by_label_and_by_law(small: Learned) -> None:
    """Fill: the label; shape: the law. Each state is drawn once, the unsafe ones last."""
    data = replace(small[0], n_ud=40)
    _, axes = panels(1)
    plot_states(axes[0], data, Config())
    drawn = []
    for cloud in axes[0].collections:
        fill = "filled" if len(cloud.get_facecolor()) else "open"
        drawn.append((fill, len(cloud.get_paths()[0].vertices), len(cloud.get_offsets())))
    safe, first = data.z == 1, np.arange(len(data.z)) < 40
    expected = [int((a & b).sum()) for a in (safe, ~safe) for b in (~first, first)]
    assert [fill for fill, *_ in drawn] == ["filled"] * 2 + ["open"] * 2
    assert [count for *_, count in drawn] == expected and sum(expected) == len(data.x)
    assert len({shape for _, shape, _ in drawn}) == 2
    assert [e.get_label() for e in states_legend()][2:] == ["from UD", "from MND"]


def test_embedding_and_gamma_show_the_same_plane_and_name_line_and_cross(small: Learned) -> None:
    region = small[1]
    origin = region.transform(np.zeros((1, 6)))[0]
    figure, (points, gamma) = panels(2)
    plot_embedding(points, region.embedding_, region.labels_, region.arrays_)
    plot_gamma(gamma, region, origin)
    figure.canvas.draw()
    assert points.get_xlim() == gamma.get_xlim() and points.get_ylim() == gamma.get_ylim()
    assert points.get_aspect() == gamma.get_aspect() == 1.0
    low, high = np.array([points.get_xlim(), points.get_ylim()]).T
    assert (low <= region.embedding_).all() and (region.embedding_ <= high).all()
    cross = dict(zip(*gamma.get_legend_handles_labels()[::-1], strict=True))[r"$\Psi(0)$"]
    assert list(cross.get_xydata()[0]) == list(origin)
    evidence = np.concatenate([c.get_offsets() for c in gamma.collections if len(c.get_offsets()) > 1])
    assert sorted(map(tuple, evidence)) == sorted(map(tuple, region.evidence_))
