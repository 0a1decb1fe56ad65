"""What made a figure, in the figure: read back from every format, and refused where it is not."""

import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from PIL import Image

from replication.__main__ import main
from replication.plots.pendulum import animate
from replication.plots.provenance import BY_HAND, read_made_by
from replication.plots.style import panels, save_figure
from srlrepro.settings.config import Config
from srlrepro.storage.provenance import MADE_BY

RECORD = {
    "notebook": "06_learning_performance.ipynb",
    "parameters": {
        "RUNS": ["alpha_0__delta_1.1__seed_0"] * 40,
        "NOTE": r"a (b) \c «Δ»",
        "SETTINGS": {"p_t": 0.5},
    },
    "arithmetic": 1,
    "command": "./reproduce.sh --set 'p_t=0.5'",
}
FORMATS = pytest.mark.parametrize("suffix", [".png", ".pdf", ".gif"])


def drawn(folder: Path) -> None:
    """A figure and an animation, each named ``fig``."""
    figure, _ = panels(1)
    save_figure(figure, folder, "fig", pd.DataFrame({"x": [1.0]}))
    plt.close(figure)
    animate(folder / "fig.gif", [("still", np.zeros((2, 4, 2)), "black")], Config().paper, 0.05)


@FORMATS
def test_a_figure_tells_what_made_it(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(MADE_BY, json.dumps(RECORD, ensure_ascii=False))
    for folder in (tmp_path / "a", tmp_path / "b"):
        drawn(folder)
    assert read_made_by(tmp_path / "a" / f"fig{suffix}") == RECORD
    files = [(tmp_path / folder / f"fig{suffix}").read_bytes() for folder in "ab"]
    assert files[0] == files[1]


@FORMATS
def test_a_figure_of_a_notebook_run_by_hand_says_so(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(MADE_BY, raising=False)
    drawn(tmp_path)
    assert read_made_by(tmp_path / f"fig{suffix}") == BY_HAND


def test_the_command_prints_the_record_in_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(MADE_BY, json.dumps(RECORD))
    drawn(tmp_path)
    assert main(["provenance", str(tmp_path / "fig.png")]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[:2] == ["notebook: 06_learning_performance.ipynb", "parameters:"]
    assert r"  NOTE = a (b) \c «Δ»" in printed and '  SETTINGS = {"p_t": 0.5}' in printed
    assert printed[-2:] == ["arithmetic: 1", "command: ./reproduce.sh --set 'p_t=0.5'"]


@pytest.mark.parametrize(
    "kind", ["png", "gif", "pdf", "text.png", "list.png", "csv", "missing.png", "cut.png"]
)
def test_another_file_is_refused_in_one_line(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, picture = tmp_path / f"fig.{kind}", Image.new("RGB", (4, 4))
    if kind in ("png", "gif"):
        picture.save(path)
    elif kind == "list.png":
        picture.save(tmp_path / "fig.gif", comment=b"[1, 2]")
        path = tmp_path / "fig.gif"
    elif kind != "missing.png":
        path.write_bytes(b"\x89PNG\r\n\x1a\n" if kind == "cut.png" else b"nothing /Subject (not JSON) here")
    assert main(["provenance", str(path)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and path.name in error
