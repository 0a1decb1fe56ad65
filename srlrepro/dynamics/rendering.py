"""Pictures of the pendulum (Fig. 1, animations, `render`), drawn with matplotlib."""

import time
from collections.abc import Sequence

import numpy as np
from gymnasium.error import DependencyNotInstalled
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import NDArray

from srlrepro.dynamics.pendulum import Floats
from srlrepro.settings.paper import Paper

LINK, TARGET, GROUND = "#333333", "#EE3377", "#999999"
SIZE = (4.8, 3.6)  # inches
LONGEST_GAP = 0.2  # s between two pictures of a window that cannot keep up


def draw_pendulum(ax: Axes, joints: Floats, paper: Paper, color: str = LINK, circle: bool = True) -> Line2D:
    """Draw ground, target circle and the pendulum of joints [n + 1, 2] (m) into ax; returns its line."""
    reach = paper.length
    ax.axhline(0.0, color=GROUND, linewidth=3, zorder=0)
    if circle:
        centre = (0.0, paper.circle_height)
        ax.add_patch(Circle(centre, paper.circle_radius, fill=False, color=TARGET, linestyle="--"))
    (line,) = ax.plot(*joints.T, "o-", color=color, linewidth=3, markersize=6, solid_capstyle="round")
    ax.set(xlim=(-reach - 0.2, reach + 0.2), ylim=(-0.6, reach + 0.2), aspect="equal")
    ax.set(xlabel="horizontal position / m", ylabel="height / m")
    return line


def open_window() -> Figure:
    """An empty figure in a window; `DependencyNotInstalled` if there is no GUI toolkit, or no display."""
    import matplotlib.pyplot as plt  # looks for a toolkit, which pictures do not need

    try:
        figure = plt.figure(figsize=SIZE, layout="constrained")
        if figure.canvas.required_interactive_framework is not None:
            plt.show(block=False)
            return figure
        plt.close(figure)
    except ImportError:
        pass
    raise DependencyNotInstalled(
        f'render_mode="human" needs a display and a GUI toolkit (such as: pip install PyQt6); matplotlib has '
        f'only {plt.get_backend()}. render_mode="rgb_array" needs neither'
    )


class PendulumView:
    """One figure that is redrawn for every picture; off-screen unless ``window``."""

    def __init__(self, paper: Paper, window: bool = False) -> None:
        self._figure = open_window() if window else Figure(figsize=SIZE, layout="constrained")
        if not window:
            FigureCanvasAgg(self._figure)
        self._began = self._shown = 0.0  # s, on the clock of the machine
        ax = self._figure.add_subplot()
        self._line = draw_pendulum(ax, np.zeros((paper.links + 1, 2)), paper)
        (self._target,) = ax.plot([], [], "o", color=TARGET, label="target $p_d$")
        self._title = ax.set_title("t = 0.00 s")
        ax.legend(loc="lower right")
        self._figure.draw_without_rendering()  # lays the axes out, once for all pictures
        self._figure.set_layout_engine("none")

    def draw(self, joints: Floats, target: Sequence[float], title: str) -> None:
        """Set the joints [n + 1, 2] and the target (2) in m, and the title."""
        self._line.set_data(*joints.T)
        self._target.set_data([target[0]], [target[1]])
        self._title.set_text(title)

    def image(self) -> NDArray[np.uint8]:
        """The picture [H, W, 3]."""
        canvas = self._figure.canvas
        assert isinstance(canvas, FigureCanvasAgg)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    def show(self, now: float) -> None:
        """Show the picture in the window ``now`` (s since the trial started), in real time.

        Waits until then. If it is past, the picture is left out, unless the last one is `LONGEST_GAP` old.
        """
        clock = time.perf_counter()
        if now == 0.0:
            self._began = clock
        ahead = self._began + now - clock
        if ahead < 0 and clock - self._shown < LONGEST_GAP:
            return
        self._figure.canvas.draw_idle()
        self._figure.canvas.start_event_loop(max(ahead, 1e-3))
        self._shown = time.perf_counter()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._figure.canvas.manager is not None:
            import matplotlib.pyplot as plt

            plt.close(self._figure)
