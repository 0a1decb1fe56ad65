"""Forged files at every reader: one line, exit status 1 or 2, and no effect.

The readers are command lines, as a stranger's file would meet them. Each gets a file that it takes, changed
in one way.
"""

import io
import json
import os
import pickle
import resource
import shutil
import sys
import zipfile
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plans import planned
from runs import CONFIG, SUPERVISED, UPDATE, Case, interrupt

from replication.__main__ import main as replication
from srlrepro.__main__ import main as srlrepro
from srlrepro.region.safe_region import learn_region
from srlrepro.samplers import generate
from srlrepro.settings.config import Config
from srlrepro.storage import files
from workflow import driver, engine, plan, verify

LIMIT = 4 * 2**20  # bytes of a file here, so that bombs are small; a checkpoint may have what its learner has
MEMORY = 64 * 2**20  # bytes that a refusal may take beyond what was used before
VARIED = {name: value for name, value in CONFIG.as_dict().items() if value != Config().as_dict()[name]}
VARIED |= {"k": 40, "random_rollouts": 60}
SETTINGS = ["--set", *(f"{name}={str(value).lower()}" for name, value in VARIED.items())]
TRAIN = ["train", "--alpha", "0.5", "--delta", "1.5", "--seed", "3", "--steps", str(SUPERVISED.steps)]


class Trap:
    """Unpickled, it makes a folder."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.path),)


def parts(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def pack(path: Path, members: list[tuple[str, bytes]], method: int = zipfile.ZIP_DEFLATED) -> None:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, content in members:
            archive.writestr(zipfile.ZipInfo(name), content, method)


def header(descr: str, shape: str) -> bytes:
    """An array without its data, whose header promises them."""
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


def stored(array: Any) -> bytes:
    content = io.BytesIO()
    np.save(content, array, allow_pickle=True)
    return content.getvalue()


def original(path: Path, name: str) -> np.ndarray:
    return np.load(io.BytesIO(parts(path)[name]))


def other(change: Callable[[np.ndarray], Any]) -> Callable[[Path, str], None]:
    """Put something else in the place of an archive's main array."""

    def forge(path: Path, name: str) -> None:
        pack(path, list((parts(path) | {name: stored(change(original(path, name)))}).items()))

    return forge


def first(value: float) -> Callable[[Path, str], None]:
    """One number of the main array is another."""

    def change(array: np.ndarray) -> np.ndarray:
        array.flat[0] = value
        return array

    return other(change)


def raw(content: bytes) -> Callable[[Path, str], None]:
    """The bytes of the main array are others."""
    return lambda path, name: pack(path, list((parts(path) | {name: content}).items()))


def cut(share: float) -> Callable[[Path, str], None]:
    return lambda path, _: path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)]) and None


def twice(path: Path, name: str) -> None:
    with pytest.warns(UserWarning, match="Duplicate"):
        pack(path, [*parts(path).items(), (name, parts(path)[name])])


def understated(path: Path, name: str) -> None:
    """The directory of the archive states fewer bytes than unpack."""
    length = len(parts(path)[name])
    content = path.read_bytes()
    path.write_bytes(content.replace(length.to_bytes(4, "little"), (length // 2).to_bytes(4, "little")))


def encrypted(path: Path, name: str) -> None:
    content = bytearray(path.read_bytes())
    content[content.rindex(b"PK\x01\x02") + 8] |= 1
    content[6] |= 1
    path.write_bytes(content)


def replaced(make: Callable[[Path], Any]) -> Callable[[Path, str], None]:
    """Something that is no regular file."""

    def forge(path: Path, _: str) -> None:
        path.unlink()
        make(path)

    return forge


def trapped(path: Path, name: str) -> None:
    pack(path, list((parts(path) | {name: stored(np.array([Trap(path.parent / "mark")], object))}).items()))


ARCHIVES: dict[str, Callable[[Path, str], None]] = {
    "a pickle": lambda path, _: path.write_bytes(pickle.dumps(Trap(path.parent / "mark"))) and None,
    "a pickle inside": trapped,
    "a pickle as a part": lambda path, name: raw(pickle.dumps(Trap(path.parent / "mark")))(path, name),
    "a bomb": raw(header("'<f8'", "(1000000,)") + bytes(2 * LIMIT)),
    "a bomb beside": lambda path, _: pack(path, [*parts(path).items(), ("more.npy", bytes(2 * LIMIT))]),
    "fewer bytes stated": understated,
    "more than there is": raw(header("'<f8'", "(1000000000000000,)")),
    "more than can be counted": raw(header("'<f8'", "(99999999999999999999, 6)")),
    "a negative shape": raw(header("'<f8'", "(-1, 6)")),
    "a nested header": raw(header("(" * 4000, "()")),
    "a header that computes": raw(header("__import__('os').mkdir('mark')", "(6,)")),
    "float16": other(lambda a: a.astype(np.float16)),
    "other floats": other(lambda a: a.astype(np.float32 if a.dtype == np.float64 else np.float64)),
    "long doubles": other(lambda a: a.astype(np.longdouble)),
    "complex": other(lambda a: a.astype(complex)),
    "whole numbers": other(lambda a: a.astype(np.int64)),
    "text": other(lambda a: a.astype("U8")),
    "bytes": other(lambda a: a.astype("S8")),
    "dates": other(lambda a: a.astype("i8").astype("M8[s]")),
    "records": other(lambda a: np.zeros(a.shape, [("a", "f8")])),
    "swapped bytes": other(lambda a: a.astype(a.dtype.newbyteorder(">"))),
    "NaN": first(np.nan),
    "infinity": first(np.inf),
    "no rows": other(lambda a: a[:0] if a.ndim else a.reshape(1)[:0]),
    "one dimension more": other(lambda a: a[None]),
    "turned": other(lambda a: a.T if a.ndim > 1 else np.repeat(a, 2)),
    "empty": lambda path, _: path.write_bytes(b"") and None,
    "cut early": cut(0.1),
    "cut late": cut(0.97),
    "a part twice": twice,
    "a part missing": lambda path, name: pack(path, [p for p in parts(path).items() if p[0] != name]),
    "another format": lambda path, _: pack(
        path, list((parts(path) | {"format.npy": stored(np.array("other-1"))}).items())
    ),
    "encrypted": encrypted,
    "a device": replaced(lambda path: path.symlink_to("/dev/zero")),
    "a pipe": replaced(os.mkfifo),
    "a folder": replaced(Path.mkdir),
    "a link to itself": replaced(lambda path: path.symlink_to(path)),
}
TEXTS: dict[str, bytes] = {
    "a pickle": pickle.dumps([print]),
    "empty": b"",
    "NUL": bytes(100),
    "no UTF-8": b"\xff\xfe\x00\x9f",
    "nested": b"[" * 100_000,
    "a list": b"[]",
    "a number": b"7",
    "twice": b'{"run": 1, "run": 2}',
    "NaN": b'{"run": NaN}',
    "infinite": b'{"run": 1e999}',
    "a long number": b'{"run": ' + b"9" * 5000 + b"}",
    "too large": b"1" * (2 * LIMIT),
}


@pytest.fixture(scope="module")
def genuine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one file of each kind, which all commands take."""
    place = tmp_path_factory.mktemp("genuine")
    config = Config().with_values(**VARIED)
    data = generate(0.5, config, 0)
    data.save(place / "data.npz")
    region = learn_region(data, config)
    region.save(place / "region.npz")
    case = Case("forged", SUPERVISED, region, config)
    case.train(place / "run")
    interrupt(case, place / "begun", 3 * UPDATE)
    out = ["--region", str(place / "region.npz"), "--out", str(place / "measures.csv")]
    with redirect_stdout(io.StringIO()):
        assert replication(["measure", str(place / "run"), *out]) == 0
    files.write_json(place / "figures" / "forged" / "workflow.json", planned("--name", "forged"))
    return place


READ = {  # {file: its main array, and the command that reads it}
    "data.npz": ("x.npy", srlrepro, ["region", "--data", "data.npz", "--out", "new.npz", *SETTINGS]),
    "region.npz": (
        "array_y_train.npy",
        srlrepro,
        [*TRAIN, "--region", "region.npz", "--out", "new", *SETTINGS],
    ),
    "begun/checkpoint.zip": (
        "weight.action_net.weight.npy",
        srlrepro,
        [*TRAIN, "--region", "region.npz", "--out", "begun", *SETTINGS],
    ),
    "run/visited.npz": (
        "x.npy",
        replication,
        ["measure", "run", "--region", "region.npz", "--out", "new.csv"],
    ),
    "run/policy.npz": ("weight_0.npy", replication, ["policies", "run/policy.npz", "--out", "new"]),
}
SET = "figures/forged/workflow.json"
TABLES = {  # the same of texts
    **dict.fromkeys(("run/run.json", "run/trials.csv", "run/curve.csv"), READ["run/visited.npz"][1:]),
    "measures.csv": (replication, ["claims", "measures.csv"]),
    SET: (driver.main, ["--name", "forged"]),
}
HARMLESS = {("run/visited.npz", "other floats")}  # read as what it says


def snapshot(folder: Path) -> list[tuple[str, int, bytes]]:
    found = [(str(p.relative_to(folder)), p.lstat().st_mode, p) for p in sorted(folder.rglob("*"))]
    return [(name, mode, p.read_bytes() if p.is_file() else b"") for name, mode, p in found]


def refusal(main: Callable[[list[str]], int], line: list[str], memory: int = MEMORY) -> str:
    """The one line with which a command refuses; that it takes no more memory than it may is seen too."""
    out, error = io.StringIO(), io.StringIO()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with redirect_stdout(out), redirect_stderr(error):
        try:
            status = main(line)
        except SystemExit as stop:
            status = int(stop.code or 0)
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 < memory
    text = error.getvalue()
    assert status in (1, 2) and out.getvalue() == "", (status, text, out.getvalue())
    assert text.count("\n") == 1 and text[:-1].isprintable() and len(text) < 2200, text
    return text


@pytest.fixture
def place(genuine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(genuine, tmp_path / "place")
    monkeypatch.chdir(tmp_path / "place")
    monkeypatch.setattr(files, "LARGEST", LIMIT)
    monkeypatch.setattr(driver, "VENV", Path(sys.prefix))
    for module in (driver, plan, verify):
        monkeypatch.setattr(module, "ROOT", tmp_path / "place")
    monkeypatch.setattr(engine, "run_workflow", lambda *_: 0)
    monkeypatch.setattr(verify, "make", None)  # which would take minutes
    return tmp_path / "place"


def test_what_is_genuine_is_taken(place: Path) -> None:
    for main, line in [*(by[1:] for by in READ.values()), *TABLES.values()]:
        with redirect_stdout(io.StringIO()):
            assert main(line) == 0
    assert list(verify.committed()) == ["forged"] and verify.why_not(verify.committed()["forged"]) == ""


@pytest.mark.parametrize("kind", ARCHIVES)
@pytest.mark.parametrize("name", READ)
def test_a_forged_archive(name: str, kind: str, place: Path) -> None:
    part, main, line = READ[name]
    ARCHIVES[kind](place / name, part)
    before = snapshot(place)
    if (name, kind) in HARMLESS:
        assert main(line) == 0
        return
    assert Path(name).name in refusal(main, line)
    assert snapshot(place) == before


@pytest.mark.parametrize("kind", TEXTS)
@pytest.mark.parametrize("name", TABLES)
def test_a_forged_text(name: str, kind: str, place: Path) -> None:
    (place / name).write_bytes(TEXTS[kind])
    before = snapshot(place)
    assert Path(name).name in refusal(*TABLES[name])
    assert snapshot(place) == before


COLUMNS = "measure,alpha,delta,seed,value\n"
MEASURES = {
    "a column too few": "measure,alpha,delta,seed\nfinal_return,0,1.1,0\n",
    "words for values": f"{COLUMNS}final_return,0,1.1,0,high\n",
    "words for a mismatch": f"{COLUMNS}final_return,0,heavy,0,1.0\n",
    "a row too long": f"{COLUMNS}final_return,0,1.1,0,1.0,2.0\nfinal_return,0,1.1,0,1.0,2.0,3.0\n",
    "no rows": COLUMNS,
}


@pytest.mark.parametrize("kind", MEASURES)
def test_forged_measures(kind: str, place: Path) -> None:
    (place / "measures.csv").write_text(MEASURES[kind])
    before = snapshot(place)
    refusal(*TABLES["measures.csv"])
    assert snapshot(place) == before


@pytest.mark.parametrize(
    ("part", "value"),
    [
        ("settings", 5),
        ("settings", {"k": "many"}),
        ("settings", {"__class__": 1}),
        ("values", []),
        ("alphas", None),
        ("deltas", "heavy"),
        ("deltas", ["heavy"]),
        ("seeds", 3),
    ],
)
def test_a_forged_configuration_of_a_set(part: str, value: Any, place: Path) -> None:
    config = json.loads((place / SET).read_text())
    (place / SET).write_text(json.dumps(config | {part: value}))
    before = snapshot(place)
    for line in (["verify", "1"], ["--name", "forged"]):
        if part in plan.DIFFERENT or line[0] == "verify":
            refusal(driver.main, line)
    assert snapshot(place) == before


@pytest.mark.parametrize(
    ("part", "value"),
    [
        ("run", {"alpha": "x", "delta": 1.5, "seed": 3, "steps": 5}),
        ("run", {"alpha": 0.5, "delta": -1, "seed": 3, "steps": 5}),
        ("run", {"alpha": 0.5, "delta": 1.5, "seed": 10**30, "steps": 5}),
        ("run", {"alpha": 0.5, "delta": 1.5, "seed": 3, "steps": []}),
        ("config", {"k": 3}),
        ("config", {"__class__": 1}),
        ("config", []),
        ("counts", []),
        ("counts", {"trials": "many"}),
        ("final_policy", {"own condition": {"return": "x"}}),
        ("region", None),
    ],
)
def test_a_forged_record_of_a_run(part: str, value: Any, place: Path) -> None:
    record = json.loads((place / "run" / "run.json").read_text())
    (place / "run" / "run.json").write_text(json.dumps(record | {part: value}))
    before = snapshot(place)
    refusal(*READ["run/visited.npz"][1:])
    assert snapshot(place) == before


def with_number(name: str, place: Any, value: Any) -> Callable[[dict[str, np.ndarray]], None]:
    def change(arrays: dict[str, np.ndarray]) -> None:
        arrays[name][place] = value

    return change


def with_array(name: str, value: Any) -> Callable[[dict[str, np.ndarray]], None]:
    return lambda arrays: arrays.update({name: np.array(value)})


CHECKPOINTS: dict[str, Callable[[dict[str, np.ndarray]], None]] = {
    "more steps than the training has": with_number("counts", 0, 10**15),
    "steps below zero": with_number("counts", 0, -UPDATE),
    "half an update": with_number("counts", 0, UPDATE + 1),
    "another period": with_number("counts", 1, 10**6),
    "a place outside numpy's generator": with_number("counts", 2, 10**6),
    "a place below numpy's generator": with_number("counts", 2, -1),
    "no flag": with_number("counts", 3, 7),
    "a place outside torch's generator": with_number("torch_rng", slice(16, 24), [255, 1, 0, 0, 0, 0, 0, 0]),
    "torch's generator turned": with_number("torch_rng", slice(8, 12), [255, 255, 255, 127]),
    "torch's generator of zeros": lambda arrays: arrays["torch_rng"].fill(0),
    "a state of infinity": with_number("state", 0, np.inf),
    "moments of NaN": with_number("exp_avg_sq.log_std", 0, np.nan),
    "a formula for an outcome": lambda arrays: arrays.update(
        {"trial.outcome": np.array(["=1+1"] * len(arrays["trial.outcome"]))}
    ),
    "trials before the first": with_number("trial.step", 0, -5),
    "trials of no step": with_number("trial.length", 0, 0),
    "fewer lengths": lambda arrays: arrays.update({"trial.length": arrays["trial.length"][:-1]}),
    "visited states in a plane": with_array("visited", np.zeros((2, 2), np.float32)),
    "a time before the start": with_array("seconds", -1.0),
    "an identity that is a list": with_array("identity", "[]"),
    "an identity that is none": with_array("identity", "{"),
    "no identity": lambda arrays: arrays.pop("identity") is None and None,
}


@pytest.mark.parametrize("kind", CHECKPOINTS)
def test_a_forged_checkpoint(kind: str, place: Path) -> None:
    path = place / "begun" / "checkpoint.zip"
    with np.load(path) as archive:
        arrays = dict(archive)
    CHECKPOINTS[kind](arrays)
    with path.open("wb") as file:
        np.savez(file, **arrays)
    before = snapshot(place)
    line = refusal(*READ["begun/checkpoint.zip"][1:])
    assert "checkpoint.zip" in line and "delete it to start over" in line
    assert snapshot(place) == before


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("array_neighbours", np.array(3.7)),
        ("array_neighbours", np.array(3)),
        ("array_scale", np.full(6, 5e-324)),
        ("array_cell", np.array(5e-324)),
        ("param_state_max", np.full(6, 5e-324)),
        ("param_p_t", np.array(np.nan)),
        ("param_gamma_evidence", np.array("neither")),
        ("made_of", np.array('{"alpha": 2, "seed": 0, "values": {}}')),
        ("made_of", np.array("[" * 100_000)),
        ("made_of", np.array('{"__class__": 1}')),
        ("labels", np.full(41, 2)),
    ],
)
def test_a_forged_region(name: str, value: np.ndarray, place: Path) -> None:
    with np.load(place / "region.npz") as archive:
        arrays = dict(archive) | {name: value}
    with (place / "region.npz").open("wb") as file:
        np.savez(file, **arrays)
    before = snapshot(place)
    refusal(*READ["region.npz"][1:])
    assert snapshot(place) == before
