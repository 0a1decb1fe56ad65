"""What made a figure, as JSON in the figure's own file.

The text chunk "Provenance" of a PNG, the Subject of a PDF and the comment of a GIF hold it: notebook,
parameters, number of the arithmetic, command. Who executes a notebook gives it in the variable `MADE_BY`.
"""

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from PIL import Image

from srlrepro.settings.fields import one_line
from srlrepro.storage.files import ResultError, existing, parse_json
from srlrepro.storage.provenance import MADE_BY

PNG_KEY, PDF_KEY, GIF_KEY = "Provenance", "Subject", "comment"
BY_HAND = {"made by": "a notebook run by hand"}
PDF_TEXT = re.compile(rb"/" + PDF_KEY.encode() + rb" \(((?:[^\\()]|\\.)*)\)", re.DOTALL)
LONGEST_LINE = 2000  # characters of a printed value


def made_by() -> str:
    """The JSON, in ASCII, that a figure of this process must carry."""
    given = os.environ.get(MADE_BY)
    return json.dumps(parse_json(given) if given else BY_HAND)


def read_made_by(figure: Path) -> dict[str, Any]:
    """What made a figure, by the record in it: notebook, parameters, arithmetic and command, or `BY_HAND`.

    `ResultError`: the file is missing, too large, no PNG, PDF or GIF, or holds no such record.
    """
    readers = {".png": _picture, ".gif": _picture, ".pdf": _document}
    kind = figure.suffix.lower()
    if kind not in readers:
        raise ResultError(f"{figure} is no figure: .png, .pdf or .gif")
    try:
        record = parse_json(readers[kind](existing(figure)))
    except ResultError:
        raise
    except Exception as error:  # Pillow raises a dozen kinds for what is damaged
        raise ResultError(f"{figure} is damaged, or holds no record of what made it") from error
    if not isinstance(record, dict):
        raise ResultError(f"{figure} holds no record of what made it")
    return record


def lines(record: dict[str, Any]) -> Iterator[str]:
    """The record for a reader, a value a line."""
    for name, value in record.items():
        if isinstance(value, dict):
            yield f"{one_line(name)}:"
            yield from (f"  {one_line(key)} = {_text(entry)}" for key, entry in value.items())
        else:
            yield f"{one_line(name)}: {_text(value)}"


def _text(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return one_line(text, LONGEST_LINE)


def _picture(path: Path) -> str:
    with Image.open(path, formats=("PNG", "GIF")) as picture:
        text = picture.info[PNG_KEY if picture.format == "PNG" else GIF_KEY]
    return text.decode() if isinstance(text, bytes) else str(text)


def _document(path: Path) -> str:
    """The Subject of a PDF; matplotlib writes it as it is, with escaped backslashes and brackets."""
    (found,) = PDF_TEXT.findall(path.read_bytes())
    return re.sub(rb"\\(.)", rb"\1", found, flags=re.DOTALL).decode()
