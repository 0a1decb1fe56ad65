"""``./reproduce.sh verify``: what is drawn, what is refused, what is found."""

import os
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from checkouts import copy_sources
from grid import SMALL
from plans import planned

from replication import documents
from replication.digests import DIGESTS, SET, changed
from replication.tables import RUN, Found
from srlrepro.pins import ARITHMETIC
from srlrepro.settings.config import Config
from srlrepro.storage.files import ResultError, write_json, write_table
from workflow import driver, verify
from workflow.command_line import make_verify_parser

ROOT = Path(__file__).parents[2]
TINY = ["--alphas", "0", "none", "--deltas", "1.1", "--seeds", "1", "--steps", "512", "--name", "tiny"]
CELL = "tiny/alpha_none__delta_1.1__seed_0"
CELLS = ["tiny/01_pendulum", "tiny/09_choices", "tiny/data_0", "tiny/alpha_0__delta_1.1__seed_0", CELL]
ROWS = pd.DataFrame({"alpha": "none", "delta": 1.1, "seed": 0, "value": [0.25, 3.5]})
CHANGES = 100  # digits, of which each must be found
# The driver where a copy of the sources shares compiled code; "keep" commits what a cell says.
DRIVER = """
import sys
from checkouts import copy_sources
from srlrepro.storage.files import write_table
from workflow import driver, verify

def keep(cell, place, figures):
    for found in cell.found(place):
        write_table(figures / f"{found.name}.csv", found.table, found.digits)
    return None, "kept"

verify.lay_out = copy_sources
verify.compare = keep if sys.argv[1] == "keep" else verify.compare
sys.exit(driver.main(["verify", *sys.argv[2:]]))
"""


def a_set(folder: Path, **other: Any) -> dict[str, Any]:
    """The configuration of a committed set, which is written."""
    config = {key: value for key, value in planned(*TINY).items() if key != "only"}
    config |= {"arithmetic": ARITHMETIC} | other
    write_json(folder / "figures" / str(config["name"]) / SET, config)
    return config


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout that holds one set, whose cells are made by hand."""
    a_set(tmp_path)
    write_table(tmp_path / "figures" / "tiny" / "measures.csv", ROWS, digits=6)
    monkeypatch.setattr(verify, "ROOT", tmp_path)
    monkeypatch.setattr(verify, "lay_out", lambda place: None)
    monkeypatch.setattr(verify, "make", lambda *_: None)
    cell = verify.Cell([], lambda place: iter([Found("measures", ROWS, group=RUN)]), {})
    known = {name.partition("/")[2]: cell for name in CELLS}
    monkeypatch.setattr(verify, "cells_of", lambda config: known)
    return tmp_path


def run(*arguments: str) -> int:
    return verify.main(make_verify_parser().parse_args(list(arguments)), {})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["three"], "invalid int value"),
        (["0"], "N = 0: must be a whole number in [1, 5]"),
        (["6"], "N = 6"),
        (["--seed", "-1"], "--seed = -1"),
        (["--seed", "1", "--tables"], "--seed = 1: must be left out where nothing is drawn"),
        (["3", "--tables"], "not allowed with argument"),
        (["3", "--cells", CELL], "not allowed with argument"),
        (["--cells", "tiny/none"], "--cells = tiny/none: must be one of 5 cells, such as tiny/01_pendulum"),
        (["--cells", "huge/data_0"], "--cells = huge/data_0: must be SET/CELL with a committed set: tiny"),
        (["--cores", "0"], "--cores = 0"),
        (["--limit", "0"], "--limit = 0.0"),
        (["--table"], "unrecognized arguments: --table"),
    ],
)
def test_a_wrong_command_line_is_one_line(
    arguments: list[str],
    message: str,
    checkout: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(driver, "VENV", Path(sys.prefix))
    monkeypatch.setattr(verify, "make", None)
    with pytest.raises(SystemExit) as stop:
        driver.main(["verify", *arguments])
    said = capsys.readouterr()
    assert stop.value.code == 2 and message in said.err
    assert said.err.count("\n") == 1 and said.out == ""


def test_the_same_seed_draws_the_same_cells(checkout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def drawn(*arguments: str) -> str:
        assert run(*arguments) == 0
        return capsys.readouterr().out.splitlines()[0]

    first = drawn("2", "--seed", "7")
    assert first.startswith("2 of 5 cells, drawn with --seed 7: tiny/") and drawn("2", "--seed", "7") == first
    assert len({drawn("2", "--seed", str(seed)).partition(": ")[2] for seed in range(10)}) > 3
    unseeded = drawn("2")
    seed = unseeded.partition("--seed ")[2].partition(":")[0]
    assert drawn("2", "--seed", seed) == unseeded


def test_what_is_the_same_is_said(checkout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--cells", CELL, CELL) == 0
    assert capsys.readouterr().out == f"{CELL}: same, 2 rows of 1 table (0.0 min)\n"


def test_a_planted_difference_is_located(checkout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_table(checkout / "figures" / "tiny" / "measures.csv", ROWS.replace(3.5, 3.6))
    assert run("--cells", CELL) == 1
    said = capsys.readouterr().out
    place = "figures/tiny/measures.csv, line 3, value: committed 3.6, found 3.5"
    assert said == f"{CELL}: DIFFERS on {verify.processor()}: {place} (0.0 min)\n"


def test_a_cell_that_cannot_be_made_is_said_and_the_next_is_tried(
    checkout: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def make(*_: object) -> None:
        calls.append(1)
        if len(calls) == 1:
            raise ResultError("no job ended well")

    monkeypatch.setattr(verify, "make", make)
    assert run("--cells", CELLS[0], CELL) == 1
    failed, same = capsys.readouterr().out.splitlines()
    assert f"{CELLS[0]}: FAILED on {verify.processor()}: no job ended well" in failed and "same" in same


def test_ctrl_c_leaves_nothing_behind(
    checkout: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    places = []

    def make(cell: object, config: object, place: Path, *_: object) -> None:
        place.mkdir()
        places.append(place)
        raise KeyboardInterrupt

    monkeypatch.setattr(verify, "make", make)
    assert run("--cells", CELL) == verify.INTERRUPTED
    assert not places[0].parent.exists() and "stopped" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("other", "why"),
    [
        ({"arithmetic": ARITHMETIC + 1}, f"of arithmetic {ARITHMETIC + 1}, not of {ARITHMETIC}"),
        ({"arithmetic": None}, f"of an earlier arithmetic, not of {ARITHMETIC}"),
        ({"values": Config().as_dict() | {"p_t": 0.7}}, "made with p_t = 0.7, not 0.8"),
    ],
)
def test_a_set_that_cannot_be_made_again_is_left_out(
    other: dict[str, Any], why: str, checkout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = a_set(checkout, name="older", **other)
    if config["arithmetic"] is None:
        write_json(checkout / "figures/older" / SET, {k: v for k, v in config.items() if k != "arithmetic"})
    assert run("1") == 0
    assert capsys.readouterr().out.startswith(f"left out: figures/older ({why})\n1 of 5 cells")
    with pytest.raises(ValueError, match=f"--cells = older/data_0: .*figures/older is {why}"):
        run("--cells", "older/data_0")
    (checkout / "figures" / "tiny" / SET).unlink()
    with pytest.raises(ResultError, match="nothing to verify"):
        run("1")


def test_every_set_has_its_cells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run, a dataset, and two notebooks for the grid; 95 universes; every run of the other studies."""
    assert [f"tiny/{name}" for name in verify.cells_of(planned(*TINY))] == CELLS
    seeds = verify.cells_of(planned("--seeds", "10"))
    assert "09_choices" not in seeds and len(seeds) == 1 + 10 + 120
    assert len(verify.cells_of(planned("--multiverse"))) == 95
    caution = verify.cells_of(planned("--caution"))
    universe = "hypothesis_svm__threshold_0.95__dataset_2"
    one = caution[f"{universe}__alpha_0.5__delta_4__seed_2"]
    assert one.varied == {"narrowed": {"ALPHAS": ["0.5"], "DELTAS": [4.0], "SEEDS": [2]}}
    assert one.targets == [f"results/caution/universes/{universe}/measures.csv"]
    numbers = {
        name: len(verify.cells_of(planned(f"--{name}"))) for name in ("calibrated", "crossed", "shift")
    }
    joints = verify.cells_of(planned("--joints"))
    learners = [name for name in joints if name.endswith(("seed_0", "seed_1", "seed_2"))]
    assert len(learners) == 120 and len(joints) == 120 + 8 * (3 * (5 + 10 + 3) + 2)
    one = joints["links_2__dataset_0__k_250__alpha_0"]
    assert one.targets == ["results/joints/cells/links_2__dataset_0__scores.csv"]
    assert one.varied == {"cells_only": ["k_250__alpha_0"], "narrowed": {"ALPHAS": ["none"]}}
    assert len(caution) == 186 and numbers == {"calibrated": 90, "crossed": 48, "shift": 50}


def test_a_universe_has_a_place_in_the_curves_that_are_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A claim that is the same in all universes has none."""
    committed = pd.read_csv(ROOT / "figures" / "multiverse" / "outcomes.csv")
    own = committed.loc[committed["id"] == "default", ["id", "claim", "value", "margin", "holds", "why"]]
    own["holds"] = own["holds"].map({"True": True, "False": False, True: True, False: False})
    for name in ("read_measures", "read_table"):
        monkeypatch.setattr(verify, name, lambda *_: pd.DataFrame())
    monkeypatch.setattr(verify.multiverse, "outcomes", lambda *_: own)
    found = verify.cells_of(planned("--multiverse"))["default"].found(tmp_path)
    names = [table.name for table in found]
    drawn = {path.stem for path in (ROOT / "figures" / "multiverse").glob("spec_curve_*.csv")}
    assert names[0] == "outcomes" and {*names[1:]} == drawn and len(drawn) < len(own)


@pytest.mark.slow
def test_a_run_is_made_anew_and_is_the_same(tmp_path: Path) -> None:
    """By the driver in a checkout whose compiled code the copies share; first so that there is a set."""
    place = copy_sources(tmp_path / "checkout")
    small = planned(*TINY, "--set", *SMALL)
    a_set(place, **{key: small[key] for key in ("settings", "values", "note", "varied")})
    variables = {**os.environ, "PYTHONPATH": f"{place}{os.pathsep}{ROOT / 'tests'}", "TMPDIR": str(tmp_path)}

    def verified(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [str(place / ".venv" / "bin" / "python"), "-c", DRIVER, *arguments, "--cells", CELL]
        return subprocess.run(command, cwd=place, env=variables, capture_output=True, text=True)

    kept = verified("keep")
    assert kept.returncode == 0, kept.stdout + kept.stderr
    before = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
    done = verified("compare")
    assert done.returncode == 0, done.stdout + done.stderr
    names = {path.stem for path in (place / "figures" / "tiny").glob("*.csv")}
    assert names == {"measures", "fig3_def_counts", "fig3_abc_learning", "reward_per_step"}
    assert f"{CELL}: same, " in done.stdout and " rows of 4 tables (" in done.stdout
    after = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
    assert after == before and not list(tmp_path.glob("verify-*"))


@pytest.fixture
def copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Copies of every committed table, of README, REPORT and the pages."""
    texts = [ROOT / "README.md", ROOT / "REPORT.md", *(ROOT / "docs").rglob("*.*")]
    texts += (ROOT / "policies").glob("*.md")
    texts += [path for folder in verify.committed() for path in (ROOT / "figures" / folder).glob("*.*")]
    kept = [path for path in texts if path.suffix in (".csv", ".md", ".txt", ".json")]
    for path in kept:
        copy = tmp_path / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, copy)
    monkeypatch.setattr(verify, "ROOT", tmp_path)
    monkeypatch.setattr(documents, "render", cache(documents.render))
    return sorted(path for path in tmp_path.rglob("*") if path.suffix in (".csv", ".md"))


@pytest.mark.slow
def test_a_changed_digit_is_found_wherever_it_is(copies: list[Path]) -> None:
    """In every kind of file: tables of results and of docs/, README, REPORT, and pages, rendered or not."""
    rng, top = np.random.default_rng(13), verify.ROOT
    assert verify.attempt(verify.of_documents) == []
    numbered = [path for path in copies if re.search(rb"[0-9]", path.read_bytes())]
    files = [numbered[i] for i in rng.integers(len(numbered), size=CHANGES)]  # however many files there are
    for file in [*files, top / "README.md", top / "REPORT.md"]:
        text = file.read_bytes()
        digits = [i for i, byte in enumerate(text) if chr(byte).isdigit()]
        place = rng.choice(digits)
        digit = str((int(chr(text[place])) + rng.integers(1, 10)) % 10).encode()
        file.write_bytes(text[:place] + digit + text[place + 1 :])
        if file.parent in (top, top / "policies"):
            (found,) = verify.attempt(verify.of_documents)
            line = text[:place].count(10) + 1
            assert found.startswith(f"{file.relative_to(top)}, line {line}, text: committed ")
        else:
            folder = top / "docs" if file.is_relative_to(top / "docs") else file.parent
            assert changed(folder) == [file.relative_to(folder).as_posix()]
        file.write_bytes(text)


@pytest.mark.parametrize("what", ["table", "digests", "README"])
def test_all_that_is_wrong_with_the_tables_is_said(
    what: str, copies: list[Path], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    top = verify.ROOT
    monkeypatch.setattr(verify, "committed", lambda: {"full": {}})
    folder = top / "figures" / "full"
    if what == "table":
        table = folder / "discrepancy_ranks.csv"
        lines = table.read_text().splitlines(keepends=True)
        table.write_text("".join([lines[0], lines[1].replace(",", ",9", 1), *lines[2:]]))
    elif what == "digests":
        (folder / DIGESTS).unlink()
    else:
        (top / "README.md").write_text((top / "README.md").read_text().replace("claims", "clams", 1))
    assert run("--tables") == 1
    said = capsys.readouterr().out.splitlines()
    expected = {
        "table": [
            "figures/full/sha256.txt says otherwise: discrepancy_ranks.csv",
            "figures/full/discrepancy_ranks.csv, line 2, final_return: committed 9",
        ],
        "digests": ["figures/full/sha256.txt says otherwise: full: ResultError: missing result"],
        "README": ["README.md, line "],
    }[what]
    wrong = said[-1 - len(expected) : -1]
    assert all(line.startswith(start) for line, start in zip(wrong, expected, strict=True))
    assert said[-1].startswith(f"{len(expected)} differences (")
    assert said[0].startswith(
        "figures/full, primary: any_cartpole, any_pendulum, budgets, choices_calibration"
    )
