"""What another checkout made of a run: checked before this one takes it for its own.

What was trained elsewhere is known from its run.json: parameters, every value, the region's digest, the hash
of the code, and versions. What is computed of the trials is computed again, and compared.

The numbers of the trials are taken on trust: what refuses a run of other code, a mixed-up or a damaged one
does not refuse a forged one, which only training here would show. No code is: no pickle is read (policy.zip
is copied, and later read for its weights alone), and of a notebook's outputs only text and pictures are kept,
no HTML and no script.
"""

import base64
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pandas as pd

from srlrepro.claims import MEASURE_COLUMNS
from srlrepro.evaluation import measure_rows, run_measures
from srlrepro.files import ResultError, bounded, bounded_archive, existing, read_arrays, read_json, read_table
from srlrepro.notebooks import INJECTED, forget_machine
from srlrepro.recording import TRIAL_COLUMNS, count, curve_window, learning_curve
from srlrepro.training import VISITED_FORMAT

ERRORS = ("generalization_error", "false_positives")  # measures of a supervised run beside `run_measures`


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


def _finite(numbers: Any, name: str) -> None:
    if not np.isfinite(np.asarray(numbers)).all():
        raise ResultError(f"{name} holds numbers that are not finite")


def _check_equal(found: pd.DataFrame, wanted: pd.DataFrame, name: str) -> None:
    try:
        pd.testing.assert_frame_equal(found, wanted, check_dtype=False, rtol=1e-9)  # digits lost in the file
    except AssertionError as error:
        raise ResultError(f"{name} does not follow from trials.csv and run.json") from error


def _check_tables(folder: Path, files: dict[str, str], result: dict[str, Any]) -> None:
    """See that the numbers of a run are finite, and that what is computed of its trials follows from them."""
    trials = read_table(folder / files["trials.csv"], TRIAL_COLUMNS, numbers=("step", "length", "return"))
    _finite(trials[["step", "length", "return"]].astype(float), files["trials.csv"])  # object if empty
    if differs := difference({"counts": count(trials)}, result):
        raise ResultError(f"trials.csv belongs to another run: {differs}")
    window, steps = curve_window(result["steps_done"], result["config"]["n_steps"]), result["steps_done"]
    curve = learning_curve(trials, window, -(-steps // window))
    _check_equal(read_table(folder / files["curve.csv"], tuple(curve.columns)), curve, files["curve.csv"])
    visited = read_arrays(folder / files["visited.npz"], VISITED_FORMAT, ("x",))["x"]
    if visited.ndim != 2 or visited.shape[1] != 6 or visited.dtype.kind != "f":
        raise ResultError(f"{files['visited.npz']} holds no states [N, 6]")
    _finite(visited, files["visited.npz"])

    run, measures = result["run"], read_table(folder / files["measures"], MEASURE_COLUMNS, numbers=("value",))
    values = run_measures(result, trials)
    if run["alpha"] is not None:
        rest = measures["value"].tolist()[len(values) :]
        values |= dict(zip(ERRORS, rest, strict=False))
        if len(rest) != len(ERRORS) or not all(0 <= error <= 1 for error in rest):
            raise ResultError(f"{files['measures']} holds no {' and '.join(ERRORS)} in [0, 1]")
    rows = measure_rows(values, "none" if run["alpha"] is None else run["alpha"], run["delta"], run["seed"])
    _check_equal(measures, pd.DataFrame(rows, columns=list(MEASURE_COLUMNS)), files["measures"])


def _plain(output: dict[str, Any]) -> Any:
    """An output of a cell without what a browser could run."""
    if output["output_type"] == "stream":
        return nbformat.v4.new_output("stream", name="stdout", text="".join(output["text"]))
    shown = {"text/plain": "".join(output["data"]["text/plain"])}
    if "image/png" in output["data"]:
        picture = base64.b64decode("".join(output["data"]["image/png"]))
        shown["image/png"] = base64.b64encode(picture).decode()
    return nbformat.v4.new_output("display_data", shown)


def _is_given(cell: dict[str, Any]) -> bool:
    return INJECTED in cell["metadata"].get("tags", [])


def _executed(folder: Path, name: str, notebook: Path) -> Any:
    """A notebook as this checkout has it, with the parameters and outputs that another executed it with."""
    found, made = read_json(folder / name), nbformat.read(existing(notebook), as_version=4)
    try:
        cells = [(cell["cell_type"], "".join(cell["source"]), cell) for cell in found["cells"]]
        sources = [(kind, source) for kind, source, cell in cells if not _is_given(cell)]
        if sources != [(cell.cell_type, cell.source) for cell in made.cells]:
            raise ResultError(f"{name} was executed from another {notebook.name}")
        for i, (_, source, cell) in enumerate(cells):
            if _is_given(cell):
                made.cells.insert(i, nbformat.v4.new_code_cell(source, metadata={"tags": [INJECTED]}))
            if made.cells[i].cell_type == "code":
                made.cells[i].execution_count = int(cell["execution_count"])
                made.cells[i].outputs = [_plain(output) for output in cell["outputs"]]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ResultError(f"{name} is not an executed notebook") from error
    forget_machine(made)
    return made


def validate(folder: Path, files: dict[str, str], wanted: dict[str, Any], notebook: Path) -> Any:
    """See that the files of a run in another checkout are whole, and what this one would make.

    Args:
        folder: the other checkout.
        files: see `outputs`.
        wanted: see `expected`.
        notebook: the source that this checkout would execute.

    Returns:
        The executed notebook, without what a browser could run.

    Raises:
        ResultError: they are not; one line says which differs.
    """
    _check_sizes(folder, files)
    result = read_json(folder / files["run"])
    if differs := difference(wanted, result):
        raise ResultError(differs)
    try:
        for place in ("own condition", "no supervisor"):
            _finite(result["final_policy"][place]["return"], files["run"])
        _finite([result["provenance"][cost] for cost in ("seconds", "peak_memory_mb")], files["run"])
    except (KeyError, TypeError) as error:
        raise ResultError(f"{files['run']} lacks the final policy's return, or what the run took") from error
    _check_tables(folder, files, result)
    return _executed(folder, files["notebook"], notebook)
