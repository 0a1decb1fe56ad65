"""Executing a parameterised notebook so that "executed" can be trusted.

papermill runs the notebook; around it: parameters are checked by name and type before the launch, the
output is written beside and renamed, and a notebook counts as executed only if papermill returned, every
code cell ran, and every result file that the notebook promises is new.
"""

import ast
import hashlib
import json
import logging
import math
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, cast

from srlrepro.pins import ARITHMETIC, pins
from srlrepro.settings.condition import NONE, Condition, alpha_text
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError, check, one_line
from srlrepro.storage.files import (
    ResultError,
    beside,
    existing,
    read_json,
    require_writable,
    sha256,
    write_json,
)
from srlrepro.storage.provenance import MADE_BY, provenance
from workflow.command_line import COMMAND_VARIABLE
from workflow.plan import setting_texts
from workflow.sources import code_of

IRI_GRAMMAR = "rfc3987_syntax"  # of IRIs: the validator takes two seconds to build it; no notebook holds one
LONGEST_RECORD = 2**16  # Linux takes 128 KiB in a variable
SETTINGS = "SETTINGS"
NAMES = ("ID", "UNIVERSES", "RUNS")
COMPARED = "# NBVAL_CHECK_OUTPUT"
INJECTED = "injected-parameters"  # papermill's tag
ADDRESS = re.compile(r" at 0x[0-9a-f]+>")  # as Python shows an object that says nothing else of itself
WITHOUT_CHECKSUM = (".csv", ".json")  # archives carry checksums of their own


def parameters_of(notebook: Path) -> dict[str, Any]:
    """{name: value} that the notebook's one cell tagged ``parameters`` assigns; read, not executed.

    Raises:
        ResultError: no such notebook, not exactly one such cell, or one that assigns more than plain values.
    """
    found = read_json(notebook)
    try:
        tagged = [cell for cell in found["cells"] if "parameters" in cell["metadata"].get("tags", [])]
        sources = ["".join(cell["source"]) for cell in tagged]
        assigned = [node for node in ast.parse("\n".join(sources)).body if isinstance(node, ast.Assign)]
        values = {ast.unparse(node.targets[0]): ast.literal_eval(node.value) for node in assigned}
    except Exception as error:  # what is no notebook fails in many ways, and so does what ast reads
        raise ResultError(f"{notebook} is no notebook, or its cell tagged 'parameters' computes") from error
    if len(sources) != 1:
        raise ResultError(f"{notebook} has {len(sources)} cells tagged 'parameters' instead of one")
    return values


def _fits(value: Any, default: Any) -> bool:
    """Whether a value has the type of a default, and the parts of a list that of the default's first part."""
    if isinstance(default, list):
        return isinstance(value, list) and all(_fits(part, first) for part in value for first in default[:1])
    kinds = (int, float) if isinstance(default, float) else type(default)
    return isinstance(value, kinds) and isinstance(value, bool) == isinstance(default, bool)


def _texts(value: Any) -> list[Any]:
    """A value, or what a list or a table holds."""
    return list(value.values()) if isinstance(value, dict) else value if isinstance(value, list) else [value]


def check_parameters(notebook: Path, given: Any) -> None:
    """See that every given parameter is one of the notebook's and has the type of its default.

    Those that set the configuration (`SETTINGS`) are tried on it; those that name a folder (`NAMES`), or
    several, must not lead out of it.

    Raises:
        ParameterError: no table, an unknown name, another type, or a value that is not allowed.
    """
    defaults = parameters_of(notebook)
    check(isinstance(given, dict), "--parameters", given, "a table {NAME: value}")
    try:
        json.dumps(given, ensure_ascii=False, allow_nan=False).encode()
    except ValueError as error:  # half a surrogate pair, or a number that is none
        raise ParameterError(f"--parameters = {one_line(given)}: must be JSON in UTF-8 ({error})") from None
    for name, value in given.items():
        check(
            name in defaults, name, value, f"one of the parameters of {notebook.name}: {', '.join(defaults)}"
        )
        kind = f"a {type(defaults[name]).__name__} such as {one_line(repr(defaults[name]))}"
        check(_fits(value, defaults[name]), name, repr(value), f"{kind}, as in {notebook.name}")
        if name == SETTINGS:
            Config().with_values(**value)
        if name in NAMES:
            for folder in _texts(value):
                inside = (
                    isinstance(folder, str) and folder not in ("", ".", "..") and not set(folder) & {*"/\0"}
                )
                check(inside, name, folder, "the name of a folder, without /")


def execute(
    notebook: Path,
    output: Path,
    parameters: dict[str, Any],
    results: Iterable[Path] = (),
    limit: float | None = None,
) -> None:
    """Execute a notebook in its own folder and write the executed copy, and beside it (.json) what made it.

    Args:
        notebook, output: the source and the executed notebook (.ipynb), which is another file.
        parameters: values for the cell tagged ``parameters``; paths among them relative to the notebook.
        results: files that the notebook writes; each must be new.
        limit: s for one cell, after which its kernel is killed; None: it may take for ever.

    Raises:
        ParameterError: an unknown parameter, or one of another type.
        ResultError: a cell failed, did not run or reached the limit, its kernel died, or a result is missing.
    """
    with _without(IRI_GRAMMAR):
        import nbformat
        import papermill
        from nbclient.exceptions import CellTimeoutError
        from traitlets.config import Config as TraitletsConfig

    logging.getLogger("papermill").setLevel(logging.WARNING)
    check_parameters(notebook, parameters)
    other = output.suffix == ".ipynb" and output.resolve() != notebook.resolve()
    check(other, "output", output, "another file than the notebook, with the suffix .ipynb")
    require_writable(output.parent)
    results, record = list(results), output.with_suffix(".json")
    record.unlink(missing_ok=True)
    before, started, code = [_written(path) for path in results], time.monotonic(), code_of(str(notebook))
    with beside(output) as temporary, tempfile.TemporaryDirectory() as private, _told(pins()):
        os.environ.update(IPYTHONDIR=private, JUPYTER_RUNTIME_DIR=private)
        os.environ[MADE_BY] = _made_by(notebook, parameters)
        transport = {"transport": "ipc", "ip": f"{private}/kernel"}  # kernels side by side race for ports
        try:
            papermill.execute_notebook(
                notebook,
                temporary,
                parameters,
                cwd=notebook.parent,
                kernel_name="python3",
                progress_bar=False,
                execution_timeout=None if limit is None else math.ceil(limit),
                shutdown_kernel="immediate",  # at its end all is written, and a busy one listens to nobody
                config=TraitletsConfig({"KernelManager": transport}),
            )
        except papermill.PapermillExecutionError as error:
            failed = f"{error.ename}: {error.evalue}".splitlines()[0]
            raise ResultError(f"{notebook.name}, cell {error.cell_index}: {failed}") from error
        except (RuntimeError, CellTimeoutError) as error:  # the former of kernels that die
            raise ResultError(f"{notebook.name}: {str(error).splitlines()[0]}") from error
        executed = nbformat.read(temporary, as_version=4)
        ran = [
            cell.execution_count
            for cell in executed.cells
            if cell.cell_type == "code" and cell.source.strip()
        ]
        if None in ran:
            raise ResultError(f"{notebook.name}: {ran.count(None)} of {len(ran)} code cells never ran")
        for path, old in zip(results, before, strict=True):
            if _written(existing(path)) == old:
                raise ResultError(f"{notebook.name} left an old {path} in place")
        forget_machine(executed)
        nbformat.write(executed, temporary)
        made = provenance(time.monotonic() - started, resource.RUSAGE_CHILDREN, code)
        digests = {str(path): sha256(path) for path in results if path.suffix in WITHOUT_CHECKSUM}
        write_json(record, {"parameters": parameters} | made | {"sha256": digests})


def _made_by(notebook: Path, parameters: dict[str, Any]) -> str:
    """What a notebook's figures carry as their record, JSON of at most `LONGEST_RECORD` characters.

    No digest of the sources is in it: better words in one of them shall change no figure.
    """
    made = {"notebook": notebook.name, "parameters": parameters, "arithmetic": ARITHMETIC}
    made["command"] = os.environ.get(COMMAND_VARIABLE, "")
    text = json.dumps(made, ensure_ascii=True, sort_keys=True)
    if len(text) > LONGEST_RECORD:
        made["parameters"] = {"sha256": hashlib.sha256(text.encode()).hexdigest()}
        text = json.dumps(made, ensure_ascii=True, sort_keys=True)
    return text


@contextmanager
def _told(values: dict[str, str]) -> Iterator[None]:
    """Variables for a kernel that starts here; what is set until the end is taken back then."""
    before = dict(os.environ)
    os.environ.update(values)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


@contextmanager
def _without(module: str) -> Iterator[None]:
    """Let imports fail to find a module that is optional to them, for a while."""
    before = sys.modules.get(module)
    sys.modules[module] = cast(ModuleType, None)
    try:
        yield
    finally:
        if before is None:
            del sys.modules[module]
        else:
            sys.modules[module] = before


def _written(path: Path) -> tuple[int, int] | None:
    """What changes when a file is written, by whatever clock; None if there is no file."""
    if not path.exists():
        return None
    status = path.stat()
    return status.st_ino, status.st_mtime_ns


def require_undamaged(folders: Iterable[Path], root: Path) -> None:
    """See that the results of all executed notebooks below folders are as these wrote them.

    A result that is missing is no damage: the workflow makes it again. Nor are those looked at whose notebook
    has not been executed to its end, or whose record holds no digests.

    Args:
        root: the folder from which the paths of results start.

    Raises:
        ResultError: a result has another content, or a record is damaged itself.
    """
    found = {}
    for notebook in (path for folder in folders for path in sorted(folder.rglob("*.ipynb"))):
        record = notebook.with_suffix(".json")
        made = read_json(record) if record.exists() else {}
        digests = made.get("sha256", {}) if isinstance(made, dict) else None
        if not isinstance(digests, dict):
            raise ResultError(f"{record} is no record of what a notebook wrote")
        for name, digest in digests.items():
            if Path(name).is_absolute() or ".." in Path(name).parts or "\0" in name:
                raise ResultError(f"{record} names a file outside of the results: {one_line(name)}")
            if (root / name).exists() and sha256(existing(root / name)) != digest:
                found[name] = notebook.name
    if found:
        name, writer = next(iter(found.items()))
        others = f" (and {len(found) - 1} others)" if len(found) > 1 else ""
        raise ResultError(f"{name}{others} is not as {writer} wrote it: delete it to have it made again")


def forget_machine(notebook: Any) -> None:
    """Drop times, versions, addresses and papermill's books: the same results give the same notebook."""
    notebook.metadata.pop("papermill", None)
    notebook.metadata.get("language_info", {}).pop("version", None)  # of Python, to the last patch
    for cell in notebook.cells:
        cell.metadata.pop("papermill", None)
        cell.metadata.pop("execution", None)
        cell.pop("id", None)
        for data in (output["data"] for output in cell.get("outputs", []) if "data" in output):
            if "text/plain" in data:
                data["text/plain"] = ADDRESS.sub(">", data["text/plain"])
    notebook.nbformat_minor = 4  # the last format without cell ids, which papermill draws at random


def prepare(notebook: Path) -> None:
    """Make what a source notebook reads when it runs with its own (smoke) parameters, as the rules would.

    That are data and regions of its α, and the measures of its runs.
    """
    values = parameters_of(notebook)
    results, seed = notebook.parent / values["RESULTS"], str(values.get("DATA_SEED", 0))
    runs = [Condition.parse(name) for name in values.get("RUNS", [])]
    alphas = {alpha_text(float(alpha)) for alpha in values.get("ALPHAS", []) if alpha != NONE}
    alphas |= {run.alpha_text for run in runs if run.alpha is not None}
    settings = ["--set", *setting_texts(values["SETTINGS"])]
    for alpha in sorted(alphas):
        folder = results / f"data_{seed}" / f"alpha_{alpha}"
        data, region = str(folder / "training_data.npz"), folder / "region.npz"
        if not region.exists():
            _call("srlrepro", "data", "--alpha", alpha, "--seed", seed, "--out", data, *settings)
            _call("srlrepro", "region", "--data", data, "--seed", seed, "--out", str(region), *settings)
    for run in runs:
        made, region = (
            results / "runs" / run.name,
            results / f"data_{seed}" / f"alpha_{run.alpha_text}" / "region.npz",
        )
        if (made / "run.json").exists() and not (made / "measures.csv").exists():
            by = [] if run.alpha is None else ["--region", str(region)]
            _call("replication", "measure", str(made / "run.json"), "--out", str(made / "measures.csv"), *by)


def _call(house: str, *arguments: str) -> None:
    subprocess.run([sys.executable, "-m", house, *arguments], check=True, stdout=subprocess.DEVNULL)


def snapshot(notebook: Path) -> None:
    """Execute a source notebook with its own (smoke) parameters, and keep the outputs that its test compares.

    Those are the outputs of the cells that start with nbval's mark; a change of a result is then a change
    of the source notebook, to be looked at and committed.
    """
    import nbformat

    prepare(notebook)
    with tempfile.TemporaryDirectory() as folder:
        executed = Path(folder, notebook.name)
        execute(notebook, executed, {})
        result = nbformat.read(executed, as_version=4)
    result.cells = [c for c in result.cells if INJECTED not in c.metadata.get("tags", [])]
    for cell in result.cells:
        if cell.cell_type == "code":
            kept = cell.source.startswith(COMPARED)
            cell.execution_count = cell.execution_count if kept else None  # nbval skips cells that never ran
            cell.outputs = [o for o in cell.outputs if kept and o.output_type == "stream"]
    with beside(notebook) as temporary:
        nbformat.write(result, temporary)
