"""Runs from another checkout: taken only if this one would make the same, and nothing else is touched."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nbformat
import pytest

from srlrepro.claims import MEASURE_COLUMNS
from srlrepro.config import Config
from srlrepro.files import LARGEST, ResultError
from srlrepro.importing import NOTEBOOK, bring_in, cells, difference, mark_finished, outputs
from srlrepro.plan import make_parser, plan
from srlrepro.training import train

ROOT = Path(__file__).parent.parent
SETTINGS = ["n_steps=64", "n_minibatches=4", "n_epochs=1", "hidden_width=16"]
GRID = ["--alphas", "0", "none", "--deltas", "1.5", "--seeds", "2", "--steps", "64", "--name", "small"]
FREE = "alpha_none__delta_1.5__seed_0"


@pytest.fixture
def workflow() -> dict[str, Any]:
    return plan(make_parser().parse_args([*GRID, "--set", *SETTINGS]))


@pytest.fixture
def checkouts(tmp_path: Path, workflow: dict[str, Any]) -> tuple[Path, Path]:
    """(another checkout, with one finished run; this one, with none)."""
    there, here = tmp_path / "there", tmp_path / "here"
    source = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("train()")])
    for root in (there, here):
        (root / "notebooks").mkdir(parents=True)
        nbformat.write(source, root / "notebooks" / f"{NOTEBOOK}.ipynb")
        (root / "results" / "small").mkdir(parents=True)
        (root / "results" / "small" / "workflow.json").write_text(json.dumps(workflow))
    run = next(run for run, _ in cells(workflow) if run.name == FREE)
    files = outputs(workflow, run)
    train(run, Config().with_values(**workflow["settings"]), None, (there / files["run"]).parent)
    for name in ("measures", "notebook"):
        (there / files[name]).parent.mkdir(parents=True)
    (there / files["measures"]).write_text(",".join(MEASURE_COLUMNS) + "\n")
    shutil.copy(there / "notebooks" / f"{NOTEBOOK}.ipynb", there / files["notebook"])
    return there, here


def written(root: Path) -> set[str]:
    return {str(p.relative_to(root)) for p in root.rglob("*") if p.is_file()}


def test_a_run_that_this_checkout_would_make_is_brought_in_once(
    checkouts: tuple[Path, Path], workflow: dict[str, Any]
) -> None:
    there, here = checkouts
    notebooks, refused = bring_in(there, "small", here)
    assert (len(notebooks), refused) == (1, {}) and written(here) == written(there)
    kept = here / "results" / "small" / "runs" / FREE / "run.json"
    kept.write_text("mine")
    assert bring_in(there, "small", here) == ([], {}) and kept.read_text() == "mine"


def changed(*path: str, value: Any) -> Callable[[Path], None]:
    """Changes one value of run.json."""

    def change(folder: Path) -> None:
        result = json.loads((folder / "run.json").read_text())
        part = result
        for key in path[:-1]:
            part = part[key]
        part[path[-1]] = value
        (folder / "run.json").write_text(json.dumps(result))

    return change


def _truncate(name: str) -> Callable[[Path], None]:
    return lambda folder: os.truncate(folder / name, 100)


def _enlarge(folder: Path) -> None:
    os.truncate(folder / "policy.zip", LARGEST + 1)


def _unpack_to_much(folder: Path) -> None:
    with zipfile.ZipFile(folder / "visited.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", bytes(LARGEST + 1))


def _link_out(folder: Path) -> None:
    target = folder.parents[4] / "outside.csv"
    (folder / "trials.csv").rename(target)
    (folder / "trials.csv").symlink_to(target)


def _shorten(folder: Path) -> None:
    lines = (folder / "trials.csv").read_text().splitlines(keepends=True)
    (folder / "trials.csv").write_text("".join(lines[:-1]))


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (changed("run", "steps", value=128), "run.steps is '128', here '64'"),
        (changed("config", "p_t", value=0.7), "config.p_t is '0.7', here '0.8'"),
        (changed("region", value="x"), "region is 'x'"),
        (changed("provenance", "code", value="x"), "provenance.code is 'x'"),
        (
            changed("provenance", "versions", "numpy", value="1.0\n2"),
            r"provenance.versions.numpy is '1.0\n2'",
        ),
        (changed("provenance", value=None), "provenance is no table of values"),
        (changed("counts", "falls", value=-1), "trials.csv belongs to another run: counts.falls"),
        (_shorten, "trials.csv belongs to another run"),
        (_truncate("run.json"), "truncated or not JSON"),
        (_truncate("visited.npz"), "truncated"),
        (_enlarge, "more than"),
        (_unpack_to_much, "unpacks to"),
        (_link_out, "a link that leads out"),
    ],
)
def test_another_run_is_refused_in_one_line_and_nothing_is_written(
    spoil: Callable[[Path], None], reason: str, checkouts: tuple[Path, Path]
) -> None:
    there, here = checkouts
    spoil(there / "results" / "small" / "runs" / FREE)
    before = written(here)
    notebooks, refused = bring_in(there, "small", here)
    assert notebooks == [] and list(refused) == [FREE] and reason in refused[FREE]
    assert "\n" not in refused[FREE] and written(here) == before


def test_a_run_of_another_notebook_or_without_its_region_here_is_refused(
    checkouts: tuple[Path, Path],
) -> None:
    there, here = checkouts
    nbformat.write(nbformat.v4.new_notebook(), here / "notebooks" / f"{NOTEBOOK}.ipynb")
    runs = there / "results" / "small" / "runs"
    shutil.copytree(runs / FREE, runs / "alpha_0__delta_1.5__seed_1")
    shutil.copytree(runs / FREE, runs / "..x")  # no run of the grid: not looked at
    refused = bring_in(there, "small", here)[1]
    assert refused.keys() == {FREE, "alpha_0__delta_1.5__seed_1"}
    assert "executed from another" in refused[FREE]
    assert "missing result" in refused["alpha_0__delta_1.5__seed_1"]


def test_results_that_nobody_planned_here(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match=r"workflow\.json"):
        bring_in(tmp_path, "small", tmp_path)


def test_a_difference_is_one_of_type_too() -> None:
    assert difference({"a": {"b": 1}}, {"a": {"b": 1, "c": 2}}) == ""
    assert difference({"a": {"b": 1}}, {"a": {"b": True}}) == "a.b is 'True', here '1'"
    assert difference({"a": 1}, {}) == "a is 'None', here '1'"


@pytest.mark.slow
def test_snakemake_takes_the_run_for_finished_until_a_value_changes(
    checkouts: tuple[Path, Path], workflow: dict[str, Any]
) -> None:
    there, here = checkouts
    for name in ("srlrepro", "Snakefile"):
        (here / name).symlink_to(ROOT / name)
    shutil.copy(ROOT / "notebooks" / f"{NOTEBOOK}.ipynb", here / "notebooks")
    run = next(run for run, _ in cells(workflow) if run.name == FREE)
    shutil.copy(ROOT / "notebooks" / f"{NOTEBOOK}.ipynb", there / outputs(workflow, run)["notebook"])
    notebooks, _ = bring_in(there, "small", here)
    mark_finished(notebooks, "small", here)

    def planned_again() -> str:
        config = ["--configfile", "results/small/workflow.json", "--allowed-rules", "training_run"]
        command = ["snakemake", "--cores", "1", "--dry-run", *config, "--", *notebooks]
        done = subprocess.run([sys.executable, "-m", *command], cwd=here, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout + done.stderr

    assert "Nothing to be done" in planned_again()
    workflow["values"]["p_t"] = 0.7
    (here / "results" / "small" / "workflow.json").write_text(json.dumps(workflow))
    assert "training_run" in planned_again()
