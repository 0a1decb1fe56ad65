"""The cells of the study of joints: which there are, their data, and the scores of every hypothesis.

A cell is n joints × k states × a share α × a dataset. The cells of one n and one dataset are a job: they
share test states and true labels. A cell is kept in a file as soon as it is done, and is not made again by
the same code. Where free learners of this n and dataset were trained, what they visited is one more law of
test states.
"""

import hashlib
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from sklearn.metrics import brier_score_loss, roc_auc_score

from replication.evidence.measures import BINS
from replication.evidence.results import read_run
from replication.studies.caution import RECALLS, at_recall
from replication.studies.joints.chains import controlled, exploring, normal, training_data
from replication.studies.joints.rungs import CEILING, RUNGS, WHOLE, Known, learn
from srlrepro.dynamics.closed_loop import ClosedLoop, Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.samplers import (
    MultivariateNormal,
    sample_mnd,
    sample_uniform,
    visited_states,
)
from srlrepro.settings.condition import Condition
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check
from srlrepro.settings.paper import Paper
from srlrepro.storage.files import read_json, read_table, write_json, write_table
from srlrepro.storage.provenance import code_hash

ALPHAS, MIXED = ("0", "0.5", "1"), "0.5"  # of the cells, and where both laws have as many states
DELTAS = (1.0, 1.1, 4.0)  # of the system that labels the test states; 1: the nominal one
LAWS, LEARNERS = (
    ("UD", "MND", "visits"),
    "learners",
)  # of test states; where free learners were trained, a fourth
MOST = 4000  # k; of more only α = `MIXED`, and no t-SNE: Ω of 16 000 states has 2 GB, twice while it is made
LEAST = 20  # test states of each label: with fewer, a share of them says little
SIMULATED = 100  # states on which the time of a simulation is taken
TEST_STREAM = 3  # of the random numbers of a dataset's seed
CELL = ("links", "k", "alpha", "dataset")
SCORES = (*(f"false_positives_{recall:g}" for recall in RECALLS), "auc", "brier", "calibration", "accepted")
CHEAP = ("pca", "lda", "mass", *WHOLE, CEILING)  # some seconds, however many states
PLANES = ("tsne", "tsne_neighbours")  # from one embedding, which takes k² in time and memory
OTHERS = tuple(name for name in RUNGS if name not in (*CHEAP, *PLANES))  # as slow, for each


@dataclass(frozen=True)
class Cell:
    """What one set of hypotheses is learned from."""

    links: int  # n
    k: int
    alpha: str  # text of α
    dataset: int  # seed

    @property
    def name(self) -> str:
        """Names its file in the folder of the job."""
        return f"k_{self.k}__alpha_{self.alpha}"


@dataclass(frozen=True)
class Design:
    """Which cells there are, and how much each is asked."""

    links: tuple[int, ...]
    datasets: dict[int, int]  # of each k
    planes: dict[int, int]  # of them, with the paper's map
    others: dict[int, int]  # of them, with the rest of the ladder
    test_states: int  # per law
    settings: dict[str, Any]  # that differ from the default

    @property
    def jobs(self) -> dict[str, tuple[int, int]]:
        """{name: (links, dataset)}, those that take longest first."""
        most = range(max(self.datasets.values()))
        return {f"links_{n}__dataset_{d}": (n, d) for d in most for n in reversed(self.links)}

    def config(self, links: int, k: int = Paper.k) -> Config:
        """The values of all parameters: those of `controlled`, and k."""
        return controlled(links).with_values(k=k, **self.settings)

    def cells(self, links: int, dataset: int) -> Iterator[tuple[Cell, tuple[str, ...]]]:
        """The cells of a job, each with the hypotheses that are learned in it, in the order of `RUNGS`."""
        for k, datasets in self.datasets.items():
            large = k > MOST
            for alpha in () if dataset >= datasets else (MIXED,) if large else ALPHAS:
                chosen = [*CHEAP]
                if dataset < self.planes[k]:
                    chosen += PLANES
                if dataset < self.others[k]:
                    chosen += OTHERS
                yield Cell(links, k, alpha, dataset), tuple(name for name in RUNGS if name in chosen)


FULL = Design(
    links=tuple(range(1, 9)),
    datasets={250: 5, 1000: 10, 4000: 3, 16_000: 2},
    planes={250: 5, 1000: 10, 4000: 3, 16_000: 0},
    others={250: 3, 1000: 3, 4000: 0, 16_000: 0},
    test_states=3000,
    settings={},
)
FEW = Design(
    links=(2, 3),
    datasets={40: 2, 120: 2},
    planes={40: 2, 120: 2},
    others={40: 1, 120: 0},
    test_states=200,
    settings={"random_rollouts": 300},
)


def design(few: bool) -> Design:
    """The study, or a small one that shows that all of it runs."""
    return FEW if few else FULL


def held_out(config: Config, seed: int, mnd: MultivariateNormal, number: int) -> dict[str, Floats]:
    """{law: states [N, 2n]} of `LAWS`, none of which any hypothesis has learned from."""
    rng = np.random.default_rng([seed, TEST_STREAM])
    states = {"UD": sample_uniform(number, config.paper.state_max, rng)}
    states["MND"] = sample_mnd(number, mnd, config, rng)
    visits = visited_states(exploring(config), rng)
    states["visits"] = visits[rng.choice(len(visits), min(number, len(visits)), replace=False)]
    return states


def learners_states(universe: Path, dataset: int, number: int) -> Floats:
    """States [N, 2n] that free learners visited, over their whole training, as many of each mismatch.

    Args:
        universe: its folder, with the runs without a supervisor of every mismatch in `DELTAS`.
        dataset: whose learner they are of.
        number: N, if each has visited so many.

    Raises:
        ResultError: a run is missing or damaged.
    """
    names = [Condition(None, delta, dataset).name for delta in DELTAS[1:]]
    visited = [read_run(universe / "runs" / name).visited() for name in names]
    most = number // len(visited)
    return np.concatenate([x[np.linspace(0, len(x) - 1, min(most, len(x))).astype(int)] for x in visited])


def scores_of(labels: Labels, safety: Floats) -> dict[str, float]:
    """`SCORES` of P(l(x) = 1) [N] where the true labels are l(x) [N]; none with too few of one label.

    The false positives are the share of the *unsafe* states that is accepted, at each recall (`at_recall`).
    Calibration is the mean distance of the predicted from the observed share, in `BINS` bins. Accepted is the
    share of all states at the paper's threshold p_t.
    """
    if min(labels.sum(), len(labels) - labels.sum()) < LEAST:
        return {}
    found = {f"false_positives_{recall:g}": rate for recall, rate in at_recall(labels, safety).items()}
    found |= {"auc": float(roc_auc_score(labels, safety)), "brier": float(brier_score_loss(labels, safety))}
    bins = np.minimum((safety * BINS).astype(np.int64), BINS - 1)
    found["calibration"] = float(np.abs(np.bincount(bins, labels - safety)).sum() / len(labels))
    return found | {"accepted": float((safety > Paper.p_t).mean())}


def sources() -> str:
    """SHA-256 of the method and of what this study adds to it."""
    here = Path(__file__).resolve().parent
    files = [
        *(here / f"{n}.py" for n in ("cells", "chains", "parametric", "rungs")),
        *(here.parent / f"{n}.py" for n in ("alternatives", "caution")),
    ]
    return hashlib.sha256(code_hash().encode() + b"".join(file.read_bytes() for file in files)).hexdigest()


def measure_cell(
    cell: Cell,
    names: tuple[str, ...],
    known: Known,
    states: dict[str, Floats],
    labels: dict[tuple[str, float], Labels],
) -> dict[str, list[dict[str, Any]]]:
    """Learn hypotheses and score them.

    Args:
        states: by law; labels: [N] of these, by law and Δ.

    Returns:
        ``scores``: a row for each hypothesis, law and Δ, with `SCORES` and the share of safe states;
        ``times``: one for each hypothesis, in s for learning and in µs for a query, of many at a time.
    """
    scores: list[dict[str, Any]] = []
    times: list[dict[str, Any]] = []
    for name in names:
        started = time.perf_counter()
        safety = learn(name, known)
        learned = time.perf_counter()
        asked = states if name != CEILING else {"UD": states["UD"][:SIMULATED]}
        said = {law: safety(x) for law, x in asked.items()}
        queried = (time.perf_counter() - learned) / sum(map(len, asked.values()))
        if name == CEILING:  # it says the nominal labels, which are there
            said = {law: labels[law, 1.0].astype(np.float64) for law in states}
        times.append(
            asdict(cell) | {"hypothesis": name, "learning_s": learned - started, "query_us": 1e6 * queried}
        )
        for (law, delta), true in labels.items():
            row = asdict(cell) | {"hypothesis": name, "law": law, "delta": delta, "safe": float(true.mean())}
            scores.append(row | scores_of(true, said[law]))
    return {"scores": scores, "times": times}


def run_job(
    name: str, folder: Path, few: bool, learners: Path | None = None, only: Iterable[str] = ()
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Scores and times of all cells of a job, as tables (see `measure_cell`).

    Every cell is written to ``folder/NAME/`` when it is done, and taken from there by the same code.

    Args:
        learners: folder of the universe whose free learners' states are test states too (`learners_states`);
            None: the law `LEARNERS` is not among the rows.
        only: names of the cells that are wanted; none: all.

    Raises:
        ParameterError: the design has no job, or the job no cell, of this name.
        ResultError: a run of the free learners is missing or damaged.
    """
    plan = design(few)
    check(name in plan.jobs, "job", name, f"one of {', '.join(plan.jobs)}")
    links, dataset = plan.jobs[name]
    config = plan.config(links)
    cells = {cell.name: (cell, names) for cell, names in plan.cells(links, dataset)}
    for wanted in only:
        check(wanted in cells, "cell", wanted, f"one of {', '.join(cells)}")
    visited = {}
    if learners is not None:
        visited[LEARNERS] = learners_states(learners, dataset, plan.test_states)
    asked = {law: hashlib.sha256(x.tobytes()).hexdigest() for law, x in visited.items()}
    made_of = {"code": sources(), "values": config.as_dict(), "test_states": plan.test_states, "asked": asked}
    tables: dict[str, list[dict[str, Any]]] = {"scores": [], "times": []}
    shared: tuple[MultivariateNormal, dict[str, Floats], dict[tuple[str, float], Labels]] | None = None
    for cell, names in (cells[wanted] for wanted in only or cells):
        file, told = folder / name / f"{cell.name}.json", made_of | {"hypotheses": list(names)}
        found = read_json(file) if file.exists() else {}
        if found.get("made_of") != told:
            shared = shared or _shared(config, dataset, plan.test_states, visited)
            mnd, states, labels = shared
            own = plan.config(links, cell.k)
            data = training_data(float(cell.alpha), own, dataset, mnd)
            found = {"made_of": told} | measure_cell(cell, names, Known(data, own, dataset), states, labels)
            write_json(file, found)
        for key, rows in tables.items():
            rows += found[key]
    scores = pd.DataFrame(tables["scores"]).reindex(
        columns=[*CELL, "hypothesis", "law", "delta", "safe", *SCORES]
    )
    return scores, pd.DataFrame(tables["times"])


def _shared(
    config: Config, dataset: int, number: int, visited: dict[str, Floats]
) -> tuple[MultivariateNormal, dict[str, Floats], dict[tuple[str, float], Labels]]:
    """The MND of a job, its test states by law, with those visited, and their labels by law and Δ."""
    mnd = normal(config, dataset)
    states = held_out(config, dataset, mnd, number) | visited
    loops = {delta: ClosedLoop.from_config(config, delta) for delta in DELTAS}
    labels = {(law, delta): loop.predict(x) for law, x in states.items() for delta, loop in loops.items()}
    return mnd, states, labels


def write_job(
    name: str, folder: Path, few: bool, learners: Path | None = None, only: Iterable[str] = ()
) -> int:
    """Write ``NAME__scores.csv`` and ``NAME__times.csv`` of `run_job`; returns the number of scores."""
    scores, times = run_job(name, folder, few, learners, only)
    write_table(folder / f"{name}__times.csv", times)
    write_table(folder / f"{name}__scores.csv", scores)
    return len(scores)


def write_times(folder: Path, out: Path) -> int:
    """Write the medians of the times of all jobs in a folder, by hypothesis and k; returns how many rows.

    Times are not the same twice, so that they stand in no result.

    Raises:
        ParameterError: the folder has no times.
        ResultError: a table is damaged.
    """
    names = ("hypothesis", "k", "learning_s", "query_us")
    tables = [read_table(file, names) for file in sorted(folder.glob("*__times.csv"))]
    check(bool(tables), "folder", folder, "one with the times of jobs (*__times.csv)")
    found = pd.concat(tables).groupby(["hypothesis", "k"])[["learning_s", "query_us"]]
    medians = found.median().join(found.size().rename("cells"))
    order = {name: place for place, name in enumerate(RUNGS)}
    medians = medians.reset_index().sort_values(["hypothesis", "k"], key=lambda c: c.replace(order))
    write_table(out, medians, digits=3)
    return len(medians)
