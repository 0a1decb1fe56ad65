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
import pandas as pd
import pytest

from srlrepro.config import Config
from srlrepro.evaluation import measure_rows, run_measures, write_measures
from srlrepro.files import LARGEST, ResultError, read_table
from srlrepro.foreign import difference
from srlrepro.importing import NOTEBOOK, bring_in, cells, mark_finished, outputs
from srlrepro.notebooks import forget_machine
from srlrepro.plan import make_parser, plan
from srlrepro.training import train

ROOT = Path(__file__).parent.parent
SETTINGS = ["n_steps=64", "n_minibatches=4", "n_epochs=1", "hidden_width=16"]
GRID = ["--alphas", "0", "none", "--deltas", "1.5", "--seeds", "2", "--steps", "64", "--name", "small"]
FREE = "alpha_none__delta_1.5__seed_0"
PIXEL = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNgAAAAAgABSK+kcQAAAABJRU5ErkJggg=="
HOSTILE = "<script>alert(1)</script>"


@pytest.fixture
def workflow() -> dict[str, Any]:
    return plan(make_parser().parse_args([*GRID, "--set", *SETTINGS]))


def executed(source: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The notebook with parameters, and with an output of each kind in its code cells."""
    shown = {"text/html": HOSTILE, "text/plain": "a table", "image/png": f"{PIXEL}\n"}
    given = nbformat.v4.new_code_cell("SEED = 0", metadata={"tags": ["injected-parameters"]})
    result = nbformat.v4.new_notebook(cells=[given, *nbformat.from_dict(source).cells])
    for cell in (cell for cell in result.cells if cell.cell_type == "code"):
        cell.execution_count = 1
        cell.outputs = [
            nbformat.v4.new_output("stream", name="stdout", text="done\n"),
            nbformat.v4.new_output("display_data", shown, metadata={"image/png": {"width": HOSTILE}}),
        ]
    forget_machine(result)
    return result


@pytest.fixture
def checkouts(tmp_path: Path, workflow: dict[str, Any]) -> tuple[Path, Path]:
    """(another checkout, with one finished run; this one, with none)."""
    there, here = tmp_path / "there", tmp_path / "here"
    words = nbformat.v4.new_markdown_cell("How does one learner fare?")
    source = nbformat.v4.new_notebook(cells=[words, nbformat.v4.new_code_cell("train()")])
    for root in (there, here):
        (root / "notebooks").mkdir(parents=True)
        nbformat.write(source, root / "notebooks" / f"{NOTEBOOK}.ipynb")
        (root / "results" / "small").mkdir(parents=True)
        (root / "results" / "small" / "workflow.json").write_text(json.dumps(workflow))
    run = next(run for run, _ in cells(workflow) if run.name == FREE)
    files = outputs(workflow, run)
    result = train(run, Config().with_values(**workflow["settings"]), None, (there / files["run"]).parent)
    trials = read_table(there / files["trials.csv"], ("step", "return"))
    write_measures(
        there / files["measures"],
        measure_rows(run_measures(result, trials), "none", run.delta, run.seed),
    )
    (there / files["notebook"]).parent.mkdir(parents=True)
    nbformat.write(executed(source), there / files["notebook"])
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


def test_of_a_notebook_nothing_is_brought_in_that_a_browser_could_run(
    checkouts: tuple[Path, Path], workflow: dict[str, Any]
) -> None:
    there, here = checkouts
    (name,), _ = bring_in(there, "small", here)
    assert HOSTILE in (there / name).read_text() and "script" not in (here / name).read_text()
    cells_here = nbformat.read(here / name, as_version=4).cells
    assert [cell.source for cell in cells_here] == ["SEED = 0", "How does one learner fare?", "train()"]
    text, picture = cells_here[2].outputs
    assert text.text == "done\n" and picture.data == {"text/plain": "a table", "image/png": PIXEL}
    assert cells_here[2].execution_count == 1


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


def _edit_table(name: str, column: str, value: Any) -> Callable[[Path], None]:
    """Changes the first row of a table, named relative to the run's folder."""

    def edit(folder: Path) -> None:
        table = pd.read_csv(folder / name)
        table[column] = [value, *table[column][1:]]
        table.to_csv(folder / name, index=False)

    return edit


def _edit_notebook(change: Callable[[Any], None]) -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        path = folder.parents[3] / "notebooks" / "executed" / "small" / "runs" / f"{NOTEBOOK}__{FREE}.ipynb"
        notebook = json.loads(path.read_text())
        change(notebook["cells"])
        path.write_text(json.dumps(notebook))

    return edit


MEASURES = f"../../measures/{NOTEBOOK}__{FREE}.csv"


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (_edit_table("trials.csv", "return", float("nan")), "not finite"),
        (_edit_table("trials.csv", "return", 1e9), "curve.csv does not follow"),
        (_edit_table("curve.csv", "falls", 99), "curve.csv does not follow"),
        (_edit_table(MEASURES, "value", 1e9), f"{FREE}.csv does not follow"),
        (_edit_table(MEASURES, "seed", 1), f"{FREE}.csv does not follow"),
        (changed("steps_done", value=128), "steps_done is '128', here '64'"),
        (changed("final_policy", "no supervisor", value={}), "lacks the final policy's return"),
        (changed("final_policy", "own condition", "return", value="1"), "lacks the final policy's return"),
        (changed("provenance", "seconds", value=None), "what the run took"),
        (_edit_notebook(lambda cells: cells[1].update(source=HOSTILE)), "executed from another"),
        (_edit_notebook(lambda cells: cells[2].update(execution_count=None)), "not an executed notebook"),
        (_edit_notebook(lambda cells: cells[2]["outputs"][0].pop("text")), "not an executed notebook"),
        (_edit_notebook(lambda cells: cells.append({})), "not an executed notebook"),
        (_edit_notebook(lambda cells: cells.append(cells[1])), "executed from another"),
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
    for name in ("srlrepro", "Snakefile", "rules"):
        (here / name).symlink_to(ROOT / name)
    shutil.copy(ROOT / "notebooks" / f"{NOTEBOOK}.ipynb", here / "notebooks")
    run = next(run for run, _ in cells(workflow) if run.name == FREE)
    source = nbformat.read(ROOT / "notebooks" / f"{NOTEBOOK}.ipynb", as_version=4)
    nbformat.write(executed(source), there / outputs(workflow, run)["notebook"])
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
