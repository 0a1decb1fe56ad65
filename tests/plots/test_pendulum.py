"""Animations: their pictures, and the note on each."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib import colors
from PIL import Image

from replication.plots.pendulum import (
    DPI,
    PANEL,
    TEXT,
    animate,
    animate_trials,
    draw_task,
    plot_pushes,
    pushes_legend,
    refined_labels,
)
from replication.plots.style import CORRECTIVE, STAMP, panels
from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.dynamics.closed_loop import Labels, Rollouts
from srlrepro.dynamics.pendulum import Floats, Pendulum
from srlrepro.learner.trials import Trial
from srlrepro.settings.config import Config


def leaning(path: Path, note: str) -> None:
    """A clip of a pendulum that leans over in a second, in black."""
    x = np.zeros((21, 6))
    x[:, 0] = np.linspace(0, 0.5, 21)
    animate(path, [("leaning", Pendulum().joints(x), "black")], Config().paper, 0.05, note)


def standing(path: Path, note: str) -> None:
    """A trial of half a second without motion; K acts in its second half."""
    joints, acting = Pendulum().joints(np.zeros((51, 6))), np.arange(51) > 25
    trial = Trial(joints, np.zeros((51, 2)), acting, total=0.0, steps=26, outcome="recovered")
    animate_trials(path, [("standing", trial)], ThreeLinkCircleEnv(), note)


def nearest(path: Path, tint: str) -> list[float]:
    """For each picture, the smallest distance of a pixel from a colour, of 255."""
    stamp, found = np.array(colors.to_rgb(tint)) * 255, []
    with Image.open(path) as picture:
        for frame in range(picture.n_frames):
            picture.seek(frame)
            found.append(float(np.abs(np.array(picture.convert("RGB")) - stamp).max(axis=-1).min()))
    return found


def test_an_animation_has_a_picture_per_stride_and_holds_its_end(tmp_path: Path) -> None:
    leaning(tmp_path / "a.gif", "")
    leaning(tmp_path / "b.gif", "")
    with Image.open(tmp_path / "a.gif") as picture:
        assert picture.n_frames == 21 + 10
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()


def test_each_arc_of_the_task_spans_its_joint_angle() -> None:
    """From the direction of the link before (dotted) to that of the link: as vectors, over each joint."""
    angles, paper = np.array([0.6, -1.0, 1.1]), Config().paper
    pose, zero = Pendulum().joints([[*angles, 0, 0, 0], [0] * 6])
    _, axes = panels(1)
    draw_task(axes[0], pose, zero, paper)
    arcs = [line.get_xydata() for line in axes[0].lines if len(line.get_xydata()) == 30]
    assert len(arcs) == 3
    for arc, joint, angle, absolute in zip(arcs, pose, angles, np.cumsum(angles), strict=False):
        from_vertical = np.arctan2(*(arc - joint).T)
        assert from_vertical[-1] == pytest.approx(absolute) and np.ptp(from_vertical) == pytest.approx(
            abs(angle)
        )
    words = {text.get_text() for text in axes[0].texts}
    assert {r"$\theta_1$", r"$\theta_2$", r"$\theta_3$", "$p_e$"} <= words


def test_the_words_of_an_animation_are_large_enough(tmp_path: Path) -> None:
    leaning(tmp_path / "a.gif", "")
    with Image.open(tmp_path / "a.gif") as picture:
        assert picture.size == (round(PANEL * DPI), round(PANEL * DPI)) and TEXT * DPI / 72 > 12  # pixels


@pytest.mark.parametrize("note", ["", "reduced: 3000 of 1500000 training steps; varied: p_t = 0.5"])
@pytest.mark.parametrize("write", [leaning, standing])
def test_a_note_is_on_every_picture(tmp_path: Path, write: Callable[[Path, str], None], note: str) -> None:
    write(tmp_path / "a.gif", note)
    assert {distance < 40 for distance in nearest(tmp_path / "a.gif", STAMP)} == {bool(note)}


def test_the_pendulum_changes_its_colour_while_k_acts(tmp_path: Path) -> None:
    standing(tmp_path / "a.gif", "")
    acting = [distance < 40 for distance in nearest(tmp_path / "a.gif", CORRECTIVE)]
    assert not any(acting[:6]) and all(acting[6:])  # a picture stands for 0.05 s


def test_pushes_are_drawn_until_their_outcome_and_named() -> None:
    """K recovers from the first push after 0.1 s; two others end on the ground after 0.05 s."""
    pushes, paths = np.array([1.0, 5.0, 9.0]), np.zeros((3, 21, 6))
    paths[:, :, 0] = np.linspace(0, 1, 21) * np.array([[0.1], [2.0], [3.0]])
    rollouts = Rollouts(np.array([1, 2, 2]), np.array([0.1, 0.05, 0.05]), paths)
    _, axes = panels(1)
    table = plot_pushes(axes[0], pushes, rollouts, 0.01)
    assert table.groupby("push / (rad/s)").size().to_dict() == {1.0: 11, 5.0: 6, 9.0: 6}
    assert table.groupby("push / (rad/s)")["outcome"].first().tolist() == [
        "recovered",
        *["hit the ground"] * 2,
    ]
    assert [text.get_text() for text in axes[0].texts] == ["1", "5", "9"]
    drawn = [len(line.get_xdata()) for line in axes[0].lines]
    assert drawn == [11, 6, 6, 2]  # the last is the ground
    assert [entry.get_label() for entry in pushes_legend()][:2] == ["recovered", "failed"]


def test_a_refined_border_is_that_of_the_whole_grid_for_fewer_questions() -> None:
    axis = np.linspace(-1, 1, 81)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    asked = []

    def inside(x: Floats) -> Labels:
        asked.append(len(x))
        return np.asarray((x**2).sum(axis=1) < 0.5, np.int64)

    found = refined_labels(inside, grid, 4)
    np.testing.assert_array_equal(found, inside(grid.reshape(-1, 2)).reshape(81, 81))
    assert sum(asked[:-1]) < 0.4 * 81**2
    constant = refined_labels(lambda x: np.ones(len(x), np.int64), grid, 4)
    assert constant.shape == (81, 81) and constant.all()
