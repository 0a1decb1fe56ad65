"""Pictures of the pendulum (Fig. 1, animations, `render`), drawn with matplotlib."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import NDArray

from srlrepro.config import Paper
from srlrepro.files import beside
from srlrepro.pendulum import Floats

LINK, TARGET, GROUND = "#333333", "#D55E00", "#999999"


def draw_pendulum(ax: Axes, joints: Floats, paper: Paper, color: str = LINK, circle: bool = True) -> Line2D:
    """Draw ground, target circle and the pendulum with its joints [4, 2] (m) into ax; returns its line."""
    reach = 3 * paper.link_length
    ax.axhline(0.0, color=GROUND, linewidth=3, zorder=0)
    if circle:
        centre = (0.0, paper.circle_height)
        ax.add_patch(Circle(centre, paper.circle_radius, fill=False, color=TARGET, linestyle="--"))
    (line,) = ax.plot(*joints.T, "o-", color=color, linewidth=3, markersize=6, solid_capstyle="round")
    ax.set(xlim=(-reach - 0.2, reach + 0.2), ylim=(-0.6, reach + 0.2), aspect="equal")
    ax.set(xlabel="horizontal position / m", ylabel="height / m")
    return line


class PendulumView:
    """One figure that is redrawn for every frame; off-screen unless ``window``."""

    def __init__(self, paper: Paper, window: bool = False) -> None:
        if window:
            plt.ion()
            self._figure = plt.figure(figsize=(4.8, 3.6), layout="constrained")
        else:
            self._figure = Figure(figsize=(4.8, 3.6), layout="constrained")
            FigureCanvasAgg(self._figure)
        self._window = window
        ax = self._figure.add_subplot()
        self._line = draw_pendulum(ax, np.zeros((4, 2)), paper)
        (self._target,) = ax.plot([], [], "o", color=TARGET, label="target $p_d$")
        self._title = ax.set_title("t = 0.00 s")
        ax.legend(loc="lower right")
        self._figure.draw_without_rendering()  # lays the axes out, once for all pictures
        self._figure.set_layout_engine("none")

    def draw(self, joints: Floats, target: Sequence[float], title: str) -> None:
        """Show the joints [4, 2] and the target (2) in m under a title."""
        self._line.set_data(*joints.T)
        self._target.set_data([target[0]], [target[1]])
        self._title.set_text(title)

    def image(self) -> NDArray[np.uint8]:
        """The picture [H, W, 3]."""
        canvas = self._figure.canvas
        assert isinstance(canvas, FigureCanvasAgg)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    def show(self, seconds: float) -> None:
        """Refresh the window and wait."""
        self._figure.canvas.draw_idle()
        self._figure.canvas.flush_events()
        if self._window:
            plt.pause(seconds)

    def close(self) -> None:
        """Release the figure."""
        if self._window:
            plt.close(self._figure)


def animate(
    path: Path, clips: Sequence[tuple[str, Floats, str]], paper: Paper, period: float, fps: int = 20
) -> None:
    """Write a GIF with one panel per clip, side by side.

    clips: (title, joints [T, 4, 2] m at every control period, colour); shorter clips hold their last frame.
    period: s between the joints; every frame shows the state nearest to its time.
    """
    longest = max(len(joints) for _, joints, _ in clips)
    stride = max(1, round(1.0 / (fps * period)))
    size = (3.6 * len(clips), 3.0)
    figure, axes = plt.subplots(1, len(clips), figsize=size, squeeze=False, layout="constrained")
    lines = []
    for ax, (title, joints, color) in zip(axes[0], clips, strict=True):
        lines.append(draw_pendulum(ax, joints[0], paper, color, circle=False))
        ax.set_title(title, fontsize=10)
    clock = figure.suptitle("t = 0.00 s", fontsize=10)

    def frame(t: int) -> list[Line2D]:
        for line, (_, joints, _) in zip(lines, clips, strict=True):
            line.set_data(*joints[min(t, len(joints) - 1)].T)
        clock.set_text(f"t = {t * period:.2f} s")
        return lines

    animation = FuncAnimation(figure, frame, frames=range(0, longest + 10 * stride, stride))
    with beside(path) as temporary:
        animation.save(temporary, writer=PillowWriter(fps=round(1.0 / (stride * period))), dpi=72)
    plt.close(figure)


def draw_task(ax: Axes, pose: Floats, zero: Floats, paper: Paper) -> None:
    """Fig. 1: the zero configuration, a pose with its joint angles (joints [4, 2] each), and the target."""
    draw_pendulum(ax, zero, paper, color="#BBBBBB", circle=False)
    draw_pendulum(ax, pose, paper)
    before = np.array([0.0, 1.0])
    for i, (start, end) in enumerate(pairwise(pose), start=1):
        ax.plot(*np.stack([start, start + 0.55 * before]).T, ":", color="#777777", linewidth=1)
        between = before + (end - start) / np.linalg.norm(end - start)
        ax.annotate(
            rf"$\theta_{i}$", start + 0.62 * between / np.linalg.norm(between), ha="center", va="center"
        )
        before = (end - start) / np.linalg.norm(end - start)
    left, height = -paper.circle_radius, paper.circle_height
    arrow = {"arrowstyle": "->", "color": TARGET}
    ax.annotate("", (left + 0.01, height + 0.12), (left, height - 0.06), arrowprops=arrow)
    ax.annotate("target circle", (left - 0.15, height), color=TARGET, ha="right", va="center")
    ax.annotate("zero configuration,\nend-effector at (0, 3) m", (0.15, 3.2), va="center", color="#777777")
    ax.set(xlim=(-1.8, 1.8), ylim=(-0.2, 3.5))
    ax.annotate("$p_e$", (pose[-1, 0] + 0.1, pose[-1, 1]))
