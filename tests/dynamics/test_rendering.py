"""Pictures of the pendulum: what is drawn lies where the task has it."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from srlrepro.dynamics.pendulum import Pendulum
from srlrepro.dynamics.rendering import PendulumView, draw_pendulum
from srlrepro.settings.paper import Paper

PAPER = Paper()
JOINTS = np.array([[0.0, 0.0], [0.3, 0.9], [0.1, 1.8], [-0.2, 2.7]])


@pytest.mark.parametrize("circle", [True, False])
def test_ground_circle_and_joints_lie_where_they_are(circle: bool) -> None:
    ax = Figure().add_subplot()
    line = draw_pendulum(ax, JOINTS, PAPER, circle=circle)
    np.testing.assert_array_equal(line.get_xydata(), JOINTS)
    ground = ax.lines[0]
    assert set(np.asarray(ground.get_ydata()).tolist()) == {0.0}  # the height of the first joint
    assert len(ax.patches) == circle
    for patch in ax.patches:
        assert patch.center == (0.0, PAPER.circle_height) and patch.radius == PAPER.circle_radius  # type: ignore[attr-defined]
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    assert -left == right > PAPER.length and bottom < 0 and top > PAPER.length  # a stretched pendulum fits


def test_a_view_shows_the_joints_the_target_and_the_title() -> None:
    view = PendulumView(PAPER)
    before = view.image()
    assert before.ndim == 3 and before.shape[2] == 3 and before.dtype == np.uint8
    view.draw(JOINTS, (0.5, 1.5), "a title")
    ax = view._figure.axes[0]
    shown = [line.get_xydata().tolist() for line in ax.lines]  # type: ignore[union-attr]
    assert JOINTS.tolist() in shown and [[0.5, 1.5]] in shown and ax.get_title() == "a title"
    assert (view.image() != before).any()
    assert len(JOINTS) == Pendulum().links + 1
