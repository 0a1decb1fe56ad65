"""One look for every figure: every colour, with its one meaning, and how a figure is written.

Hex codes stand here alone, but for those of the pendulum itself (`srlrepro.dynamics.rendering`).
"""

import textwrap
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from replication.plots import provenance
from srlrepro.dynamics.rendering import GROUND as GROUND
from srlrepro.dynamics.rendering import LINK as LINK
from srlrepro.dynamics.rendering import TARGET as TARGET
from srlrepro.settings.condition import NONE
from srlrepro.storage.files import beside, write_table

# Conditions: α of the training data, or no supervisor. Okabe and Ito's colours.
CONDITIONS = {"0": "#0072B2", "0.5": "#009E73", "1": "#D55E00", NONE: "#4D4D4D"}
MARKERS = {"0": "o", "0.5": "s", "1": "^", NONE: "D"}
OTHER_MARKER = "v"  # of other values of α
KNOWS_SYSTEM = "#CC79A7"  # a hypothesis that knows the system, whatever α
ANY_CONDITION = "#666666"  # entries of a legend that hold for all conditions

# States: the label l(x), the law that they were drawn from, and the safe region.
SAFE, UNSAFE = "#56B4E9", "#AA4499"  # K recovers from x, or not
LAWS = {"UD": "s", "MND": "o"}  # markers
BORDER = "#00E5FF"  # of S_y, drawn on Γ

# The pendulum; LINK, TARGET and GROUND are handed on from `render`.
CORRECTIVE = "#E69F00"  # the pendulum while K acts
TRACE = "#8172D0"  # the path of the end-effector
ZERO_POSE = "#BBBBBB"  # the pendulum in its zero configuration

# Claims: the state of a contrast.
SUPPORTS, CONTRADICTS, UNRESOLVED = "#117733", "#882255", "#888888"
PAPERS_NUMBER = "#8C510A"  # what the paper states, with its tolerance

# The multiverse.
DEFAULT_UNIVERSE = "#7B3FBF"
LEVELS = ("#D9D9D9", "#DDCC77", "#332288")  # of a choice: the default, the first and the second alternative

# Around the data.
INK = "#000000"  # single values: seeds, universes, the origin
BACKGROUND = "#FFFFFF"  # the page, and what is left open
GUIDE = "#777777"  # bounds, thresholds, diagonals
GRID = "#E5E5E5"
STAMP = "#B00000"  # the note that a figure does not show the full experiment

# Colour maps: of Γ, of α beside those of the paper, of Δ.
GAMMA_MAP, ALPHA_MAP, DELTA_MAP = "cividis", "cool", "magma"

FONT = "DejaVu Sans"  # matplotlib brings it; seaborn would take Arial where the machine has it
NOTE_WIDTH = 11  # characters of a note that fit into an inch


def use_style() -> None:
    """Set matplotlib's defaults for every figure of the replication."""
    import seaborn as sns  # here, since it is slow to import and a training run draws without it

    own = {"figure.dpi": 100, "savefig.dpi": 160, "pdf.fonttype": 42, "svg.hashsalt": "srlrepro"}
    own |= {"pdf.compression": 0}  # other builds of zlib, which Python takes from the system, pack otherwise
    own |= {"font.sans-serif": [FONT], "font.family": ["sans-serif"]}
    own |= {"legend.frameon": False, "axes.titlesize": 10, "figure.constrained_layout.use": True}
    plt.style.use("default")  # nothing of the user's own
    sns.set_theme(context="paper", style="ticks", rc=own)


def color(name: str) -> str:
    """The colour of a condition; other values of α lie between those of the paper."""
    if name in CONDITIONS:
        return CONDITIONS[name]
    return mpl.colors.to_hex(mpl.colormaps[ALPHA_MAP](0.15 + 0.7 * float(name)))


def marker(name: str) -> str:
    """The marker of a condition, for those who do not see its colour."""
    return MARKERS.get(name, OTHER_MARKER)


def delta_colors(count: int) -> list[str]:
    """As many colours for rising values of Δ."""
    return [mpl.colors.to_hex(mpl.colormaps[DELTA_MAP](place)) for place in np.linspace(0.1, 0.8, count)]


def label(name: str) -> str:
    """The legend's text of a condition."""
    return "no supervisor" if name == NONE else rf"$\alpha = {name}$"


def count_of(number: int, word: str) -> str:
    """A number and its noun: "1 seed", "3 seeds"."""
    return f"{number} {word}{'' if number == 1 else 's'}"


def panels(
    count: int, height: float = 2.9, width: float = 3.1, letters: str = "abc", sharey: bool = False
) -> tuple[Figure, list[Axes]]:
    """A row of panels, lettered on from the first of ``letters``, if there are any: figure and axes.

    sharey: all have the same vertical range, which the first one names.
    """
    figure, axes = plt.subplots(1, count, figsize=(width * count, height), squeeze=False, sharey=sharey)
    for i, ax in enumerate(axes[0] if letters else []):
        ax.set_title(f"({chr(ord(letters[0]) + i)})", loc="left", fontweight="bold")
    return figure, list(axes[0])


def fit_note(note: str, figure: Figure) -> str:
    """The note in lines that are no wider than the figure."""
    return textwrap.fill(note, round(NOTE_WIDTH * figure.get_figwidth()))


def save_figure(figure: Figure, folder: str | Path, name: str, table: pd.DataFrame, note: str = "") -> None:
    """Write ``name``.pdf and ``name``.png, which say what made them, and ``name``.csv.

    Args:
        table: what the figure draws.
        note: stands on the figure and says how it differs from the full experiment; empty if it does not.

    Raises:
        ResultError: a file cannot be written.
    """
    if note:
        figure.suptitle(fit_note(note, figure), color=STAMP, fontsize=9, fontweight="bold")
    made = provenance.made_by()
    pdf = {"CreationDate": None, "Producer": None, provenance.PDF_KEY: made}
    for suffix, metadata in (("pdf", pdf), ("png", {"Software": None, provenance.PNG_KEY: made})):
        with beside(Path(folder) / f"{name}.{suffix}") as temporary:
            figure.savefig(temporary, metadata=metadata)
    write_table(Path(folder) / f"{name}.csv", table, digits=6)
