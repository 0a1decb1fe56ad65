"""Files: what is written comes back, a write is whole or absent, what is damaged or foreign is refused."""

import json
import os
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from srlrepro.storage.files import (
    ResultError,
    beside,
    existing,
    read_arrays,
    read_json,
    read_table,
    remove,
    remove_unfinished,
    require_writable,
    sha256,
    write_arrays,
    write_json,
    write_table,
)

KIND = "test-arrays-1"
ARRAYS = {"x": np.random.default_rng(0).normal(size=(40, 6)), "n": np.array(7), "name": np.array("θ")}
TABLE = pd.DataFrame({"a": [1, 2], "b": [0.1, 1 / 3], "c": ["x", "y"]})


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    path = tmp_path / "arrays.npz"
    write_arrays(path, KIND, **ARRAYS)
    return path


def read(path: Path) -> dict[str, np.ndarray]:
    return read_arrays(path, KIND, tuple(ARRAYS))


def test_arrays_come_back(archive: Path) -> None:
    back = read(archive)
    assert set(back) == set(ARRAYS)
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(back[name], array)
        assert back[name].dtype == array.dtype


def test_json_and_tables_come_back(tmp_path: Path) -> None:
    value = {"Δ": 1.5, "list": [1, None, "x"], "deep": {"a": True}}
    write_json(tmp_path / "a.json", value)
    assert read_json(tmp_path / "a.json") == value
    write_table(tmp_path / "a.csv", TABLE)
    pd.testing.assert_frame_equal(read_table(tmp_path / "a.csv", ("a", "b", "c")), TABLE)
    write_table(tmp_path / "a.csv", TABLE, digits=3)
    assert list(read_table(tmp_path / "a.csv", ("b",))["b"]) == [0.1, 0.333]


def test_a_folder_is_not_written_over(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="it is a folder"):
        write_json(tmp_path, {})
    assert list(tmp_path.iterdir()) == []


def test_writing_replaces_the_file_and_makes_the_folder(tmp_path: Path) -> None:
    path = tmp_path / "new" / "deep" / "a.json"
    for value in (1, 2):
        write_json(path, value)
        assert read_json(path) == value
    assert list(path.parent.iterdir()) == [path]
    mask = os.umask(0)
    os.umask(mask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~mask


def test_an_interrupted_write_leaves_no_trace(tmp_path: Path) -> None:
    def interrupted(path: Path) -> None:
        with beside(path) as temporary:
            temporary.write_text("half of it")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted(tmp_path / "a.json")
    assert list(tmp_path.iterdir()) == []
    write_json(tmp_path / "a.json", "old")
    with pytest.raises(KeyboardInterrupt):
        interrupted(tmp_path / "a.json")
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]
    assert read_json(tmp_path / "a.json") == "old"


def test_a_value_that_is_no_json_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_json(path, 1)
    for value in (float("nan"), {1, 2}):
        with pytest.raises((ValueError, TypeError)):
            write_json(path, value)
    assert read_json(path) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


@pytest.mark.parametrize("share", [0.0, 0.05, 0.3, 0.7, 0.95, 0.999])
def test_a_truncated_archive_is_refused(archive: Path, share: float) -> None:
    content = archive.read_bytes()
    archive.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ResultError, match=r"arrays\.npz is truncated or not a test-arrays-1 file"):
        read(archive)


def test_a_damaged_archive_is_refused_or_reads_as_it_was(archive: Path) -> None:
    content = archive.read_bytes()
    refused = 0
    for position in range(len(content)):
        damaged = bytearray(content)
        damaged[position] ^= 0xFF
        archive.write_bytes(damaged)
        try:
            back = read(archive)
        except ResultError:
            refused += 1
        else:
            for name, array in ARRAYS.items():
                np.testing.assert_array_equal(back[name], array)
    assert refused > len(content) / 2


def plain_npz(path: Path) -> None:
    with path.open("wb") as file:
        np.savez(file, **ARRAYS)


def other_kind(path: Path) -> None:
    write_arrays(path, "test-arrays-2", **ARRAYS)


def lacks_an_array(path: Path) -> None:
    write_arrays(path, KIND, x=ARRAYS["x"])


def single_array(path: Path) -> None:
    with path.open("wb") as file:
        np.save(file, ARRAYS["x"])


def pickled(path: Path) -> None:
    path.write_bytes(pickle.dumps(ARRAYS))


def pickled_inside(path: Path) -> None:
    with path.open("wb") as file:
        np.savez(file, format=np.array(KIND), **{**ARRAYS, "x": np.array([{}], dtype=object)})


def text(path: Path) -> None:
    path.write_text("no archive")


FOREIGN = (plain_npz, other_kind, lacks_an_array, single_array, pickled, pickled_inside, text)


@pytest.mark.parametrize("write", FOREIGN, ids=lambda f: f.__name__)
def test_a_foreign_file_is_refused_in_one_line(tmp_path: Path, write: Callable[[Path], None]) -> None:
    path = tmp_path / "foreign.npz"
    write(path)
    with pytest.raises(ResultError, match=r"foreign\.npz is .*not a test-arrays-1 file") as caught:
        read(path)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "absent.x"
    for call in (existing, read, read_json, lambda p: read_table(p, ())):
        with pytest.raises(ResultError, match=r"missing result .*absent\.x"):
            call(path)
        with pytest.raises(ResultError, match="missing result"):
            call(tmp_path)  # a folder is no result


def test_broken_json_and_tables_are_refused(tmp_path: Path) -> None:
    for content in (b"", b'{"a": 1', b"\xff\xfe\x00", json.dumps([1, 2]).encode()[:-1]):
        (tmp_path / "a.json").write_bytes(content)
        with pytest.raises(ResultError, match=r"a\.json is truncated or not JSON"):
            read_json(tmp_path / "a.json")
    for content in (b"", b"\xff\xfe\x00\x9f", b'a,b\n1,2\n3,4,5,6\n"x'):
        (tmp_path / "a.csv").write_bytes(content)
        with pytest.raises(ResultError, match=r"a\.csv is truncated or not a table"):
            read_table(tmp_path / "a.csv", ("a",))


def test_lacking_columns_are_named(tmp_path: Path) -> None:
    write_table(tmp_path / "a.csv", TABLE)
    with pytest.raises(ResultError, match=r"a\.csv lacks the columns d, e"):
        read_table(tmp_path / "a.csv", ("a", "d", "e"))


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    """A path below a regular file, which no right can make a folder."""
    (tmp_path / "file").write_text("")
    folder = tmp_path / "file" / "folder"
    calls: list[Callable[[], None]] = [
        lambda: require_writable(folder),
        lambda: write_json(folder / "a.json", 1),
        lambda: write_table(folder / "a.csv", TABLE),
        lambda: write_arrays(folder / "a.npz", KIND, **ARRAYS),
    ]
    for call in calls:
        with pytest.raises(ResultError, match=f"cannot write to {folder}"):
            call()


def test_a_writable_folder_is_made_and_left_empty(tmp_path: Path) -> None:
    require_writable(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []


def test_what_killed_writers_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    write_json(tmp_path / "deep" / "a-unfinished-b.json", 1)
    killed = beside(tmp_path / "deep" / "a.json")
    left = killed.__enter__()
    (tmp_path / ".hidden.json").touch()
    assert left.exists()
    remove_unfinished(tmp_path)
    found = {path.name for path in tmp_path.rglob("*.json")}
    assert found == {"a-unfinished-b.json", ".hidden.json"}


def test_a_digest_is_that_of_the_content(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    assert sha256(tmp_path / "a") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


@pytest.mark.parametrize("kind", ["link", "broken link", "pipe", "device"])
def test_what_is_no_regular_file_is_not_written_over(kind: str, tmp_path: Path) -> None:
    path, target = tmp_path / "a.json", tmp_path / "target"
    target.write_text("old")
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path = Path("/dev/null")
    else:
        path.symlink_to(target if kind == "link" else tmp_path / "absent")
    before = path.lstat()
    with pytest.raises(ResultError, match=f"cannot write {path}: it is no regular file"):
        write_json(path, {})
    assert path.lstat() == before and target.read_text() == "old"
    assert {p.name for p in tmp_path.iterdir()} <= {"a.json", "target"}


def test_what_is_removed_is_gone_and_what_is_not_there_may_be_removed(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", 1)
    for _ in range(2):
        remove(tmp_path / "a.json")
        assert list(tmp_path.iterdir()) == []


def test_kinds_of_arrays_may_be_asked_for(archive: Path) -> None:
    kinds = {"x": "f8", "n": "i8", "name": "U"}
    assert set(read_arrays(archive, KIND, kinds)) == set(kinds)
    for name, kind in (("x", "f4"), ("n", "f8"), ("name", "i8"), ("x", "U")):
        with pytest.raises(ResultError, match=f"{name} holds .*, not {kind}"):
            read_arrays(archive, KIND, kinds | {name: kind})


def test_infinite_numbers_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("step,return\n1,inf\n")
    with pytest.raises(ResultError, match="infinite numbers in the columns return"):
        read_table(tmp_path / "a.csv", ("step",), numbers=("step", "return"))
    (tmp_path / "a.json").write_text('{"return": 1e999}')
    with pytest.raises(ResultError, match="too large a number"):
        read_json(tmp_path / "a.json")
