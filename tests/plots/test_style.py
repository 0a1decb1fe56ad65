"""Figures: one colour for one meaning, each figure with its table and its note, same bytes for same data."""

import ast
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
import pytest
from matplotlib import colormaps, colors, font_manager
from PIL import Image

from replication.plots import style
from replication.plots.paper import plot_learning
from replication.plots.style import CONDITIONS, color, delta_colors, panels, save_figure
from srlrepro.dynamics.pendulum import Floats

ROOT = Path(__file__).parents[2]
HOLDERS = ("replication/plots/style.py", "srlrepro/dynamics/rendering.py")
HEX = re.compile(r"#[0-9A-Fa-f]{3}(?:[0-9A-Fa-f]{3})?\b")
NAMED = re.compile("|".join([*map(re.escape, colors.CSS4_COLORS), "C[0-9]", "tab:[a-z]+", "xkcd:.*"]))
COLOUR_ARGUMENTS = re.compile(r"c|mec|mfc|.*colou?rs?")
NOTE = "reduced: 3000 of 1500000 training steps; varied: p_t = 0.5"
CURVES = pd.DataFrame(
    {
        "alpha": ["0", "0", "none", "none"] * 2,
        "seed": [0] * 4 + [1] * 4,
        "step": [1, 2] * 4,
        "mean_return": [1.0, 2.0, 3.0, 4.0, 3.0, 4.0, 5.0, 6.0],
    }
)
# Machado, Oliveira and Fernandes (2009), Table 1, for the whole deficiency; on linear RGB.
SIGHTS = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
}
TOGETHER = {
    "conditions": [*CONDITIONS.values(), style.KNOWS_SYSTEM],
    "other conditions": [*CONDITIONS.values(), color("0.25"), color("0.75")],
    "labels": [style.SAFE, style.UNSAFE, style.GUIDE, style.BACKGROUND],
    "trials": [style.LINK, style.CORRECTIVE, style.TARGET, style.TRACE, style.BACKGROUND],
    "states": [style.SUPPORTS, style.CONTRADICTS, style.UNRESOLVED, style.BACKGROUND],
    "levels": list(style.LEVELS),
    "universes": [style.INK, style.PAPERS_NUMBER, style.DEFAULT_UNIVERSE, style.BACKGROUND],
}


def constants() -> Iterator[tuple[str, str]]:
    """(name, colour) of every colour of the style, those of the pendulum among them."""
    for name, value in vars(style).items():
        entries = (
            value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else [value]
        )
        yield from ((name, e.upper()) for e in entries if isinstance(e, str) and HEX.fullmatch(e))


def cielab(tint: str, sight: str) -> Floats:
    """Lightness and opponent colours of a colour, as somebody with that sight sees it."""
    rgb = np.array(colors.to_rgb(tint))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    to_xyz = [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
    xyz = np.array(to_xyz) @ np.clip(SIGHTS[sight] @ linear, 0, 1) / [0.95047, 1.0, 1.08883]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def sources() -> Iterator[tuple[str, str]]:
    """(name, Python source) of every module of the three houses and every source notebook."""
    for house in ("srlrepro", "replication", "workflow"):
        for path in sorted((ROOT / house).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), path.read_text("utf-8")
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        cells = json.loads(path.read_text("utf-8"))["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        yield path.relative_to(ROOT).as_posix(), "\n".join(code)


SOURCES = dict(sources())
DRAWING = [
    name for name, source in SOURCES.items() if name.endswith(".ipynb") and "replication.plots" in source
]


def literal_colours(source: str) -> list[str]:
    """The colours that a source states: hex codes, names, and any text that is given as a colour."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            found += HEX.findall(node.value) + ([node.value] if NAMED.fullmatch(node.value) else [])
        if isinstance(node, ast.keyword) and COLOUR_ARGUMENTS.fullmatch(node.arg or ""):
            values = [n.value for n in ast.walk(node.value) if isinstance(n, ast.Constant)]
            found += [v for v in values if isinstance(v, str) and v != "none" and colors.is_color_like(v)]
    return found


def test_the_search_for_colours_finds_them() -> None:
    source = 'ax.plot(x, color="k", mfc="0.5", c="none")\ntint = "#ABCDEF" if y else "red"\nalpha = "0.5"'
    assert sorted(literal_colours(source)) == ["#ABCDEF", "0.5", "k", "red"]
    assert all(literal_colours(SOURCES[name]) for name in HOLDERS)


def test_colours_stand_in_the_style_alone() -> None:
    assert len(SOURCES) > 60
    found = {name: literal_colours(source) for name, source in SOURCES.items() if name not in HOLDERS}
    assert {name: tints for name, tints in found.items() if tints} == {}


def test_no_colour_has_two_meanings() -> None:
    values = [value for _, value in constants()]
    assert len(values) >= 25
    assert sorted({v for v in values if values.count(v) > 1}) == []
    maps = (style.GAMMA_MAP, style.ALPHA_MAP, style.DELTA_MAP)
    assert len(set(maps)) == 3 and not {*delta_colors(4), color("0.25")} & {v.lower() for v in values}


@pytest.mark.parametrize("sight", SIGHTS)
@pytest.mark.parametrize("group", TOGETHER)
def test_colours_of_one_figure_can_be_told_apart(group: str, sight: str) -> None:
    """The smallest distance is that of two colours of Okabe and Ito."""
    seen = [cielab(tint, sight) for tint in TOGETHER[group]]
    assert min(float(np.linalg.norm(a - b)) for a, b in combinations(seen, 2)) > 17


@pytest.mark.parametrize("sight", SIGHTS)
def test_the_border_is_seen_on_every_value_of_gamma(sight: str) -> None:
    border, shades = cielab(style.BORDER, sight), colormaps[style.GAMMA_MAP](np.linspace(0, 1, 21))
    assert min(np.linalg.norm(cielab(colors.to_hex(s), sight) - border) for s in shades) > 30


def test_a_figure_is_vector_raster_and_table_and_deterministic(tmp_path: Path) -> None:
    files = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        figure, axes = panels(1)
        plot_learning(axes[0], CURVES, "mean_return", 8.0)
        save_figure(figure, folder, "fig", CURVES, NOTE)
        files.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert sorted(files[0]) == ["fig.csv", "fig.pdf", "fig.png"]
    assert files[0] == files[1]


DRAW = """
import sys
import numpy as np
import pandas as pd
from replication.plots.style import panels, save_figure, use_style
use_style()
figure, axes = panels(2)
axes[0].imshow(np.arange(16.0).reshape(4, 4))
axes[1].plot([1, 2.5], [1, 1e4], label=r"$\\theta_1$ Γ −")
axes[1].legend()
save_figure(figure, sys.argv[1], "fig", pd.DataFrame({"a": [0.1 + 0.2]}), "note")
figure.savefig(f"{sys.argv[1]}/fig.svg", metadata={"Date": None})
"""


@pytest.mark.slow
def test_another_folder_user_time_and_locale_give_the_same_bytes(tmp_path: Path) -> None:
    """PDF, PNG, SVG and CSV, drawn by two processes under all that a machine may have otherwise."""
    (tmp_path / "matplotlibrc").write_text("lines.linewidth: 9\nsavefig.facecolor: red\nfont.size: 20\n")
    usual = {"TZ": "UTC", "LC_ALL": "C.UTF-8", "PYTHONHASHSEED": "1", "HOME": str(tmp_path)}
    other = {"TZ": "Asia/Tokyo", "LC_ALL": "C", "PYTHONHASHSEED": "2", "HOME": "/nowhere"}
    other |= {"MATPLOTLIBRC": str(tmp_path), "SOURCE_DATE_EPOCH": "1"}
    files = []
    for name, variables in (("a", usual), ("another_folder", other)):
        environment = os.environ | {"MPLCONFIGDIR": str(tmp_path / "fonts")} | variables
        command = [sys.executable, "-c", DRAW, str(tmp_path / name)]
        subprocess.run(command, env=environment, cwd=ROOT, check=True)
        files.append({path.name: path.read_bytes() for path in (tmp_path / name).iterdir()})
    assert sorted(files[0]) == ["fig.csv", "fig.pdf", "fig.png", "fig.svg"]
    assert [name for name in files[0] if files[0][name] != files[1][name]] == []
    assert re.search(rb"/CreationDate|/Producer|/FlateDecode", files[0]["fig.pdf"]) is None
    assert b"DejaVuSans" in files[0]["fig.pdf"]


def test_the_font_is_the_one_that_matplotlib_brings() -> None:
    found = font_manager.findfont(style.FONT, fallback_to_default=False)
    assert Path(found).resolve().is_relative_to(Path(matplotlib.get_data_path()).resolve())


def test_a_note_is_on_the_figure_and_an_empty_one_changes_nothing(tmp_path: Path) -> None:
    pictures = {}
    for name, note in (("plain", None), ("empty", ""), ("varied", NOTE)):
        figure, _ = panels(1)
        save_figure(figure, tmp_path, name, CURVES, **({} if note is None else {"note": note}))
        with Image.open(tmp_path / f"{name}.png") as picture:
            pictures[name] = picture.convert("RGB")
    assert pictures["plain"] == pictures["empty"]
    stamp = np.array(colors.to_rgb(style.STAMP)) * 255
    stamped = {n: bool((np.array(p) == stamp).all(axis=-1).any()) for n, p in pictures.items()}
    assert stamped == {"plain": False, "empty": False, "varied": True}


def test_a_long_note_fits_on_the_narrowest_figure(tmp_path: Path) -> None:
    style.use_style()
    figure, _ = panels(1)
    save_figure(figure, tmp_path, "long", CURVES, NOTE + ", gamma_evidence = embedded, known_origin = false")
    figure.canvas.draw()
    (words,) = [text for text in figure.texts if "reduced" in text.get_text()]
    extent = words.get_window_extent()
    assert figure.bbox.x0 <= extent.x0 and extent.x1 <= figure.bbox.x1 and extent.y1 <= figure.bbox.y1


@pytest.mark.parametrize("name", DRAWING)
def test_every_figure_of_a_notebook_gets_the_note(name: str) -> None:
    tree = ast.parse(SOURCES[name])
    calls = [
        node for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    ]
    drawn = [c for c in calls if c.func.id in ("save_figure", "animate", "animate_trials")]  # type: ignore[attr-defined]
    for call in drawn:
        given = [*call.args, *(k.value for k in call.keywords if k.arg == "note")]
        assert any(isinstance(a, ast.Name) and a.id == "NOTE" for a in given), ast.unparse(call)
    assigned = [ast.unparse(n.targets[0]) for n in tree.body if isinstance(n, ast.Assign)]
    assert "NOTE" in assigned or not drawn


def test_more_panels_than_letters_are_lettered_on() -> None:
    _, axes = panels(5, letters="def")
    assert [ax.get_title(loc="left") for ax in axes] == ["(d)", "(e)", "(f)", "(g)", "(h)"]
    assert panels(2, letters="")[1][1].get_title(loc="left") == ""


def test_conditions_differ_in_their_markers_and_other_alphas_have_one_of_their_own() -> None:
    known = [style.marker(name) for name in CONDITIONS]
    assert len(set(known)) == len(known) and style.marker("0.25") == style.marker("0.75")
    assert style.marker("0.25") not in known and len(set(style.LAWS.values())) == len(style.LAWS)


def test_panels_share_their_vertical_range_if_they_shall() -> None:
    for shared in (False, True):
        _, axes = panels(2, sharey=shared)
        axes[0].set_ylim(0, 7)
        assert (axes[1].get_ylim() == (0, 7)) == shared


def test_a_number_agrees_with_its_noun() -> None:
    assert [style.count_of(n, "seed") for n in (1, 3)] == ["1 seed", "3 seeds"]
