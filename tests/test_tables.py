"""Tables held against each other: differences are located, and no digit changes unseen."""

import shutil
import subprocess
from pathlib import Path

import pandas as pd
import pytest

from replication import tables
from replication.digests import DIGESTS, SET, changed, write_digests
from replication.evidence.verdicts import CALIBRATED
from replication.facts import Facts
from replication.tables import RUN, Difference, disagreement, first_difference, found_in, is_new, near, shared
from srlrepro.storage.files import ResultError, write_json, write_table

ROOT = Path(__file__).parent.parent
SETS = sorted(path.parent for path in (ROOT / "figures").glob(f"*/{DIGESTS}"))
CHANGES = 100
FOUND = pd.DataFrame(
    {"alpha": ["0", "none"], "delta": [1.1, 4.0], "seed": [0, 0], "value": [0.25, 1234567.0]}
)


@pytest.fixture
def committed(tmp_path: Path) -> Path:
    """A table with the rows of ``FOUND``, and others."""
    file = tmp_path / "figures" / "tiny" / "measures.csv"
    others = FOUND.assign(seed=1, value=7.0)
    write_table(file, pd.concat([others[:1], FOUND, others[1:]]), digits=6)
    return file


def replace(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert text.count(old) == 1
    file.write_text(text.replace(old, new))


def test_rows_that_are_there_do_not_differ(committed: Path) -> None:
    assert first_difference(committed, FOUND, group=RUN) is None
    assert first_difference(committed, FOUND[::-1], group=RUN) is None


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ("0,1.1,0,0.25", "0,1.1,0,0.26", (3, "value", "0.26", "0.25")),
        ("none,4,0,1.23457e+06", "none,4,0,1.23458e+06", (4, "value", "1.23458e+06", "1.23457e+06")),
        ("0,1.1,0,0.25\n", "", (3, "the row", "none,4,0,1.23457e+06", "0,1.1,0,0.25")),
        ("0,1.1,0,0.25\n", "0,1.1,0,0.25\n" * 2, (4, "the row", "0,1.1,0,0.25", "none,4,0,1.23457e+06")),
        ("none,4,0,1.23457e+06\n", "", (4, "the row", "", "none,4,0,1.23457e+06")),
        ("0,1.1,0,0.25", "0,1.1,0", (3, "the row", "0,1.1,0", "4 columns")),
    ],
)
def test_a_difference_is_located(
    old: str, new: str, where: tuple[int, str, str, str], committed: Path
) -> None:
    replace(committed, old, new)
    found = first_difference(committed, FOUND, group=RUN)
    assert found == Difference("figures/tiny/measures.csv", *where)


def test_without_a_group_every_row_counts(committed: Path) -> None:
    found = first_difference(committed, FOUND)
    assert found is not None and found.line == 2 and found.column == "seed"


def test_a_table_of_other_columns_is_refused(committed: Path) -> None:
    with pytest.raises(ResultError, match=r"figures/tiny/measures\.csv lacks the columns more"):
        first_difference(committed, FOUND.assign(more=1))


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("0.0027 [0.0026, 0.0028]", "0.0027 [0.00261, 0.0028]", True),
        ("1.234", "1.235", True),
        ("1.234", "1.334", False),
        ("-1.234", "1.234", False),
        ("1 of 6", "2 of 6", False),
        ("holds", "fails", False),
        ("", "0", False),
        ("0", "1e-17", True),
    ],
)
def test_only_last_digits_are_forgiven(one: str, other: str, same: bool) -> None:
    assert near(one, other) == near(other, one) == same


@pytest.mark.slow
@pytest.mark.parametrize("folder", SETS, ids=lambda folder: folder.name)
def test_no_committed_table_contradicts_another(folder: Path) -> None:
    """A set of measures alone says nothing of itself: what the grid says of it is held against them."""
    found, tables_there = list(found_in(folder)), {path.stem for path in folder.glob("*.csv")}
    assert bool(found) == (tables_there != {"measures", "conditions"})
    assert [d for table in found if (d := disagreement(folder, table))] == []
    assert changed(folder) == []


def test_a_changed_table_contradicts_others_even_if_the_digests_are_renewed(tmp_path: Path) -> None:
    ignored = shutil.ignore_patterns("*.pdf", "*.png")
    folder = shutil.copytree(ROOT / "figures" / "full", tmp_path / "full", ignore=ignored)
    file = folder / "discrepancy.csv"
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join([*lines[:-1], lines[-1].replace(",0.", ",9.")]))
    assert changed(folder) == [file.name]
    write_digests(folder)
    assert changed(folder) == []
    found = [d for table in found_in(folder) if (d := disagreement(folder, table))]
    assert [Path(d.file).stem for d in found] == ["discrepancy_outcomes", "discrepancy_ranks"]


def test_the_other_arm_is_held_against_its_measures(tmp_path: Path) -> None:
    ignored = shutil.ignore_patterns("*.pdf", "*.png", "*.gif")
    for name in ("full", CALIBRATED):
        shutil.copytree(ROOT / "figures" / name, tmp_path / name, ignore=ignored)
    told = [f for f in found_in(tmp_path / "full") if f.name == "failure_rate"]
    assert [disagreement(tmp_path / "full", found) for found in told] == [None]
    measures = tmp_path / CALIBRATED / "measures.csv"
    row = next(
        line for line in measures.read_text().splitlines() if line.startswith("success_log_odds,1,1.1,0,")
    )
    parts = row.split(",")
    replace(measures, row, ",".join([*parts[:4], str(float(parts[4]) + 1), *parts[5:]]))
    (found,) = [f for f in found_in(tmp_path / "full") if f.name == "failure_rate"]
    difference = disagreement(tmp_path / "full", found)
    assert difference is not None and difference.column == "failure_rate"


def test_two_sets_say_the_same_of_their_runs(tmp_path: Path) -> None:
    config = {"cells": "full", "steps": 5, "values": {}, "study": "", "arithmetic": 1}
    folders = [tmp_path / "figures" / name for name in ("small", "large")]
    runs = pd.DataFrame({"alpha": "0", "delta": 1.1, "seed": range(3), "measure": "falls", "value": range(3)})
    for folder, count in zip(folders, (2, 3), strict=True):
        for name in tables.SHARED:
            write_table(folder / f"{name}.csv", runs[:count])
        write_json(folder / SET, config)
    small, large = folders
    assert [disagreement(large, found) for found in shared(small, large)] == [None] * len(tables.SHARED)
    replace(large / "fig3_def_counts.csv", "0,1.1,1,falls,1", "0,1.1,1,falls,2")
    (found,) = filter(None, (disagreement(large, found) for found in shared(small, large)))
    assert found == Difference("figures/large/fig3_def_counts.csv", 3, "value", "2", "1")
    write_json(large / SET, config | {"arithmetic": 2})
    assert list(shared(small, large)) == []


@pytest.mark.parametrize(
    "forged",
    [[], "arithmetic", None, {"arithmetic": "1"}, {"arithmetic": True}, {"steps": 1.5}, {"study": []}],
)
def test_a_forged_set_is_refused_in_one_line(forged: object, tmp_path: Path) -> None:
    facts = Facts(tmp_path, tmp_path)
    write_json(tmp_path / "full" / SET, {"arithmetic": 0})
    write_json(tmp_path / "forged" / SET, forged)
    for reader in (
        lambda: is_new(tmp_path / "forged"),
        lambda: list(shared(tmp_path / "full", tmp_path / "forged")),
        lambda: facts.earlier,
    ):
        with pytest.raises(ResultError, match=r"^\S+workflow\.json is no configuration of the workflow$"):
            reader()


def test_the_digests_are_those_of_sha256sum(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("1\n")
    (tmp_path / "page.md").write_text("2\n")
    (tmp_path / "picture.png").write_text("3\n")
    write_digests(tmp_path)
    done = subprocess.run(["sha256sum", "--check", DIGESTS], cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout == "a.csv: OK\npage.md: OK\n"


@pytest.mark.parametrize("what", ["changed", "removed", "added", "the digest"])
def test_a_table_and_its_digest_belong_together(what: str, tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("1\n")
    write_digests(tmp_path)
    assert changed(tmp_path) == []
    if what == "changed":
        file.write_text("2\n")
    elif what == "removed":
        file.unlink()
    elif what == "added":
        write_table(file := tmp_path / "b.csv", FOUND)
    else:
        digests = (tmp_path / DIGESTS).read_text()
        (tmp_path / DIGESTS).write_text(digests.replace(digests[0], "f" if digests[0] != "f" else "e", 1))
    assert changed(tmp_path) == [file.name]
