"""The pendulum: animations, the task of Fig. 1, and what K makes of pushes and of other starts."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from replication.plots import provenance
from replication.plots.style import (
    CORRECTIVE,
    GROUND,
    GUIDE,
    INK,
    LINK,
    SAFE,
    STAMP,
    TARGET,
    TRACE,
    UNSAFE,
    ZERO_POSE,
    fit_note,
)
from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.dynamics.closed_loop import OUTCOMES, RECOVERED, Labels, Rollouts
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


def plot_pushes(ax: Axes, pushes: Floats, rollouts: Rollouts, period: float) -> pd.DataFrame:
    """θ1 over time after pushes [B] rad/s of the first link, from rollouts of K with their paths.

    Numbers name the pushes: all from which K recovers; of the others, whose lines lie close together, the
    smallest and the largest. period: s between two states of a path.

    Returns:
        What is drawn: push / (rad/s), outcome, time / s, theta1 / rad.
    """
    failed, drawn = pushes[rollouts.outcomes != RECOVERED], []
    ends = {float(failed.min()): "left", float(failed.max()): "right"} if len(failed) else {}
    for push, path, outcome, end in zip(
        pushes, rollouts.paths, rollouts.outcomes, rollouts.durations, strict=True
    ):
        time = period * np.arange(len(path))
        time, angle = time[time <= end], path[time <= end, 0]
        tint, line = (SAFE, "-") if outcome == RECOVERED else (UNSAFE, "--")
        ax.plot(time, angle, line, color=tint, linewidth=1)
        below = outcome == RECOVERED
        if below or push in ends:
            top, side = int(angle.argmax()), "center" if below else ends[float(push)]
            place = (0, -8 if below else 3)
            ax.annotate(
                f"{push:g}",
                (time[top], angle[top]),
                place,
                textcoords="offset points",
                ha=side,
                color=tint,
                fontsize=7,
            )
        of = {"push / (rad/s)": push, "outcome": OUTCOMES[outcome]}
        drawn.append(pd.DataFrame(of | {"time / s": time, "theta1 / rad": angle}))
    ax.axhline(np.pi / 2, color=GROUND, linewidth=3)
    ax.set(xlabel="time / s", ylim=(None, 1.85))
    return pd.concat(drawn, ignore_index=True)


def pushes_legend() -> list[Artist]:
    """Entries of the legend of `plot_pushes`."""
    ground = Line2D([], [], color=GROUND, linewidth=3, label="the first link lies on the ground")
    lines = (("-", SAFE, "recovered"), ("--", UNSAFE, "failed"))
    return [*(Line2D([], [], ls=ls, c=tint, lw=1, label=text) for ls, tint, text in lines), ground]


def refined_labels(predict: Callable[[Floats], Labels], grid: Floats, finer: int) -> Labels:
    """Labels [N, M] of the states of a grid [N, M, d], where N − 1 and M − 1 are multiples of ``finer``.

    Asked are every ``finer``-th row and column, and all states between such whose labels differ: a border is
    found as on the whole grid, unless the coarse one steps over a piece of it.
    """
    coarse = grid[::finer, ::finer]
    rows, columns = coarse.shape[:2]
    found = predict(coarse.reshape(-1, grid.shape[2])).reshape(rows, columns)
    edge = np.pad(found, 1, mode="edge")
    near = [edge[i : i + rows, j : j + columns] != found for i in range(3) for j in range(3)]
    nearest = np.ix_(*((np.arange(size) + finer // 2) // finer for size in grid.shape[:2]))
    labels, asked = found[nearest], np.any(near, axis=0)[nearest]
    if asked.any():
        labels[asked] = predict(grid[asked])
    return labels
