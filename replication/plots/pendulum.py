"""The pendulum moving: animations, and the task of Fig. 1."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from replication.plots import provenance
from replication.plots.style import (
    CORRECTIVE,
    GUIDE,
    INK,
    LINK,
    STAMP,
    TARGET,
    TRACE,
    ZERO_POSE,
    fit_note,
)
from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.dynamics.pendulum import Floats
from srlrepro.dynamics.rendering import draw_pendulum
from srlrepro.learner.trials import Trial
from srlrepro.settings.paper import Paper
from srlrepro.storage.files import beside

COLOURS = 64  # of a picture
FPS = 20  # pictures per second
PANEL, DPI, TEXT = 3.4, 100, 10  # inches of a panel, pixels per inch, points of all words: 14 pixels
REST = 0.5  # s that the last picture stays
ARC, REFERENCE = (
    0.38,
    0.62,
)  # m of Fig. 1: the radius of the arcs, the length of the lines that they start from


def animate_trials(
    path: Path, trials: Sequence[tuple[str, Trial]], task: ThreeLinkCircleEnv, note: str = ""
) -> None:
    """Write a GIF in real time with one panel per titled trial, side by side; short trials hold their end."""
    figure = Figure(figsize=(PANEL * len(trials), PANEL), dpi=DPI, layout="constrained")
    parts = []
    for ax, (title, trial) in zip(figure.subplots(1, len(trials), squeeze=False)[0], trials, strict=True):
        line = draw_pendulum(ax, trial.joints[0], task.config.paper)
        (goal,) = ax.plot([], [], "o", color=TARGET, markersize=5)
        (trace,) = ax.plot([], [], "-", color=TRACE, linewidth=1)
        ax.set(xlim=(-2.2, 2.2), ylim=(-0.3, 3.4))
        ax.set_title(title, fontsize=TEXT)
        parts.append((trial, trace, line, goal, ax.text(-2.1, 3.1, "", fontsize=TEXT)))

    def show(t: int) -> None:
        for trial, trace, line, goal, words in parts:
            now = min(t, len(trial.joints) - 1)
            line.set_data(*trial.joints[now].T)
            line.set_color(CORRECTIVE if trial.supervised[now] else LINK)
            goal.set_data(trial.targets[now, :1], trial.targets[now, 1:])
            goal.set_visible(not trial.supervised[now])
            trace.set_data(*trial.joints[: min(now, trial.steps) + 1, -1].T)
            acting = "K(x) acts" if trial.supervised[now] else "π(x) acts"
            words.set_text(trial.outcome if now == len(trial.joints) - 1 else acting)

    moving: list[Artist] = [artist for _, *artists in parts for artist in artists]
    longest = max(len(trial.joints) for _, trial in trials)
    _write(path, figure, moving, show, longest, task.rule.control_period, note)


def animate(
    path: Path, clips: Sequence[tuple[str, Floats, str]], paper: Paper, period: float, note: str = ""
) -> None:
    """Write a GIF with one panel per clip, side by side; short clips hold their end.

    Args:
        clips: (title, joints [T, 4, 2] m at every control period, colour).
        period: s between the joints; every picture shows the state nearest to its time.
    """
    figure = Figure(figsize=(PANEL * len(clips), PANEL), dpi=DPI, layout="constrained")
    lines, axes = [], figure.subplots(1, len(clips), squeeze=False)[0]
    for ax, (title, joints, color) in zip(axes, clips, strict=True):
        lines.append(draw_pendulum(ax, joints[0], paper, color, circle=False))
        ax.set_title(title, fontsize=TEXT)

    def show(t: int) -> None:
        for line, (_, joints, _) in zip(lines, clips, strict=True):
            line.set_data(*joints[min(t, len(joints) - 1)].T)

    _write(path, figure, lines, show, max(len(joints) for _, joints, _ in clips), period, note)


def _write(
    path: Path,
    figure: Figure,
    moving: Sequence[Artist],
    show: Callable[[int], None],
    longest: int,
    period: float,
    note: str,
) -> None:
    """Write the GIF of a figure in real time; what does not move is drawn once.

    Args:
        show: sets what moves to its state at a control period, counted from 0 to ``longest``.
    """
    canvas, stride = FigureCanvasAgg(figure), max(1, round(1.0 / (FPS * period)))
    clock = figure.suptitle("t = 0.00 s", fontsize=TEXT)
    if note:
        figure.supxlabel(fit_note(note, figure), color=STAMP, fontsize=7, fontweight="bold")
    for artist in (clock, *moving):
        artist.set_animated(True)  # left out of the background
    canvas.draw()
    background, pictures = canvas.copy_from_bbox(figure.bbox), []
    for t in range(0, longest + round(REST / period), stride):
        show(t)
        clock.set_text(f"t = {t * period:.2f} s")
        canvas.restore_region(background)
        for artist in (clock, *moving):
            figure.draw_artist(artist)
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]).quantize(COLOURS))
    first, *others = pictures
    options: dict[str, Any] = {"append_images": others, "duration": round(1000 * stride * period)}
    options[provenance.GIF_KEY] = provenance.made_by()
    with beside(path) as temporary:
        first.save(temporary, save_all=True, loop=0, **options)


def draw_task(ax: Axes, pose: Floats, zero: Floats, paper: Paper) -> None:
    """Fig. 1: the zero configuration, a pose with its joint angles (joints [4, 2] each), and the target."""
    draw_pendulum(ax, zero, paper, color=ZERO_POSE, circle=False)
    draw_pendulum(ax, pose, paper)
    before = 0.0  # the angle of the link before, clockwise from the vertical
    for i, (start, end) in enumerate(pairwise(pose), start=1):
        now = before + _turn(before, end - start)
        ax.plot(*np.stack([start, start + REFERENCE * _direction(before)]).T, ":", color=GUIDE, linewidth=1)
        along = start[:, None] + ARC * _direction(np.linspace(before, now, 30))
        ax.plot(*along, color=INK, linewidth=0.9)
        ax.annotate("", along[:, -1], along[:, -4], arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 0.9})
        place = start + (ARC + 0.14) * _direction((before + now) / 2)
        ax.annotate(rf"$\theta_{i}$", place, ha="center", va="center", fontsize=9)
        before = now
    left, height = -paper.circle_radius, paper.circle_height
    arrow = {"arrowstyle": "->", "color": TARGET}
    ax.annotate("", (left + 0.01, height + 0.12), (left, height - 0.06), arrowprops=arrow)
    ax.annotate("target circle", (left - 0.15, height), color=TARGET, ha="right", va="center")
    ax.annotate("zero configuration,\nend-effector at (0, 3) m", (0.15, 3.2), va="center", color=GUIDE)
    ax.set(xlim=(-1.8, 1.8), ylim=(-0.2, 3.5))
    ax.annotate("$p_e$", (pose[-1, 0] + 0.1, pose[-1, 1]))


def _direction(angle: float | Floats) -> Floats:
    """The unit vector [2] or [2, N] of an angle, clockwise from the vertical."""
    return np.array([np.sin(angle), np.cos(angle)])


def _turn(before: float, along: Floats) -> float:
    """The joint angle in (−π, π] from the direction ``before`` to the vector ``along`` [2]."""
    turn = float(np.arctan2(*along)) - before
    return float(np.arctan2(np.sin(turn), np.cos(turn)))
