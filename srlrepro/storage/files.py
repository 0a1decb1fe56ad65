"""Results on disk: written beside and renamed, read with checks, never a pickle.

A file is either whole or absent, after a loss of power too: writers fill a temporary file in the same folder,
force it to the disk, rename it, and force the folder.
Readers take nothing on trust, as a file may come from elsewhere: they run none of its content, read no more
than `LARGEST` bytes of it, and raise `ResultError`, one line that names the file and what is wrong with it.
"""

import errno
import hashlib
import json
import math
import os
import secrets
import stat
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from srlrepro.settings.fields import LONGEST_MESSAGE, one_line

UNFINISHED = "-unfinished-"  # in the names of temporary files
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
LARGEST = 256 * 2**20  # bytes of one file, and of what it unpacks to: 250 times the largest of a full run
NUMBERS = "?bhilqBHILQfd"  # kinds of numbers (dtype.char) that the compiled code takes


class ResultError(RuntimeError):
    """A result is missing, truncated, foreign or cannot be written; the message is one line."""

    def __init__(self, message: object) -> None:
        super().__init__(one_line(message, LONGEST_MESSAGE))


def _flush(path: Path) -> None:
    """Force a file, or the names in a folder, to the disk."""
    opened = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened)
    except OSError as error:
        if error.errno != errno.EINVAL or not path.is_dir():  # some file systems cannot force a folder
            raise
    finally:
        os.close(opened)


def _make(folder: Path) -> None:
    """Make a folder, and those above it."""
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for each in made:
        _flush(each.parent)


def require_replaceable(path: Path) -> None:
    """Raise `ResultError` if there is something that is no regular file, such as a link or a device."""
    if path.is_dir() and not path.is_symlink():
        raise ResultError(f"cannot write {path}: it is a folder")
    if os.path.lexists(path) and not stat.S_ISREG(path.lstat().st_mode):
        raise ResultError(f"cannot write {path}: it is no regular file")


@contextmanager
def beside(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of ``path``; on success rename it to ``path``, and force both.

    Raises:
        ResultError: the folder cannot be made or written, the disk is full, or the path is that of a folder,
            a link, a device or anything else but a regular file.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}{UNFINISHED}{secrets.token_hex(4)}{path.suffix}")
    try:
        require_replaceable(path)
        _make(path.parent)
        temporary.touch(exist_ok=False)
    except OSError as error:
        raise ResultError(f"cannot write to {path.parent}: {error.strerror}") from error
    try:
        yield temporary
        _flush(temporary)
        temporary.replace(path)
        _flush(path.parent)
    except OSError as error:
        if error.errno not in FULL:
            raise
        raise ResultError(f"cannot write {path}: {error.strerror}") from error
    finally:
        temporary.unlink(missing_ok=True)


def remove(path: Path) -> None:
    """Remove a file, if there is one, before anything that is written later."""
    if path.exists():
        path.unlink()
        _flush(path.parent)


def remove_unfinished(folder: Path) -> None:
    """Remove the temporary files that killed writers have left anywhere below a folder."""
    for path in folder.rglob(f".*{UNFINISHED}*"):
        path.unlink()


def sha256(path: Path) -> str:
    """SHA-256 of the content of a file that exists."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def require_writable(folder: Path) -> None:
    """Make the folder; raise `ResultError` if no file can be written there."""
    folder = Path(folder)
    probe = folder / f".probe{UNFINISHED}{secrets.token_hex(4)}"
    try:
        _make(folder)
        probe.touch(exist_ok=False)
        probe.unlink()
    except OSError as error:
        raise ResultError(f"cannot write to {folder}: {error.strerror}") from error


def existing(path: Path, more: int = 0) -> Path:
    """``path``, if there is such a file, of at most `LARGEST` + ``more`` bytes; else raise `ResultError`."""
    path = Path(path)
    try:
        if not path.is_file():
            raise ResultError(f"missing result {path}: run the stage that makes it first")
        size = path.stat().st_size
    except OSError as error:
        raise ResultError(f"cannot read {path}: {error.strerror}") from error
    if size > LARGEST + more:
        raise ResultError(f"{path} has {size} bytes, more than {LARGEST + more}")
    return path


def check_unpacked(archive: zipfile.ZipFile, path: Path, more: int = 0) -> None:
    """Raise `ResultError` if a part stands twice, or all state more than `LARGEST` and ``more`` bytes.

    zipfile reads no more than is stated.
    """
    parts = archive.infolist()
    if len({part.filename for part in parts}) < len(parts):
        raise ResultError(f"{path} has a part twice")
    unpacked = sum(part.file_size for part in parts)
    if unpacked > LARGEST + more:
        raise ResultError(f"{path} unpacks to {unpacked} bytes, more than {LARGEST + more}")


def bounded_archive(path: Path, kind: str = "zip archive", more: int = 0) -> Path:
    """``path``, if it is an archive of at most `LARGEST` + ``more`` bytes, unpacked; else `ResultError`."""
    try:
        with zipfile.ZipFile(existing(path, more)) as archive:
            check_unpacked(archive, path, more)
    except ResultError:
        raise
    except Exception as error:  # zipfile raises more than it documents
        raise ResultError(f"{path} is truncated or not a {kind}") from error
    return Path(path)


def write_arrays(path: Path, kind: str, **arrays: Any) -> None:
    """Write named arrays as compressed npz, with ``kind`` naming the format."""
    with beside(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, format=np.array(kind), **arrays)


def read_arrays(
    path: Path, kind: str, names: Sequence[str] | Mapping[str, str], more: int = 0
) -> dict[str, Any]:
    """Read the named arrays of an npz file of the given kind; pickled content is refused.

    Args:
        names: of the arrays; or with what each must hold: "U", text, or a kind of numbers such as "f8".
        more: bytes beyond `LARGEST` that the caller has reason to expect.

    Raises:
        ResultError: the file is missing, too large, truncated, not of this kind, or an array holds neither
            numbers that the compiled code takes nor text, or another kind than it must hold.
    """
    try:
        with np.load(bounded_archive(path, f"{kind} file", more), allow_pickle=False) as archive:
            if "format" not in archive or str(archive["format"]) != kind:
                raise ResultError(f"{path} is not a {kind} file")
            arrays = {name: archive[name] for name in names}
        if not all(
            isinstance(array, np.ndarray) for array in arrays.values()
        ):  # numpy hands out other parts raw
            raise ValueError("a part that is no array")
    except ResultError:
        raise
    except Exception as error:  # zipfile, its decompressors and numpy raise a dozen kinds
        raise ResultError(f"{path} is truncated or not a {kind} file") from error
    for name, array in arrays.items():
        dtype = array.dtype
        if not dtype.isnative or (dtype.char not in NUMBERS and dtype.kind != "U"):
            raise ResultError(f"{path}: {name} holds {one_line(dtype)}, not plain numbers or text")
        if isinstance(names, Mapping) and names[name] not in (dtype.str[1:], "U" * (dtype.kind == "U")):
            raise ResultError(f"{path}: {name} holds {one_line(dtype)}, not {names[name]}")
    return arrays


def write_json(path: Path, value: Any) -> None:
    """Write a value as indented JSON."""
    with beside(path) as temporary:
        temporary.write_text(json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n", "utf-8")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) < len(pairs):
        raise ValueError("a name stands twice in a table")
    return values


def _no_number(text: str) -> None:
    raise ValueError(f"{text} is no number of JSON")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is too large a number")
    return value


def parse_json(text: str) -> Any:
    """The value of a JSON text; `ValueError`: it is none, too deep, or has NaN, infinity or a name twice."""
    try:
        return json.loads(text, object_pairs_hook=_once, parse_constant=_no_number, parse_float=_finite)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def read_json(path: Path) -> Any:
    """Read a JSON file; raise `ResultError` if it is missing, too large or not JSON (`parse_json`)."""
    try:
        return parse_json(existing(path).read_text(encoding="utf-8"))
    except ValueError as error:
        raise ResultError(f"{path} is truncated or not JSON: {one_line(error)}") from error


def write_table(path: Path, table: pd.DataFrame, digits: int | None = None) -> None:
    """Write a table as CSV; ``digits``: significant digits of floating-point columns."""
    with beside(path) as temporary:
        table.to_csv(temporary, index=False, float_format=None if digits is None else f"%.{digits}g")


def read_table(
    path: Path, columns: tuple[str, ...], numbers: tuple[str, ...] = (), text: tuple[str, ...] = ()
) -> pd.DataFrame:
    """Read a CSV table that has at least ``columns``; those in ``text`` are kept as they are written.

    Raises:
        ResultError: the file is missing, too large, empty, lacks a column, or has words or infinity in
            ``numbers``.
    """
    try:
        table = pd.read_csv(existing(path), dtype=dict.fromkeys(text, str))
    except (ValueError, OverflowError) as error:  # pandas' own errors and those of the encoding are of these
        raise ResultError(f"{path} is truncated or not a table") from error
    lacking = [name for name in columns if name not in table]
    if lacking:
        raise ResultError(f"{path} lacks the columns {', '.join(lacking)}")
    words = [name for name in numbers if len(table) and table[name].dtype.kind not in "biuf"]
    if words:
        raise ResultError(f"{path} holds no numbers in the columns {', '.join(words)}")
    infinite = [name for name in numbers if len(table) and np.isinf(table[name].astype(float)).any()]
    if infinite:
        raise ResultError(f"{path} holds infinite numbers in the columns {', '.join(infinite)}")
    return table
