"""Files from elsewhere: damaged, foreign or made to harm, they are refused in one line and run nothing."""

import ast
import json
import pickle
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learned import Learned
from runs import FREE, STOCK

from srlrepro.learner import VISITED_FORMAT
from srlrepro.learner.policy import TrainedPolicy, load_policy
from srlrepro.learner.training import make_env, make_learner
from srlrepro.region.safe_region import SafeRegion
from srlrepro.samplers import TrainingData
from srlrepro.settings.fields import ParameterError
from srlrepro.storage import files
from srlrepro.storage.files import ResultError, read_arrays, read_json, read_table
from workflow.notebooks import check_parameters, parameters_of
from workflow.sources import HOUSES

ROOT = Path(__file__).parent.parent
SOURCES = sorted(p for house in (*HOUSES, "benchmarks") for p in (ROOT / house).rglob("*.py"))
SOURCES += [ROOT / "workflow" / "Snakefile", *sorted(ROOT.glob("workflow/rules/*.smk"))]
NOTEBOOKS = sorted(ROOT.glob("notebooks/*.ipynb"))
DAMAGES = 60  # of each file: half of them cut short, half with some bytes changed


def damaged(content: bytes, rng: np.random.Generator) -> Iterator[bytes]:
    """A file's content, cut somewhere or with up to eight bytes changed."""
    for n in range(DAMAGES):
        if n % 2:
            yield content[: rng.integers(len(content))]
            continue
        changed = bytearray(content)
        for position in rng.integers(len(content), size=rng.integers(1, 9)):
            changed[position] ^= int(rng.integers(1, 256))
        yield bytes(changed)


def test_a_damaged_file_is_refused_or_reads_as_it_was(
    small: Learned, tmp_path: Path, rng: np.random.Generator
) -> None:
    """Archives carry check sums; text does not, so that a changed digit is another value."""
    data, region = small
    data.save(tmp_path / "data.npz")
    region.save(tmp_path / "region.npz")
    (tmp_path / "trials.csv").write_text("step,return,outcome\n" + "64,1.5,time limit\n" * 40)
    TrainedPolicy.of(make_learner(make_env(FREE, STOCK, None), STOCK, seed=5)).save(tmp_path / "policy.npz")
    (tmp_path / "notebook.ipynb").write_bytes(NOTEBOOKS[4].read_bytes())
    readers: dict[str, Callable[[Path], Any]] = {
        "data.npz": lambda path: TrainingData.load(path).x.tobytes(),
        "region.npz": lambda path: SafeRegion.load(path).digest(),
        "policy.npz": lambda path: b"".join(w.tobytes() for w in load_policy(path).weights),
        "trials.csv": lambda path: read_table(path, ("step", "return"), numbers=("step", "return")),
        "notebook.ipynb": parameters_of,
    }
    for name, reader in readers.items():
        path, refused = tmp_path / name, 0
        content, whole = path.read_bytes(), reader(path)
        for spoilt in damaged(content, rng):
            path.write_bytes(spoilt)
            try:
                found = reader(path)
            except (ResultError, ParameterError) as error:
                assert str(error).isprintable()
                refused += 1
            else:
                assert path.suffix != ".npz" or found == whole, name
        assert refused > DAMAGES / 4, name


def with_part(path: Path, name: str, content: bytes) -> None:
    """Write an archive's part again."""
    with zipfile.ZipFile(path) as archive:
        parts = {part: archive.read(part) for part in archive.namelist()} | {name: content}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for part, data in parts.items():
            archive.writestr(part, data)


def header(descr: str, shape: str) -> bytes:
    """An array without its data, whose header promises them."""
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


HARMFUL = {
    "more than there is": header("'<f8'", "(1000000000000000,)"),
    "more than can be counted": header("'<f8'", "(99999999999999999999, 6)"),
    "a negative shape": header("'<f8'", "(-1, 6)"),
    "a nested header": header("(" * 4000, "()"),
    "an object": header("'|O'", "(1,)") + pickle.dumps([print]),
}
ODD = {
    "complex": np.zeros((3, 6), complex),
    "dates": np.zeros((3, 6), "M8[s]"),
    "records": np.zeros(3, [("a", "f8")]),
    "swapped bytes": np.zeros((3, 6), ">f8"),
    "bytes": np.zeros(3, "S4"),
}


@pytest.mark.parametrize("kind", [*HARMFUL, *ODD])
def test_an_array_of_another_kind_is_refused(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "visited.npz"
    files.write_arrays(path, VISITED_FORMAT, x=ODD.get(kind, np.zeros(1)))
    if kind in HARMFUL:
        with_part(path, "x.npy", HARMFUL[kind])
    with pytest.raises(ResultError, match=r"visited\.npz"):
        read_arrays(path, VISITED_FORMAT, ("x",))


def test_what_is_too_large_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file, and what it unpacks to."""
    monkeypatch.setattr(files, "LARGEST", 100_000)
    path = tmp_path / "a.npz"
    files.write_arrays(path, VISITED_FORMAT, x=np.zeros(50_000))
    with pytest.raises(ResultError, match="unpacks to 4"):
        read_arrays(path, VISITED_FORMAT, ("x",))
    for read in (read_json, lambda p: read_table(p, ()), parameters_of):
        (tmp_path / "a").write_bytes(b"1" * 100_001)
        with pytest.raises(ResultError, match="has 100001 bytes, more than 100000"):
            read(tmp_path / "a")


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        '{"a":' * 50_000,
        '{"a": 1, "a": 2}',
        "[NaN]",
        "-Infinity",
        "9" * 5000,
        "\ufeff{}",
        "{}\n{}",
    ],
)
def test_json_that_others_would_not_read_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(text, encoding="utf-8")
    for read in (read_json, parameters_of):
        with pytest.raises(ResultError, match=r"run\.json is truncated or not JSON"):
            read(tmp_path / "run.json")


def test_a_table_with_words_for_numbers_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("step,outcome\n1,x\ntwo,y\n")
    with pytest.raises(ResultError, match="no numbers in the columns step"):
        read_table(tmp_path / "a.csv", ("outcome",), numbers=("step",))


@pytest.mark.parametrize("folder", ["../x", "/x", "..", "", "a/../..", "a\0"])
def test_names_of_notebooks_lead_nowhere_else(folder: str) -> None:
    by_name = {path.stem[:2]: path for path in NOTEBOOKS}
    for number, given in (
        ("13", {"ID": folder}),
        ("06", {"RUNS": ["alpha_0__delta_1.1__seed_0", folder]}),
        ("14", {"UNIVERSES": [folder]}),
        ("15", {"UNIVERSES": {"tsne": folder}}),
    ):
        with pytest.raises(ParameterError, match="the name of a folder"):
            check_parameters(by_name[number], given)


def code(path: Path) -> Iterator[ast.AST]:
    """The syntax tree of a module, or of a notebook's cells."""
    if path.suffix == ".ipynb":
        cells = json.loads(path.read_text())["cells"]
        text = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    else:
        text = path.read_text() if path.suffix == ".py" else ""
    yield from ast.walk(ast.parse(text))


RUNS_CODE = {
    "pickle",
    "cPickle",
    "_pickle",
    "cloudpickle",
    "dill",
    "joblib",
    "shelve",
    "marshal",
    "jsonpickle",
}
READERS = ("eval", "exec", "torch.load", "pd.read_pickle", "yaml.load", "runpy.run_path", "np.fromfile")


def what_could_run_code(paths: list[Path]) -> list[tuple[str, str]]:
    """Beside the linter's rules: pickle by any name, and readers of numpy, torch or PPO that take one."""
    found = []
    for path in paths:
        for node in code(path):
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                modules = {getattr(node, "module", None), *(alias.name for alias in node.names)}
                found += [(path.name, name) for name in modules if name and name.split(".")[0] in RUNS_CODE]
            if not isinstance(node, ast.Call):
                continue
            name, options = ast.unparse(node.func), {k.arg: ast.unparse(k.value) for k in node.keywords}
            array = name.endswith("np.load") and options.get("allow_pickle") != "False"
            owner = name.rpartition(".")[0].lower()
            learner = name.endswith(".load") and ("ppo" in owner or "type(" in owner or "model" in owner)
            learner |= name.endswith(".load") and bool(set(options) & {"device", "env", "custom_objects"})
            allowed = (
                options.get("allow_pickle", "False") != "False" or options.get("weights_only") == "False"
            )
            if name in READERS or array or learner or allowed:
                found.append((path.name, name))
    return found


def test_nothing_reads_what_could_run_code() -> None:
    assert len(SOURCES) > 60 and len(NOTEBOOKS) > 10
    assert what_could_run_code([*SOURCES, *NOTEBOOKS]) == []


@pytest.mark.parametrize(
    "line",
    [
        "import pickle",
        "from joblib import load",
        "import cloudpickle as c",
        "torch.load(path)",
        "np.load(path)",
        "np.load(path, allow_pickle=True)",
        "PPO.load(path)",
        "type(fresh).load(path)",
        "model.load(path, device='cpu')",
        "torch.jit.load(path, weights_only=False)",
    ],
)
def test_the_search_finds(line: str, tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text(line)
    assert len(what_could_run_code([tmp_path / "bad.py"])) == 1
