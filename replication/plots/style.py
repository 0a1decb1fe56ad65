"""The paper's figures: one look, one colour per condition, and beside each figure the table it draws."""

from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from srlrepro.storage.files import beside, write_table

COLORS = {"0": "#0072B2", "0.5": "#009E73", "1": "#D55E00", "none": "#4D4D4D"}  # Okabe and Ito
MARKERS = {"0": "o", "0.5": "s", "1": "^", "none": "D"}
SAFE, UNSAFE = "#56B4E9", "#AA4499"


def use_style() -> None:
    """Set matplotlib's defaults for every figure of the replication."""
    import seaborn as sns  # here, since it is slow to import and a training run draws without it

    sns.set_theme(context="paper", style="ticks", font_scale=1.0)
    mpl.rcParams.update(
        {
            "figure.dpi": 100,
            "savefig.dpi": 160,
            "pdf.fonttype": 42,
            "svg.hashsalt": "srlrepro",
            "legend.frameon": False,
            "axes.titlesize": 10,
            "figure.constrained_layout.use": True,
        }
    )


def color(name: str) -> str:
    """The colour of a condition; other values of α lie between those of the paper."""
    if name in COLORS:
        return COLORS[name]
    return mpl.colors.to_hex(mpl.colormaps["viridis"](0.15 + 0.7 * float(name)))


def label(name: str) -> str:
    """The legend's text of a condition."""
    return "no supervisor" if name == "none" else rf"$\alpha = {name}$"


def save_figure(figure: Figure, folder: str | Path, name: str, table: pd.DataFrame) -> None:
    """Write ``name``.pdf, ``name``.png and ``name``.csv, the table that the figure draws."""
    for suffix, metadata in (
        (".pdf", {"CreationDate": None, "Producer": None}),
        (".png", {"Software": None}),
    ):
        with beside(Path(folder) / f"{name}{suffix}") as temporary:
            figure.savefig(temporary, metadata=metadata)
    write_table(Path(folder) / f"{name}.csv", table, digits=6)


def panels(
    count: int, height: float = 2.9, width: float = 3.1, letters: str = "abc"
) -> tuple[Figure, list[Axes]]:
    """A row of panels, lettered as in the paper."""
    figure, axes = plt.subplots(1, count, figsize=(width * count, height), squeeze=False)
    row = list(axes[0])
    for ax, letter in zip(row, letters, strict=False):
        ax.set_title(f"({letter})", loc="left", fontweight="bold")
    return figure, row


def mark_reduced(figure: Figure, note: str) -> None:
    """Say on the figure that it does not show the full experiment; an empty note says nothing."""
    if note:
        figure.suptitle(note, color="#B00000", fontsize=9, fontweight="bold")
