"""Loss of power: what was not forced to the disk may be lost, cut short or out of order.

A small run (data, region, training with checkpoints, measures) is taken down operation by operation. At a
moment of it, each name that was made, changed or removed since its folder was forced is there or not, and
content that was not forced is the old one, cut short, zeros or whole. From what is left the run is started
again: what is there is believed, the rest is made.
"""

import contextlib
import io
import json
import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from runs import CONFIG, SUPERVISED

from replication.__main__ import main as replication
from srlrepro.__main__ import main as srlrepro
from srlrepro.settings.config import Config
from srlrepro.storage.files import UNFINISHED, remove_unfinished

VARIED = {name: value for name, value in CONFIG.as_dict().items() if value != Config().as_dict()[name]}
VARIED |= {"k": 40, "random_rollouts": 60}
SETTINGS = ["--set", *(f"{name}={str(value).lower()}" for name, value in VARIED.items())]
TRAIN = ["--alpha", "0.5", "--delta", "1.5", "--seed", "3", "--steps", str(SUPERVISED.steps)]
PRODUCTS = [
    f"run/{name}"
    for name in ("trials.csv", "evaluations.csv", "curve.csv", "visited.npz", "policy.zip", "run.json")
]
STEPS = [  # what a step writes, and its command line
    (["data.npz"], srlrepro, ["data", "--alpha", "0.5", "--out", "data.npz", *SETTINGS]),
    (["region.npz"], srlrepro, ["region", "--data", "data.npz", "--out", "region.npz", *SETTINGS]),
    (PRODUCTS, srlrepro, ["train", *TRAIN, "--region", "region.npz", "--out", "run", *SETTINGS]),
    (["measures.csv"], replication, ["measure", "run", "--region", "region.npz", "--out", "measures.csv"]),
]
SEED = 11

Names = dict[Path, int]
Operation = tuple[Any, ...]


@dataclass(frozen=True)
class Moment:
    """What is on the disk, and what is not yet."""

    names: Names  # on the disk: {path: number of its file}
    folders: frozenset[Path]
    under_way: tuple[Operation, ...]  # of names, since their folders were forced
    content: dict[int, bytes]  # {number of a file: what was written to it}
    forced: dict[int, bytes]  # of that, what is on the disk for certain


def apply(operation: Operation, names: Names, folders: set[Path]) -> None:
    """Let an operation reach the disk."""
    kind, path, *more = operation
    if kind == "mkdir":
        folders.add(path)
    elif kind == "create":
        names[path] = more[0]
    elif kind == "unlink":
        names.pop(path, None)
    else:
        names.pop(path, None)
        names[more[0]] = more[1]


@dataclass
class Disk:
    """Watches what is written below a folder. ``forces``: whether forcing reaches the disk at all."""

    root: Path
    forces: bool = True
    moments: list[Moment] = field(default_factory=list)
    now: Names = field(default_factory=dict)
    names: Names = field(default_factory=dict)
    under_way: list[Operation] = field(default_factory=list)
    content: dict[int, bytes] = field(default_factory=dict)
    forced: dict[int, bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.folders = {self.root}

    def look(self) -> None:
        """Take down the moment before an operation."""
        for path in sorted(path for path in self.root.rglob("*") if path.is_file()):
            if path not in self.now:
                self.now[path] = len(self.content)
                self.under_way.append(("create", path, self.now[path]))
            content = path.read_bytes()
            if self.content.get(self.now[path]) != content:
                self.content[self.now[path]] = content
        parts = tuple(self.under_way), dict(self.content), dict(self.forced)
        self.moments.append(Moment(dict(self.names), frozenset(self.folders), *parts))

    @contextlib.contextmanager
    def watch(self) -> Iterator[None]:
        real = {name: getattr(os, name) for name in ("fsync", "replace", "unlink", "mkdir")}

        def fsync(opened: int) -> None:
            path = Path(f"/proc/self/fd/{opened}").readlink()
            if path.is_relative_to(self.root):
                self.look()
                self.force(path, stat.S_ISDIR(os.fstat(opened).st_mode))
            real["fsync"](opened)

        def replace(source: Any, target: Any) -> None:
            self.look()
            old, new = Path(source).absolute(), Path(target).absolute()
            real["replace"](source, target)
            if old in self.now:
                self.now[new] = number = self.now.pop(old)
                self.under_way.append(("rename", old, new, number))

        def unlink(path: Any, **values: Any) -> None:
            self.look()
            real["unlink"](path, **values)
            if self.now.pop(Path(path).absolute(), None) is not None:
                self.under_way.append(("unlink", Path(path).absolute()))

        def mkdir(path: Any, *values: Any) -> None:
            real["mkdir"](path, *values)
            if Path(path).absolute().is_relative_to(self.root):
                self.look()
                self.under_way.append(("mkdir", Path(path).absolute()))

        with pytest.MonkeyPatch.context() as patch:
            for function in (fsync, replace, unlink, mkdir):
                patch.setattr(os, function.__name__, function)
            yield
        self.look()

    def force(self, path: Path, is_folder: bool) -> None:
        if not self.forces:
            return
        if not is_folder:
            self.forced[self.now[path]] = self.content[self.now[path]]
            return
        for operation in [each for each in self.under_way if each[1].parent == path]:
            self.under_way.remove(operation)
            apply(operation, self.names, self.folders)


def left(moment: Moment, rng: np.random.Generator) -> dict[Path, bytes]:
    """{path: content} of the files that a loss of power leaves."""
    names, folders, waiting = dict(moment.names), set(moment.folders), moment.under_way
    some = waiting[: rng.integers(len(waiting) + 1)]
    if rng.random() < 0.5:
        some = tuple(operation for operation in waiting if rng.random() < 0.5)
    for operation in some:
        apply(operation, names, folders)
    found = {}
    for path, number in names.items():
        content, forced = moment.content[number], moment.forced.get(number)
        if content != forced:
            short = content[: rng.integers(len(content) + 1)]
            content = (forced or b"", short, bytes(len(content)), content)[rng.integers(4)]
        if path.parent in folders:
            found[path] = content
    return found


def work(folder: Path) -> None:
    """Make what is not there, as a start of the workflow does."""
    remove_unfinished(folder)
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
        for outputs, main, line in STEPS:
            if not all(Path(name).exists() for name in outputs):
                assert main(line) == 0


def outcome(folder: Path) -> dict[str, Any]:
    """{name: content} of all outputs, but for times and memory; the last checkpoint may be there still."""
    found: dict[str, Any] = {name: (folder / name).read_bytes() for outputs, *_ in STEPS for name in outputs}
    found["run/run.json"] = json.loads(found["run/run.json"]) | {"provenance": {}}
    return found


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed")
    work(folder)
    return folder


def survived(disk: Disk, cuts: int, whole: dict[str, Any], place: Path) -> list[bool]:
    """Whether a start after each of some losses of power ends with the same bytes."""
    rng, results, known = np.random.default_rng(SEED), list[bool](), dict[Any, bool]()
    for n in range(cuts):
        files = left(disk.moments[rng.integers(len(disk.moments))], rng)
        relative = {path.relative_to(disk.root): content for path, content in files.items()}
        key = frozenset((name, text) for name, text in relative.items() if UNFINISHED not in name.name)
        if key not in known:
            folder = place / f"{n}"
            folder.mkdir()
            for name, content in relative.items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes(content)
            try:
                work(folder)
                known[key] = outcome(folder) == whole
            except (AssertionError, SystemExit):
                known[key] = False
        results.append(known[key])
    print(f"{len(disk.moments)} moments, {len(known)} different remains")
    return results


@pytest.mark.slow
@pytest.mark.parametrize("forces", [True, False], ids=["forced", "not forced"])
def test_a_loss_of_power(
    forces: bool,
    undisturbed: Path,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The second case sees that the first could fail: without forcing, some of the starts go wrong."""
    disk = Disk(tmp_path / "run", forces)
    disk.root.mkdir()
    with disk.watch():
        work(disk.root)
    whole = outcome(undisturbed)
    assert outcome(disk.root) == whole
    cuts = request.config.getoption("--cuts", default=200)
    results = survived(disk, cuts if forces else min(cuts, 40), whole, tmp_path)
    if forces:
        assert results == [True] * cuts
        request.getfixturevalue("count").extend(results)
    else:
        assert not all(results)


RULES = """
rule all:
    input: "b.txt"
rule a:
    output: "a.txt"
    shell: "echo 1 > {output}; echo a >> made"
rule b:
    input: "a.txt"
    output: "b.txt"
    shell: "cat {input} > {output}; echo b >> made"
"""


@pytest.mark.slow
@pytest.mark.parametrize("remains", [b"", None], ids=["emptied", "lost"])
def test_snakemake_without_its_records(remains: bytes | None, tmp_path: Path) -> None:
    """What is there is believed, which is why it has to be whole; what is not is made again."""
    (tmp_path / "Snakefile").write_text(RULES)
    command = [sys.executable, "-m", "snakemake", "--cores", "1", "--rerun-incomplete", "--nolock", "--quiet"]
    for made in ("a\nb\n", "a\nb\nb\n"):
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
        assert (tmp_path / "made").read_text() == made and (tmp_path / "b.txt").read_text() == "1\n"
        for record in list((tmp_path / ".snakemake" / "metadata").iterdir()):
            record.unlink() if remains is None else record.write_bytes(remains)
        (tmp_path / "b.txt").unlink()
