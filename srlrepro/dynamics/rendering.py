"""Pictures of the pendulum (Fig. 1, animations, `render`), drawn with matplotlib."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import NDArray

from srlrepro.dynamics.pendulum import Floats
from srlrepro.settings.paper import Paper

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
