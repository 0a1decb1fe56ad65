"""``./reproduce.sh verify``: some of the committed results made anew, or all tables held against each other.

A *cell* is a part of a committed set that can be made by itself: a run of the grid, the training data and
regions of a seed, a universe. It is made from nothing by the rules of the workflow, in a copy of the sources
that is removed afterwards, and its rows are compared with the committed ones as texts.
"""

import argparse
import itertools
import random
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from replication.digests import DIGESTS, SET, changed, read_set
from replication.evidence.claims import GRID, load_claims
from replication.evidence.measures import read_measures
from replication.evidence.results import read_curves, read_run_measures, read_runs
from replication.plots.multiverse import curve_table
from replication.studies import designs, multiverse
from replication.studies.joints import cells as joints
from replication.studies.joints.answer import at_equal_recall
from replication.tables import RUN, Difference, Found, disagreement, found_in, shared
from srlrepro.pins import ARITHMETIC
from srlrepro.settings.condition import NONE
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check, check_whole, one_line
from srlrepro.storage.files import ResultError, read_table, write_json
from srlrepro.storage.provenance import processor
from workflow import ROOT
from workflow.command_line import CORES, LIMIT_VARIABLE, VERIFIED
from workflow.engine import INTERRUPTED, supervise
from workflow.plan import check_limit

SOURCES = ("srlrepro", "replication", "workflow", "notebooks")  # all that a cell is made of
NOT_COPIED = ("__pycache__", "executed")
MADE = ("results", "figures", "notebooks/executed", ".snakemake")  # by a cell, in the copy
LARGEST_SEED = 2**32  # of a draw
TAIL = 12  # last lines of a log that are shown
CELLS = ("ALPHAS", "DELTAS", "SEEDS")  # of a universe
LEARNED = ("02_training_data", "03_embedding", "04_safe_region")  # of the data and regions of a seed

Plan = Mapping[str, Any]  # the workflow's configuration, as of `plan`


class Cell(NamedTuple):
    """A part of a set: what makes it, and what it says of the set's tables."""

    targets: list[str]  # files that Snakemake is asked for
    found: Callable[[Path], Iterator[Found]]  # rows of the tables, of the folder in which the files were made
    varied: Plan  # what differs from the configuration of the set


def _texts(file: Path) -> pd.DataFrame:
    """A table whose cells are texts, as they are written."""
    return pd.read_csv(file, dtype=str, keep_default_na=False)


def _drawn(place: Path, look: str) -> Iterator[Found]:
    for path in sorted((place / "figures" / look).glob("*.csv")):
        yield Found(path.stem, _texts(path))


def _of_stages(config: Plan, *stages: str) -> Cell:
    """What notebooks before any training measure, and draw if the figures are those of the set."""
    look, files = config["look"], [f"results/{config['look']}/measures/{stage}.csv" for stage in stages]

    def found(place: Path) -> Iterator[Found]:
        yield Found("measures", read_measures(*(place / file for file in files)), group=RUN)
        if look == config["name"]:
            yield from _drawn(place, look)

    return Cell(files, found, {})


def _of_run(config: Plan, run: str) -> Cell:
    results = f"results/{config['cells']}"

    def found(place: Path) -> Iterator[Found]:
        values = Config().with_values(**config["settings"])
        curves = read_curves(place / results, [run])
        yield Found("measures", read_run_measures(place / results, [run]), group=RUN)
        yield Found("fig3_def_counts", read_runs(place / results, [run], values, config["steps"]), group=RUN)
        yield Found("fig3_abc_learning", curves[[*RUN, "step", "trials", "mean_return"]], group=RUN)
        yield Found("reward_per_step", curves[[*RUN, "step", "reward_per_step"]], group=RUN)

    return Cell([f"{results}/runs/{run}/measures.csv"], found, {})


def _of_universe(config: Plan, name: str) -> Cell:
    folder = f"results/{config['cells']}/universes/{name}"

    def found(place: Path) -> Iterator[Found]:
        measures = {name: read_measures(place / folder / "measures.csv")}
        met = {name: read_table(place / folder / "conditions.csv", ("condition", "met"))}
        claims, universes = load_claims(), multiverse.design(multiverse.load_choices()).loc[[name]]
        results = multiverse.outcomes(claims, measures, met, GRID | {"delta": config["deltas"]})
        yield Found("outcomes", results.join(universes, on="id"), 4, ("id",))
        drawn = {path.stem for path in (ROOT / "figures" / config["name"]).glob("spec_curve_*.csv")}
        for claim in claims:
            curve, stem = curve_table(claim, results, universes), f"spec_curve_{claim.id}"
            # A claim that is the same in every universe has no curve; digests tell of one that is lost.
            if len(curve) and stem in drawn:
                yield Found(stem, curve, group=("id",))

    return Cell([f"{folder}/measures.csv"], found, {})


def _of_gathered(config: Plan, name: str, alpha: str, delta: float, seed: int) -> Cell:
    """A run of a universe whose tables are gathered; the universe has no other then."""
    folder = f"results/{config['cells']}/universes/{name}"

    def found(place: Path) -> Iterator[Found]:
        measures, _ = designs.gather({name: place / folder})
        told = [column for column in designs.tells(name) if column in measures]
        yield Found("measures", measures, None, group=(*told, "measure", *RUN))

    narrowed = {"ALPHAS": [alpha], "DELTAS": [delta], "SEEDS": [seed]}
    return Cell([f"{folder}/measures.csv"], found, {"narrowed": narrowed})


def _of_joints(config: Plan, job: str, cell: joints.Cell) -> Cell:
    """A cell of the study of joints; free learners whose states are asked about are trained for it too."""
    file = f"results/{config['cells']}/cells/{job}__scores.csv"

    def found(place: Path) -> Iterator[Found]:
        scores = read_table(place / file, joints.CELL, text=("alpha",))
        yield Found("joints_recall", at_equal_recall(scores), 4, joints.CELL)

    return Cell([file], found, {"cells_only": [cell.name], "narrowed": {"ALPHAS": [NONE]}})


def cells_of(config: Plan) -> dict[str, Cell]:
    """{name: cell} of a set: all that can be made without most of the set."""
    if config["study"]:
        jobs = designs.universes(*(config[key] for key in ("study", "alphas", "deltas", "seeds", "few")))
        if config["study"] == "multiverse":
            return {name: _of_universe(config, name) for name in jobs}
        runs = ((n, c) for n, job in jobs.items() for c in itertools.product(*(job[key] for key in CELLS)))
        known = {f"{name}__{_condition(*cell)}": _of_gathered(config, name, *cell) for name, cell in runs}
        if config["study"] == "joints":
            plan = joints.design(config["few"])
            parts = [(job, cell) for job, own in plan.jobs.items() for cell, _ in plan.cells(*own)]
            known |= {f"{job}__{cell.name}": _of_joints(config, job, cell) for job, cell in parts}
        return known
    found = {"01_pendulum": _of_stages(config, "01_pendulum")}
    if (look := config["look"]) == config["name"]:
        targets = [f"figures/{look}/choices_stability.csv"]
        found["09_choices"] = Cell(targets, lambda place: _drawn(place, look), {})
    for seed in config["seeds"]:
        found[f"data_{seed}"] = _of_stages(config, *(f"{stage}__data_{seed}" for stage in LEARNED))
    grid = itertools.product(config["alphas"], config["deltas"], config["seeds"])
    return found | {run: _of_run(config, run) for run in itertools.starmap(_condition, grid)}


def _condition(alpha: str, delta: float, seed: int) -> str:
    return f"alpha_{alpha}__delta_{delta:g}__seed_{seed}"


def committed() -> dict[str, Plan]:
    """{name: configuration} of the committed sets; of all sets in figures/, where git knows of none.

    Raises:
        ResultError: one is damaged, or no configuration.
    """
    listed: list[str] = []
    if git := shutil.which("git"):
        command = [git, "ls-files", f"figures/*/{SET}"]
        listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True).stdout.splitlines()
    files = [ROOT / file for file in listed] or sorted((ROOT / "figures").glob(f"*/{SET}"))
    sets: dict[str, Plan] = {file.parent.name: read_set(file) for file in files}
    for name, config in sets.items():
        try:
            _ = why_not(config) or cells_of(config)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            reason = one_line(repr(error))
            raise ResultError(
                f"figures/{name}/{SET} is no configuration of the workflow: {reason}"
            ) from error
    return sets


def why_not(config: Plan) -> str:
    """Why a set cannot be made again to the last digit, in words; "" if it can."""
    if config.get("arithmetic") != ARITHMETIC:
        of = f"arithmetic {config['arithmetic']}" if "arithmetic" in config else "an earlier arithmetic"
        return f"of {of}, not of {ARITHMETIC}"
    values = Config().with_values(**config["settings"]).as_dict()
    other = [name for name in values if values[name] != config["values"].get(name)]
    return f"made with {other[0]} = {config['values'].get(other[0])}, not {values[other[0]]}" if other else ""


def draw(options: argparse.Namespace, sets: Mapping[str, Plan]) -> dict[str, Cell]:
    """The cells that a command line names, or a random draw of them; what was drawn is printed.

    Raises:
        ParameterError: no such cell, or one of a set that cannot be made again.
        ResultError: no set can.
    """
    reasons = {name: why_not(config) for name, config in sets.items()}
    for name in options.cells or []:
        own = name.partition("/")[0]
        check(own in sets, "--cells", name, f"SET/CELL with a committed set: {', '.join(sets) or 'none'}")
        check(not reasons[own], "--cells", name, f"of another set: figures/{own} is {reasons[own]}")
    left_out = [f"figures/{name} ({why})" for name, why in reasons.items() if why]
    if left_out and not options.cells:
        print(f"left out: {', '.join(left_out)}", flush=True)
    sound = [name for name, why in reasons.items() if not why]
    known = {f"{own}/{name}": cell for own in sound for name, cell in cells_of(sets[own]).items()}
    if not known:
        raise ResultError("nothing to verify: no committed set can be made again to the last digit here")
    some = ", ".join([*known][:3])
    for name in options.cells or []:
        check(name in known, "--cells", name, f"one of {len(known)} cells, such as {some}")
    if options.cells:
        return {name: known[name] for name in dict.fromkeys(options.cells)}
    number = VERIFIED if options.number is None else options.number
    check_whole("N", number, 1, len(known))
    seed = secrets.randbelow(LARGEST_SEED) if options.seed is None else options.seed
    check_whole("--seed", seed, 0, LARGEST_SEED)
    names = random.Random(seed).sample(sorted(known), number)
    print(f"{len(names)} of {len(known)} cells, drawn with --seed {seed}: {', '.join(names)}", flush=True)
    return {name: known[name] for name in names}


def lay_out(place: Path) -> None:
    """Copy what results are made of, and nothing that was made."""
    for name in SOURCES:
        shutil.copytree(ROOT / name, place / name, ignore=shutil.ignore_patterns(*NOT_COPIED))


def make(
    cell: Cell, config: Plan, place: Path, options: argparse.Namespace, variables: Mapping[str, str]
) -> None:
    """Make a cell in a copy of the sources, from nothing.

    Raises:
        ResultError: a job failed; the end of the log has been printed.
        KeyboardInterrupt: Ctrl-C or SIGTERM came, and all jobs have ended.
    """
    for name in MADE:
        shutil.rmtree(place / name, ignore_errors=True)
    write_json(file := place / "results" / SET, {**config, "only": "", **cell.varied})
    command = [sys.executable, "-m", "snakemake", *cell.targets, "--cores", str(options.cores or CORES)]
    command += ["--nolock", "--scheduler", "greedy", "--configfile", str(file)]
    own = {"PYTHONPATH": str(place), LIMIT_VARIABLE: str(options.limit)}
    log = place / "results" / "snakemake.log"
    with (place / "results" / ".lock").open("w") as lock:
        ended = supervise(command, {**variables, **own}, log, lock, place)
    if ended.interrupted:
        raise KeyboardInterrupt
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)  # which `supervise` has silenced
    if ended.status:
        print("\n".join(log.read_text(errors="replace").splitlines()[-TAIL:]), file=sys.stderr)
        raise ResultError("it could not be made; the end of Snakemake's log stands above")


def compare(cell: Cell, place: Path, figures: Path) -> tuple[Difference | None, str]:
    """Where the committed tables start to differ from a cell that was made; what was the same, in words."""
    rows, tables = 0, 0
    for found in cell.found(place):
        if difference := disagreement(figures, found):
            return difference, ""
        rows, tables = rows + len(found.table), tables + 1
    return None, f"{rows} rows of {tables} table{'s' * (tables > 1)}"


def verify_cells(options: argparse.Namespace, variables: Mapping[str, str]) -> int:
    """Make cells anew and compare them, one line each; returns the exit status."""
    sets = committed()
    cells, same, started = draw(options, sets), 0, time.monotonic()
    with tempfile.TemporaryDirectory(prefix="verify-") as folder:
        place = Path(folder).resolve() / "checkout"
        lay_out(place)
        for done, (name, cell) in enumerate(cells.items(), 1):
            began, own = time.monotonic(), name.partition("/")[0]
            try:
                make(cell, sets[own], place, options, variables)
                difference, compared = compare(cell, place, ROOT / "figures" / own)
                same += difference is None
                said = f"DIFFERS on {processor()}: {difference}" if difference else f"same, {compared}"
            except ResultError as error:
                said = f"FAILED on {processor()}: {error}"
            now = time.monotonic()
            left = (now - started) / done * (len(cells) - done) / 60
            said += f" ({(now - began) / 60:.1f} min" + (f"; about {left:.0f} min left)" if left else ")")
            print(f"{name}: {said}", flush=True)
    return int(same < len(cells))


def attempt(check: Callable[..., Iterable[object]], *folders: Path) -> list[str]:
    """What a check of folders finds; an error is a finding too, as a changed digit may lead to any."""
    found: list[str] = []
    try:
        found.extend(map(str, check(*folders)))
    except Exception as error:
        names = ", ".join(folder.name for folder in folders) or "documents"
        found.append(f"{names}: {type(error).__name__}: {one_line(error)}")
    return found


def of_set(folder: Path) -> Iterator[object]:
    """Differences between the tables of a set; what is derived is printed."""
    found = list(found_in(folder))
    derived = list(dict.fromkeys(table.name for table in found if not table.group))
    primary = sorted({path.stem for path in folder.glob("*.csv")}.difference(derived))
    print(f"figures/{folder.name}, primary: {', '.join(primary)}")
    print(f"figures/{folder.name}, derived and made anew: {', '.join(derived)}", flush=True)
    yield from filter(None, (disagreement(folder, table) for table in found))


def of_pair(one: Path, other: Path) -> Iterator[object]:
    """Differences between what two sets say of the same runs."""
    yield from filter(None, (disagreement(other, table) for table in shared(one, other)))


def of_documents() -> Iterator[object]:
    """Where each document starts to differ from what its template and the tables say."""
    from replication.documents import documents, render  # jinja2 is slow to import

    for name in documents():
        texts = [text.splitlines() for text in ((ROOT / name).read_text("utf-8"), render(name))]
        for line, (said, told) in enumerate(itertools.zip_longest(*texts, fillvalue=""), 1):
            if said != told:
                yield Difference(name, line, "text", said.strip(), told.strip())
                break


def verify_tables() -> int:
    """Hold all committed tables and documents against each other; returns the exit status."""
    started, found = time.monotonic(), []
    sets = [ROOT / "figures" / name for name in committed()]
    for folder in [*sets, ROOT / "docs"]:
        place = folder.relative_to(ROOT).as_posix()
        found += [f"{place}/{DIGESTS} says otherwise: {name}" for name in attempt(changed, folder)]
    for folder in sets:
        found += attempt(of_set, folder)
    for one, other in itertools.combinations(sets, 2):
        found += attempt(of_pair, one, other)
    found += attempt(of_documents)
    print("\n".join([*found, f"{len(found) or 'no'} differences ({time.monotonic() - started:.0f} s)"]))
    return int(bool(found))


def main(options: argparse.Namespace, variables: Mapping[str, str]) -> int:
    """Verify what the command line asks for; returns the exit status. variables: of the jobs."""
    check_limit(options.limit)
    if options.cores is not None:
        check_whole("--cores", options.cores, 1)
    drawn = not (options.tables or options.cells)
    check(options.seed is None or drawn, "--seed", options.seed, "left out where nothing is drawn")
    try:
        return verify_tables() if options.tables else verify_cells(options, variables)
    except KeyboardInterrupt:
        print("reproduce.sh verify: stopped")
        return INTERRUPTED
