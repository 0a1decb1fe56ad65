"""Results on disk: written beside and renamed, read with checks, never a pickle.

A file is either whole or absent: writers fill a temporary file in the same folder and rename it.
Readers raise `ResultError`, one line that names the file and what is wrong with it.
"""

import json
import os
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd


class ResultError(RuntimeError):
    """A result is missing, truncated, foreign or cannot be written; the message is one line."""


@contextmanager
def beside(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of ``path``; on success rename it to ``path``.

    Raises:
        ResultError: the folder cannot be made or written, or the path is a folder.
    """
    path = Path(path)
    if path.is_dir():
        raise ResultError(f"cannot write {path}: it is a folder")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise ResultError(f"cannot write to {path.parent}: {error.strerror}") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def require_writable(folder: Path) -> None:
    """Make the folder, and see that a file can be written there.

    Raises:
        ResultError: it cannot.
    """
    with suppress(_ProbeError), beside(Path(folder) / "probe"):
        raise _ProbeError


class _ProbeError(Exception):
    """Ends `beside` without leaving a file."""


def existing(path: Path) -> Path:
    """``path``, if there is such a file.

    Raises:
        ResultError: there is none.
    """
    if not Path(path).is_file():
        raise ResultError(f"missing result {path}: run the stage that makes it first")
    return Path(path)


def write_arrays(path: Path, kind: str, **arrays: Any) -> None:
    """Write named arrays as compressed npz, with ``kind`` naming the format."""
    with beside(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, format=np.array(kind), **arrays)


def read_arrays(path: Path, kind: str, names: tuple[str, ...]) -> dict[str, Any]:
    """Read the named arrays of an npz file of the given kind; pickled content is refused.

    Raises:
        ResultError: the file is missing, truncated, or not of this kind.
    """
    existing(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            if "format" not in archive or str(archive["format"]) != kind:
                raise ResultError(f"{path} is not a {kind} file")
            return {name: archive[name] for name in names}
    except ResultError:
        raise
    except (zipfile.BadZipFile, zlib.error, ValueError, KeyError, EOFError, OSError) as error:
        raise ResultError(f"{path} is truncated or not a {kind} file") from error
    except (TypeError, RuntimeError) as error:  # a single array; a damaged header of the archive
        raise ResultError(f"{path} is truncated or not a {kind} file") from error


def write_json(path: Path, value: Any) -> None:
    """Write a value as indented JSON."""
    with beside(path) as temporary:
        temporary.write_text(json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises:
        ResultError: the file is missing or not JSON.
    """
    try:
        return json.loads(existing(path).read_text())
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ResultError(f"{path} is truncated or not JSON") from error


def write_table(path: Path, table: pd.DataFrame, digits: int | None = None) -> None:
    """Write a table as CSV; ``digits``: significant digits of floating-point columns."""
    with beside(path) as temporary:
        table.to_csv(temporary, index=False, float_format=None if digits is None else f"%.{digits}g")


def read_table(path: Path, columns: tuple[str, ...], text: tuple[str, ...] = ()) -> pd.DataFrame:
    """Read a CSV table that has at least the given columns; those in ``text`` are kept as they are written.

    Raises:
        ResultError: the file is missing, empty or lacks a column.
    """
    try:
        table = pd.read_csv(existing(path), dtype=dict.fromkeys(text, str))
    except (pd.errors.EmptyDataError, pd.errors.ParserError, UnicodeDecodeError) as error:
        raise ResultError(f"{path} is truncated or not a table") from error
    lacking = [name for name in columns if name not in table]
    if lacking:
        raise ResultError(f"{path} lacks the columns {', '.join(lacking)}")
    return table
