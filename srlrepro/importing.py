"""Runs that another checkout has trained: brought in only if this one would have made the same.

What was trained elsewhere is known from its run.json: parameters, every value, the region's digest, the hash
of the code, and versions. Nothing is written before every run has been looked at. Only runs that the grid of
this checkout names are looked for, so that no name from elsewhere becomes a path. No pickle is read:
policy.zip is copied.
"""

import json
import platform
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import version
from itertools import product
from pathlib import Path
from shutil import copyfile
from typing import Any

from srlrepro.claims import MEASURE_COLUMNS
from srlrepro.config import Config
from srlrepro.files import (
    ResultError,
    beside,
    bounded,
    bounded_archive,
    existing,
    read_arrays,
    read_json,
    read_table,
)
from srlrepro.hypotheses import read
from srlrepro.plan import check_workflow
from srlrepro.provenance import PACKAGES, code_hash
from srlrepro.recording import TRIAL_COLUMNS, count
from srlrepro.training import VISITED_FORMAT, Run, identify

NOTEBOOK = "05_training_run"
AT_ONCE = 500  # runs that one command of Snakemake names: a command line has an end


def cells(workflow: dict[str, Any]) -> Iterator[tuple[Run, str | None]]:
    """(run, file of its region or None) for each cell of a workflow's grid; paths relative to a checkout."""
    per_seed = workflow["values"]["data_per_seed"]
    for alpha, delta, seed in product(workflow["alphas"], workflow["deltas"], workflow["seeds"]):
        data = f"results/{workflow['cells']}/data_{seed if per_seed else 0}"
        free = alpha == "none"
        run = Run(None if free else float(alpha), delta, seed, workflow["steps"])
        yield run, None if free else f"{data}/alpha_{alpha}/region.npz"


def outputs(workflow: dict[str, Any], run: Run) -> dict[str, str]:
    """{name: path relative to a checkout} of what the workflow keeps of a run; run.json comes last."""
    results, executed = f"results/{workflow['cells']}", f"notebooks/executed/{workflow['cells']}"
    files = {name: f"{results}/runs/{run.name}/{name}" for name in ("trials.csv", "curve.csv", "visited.npz")}
    return {
        **files,
        "policy": f"{results}/runs/{run.name}/policy.zip",
        "measures": f"{results}/measures/{NOTEBOOK}__{run.name}.csv",
        "notebook": f"{executed}/runs/{NOTEBOOK}__{run.name}.ipynb",
        "run": f"{results}/runs/{run.name}/run.json",
    }


def expected(run: Run, config: Config, region: Path | None) -> dict[str, Any]:
    """What run.json would say of the run if this checkout trained it, but for results and machine.

    Raises:
        ResultError: the region has not been made here.
    """
    learned = None if region is None else read(existing(region), config, run.delta)
    versions = {name: version(name) for name in PACKAGES}
    origin = {"code": code_hash(), "python": platform.python_version(), "versions": versions}
    return dict(json.loads(json.dumps({**identify(run, config, learned), "provenance": origin})))


def difference(wanted: Any, found: Any, name: str = "") -> str:
    """The first value of ``wanted`` that ``found`` has not, as one line; empty if it has all of them."""
    if not isinstance(wanted, dict):
        same = type(wanted) is type(found) and wanted == found
        return "" if same else f"{name} is {str(found)[:64]!r}, here {str(wanted)[:64]!r}"
    if not isinstance(found, dict):
        return f"{name or 'run.json'} is no table of values"
    parts = (difference(v, found.get(key), f"{name}.{key}".lstrip(".")) for key, v in wanted.items())
    return next((part for part in parts if part), "")


def _check_sizes(folder: Path, files: dict[str, str]) -> None:
    for name in files.values():
        if not bounded(folder / name).resolve().is_relative_to(folder.resolve()):
            raise ResultError(f"{name} is a link that leads out of the folder")
    bounded_archive(folder / files["policy"])


def _sources(notebook: Path) -> list[str]:
    """Sources of the code cells, but for parameters."""
    found = read_json(notebook)
    try:
        return [
            "".join(cell["source"])
            for cell in found["cells"]
            if cell["cell_type"] == "code" and "injected-parameters" not in cell["metadata"].get("tags", [])
        ]
    except (KeyError, TypeError, AttributeError) as error:
        raise ResultError(f"{notebook} is not a notebook") from error


def validate(folder: Path, files: dict[str, str], wanted: dict[str, Any], notebook: Path) -> None:
    """See that the files of a run in another checkout are whole, and what this one would make.

    Args:
        folder: the other checkout.
        files: see `outputs`.
        wanted: see `expected`.
        notebook: the source that this checkout would execute.

    Raises:
        ResultError: they are not; one line says which differs.
    """
    _check_sizes(folder, files)
    result = read_json(folder / files["run"])
    if differs := difference(wanted, result):
        raise ResultError(differs)
    trials = read_table(folder / files["trials.csv"], TRIAL_COLUMNS, numbers=("step", "length", "return"))
    if differs := difference({"counts": count(trials)}, result):
        raise ResultError(f"trials.csv belongs to another run: {differs}")
    read_table(folder / files["curve.csv"], columns := ("step", "mean_return"), numbers=columns)
    visited = read_arrays(folder / files["visited.npz"], VISITED_FORMAT, ("x",))["x"]
    if visited.ndim != 2 or visited.shape[1] != 6 or visited.dtype.kind != "f":
        raise ResultError(f"{files['visited.npz']} holds no states [N, 6]")
    read_table(folder / files["measures"], MEASURE_COLUMNS, numbers=("delta", "seed", "value"))
    if _sources(folder / files["notebook"]) != _sources(notebook):
        raise ResultError(f"{files['notebook']} was executed from another {notebook.name}")


def bring_in(folder: Path, name: str, root: Path) -> tuple[list[str], dict[str, str]]:
    """Copy the finished runs of another checkout that this one's results NAME lack.

    Args:
        folder: the other checkout, or its folders ``results`` and ``notebooks/executed``.
        name: of the results; their ``workflow.json`` says what this checkout would make.
        root: this checkout.

    Returns:
        The executed notebooks that were brought in, and {run: why it was refused}.

    Raises:
        ResultError: the results have no ``workflow.json``.
        ParameterError: it holds a value that is not allowed.
    """
    workflow = check_workflow(read_json(root / "results" / name / "workflow.json"))
    config = Config().with_values(**workflow["settings"])
    accepted, refused = [], {}
    for run, region in cells(workflow):
        files = outputs(workflow, run)
        if (root / files["run"]).exists() or not (folder / files["run"]).exists():
            continue
        try:
            wanted = expected(run, config, None if region is None else root / region)
            validate(folder, files, wanted, root / "notebooks" / f"{NOTEBOOK}.ipynb")
            accepted.append(files)
        except ResultError as error:
            refused[run.name] = str(error)
    for files in accepted:  # a record tells of results that were made here
        (root / files["notebook"]).with_suffix(".json").unlink(missing_ok=True)
    for path in (path for files in accepted for path in files.values()):
        with beside(root / path) as temporary:
            copyfile(folder / path, temporary)
    return [files["notebook"] for files in accepted], refused


def mark_finished(notebooks: list[str], name: str, root: Path) -> None:
    """Let Snakemake record the runs of these executed notebooks as made by this checkout.

    Raises:
        ResultError: it does not.
    """
    command = [sys.executable, "-m", "snakemake", "--cores", "1", "--nolock", "--quiet", "all"]
    command += ["--configfile", f"results/{name}/workflow.json", "--touch", "--force"]
    command += ["--allowed-rules", "training_run", "--"]
    for first in range(0, len(notebooks), AT_ONCE):
        done = subprocess.run([*command, *notebooks[first : first + AT_ONCE]], cwd=root, capture_output=True)
        if done.returncode:
            raise ResultError(f"Snakemake does not take the runs: {done.stderr.decode().splitlines()[-1]}")
