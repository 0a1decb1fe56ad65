"""Mutants: the method with one thing changed, and whether a test of its room notices.

A mutant is a module in which one operator, comparison, condition, number or loop is another, as cosmic-ray
changes it. Each is put into a copy of the last commit, and the tests that own the room run until one fails:
quick ones first. A mutant *survives* if all pass. Three things cosmic-ray's own runner has not, so that only
its mutations are taken: a draw at random, limits in the time of the processor instead of the clock, and one
process that has loaded the libraries and forks for each mutant.

Drawn are places, and one of the mutants of each, since an operator has eleven and a comparison seven. Left
out are annotations, which every import would refuse, and decorators: without ``@jit`` a kernel is slow, and
no other.

Compiled code is kept on disk, and compiled anew where a mutant changes it: its own module, and those that
import it. Tests of uncompiled kernels would take longer than that: a rollout is a thousand times slower.
"""

import ast
import hashlib
import json
import os
import random
import re
import resource
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from srlrepro.command_line import Parser
from srlrepro.pins import pin
from srlrepro.settings.fields import check_whole

ROOT = Path(__file__).parent.parent
RECORDS = ROOT / "docs" / "records"
TOOL = "cosmic-ray"
KILLED, SURVIVED, TIMEOUT = "killed", "survived", "timeout"
PER_ROOM = 20  # mutants, unless it is said otherwise
LARGEST_SEED = 2**32
PASSES = (
    "not slow and not faults and not slurm",
    "slow and not slurm",
)  # of the tests of a room, quick first
ROOMY, LEAST = 3.0, 60.0  # limit of a mutant: so many times what the tests take, and s of the processor more
PATIENCE = 20  # times that limit by the clock, for what waits and computes nothing
NONE_SELECTED = 5  # status of pytest where no test has the mark
KERNEL = {"jit", "inner", "intrinsic", "overload"}  # decorators of compiled code
LIBRARIES = (  # what the tests of all rooms need: loaded once, for all mutants
    "matplotlib.pyplot",
    "numba",
    "openTSNE",
    "pandas",
    "pytest",
    "scipy.signal",
    "scipy.stats",
    "sklearn.model_selection",
    "sklearn.neural_network",
    "stable_baselines3",
)
HOUSES = ("srlrepro", "replication", "workflow", "benchmarks")


class Room(NamedTuple):
    """A room of the method: its modules (a folder, or one), and the tests that own it."""

    modules: str
    tests: tuple[str, ...]


UP_TO_DATE = (
    "tests/documents/test_documents.py::test_the_documents_are_up_to_date"  # choices.md has all values
)
ROOMS = {
    "settings": Room("srlrepro/settings", ("tests/settings", UP_TO_DATE)),
    "dynamics": Room("srlrepro/dynamics", ("tests/dynamics",)),
    "samplers": Room("srlrepro/samplers.py", ("tests/test_samplers.py",)),
    "region": Room("srlrepro/region", ("tests/region", "tests/studies/test_alternatives.py")),
    "supervisor": Room("srlrepro/supervisor.py", ("tests/test_supervisor.py",)),
    "fast_ppo": Room("srlrepro/fast_ppo", ("tests/fast_ppo",)),
    "learner": Room("srlrepro/learner", ("tests/learner",)),
    "evidence": Room("replication/evidence", ("tests/evidence",)),
}
COLUMNS = (
    *("room", "places", "mutants", "killed_at_first", "killed", "timeouts"),
    *("survived", "seed", "commit", "tool"),
)
SURVIVORS = ("room", "seed", "module", "line", "before", "after", "reason")


@dataclass(frozen=True)
class Mutant:
    """One change of a module; before and after: the line, without its indentation."""

    module: str
    operator: str
    occurrence: int
    line: int
    before: str
    after: str
    source: str  # SHA-256 of the module as it was


class Outcome(NamedTuple):
    """What became of a mutant, by which test, and s of the processor that it took."""

    what: str  # `KILLED`, `SURVIVED` or `TIMEOUT`
    by: str
    seconds: float


def modules(checkout: Path, room: Room) -> list[Path]:
    """The modules of a room, in order."""
    place = checkout / room.modules
    return [place] if place.suffix else sorted(place.glob("*.py"))


def annotations(tree: ast.AST) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """(start, end) of every annotation, as (line, column)."""
    found: list[ast.expr | None] = []
    for node in ast.walk(tree):
        if isinstance(node, (ast.arg, ast.AnnAssign)):
            found.append(node.annotation)
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            found.append(node.returns)
    spans = []
    for n in found:
        if n is not None:
            assert n.end_lineno is not None and n.end_col_offset is not None
            spans.append(((n.lineno, n.col_offset), (n.end_lineno, n.end_col_offset)))
    return spans


def places(text: str) -> list[list[tuple[str, int]]]:
    """Where a module can be changed: for each place its mutants, as (operator, occurrence)."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator, operator_names

    leaves = ("name", "newline", "string", "endmarker")  # nothing that an operator would change
    nodes = [n for n in ast_nodes(get_ast(text)) if n.type not in leaves]
    left_out = annotations(ast.parse(text))
    found: dict[tuple[tuple[int, int], str], list[tuple[str, int]]] = {}
    for name in operator_names():
        kind = get_operator(name)
        if kind.arguments() or name.endswith("RemoveDecorator"):
            continue
        operator = kind()
        starts = (start for node in nodes for start, _ in operator.mutation_positions(node))
        for occurrence, start in enumerate(starts):
            if not any(low <= start < high for low, high in left_out):
                found.setdefault((start, name.split("_")[0]), []).append((name, occurrence))
    return [found[place] for place in sorted(found)]


def change(text: str, operator: str, occurrence: int) -> str | None:
    """The text of a mutant; None if there is none, or one that is no Python."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    changed = mutate_code(text, get_operator(operator)(), occurrence)
    try:
        same = changed is None or ast.dump(ast.parse(changed)) == ast.dump(ast.parse(text))
    except SyntaxError:
        return None
    return None if same else str(changed)


def describe(checkout: Path, path: Path, operator: str, occurrence: int) -> Mutant | None:
    """A mutant of a module; None if there is none."""
    text = path.read_text(encoding="utf-8")
    changed = change(text, operator, occurrence)
    if changed is None:
        return None
    lines = text.splitlines(), changed.splitlines()
    n = next(n for n, (old, new) in enumerate(zip(*lines, strict=False)) if old != new)
    before, after = (side[n].strip() for side in lines)
    source = hashlib.sha256(text.encode()).hexdigest()
    return Mutant(path.relative_to(checkout).as_posix(), operator, occurrence, n + 1, before, after, source)


def draw(checkout: Path, room: str, seed: int, number: int | None) -> tuple[int, list[Mutant]]:
    """The places of a room, and mutants of so many of them at random; None: every mutant of every place."""
    found = [
        (path, own)
        for path in modules(checkout, ROOMS[room])
        for own in places(path.read_text(encoding="utf-8"))
    ]
    rng = random.Random(f"{seed} {room}")
    if number is None:
        chosen = [(path, one) for path, own in found for one in own]
    else:
        chosen = [(path, rng.choice(own)) for path, own in rng.sample(found, len(found))]
    mutants: list[Mutant] = []
    for path, one in chosen:
        if number is not None and len(mutants) == number:
            break
        if mutant := describe(checkout, path, *one):
            mutants.append(mutant)
    return len(found), mutants


def recompiled(checkout: Path, mutant: Mutant) -> list[str]:
    """Patterns of the kept kernels that a mutant may change: of its module, and of those that import it.

    There are none if the change lies in a function that is not compiled: no kernel can depend on it.
    """
    text = (checkout / mutant.module).read_text(encoding="utf-8")
    around = [
        node
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef) and node.lineno <= mutant.line <= (node.end_lineno or 0)
    ]
    if around and not any(KERNEL & {ast.unparse(d) for d in node.decorator_list} for node in around):
        return []
    paths = {
        ".".join(p.relative_to(checkout).with_suffix("").parts): p for p in checkout.glob("srlrepro/**/*.py")
    }
    imported = {
        name: {n.module for n in ast.walk(ast.parse(p.read_text("utf-8"))) if isinstance(n, ast.ImportFrom)}
        for name, p in paths.items()
    }
    reached, more = {mutant.module.removesuffix(".py").replace("/", ".")}, True
    while more:
        following = reached | {name for name, of in imported.items() if of & reached}
        more, reached = following != reached, following
    return [f"{paths[name].stem}.*" for name in reached if name in paths]


def _child(
    checkout: Path, arguments: list[str], limit: float, log: Path, base: Path, stale: Iterable[str]
) -> int:
    """Run pytest in a copy, in a process that has been forked for it; its exit status."""
    os.setsid()
    # Python 3.11 forgets it in a fork; by it matplotlib knows that this is the main thread
    threading.main_thread()._set_native_id()  # type: ignore[attr-defined]
    resource.setrlimit(resource.RLIMIT_CPU, (round(limit), round(limit) + 5))
    signal.alarm(round(PATIENCE * limit))
    with log.open("wb") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    os.chdir(checkout)
    os.environ |= {"NUMBA_CACHE_DIR": str(base.parent), "PYTHONPATH": str(checkout), "MPLBACKEND": "Agg"}
    for name in [name for name in sys.modules if name.split(".")[0] in HOUSES]:
        del sys.modules[name]
    sys.path[:] = [str(checkout), *(p for p in sys.path if Path(p or ".").resolve() != ROOT)]
    sys.dont_write_bytecode = True
    import numba
    import pytest

    import srlrepro.compiled.jit  # noqa: F401  names the folder of kernels by the sources

    own = Path(numba.config.CACHE_DIR)  # type: ignore[attr-defined]
    if base.exists() and not own.exists():
        shutil.copytree(base, own, copy_function=os.link, ignore=shutil.ignore_patterns(*stale))
    # no limit by the clock for a single test: it would take the alarm of this process
    options = ["-x", "-q", "-p", "no:cacheprovider", "--no-header", "-o", "timeout=0"]
    return int(pytest.main([*options, *arguments]))


def attempt(
    checkout: Path, arguments: list[str], limit: float, log: Path, base: Path, stale: Iterable[str] = ()
) -> Outcome:
    """Run tests in a process of their own.

    limit: s of the processor; base: the folder of the kernels that are kept, in which no mutant leaves any;
    stale: patterns of those that are not to be used.
    """
    sys.stdout.flush()
    pid = os.fork()
    if pid == 0:
        status = 70
        try:
            status = _child(checkout, arguments, limit, log, base, stale)
        finally:
            os._exit(status)
    _, status, used = os.wait4(pid, 0)
    seconds = used.ru_utime + used.ru_stime
    code = os.waitstatus_to_exitcode(status)
    if -code in (signal.SIGXCPU, signal.SIGALRM, signal.SIGKILL):
        return Outcome(TIMEOUT, "", seconds)
    if code in (0, NONE_SELECTED):
        return Outcome(SURVIVED, "", seconds)
    failed = re.findall(r"^(?:FAILED|ERROR) (?:\S*/)?(\S+)", log.read_text(errors="replace"), re.MULTILINE)
    return Outcome(KILLED, failed[0] if failed else f"status {code}", seconds)


def ordered(room: Room, module: str, checkout: Path) -> list[str]:
    """The tests of a room, those named after a module first."""
    stem, named = Path(module).stem, []
    for place in room.tests:
        own = Path(place, f"test_{stem}.py")
        if (checkout / own).exists():
            named.append(own.as_posix())
    return [*named, *room.tests]


def copy_of(commit: str, place: Path) -> Path:
    """A checkout of a commit, in a folder that keeps it."""
    checkout = place / "checkout"
    if not checkout.exists():
        subprocess.run(["git", "clone", "-q", "--shared", "--no-checkout", ROOT, checkout], check=True)
    for command in (["fetch", "-q", "origin", commit], ["checkout", "-q", "-f", "--detach", commit]):
        subprocess.run(["git", "-C", checkout, *command], check=True)
    return checkout


def kernels(checkout: Path, place: Path) -> Path:
    """The folder in which the kernels of a copy are kept."""
    ask = "import srlrepro.compiled.jit, numba; print(numba.config.CACHE_DIR)"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(place / "kernels"), "PYTHONPATH": str(checkout)}
    command = [sys.executable, "-B", "-c", ask]
    done = subprocess.run(command, cwd=checkout, env=environment, check=True, capture_output=True, text=True)
    return Path(done.stdout.strip())


def unmutated(checkout: Path, room: Room, place: Path, base: Path) -> list[float]:
    """s of the processor that each of the `PASSES` takes without a mutant, from kept kernels.

    Raises:
        SystemExit: a test fails.
    """
    taken = []
    for marks in PASSES:
        for _ in range(2):  # the first may compile
            found = attempt(checkout, [*room.tests, "-m", marks], 7200.0, place / "log", base)
            if found.what != SURVIVED:
                sys.exit(f"without any mutant {found.by or found.what}: see {place / 'log'}")
        taken.append(found.seconds)
    return taken


def try_one(
    checkout: Path, room: Room, mutant: Mutant, place: Path, base: Path, taken: list[float]
) -> Outcome:
    """Put a mutant into the copy, run the tests of its room, and take it out again."""
    path = checkout / mutant.module
    text, times = path.read_text(encoding="utf-8"), path.stat()
    stale = recompiled(checkout, mutant)
    changed = change(text, mutant.operator, mutant.occurrence)
    assert changed is not None
    try:
        path.write_text(changed, encoding="utf-8")
        found, seconds = Outcome(SURVIVED, "", 0.0), 0.0
        for marks, usual in zip(PASSES, taken, strict=True):
            arguments = [*ordered(room, mutant.module, checkout), "-m", marks]
            found = attempt(checkout, arguments, LEAST + ROOMY * usual, place / "log", base, stale)
            seconds += found.seconds
            if found.what != SURVIVED:
                break
        return found._replace(seconds=seconds)
    finally:
        path.write_text(text, encoding="utf-8")
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        for folder in base.parent.iterdir():
            if folder != base:
                shutil.rmtree(folder)


def kept(file: Path) -> Iterator[dict[str, Any]]:
    """What earlier runs in the same folder have found."""
    for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else []:
        yield json.loads(line)


def known(file: Path, mutant: Mutant, commit: str) -> Outcome | None:
    """What is known of a mutant: a survivor is tried again at another commit, whose tests may be better."""
    for entry in kept(file):
        same = entry["mutant"] == asdict(mutant)
        if same and (entry["outcome"][0] != SURVIVED or entry["commit"] == commit):
            return Outcome(*entry["outcome"])
    return None


def at_first(file: Path, mutant: Mutant) -> str | None:
    """What became of a mutant when it was tried first, before any test was written for it."""
    return next((e["outcome"][0] for e in kept(file) if e["mutant"] == asdict(mutant)), None)


def run_room(name: str, commit: str, seed: int, number: int | None, place: Path) -> dict[str, Any]:
    """Try the mutants of a room, a line each; the row of the record, with the survivors."""
    checkout, room, results = copy_of(commit, place), ROOMS[name], place / "results.jsonl"
    found, mutants = draw(checkout, name, seed, number)
    base, taken = kernels(checkout, place), list[float]()
    counts, survivors = dict.fromkeys((KILLED, TIMEOUT, SURVIVED), 0), []
    for n, mutant in enumerate(mutants, 1):
        outcome = known(results, mutant, commit)
        if outcome is None:
            if not taken:
                taken = unmutated(checkout, room, place, base)
            outcome = try_one(checkout, room, mutant, place, base, taken)
            entry = {"mutant": asdict(mutant), "commit": commit, "outcome": outcome}
            with results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(entry, ensure_ascii=False) + "\n")
        counts[outcome.what] += 1
        if outcome.what == SURVIVED:
            survivors.append({"room": name, "seed": seed} | {n: getattr(mutant, n) for n in SURVIVORS[2:-1]})
        said = f"{mutant.module}:{mutant.line}: {mutant.before}  →  {mutant.after}"
        by = f"  by {outcome.by}" if outcome.by else ""
        print(f"{name} {n}/{len(mutants)} {outcome.what} in {outcome.seconds:.0f} s  {said}{by}", flush=True)
    row = {"room": name, "places": found, "mutants": len(mutants), "killed": counts[KILLED]}
    row |= {"killed_at_first": sum(at_first(results, mutant) != SURVIVED for mutant in mutants)}
    row |= {"timeouts": counts[TIMEOUT], "survived": counts[SURVIVED], "seed": seed}
    row |= {"commit": commit[:10], "tool": f"{TOOL} {version(TOOL)}"}
    return row | {"survivors": survivors}


def record(rows: list[dict[str, Any]], folder: Path) -> None:
    """Put the rows of some rooms into the record, in place of those of the same draw.

    Reasons that stand there for a survivor are kept.
    """
    import pandas as pd

    from srlrepro.storage.files import write_table

    found: dict[str, list[dict[str, Any]]] = {"mutants.csv": rows, "survivors.csv": []}
    path = folder / "survivors.csv"
    told = pd.read_csv(path, dtype=str).fillna("").to_dict("records") if path.exists() else []
    reasons = {(s["module"], s["before"], s["after"]): s["reason"] for s in told}
    for survivor in (s for row in rows for s in row["survivors"]):
        key = survivor["module"], survivor["before"], survivor["after"]
        found["survivors.csv"].append(survivor | {"reason": reasons.get(key, "")})
    for (name, new), columns in zip(found.items(), (COLUMNS, SURVIVORS), strict=True):
        path = folder / name
        old = pd.read_csv(path, dtype=str) if path.exists() else pd.DataFrame(columns=[*columns])
        drawn = {(row["room"], str(row["seed"])) for row in rows}
        old = old[[pair not in drawn for pair in zip(old["room"], old["seed"], strict=True)]]
        both = pd.concat([old, pd.DataFrame(new, columns=[*columns]).astype(str)])
        both["order"] = both["room"].map([*ROOMS].index)
        write_table(path, both.sort_values(["seed", "order"], kind="stable")[[*columns]])


def main() -> None:
    """The command line."""
    parser = Parser(prog="python -m benchmarks.mutants", description=__doc__, allow_abbrev=False)
    parser.add_argument("--rooms", nargs="+", choices=ROOMS, default=list(ROOMS), help="(default: all)")
    some = parser.add_mutually_exclusive_group()
    some.add_argument("--number", type=int, default=PER_ROOM, help="mutants of a room (default: %(default)s)")
    some.add_argument("--all", action="store_true", help="every mutant of every place, which takes days")
    parser.add_argument("--seed", type=int, help="of the draw (default: at random; it is printed)")
    work = Path(tempfile.gettempdir(), "mutants")
    parser.add_argument("--work", type=Path, default=work, help="folder to work in, and to go on from")
    parser.add_argument("--out", type=Path, default=RECORDS, help="folder of the record")
    arguments = parser.parse_args()
    check_whole("--number", arguments.number, 1)
    seed = secrets.randbelow(LARGEST_SEED) if arguments.seed is None else arguments.seed
    check_whole("--seed", seed, 0, LARGEST_SEED)
    pin()
    for library in LIBRARIES:
        import_module(library)
    arguments.work.mkdir(parents=True, exist_ok=True)
    command = ["git", "rev-parse", "HEAD"]
    commit = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()
    print(f"commit {commit[:10]}, --seed {seed}, in {arguments.work}", flush=True)
    number = None if arguments.all else arguments.number
    for name in arguments.rooms:
        record([run_room(name, commit, seed, number, arguments.work)], arguments.out)


if __name__ == "__main__":
    main()
