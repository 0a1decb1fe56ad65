"""Figures of other systems: what they draw is in their tables."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from replication.plots.style import CORRECTIVE, LINK, SAFE, UNSAFE
from replication.plots.systems import Walk, plot_plane, plot_walks

LINE = np.arange(4.0)[:, None] * [1.0, 10.0]
WALKS = [
    Walk("K: recovered", LINE, LINE[::-1][1:]),
    Walk("K: failed", LINE, LINE[3:]),
    Walk("π fails", LINE[:2], LINE[:0]),
]


def test_walks_change_colour_where_k_takes_over() -> None:
    figure, table = plot_walks(WALKS, 1, 25.0, 0.5)
    drawn = [line for line in figure.axes[0].lines if line.get_linestyle() == "-"]
    shades = [line.get_color() for line in drawn]
    assert shades[:5] == [LINK, CORRECTIVE, LINK, UNSAFE, LINK]
    np.testing.assert_array_equal(drawn[0].get_xydata(), np.column_stack([0.5 * np.arange(4), LINE[:, 1]]))
    np.testing.assert_array_equal(drawn[1].get_xydata()[0], drawn[0].get_xydata()[-1])
    assert table["acts"].tolist() == ["π"] * 3 + ["K"] * 4 + ["π"] * 3 + ["K"] * 2 + ["π"] * 2
    assert table.groupby("trial")["t / s"].max().tolist() == [3.0, 2.0, 0.5]
    assert table["value"].max() == 30.0
    plt.close(figure)


def test_a_plane_shows_where_k_takes_over() -> None:
    """Labels that depend on the first coordinate alone have borders along the second one."""
    x, y = np.meshgrid(np.linspace(0, 4, 5), np.linspace(0, 30, 4), indexing="ij")
    plane = pd.DataFrame({"a": x.ravel(), "b": y.ravel()})
    plane = plane.assign(
        l_n=(plane["a"] < 3).astype(int), l=(plane["a"] < 2).astype(int), gamma=1 - plane["a"] / 4
    )
    figure, table = plot_plane(plane, 0.6, WALKS)
    ax = figure.axes[0]
    borders = [path.vertices[:, 0] for drawn in ax.collections[1:] for path in drawn.get_paths()]
    np.testing.assert_allclose([np.ptp(border) for border in borders], 0)
    np.testing.assert_allclose([border[0] for border in borders], [2.5, 1.6])
    assert [line.get_color() for line in ax.lines] == [SAFE, UNSAFE]
    assert [len(line.get_xydata()) for line in ax.lines] == [1, 1]
    pd.testing.assert_frame_equal(table[:20][list(plane)].astype(plane.dtypes), plane)
    assert table[20:]["end"].tolist() == ["K: recovered", "K: failed"]
    assert table[20:][["a", "b"]].to_numpy().tolist() == [[3.0, 30.0]] * 2
    plt.close(figure)
