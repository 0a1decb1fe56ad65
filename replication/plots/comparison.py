"""Two variations side by side: a picture of each under its name, and their measures."""

import json
import shlex
from pathlib import Path

import pandas as pd
from matplotlib.font_manager import findfont
from PIL import Image, ImageDraw, ImageFont
from PIL.PngImagePlugin import PngInfo

from replication.evidence.measures import read_measures
from replication.plots.provenance import PNG_KEY, read_made_by
from replication.plots.style import BACKGROUND, INK
from srlrepro.settings.fields import check
from srlrepro.storage.files import ResultError, beside, existing

CELL = ["measure", "delta", "alpha"]
HEAD = 48  # pixels above the pictures, for the names


def join_pictures(first: Path, second: Path, figure: str, out: Path) -> None:
    """Write a PNG of the same figure of two folders, each under the folder's name, and what made the two.

    Raises:
        ParameterError: out is no name of a PNG.
        ResultError: a picture is missing or damaged, or out cannot be written.
    """
    check(out.suffix == ".png", "--out", out, "the name of a picture (.png)")
    pictures = [_opened(folder / f"{figure}.png") for folder in (first, second)]
    size = (sum(p.width for p in pictures), HEAD + max(p.height for p in pictures))
    joined, left = Image.new("RGB", size, BACKGROUND), 0
    words, font = ImageDraw.Draw(joined), ImageFont.truetype(findfont("DejaVu Sans"), HEAD // 2)
    for folder, picture in zip((first, second), pictures, strict=True):
        joined.paste(picture, (left, HEAD))
        words.text((left + picture.width // 2, HEAD // 2), folder.name, INK, font, anchor="mm")
        left += picture.width
    command = ["python", "-m", "replication", "beside", first.name, second.name, "--figure", figure]
    made = {"command": shlex.join(command)} | {f.name: _record(f / f"{figure}.png") for f in (first, second)}
    chunk = PngInfo()
    chunk.add_text(PNG_KEY, json.dumps(made))
    with beside(out) as temporary:
        joined.save(temporary, pnginfo=chunk)


def compare_measures(first: Path, second: Path) -> pd.DataFrame:
    """A row per measure, Δ and α: the mean over seeds in either folder, and the second's less the first's.

    `ResultError`: a ``measures.csv`` is missing or damaged.
    """
    names = [first.name, second.name]
    tables = [read_measures(folder / "measures.csv") for folder in (first, second)]
    means = [table.groupby(CELL, dropna=False, sort=False)["value"].mean() for table in tables]
    joined = pd.concat(means, axis=1, keys=names)
    return joined.assign(difference=joined[names[1]] - joined[names[0]]).reset_index().fillna({"alpha": ""})


def _opened(path: Path) -> Image.Image:
    try:
        with Image.open(existing(path), formats=("PNG",)) as picture:
            return picture.convert("RGB")
    except ResultError:
        raise
    except Exception as error:  # Pillow raises a dozen kinds for what is damaged
        raise ResultError(f"{path} is damaged or no PNG") from error


def _record(path: Path) -> object:
    try:
        return read_made_by(path)
    except ResultError:
        return None
