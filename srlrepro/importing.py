"""Runs that another checkout has trained: brought in only if this one would have made the same.

Nothing is written before every run has been looked at (`foreign`). Only runs that the grid of this checkout
names are looked for, so that no name from elsewhere becomes a path.
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

import nbformat

from srlrepro.config import Config
from srlrepro.files import ResultError, beside, existing, read_json
from srlrepro.foreign import validate
from srlrepro.hypotheses import read
from srlrepro.plan import check_workflow
from srlrepro.provenance import PACKAGES, code_hash
from srlrepro.training import Run, identify

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
    updates = -(-run.steps // config.paper.n_steps)
    facts = {"steps_done": updates * config.paper.n_steps, "provenance": origin}
    return dict(json.loads(json.dumps(identify(run, config, learned) | facts)))


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
            source = root / "notebooks" / f"{NOTEBOOK}.ipynb"
            accepted.append((files, validate(folder, files, wanted, source)))
        except ResultError as error:
            refused[run.name] = str(error)
    for files, notebook in accepted:
        (root / files["notebook"]).with_suffix(".json").unlink(missing_ok=True)  # tells of what was made here
        for path in files.values():
            with beside(root / path) as temporary:
                if path == files["notebook"]:
                    nbformat.write(notebook, temporary)
                else:
                    copyfile(folder / path, temporary)
    return [files["notebook"] for files, _ in accepted], refused


def mark_finished(notebooks: list[str], name: str, root: Path) -> None:
    """Let Snakemake record the runs of these executed notebooks as made by this checkout.

    Raises:
        ResultError: it does not.
    """
    command = [sys.executable, "-m", "snakemake", "--cores", "1", "--nolock", "--quiet", "rules"]
    command += ["--configfile", f"results/{name}/workflow.json", "--touch", "--force"]
    command += ["--allowed-rules", "training_run", "--"]
    for first in range(0, len(notebooks), AT_ONCE):
        done = subprocess.run([*command, *notebooks[first : first + AT_ONCE]], cwd=root, capture_output=True)
        if done.returncode:
            reason = " ".join(done.stderr.decode().splitlines()[-2:])
            raise ResultError(f"Snakemake does not take the runs: {reason}")
