"""The universes of every study: which values, datasets, learners and cells each has.

- "multiverse": a universe for every row of `multiverse.design`;
- "calibrated": the grid with Γ's evidence, and what goes with it, as held-out calibration chose them;
- "crossed": every dataset with every learner seed, so that the variance of the two can be told apart;
- "caution": thresholds p_t with shares α, under the paper's region and under an SVM of the whole state;
- "shift": distributions D_n that Theorem 1 advises, nearer to the D of the learner, α = 0 in all but one;
- "joints": numbers of joints with the ends of α, under the paper's region and under `WHOLE_STATE`, each with
  the p_t that gives `RECALL`. Beside them are the cells of `joints.cells`, which train nothing.

Where datasets and learners are not crossed, a dataset has the learner of its own number. The id of a universe
says what tells it from the others, `tells` reads it.
"""

from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd

from replication.evidence.measures import read_measures
from replication.evidence.results import RECORD, TrainedRun, read_run
from replication.studies import multiverse
from replication.studies.joints.chains import learning
from srlrepro.settings.choices import Choices
from srlrepro.settings.condition import NONE
from srlrepro.settings.config import Config
from srlrepro.settings.paper import Paper
from srlrepro.storage.files import read_table, write_table

Jobs = dict[str, dict[str, Any]]  # by the id of a universe: parameters of its notebook

# Held-out calibration chose these, before the paper's words for the evidence came first.
CALIBRATED = {
    "gamma_evidence": "held out",
    "psi": "neighbours",
    "psi_neighbours": 16,
    "gamma_bandwidth": 0.2,
    "gamma_prior": 0.001,
}
THRESHOLDS = (0.5, 0.65, Paper.p_t, 0.9, 0.95)  # p_t: below and above the paper's, to a risk of 1 in 20
HYPOTHESES = (Choices.hypothesis, "svm")  # of two dimensions, and of all
AS_WRITTEN, REFITTED, WEIGHTED = "as-written", "refitted", "weighted-ud"
LAW = "learners-law"
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {  # of D_n: α, and what differs from the default
    AS_WRITTEN: ("0", {}),
    # The torques of the learner's first policy: its std, anew in each period; it meets no end but the ground.
    LAW: ("0", {"random_law": "normal", "random_hold": Choices.control_period, "random_stop": "ground"}),
    REFITTED: ("0", {}),
    WEIGHTED: ("1", {"gamma_weights": "density ratio"}),
}
LINKS, FEW_LINKS = (2, 3, 4, 5), (2, 3)  # joints with learners, of all and of a quick study
ENDS_OF_ALPHA = ("0", "1")
WHOLE_STATE = "svm"  # at n = 3 the best of the whole state, by earlier comparisons; notebook 21 names others
RECALL = 0.8  # P(h = 1 | l = 1) on a random policy's visits, by which p_t is set for more joints
FEW = 2  # datasets, and learners, of a quick study; a quick multiverse has some universes of its own


def universes(study: str, alphas: list[str], deltas: list[float], seeds: list[int], few: bool) -> Jobs:
    """{id of a universe: the parameters of its notebook that differ between universes}.

    Args:
        study: see the module.
        alphas: conditions of the paper's grid, as texts, with "none".
        deltas, seeds: mismatches and datasets of the study.
        few: only some of the universes.
    """
    if study == "multiverse":
        return multiverse.jobs(alphas, few)
    seeds = seeds[:FEW] if few else seeds
    supervised = [alpha for alpha in alphas if alpha != NONE]
    found: Jobs = {}
    if study == "crossed":
        for d in seeds:
            found |= _job({"dataset": d}, d, supervised, deltas, seeds)
    elif study == "calibrated":
        for d in seeds:
            found |= _job({"dataset": d}, d, supervised, deltas, [d], CALIBRATED)
    elif study == "caution":
        thresholds = (min(THRESHOLDS), Paper.p_t) if few else THRESHOLDS
        for kind, p_t, d in product(HYPOTHESES, thresholds, seeds):
            papers = (kind, p_t) == (Choices.hypothesis, Paper.p_t)  # has the free learner, for its states
            told = {"hypothesis": kind, "threshold": f"{p_t:g}", "dataset": d}
            values = {"hypothesis": kind, "p_t": p_t}
            found |= _job(told, d, alphas if papers else supervised, deltas, [d], values)
    elif study == "shift":
        found = dict(_shifted(deltas, seeds))
    elif study == "joints":
        ends, links = [*ENDS_OF_ALPHA], FEW_LINKS if few else LINKS
        for n, kind, d in product(links, (Choices.hypothesis, WHOLE_STATE), seeds):
            own = (
                [*ends, NONE] if kind == Choices.hypothesis else ends
            )  # the free learner is the same beside both
            values = differing(learning(n).with_values(hypothesis=kind))
            jobs = _job({"links": n, "hypothesis": kind, "dataset": d}, d, own, deltas, [d], values)
            found |= {name: job | {"RECALL": RECALL} for name, job in jobs.items()}
    return found


def learners_of(job: str) -> str:
    """The universe whose free learners have the joints and the dataset of a job of `joints.cells`."""
    own = tells(job)
    return f"links_{own['links']}__hypothesis_{Choices.hypothesis}__dataset_{own['dataset']}"


def differing(config: Config) -> dict[str, Any]:
    """{name: value} of the parameters that differ from the default."""
    default = Config().as_dict()
    return {name: value for name, value in config.as_dict().items() if value != default[name]}


def _shifted(deltas: list[float], seeds: list[int]) -> Iterator[tuple[str, dict[str, Any]]]:
    """A refitted D_n is of one Δ, and so is its universe; beside the data as written is the free learner."""
    for (variant, (alpha, values)), d in product(VARIANTS.items(), seeds):
        told, own = {"variant": variant, "dataset": d}, [alpha, NONE] if variant == AS_WRITTEN else [alpha]
        if variant != REFITTED:
            yield from _job(told, d, own, deltas, [d], values).items()
            continue
        for delta in deltas:
            one = _job(told | {"delta": f"{delta:g}"}, d, own, [delta], [d], values)
            yield from ((name, job | {"REFIT_STEPS": Choices.quick_steps}) for name, job in one.items())


def _job(
    told: dict[str, Any],
    dataset: int,
    alphas: list[str],
    deltas: list[float],
    seeds: list[int],
    values: dict[str, Any] | None = None,
) -> Jobs:
    name = "__".join(f"{key}_{value}" for key, value in told.items())
    cells = {"ALPHAS": alphas, "DELTAS": deltas, "SEEDS": seeds}
    return {name: {"ID": name, "DATA_SEED": dataset, "SETTINGS": values or {}} | cells}


def tells(name: str) -> dict[str, str]:
    """What the id of a universe says of it: dataset, hypothesis, threshold, variant, links, …, as texts."""
    parts = (part.partition("_") for part in name.split("__"))
    return {key: value for key, _, value in parts}


def gather(folders: Mapping[str, Path]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The measures and the conditions of universes as two tables; `tells` gives more columns.

    Args:
        folders: of the universes, by their ids.

    Raises:
        ResultError: a table is missing or damaged.
    """
    measures, met = [], []
    names = ("alpha", "condition", "value", "met")
    for name, folder in folders.items():
        told, own = tells(name), read_measures(folder / "measures.csv")
        met.append(read_table(folder / "conditions.csv", names, text=("alpha",)).assign(**told))
        if "delta" in told:  # of one mismatch: so are its data and its region
            own["delta"] = own["delta"].fillna(float(told.pop("delta")))
        measures.append(own.assign(**told))
    tables = [pd.concat(tables, ignore_index=True) for tables in (measures, met)]
    for table, column in product(tables, ("dataset", "threshold", "links")):
        if column in table:
            table[column] = pd.to_numeric(table[column])
    return tables[0], tables[1]


def write_gathered(folders: list[Path], out: Path) -> int:
    """Write the tables of `gather` to a folder, and return how many rows of measures there are."""
    measures, met = gather({folder.name: folder for folder in folders})
    write_table(out / "measures.csv", measures)
    write_table(out / "conditions.csv", met)
    return len(measures)


def free_runs(folders: Mapping[str, Path]) -> dict[tuple[float, int], TrainedRun]:
    """The runs without a supervisor in universes, by Δ and dataset; folders: as of `gather`."""
    found = {}
    for name, folder in folders.items():
        for record in sorted((folder / "runs").glob(f"alpha_{NONE}__*/{RECORD}")):
            run = read_run(record)
            found[run.condition.delta, int(tells(name)["dataset"])] = run
    return found
