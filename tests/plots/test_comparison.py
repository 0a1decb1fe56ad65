"""Two variations side by side: the joined picture, and the table of their measures."""

from pathlib import Path

import pandas as pd
import pytest
from PIL import Image

from replication import documents
from replication.__main__ import main
from replication.plots.comparison import HEAD, compare_measures, join_pictures
from replication.plots.provenance import BY_HAND, read_made_by
from replication.plots.style import panels, save_figure

ROWS = [
    ("success_rate", "0", 1.1, 0, 0.5),
    ("success_rate", "0", 1.1, 1, 0.7),
    ("spectral_radius", "", 1.1, "", 0.9),
]


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Two folders with a figure, of different sizes, and measures; the second lacks one and has one more."""
    for name, height, added in (("full", 2.0, 0.0), ("p_t_0.5", 3.0, 0.25)):
        figure, _ = panels(1, height=height)
        save_figure(figure, tmp_path / name, "fig", pd.DataFrame({"x": [1.0]}))
        table = pd.DataFrame(ROWS, columns=["measure", "alpha", "delta", "seed", "value"])
        table["value"] += added
        table.iloc[: 2 if added else 3].to_csv(tmp_path / name / "measures.csv", index=False)
    return tmp_path / "full", tmp_path / "p_t_0.5"


def test_measures_stand_beside_each_other_with_their_difference(folders: tuple[Path, Path]) -> None:
    table = compare_measures(*folders)
    assert list(table.columns) == ["measure", "delta", "alpha", "full", "p_t_0.5", "difference"]
    assert table.iloc[0, 3:].tolist() == pytest.approx([0.6, 0.85, 0.25])
    assert table.iloc[1, 0] == "spectral_radius" and table.iloc[1, 4:].isna().all()


def test_a_picture_holds_both_under_their_names(folders: tuple[Path, Path], tmp_path: Path) -> None:
    join_pictures(*folders, "fig", tmp_path / "both.png")
    parts = [Image.open(folder / "fig.png").convert("RGB") for folder in folders]
    with Image.open(tmp_path / "both.png") as both:
        assert both.size == (parts[0].width + parts[1].width, HEAD + parts[1].height)
        for left, part in zip((0, parts[0].width), parts, strict=True):
            box = (left, HEAD, left + part.width, HEAD + part.height)
            assert both.crop(box).tobytes() == part.tobytes()
            assert len(both.crop((left, 0, left + part.width, HEAD)).getcolors()) > 1
    made = read_made_by(tmp_path / "both.png")
    assert made["full"] == BY_HAND and "beside full p_t_0.5 --figure fig" in made["command"]


@pytest.mark.parametrize(
    ("names", "figure", "out", "status", "reason"),
    [
        (("full", "p_t_0.6"), "fig", "both.png", 2, "NAME = p_t_0.6: must be one of full, p_t_0.5"),
        (("full", "../full"), "fig", "both.png", 2, "NAME = ../full"),
        (("full", "full"), "fig", "both.png", 2, "another than the first"),
        (("full", "p_t_0.5"), "fig", "both.jpg", 2, "--out"),
        (("full", "p_t_0.5"), "other", "both.png", 1, "other.png"),
    ],
)
def test_what_cannot_be_laid_side_by_side_is_refused(
    folders: tuple[Path, Path],
    names: tuple[str, str],
    figure: str,
    out: str,
    status: int,
    reason: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(documents, "FIGURES", tmp_path)
    given = ["beside", *names, "--figure", figure, "--out", str(tmp_path / out)]
    try:
        left = main(given)
    except SystemExit as stop:
        left = int(stop.code or 0)
    printed = capsys.readouterr()
    assert left == status and reason in printed.err and printed.err.count("\n") == 1 and not printed.out
    assert not (tmp_path / out).exists()


def test_the_command_writes_the_picture_and_prints_the_table(
    folders: tuple[Path, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(documents, "FIGURES", tmp_path)
    assert main(["beside", "full", "p_t_0.5", "--figure", "fig", "--out", str(tmp_path / "both.png")]) == 0
    row = capsys.readouterr().out.splitlines()[1].split()
    assert row == ["success_rate", "1.1", "0", "0.6", "0.85", "0.25"]
    assert (tmp_path / "both.png").exists()


def test_figures_of_a_variation_that_is_not_measured_stand_side_by_side_all_the_same(
    folders: tuple[Path, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("replication.documents.FIGURES", tmp_path)
    (folders[1] / "measures.csv").unlink()
    assert main(["beside", "full", "p_t_0.5", "--figure", "fig", "--out", str(tmp_path / "both.png")]) == 0
    assert capsys.readouterr().out.startswith("p_t_0.5: not measured") and (tmp_path / "both.png").exists()
