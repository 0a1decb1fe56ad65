"""Results as evidence: what they say, and whether they are of what their reader asks for.

The products of a run lie in one folder (`srlrepro.learner.training`); its measures, made of them by
``python -m replication measure``, lie beside them in ``measures.csv``.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from replication.evidence.claims import MEASURE_COLUMNS
from srlrepro.dynamics.pendulum import Floats
from srlrepro.learner import VISITED_FORMAT
from srlrepro.pins import ARITHMETIC
from srlrepro.region.safe_region import SafeRegion
from srlrepro.samplers import TrainingData
from srlrepro.settings.condition import Condition, parse_alpha
from srlrepro.settings.config import Config
from srlrepro.storage.files import ResultError, read_arrays, read_json, read_table
from srlrepro.storage.made_of import require_made_of

RECORD, DATA, REGION = "run.json", "training_data.npz", "region.npz"


def read_learned(
    results: str | Path, alphas: Iterable[str], seed: int, config: Config
) -> dict[str, tuple[TrainingData, SafeRegion]]:
    """The training data (of a seed) and the regions of a folder of results, by the text of α.

    Raises:
        ParameterError: one was made with other values than those of config.
        ResultError: a file is missing or damaged.
    """
    learned = {}
    for alpha in alphas:
        folder, asked = Path(results, f"data_{seed}", f"alpha_{alpha}"), parse_alpha(alpha)
        data, region = TrainingData.load(folder / DATA), SafeRegion.load(folder / REGION)
        require_made_of(data.made_of, config, "data", where=folder / DATA, alpha=asked, seed=seed)
        require_made_of(region.made_of_, config, "region", where=folder / REGION, alpha=asked, seed=seed)
        learned[alpha] = data, region
    return learned


@dataclass(frozen=True)
class TrainedRun:
    """What the record of a run, its run.json, says.

    Attributes:
        folder: that holds all products.
        region: digest of the hypothesis behind the supervisor.
        steps: asked for; steps_done: rounded up to whole updates.
        counts: of the whole training: activations of K, their outcomes, falls of π, ….
        returns: of the final mean policy, in its "own condition" and with "no supervisor".
    """

    folder: Path
    condition: Condition
    config: Config
    region: str
    steps: int
    steps_done: int
    counts: Mapping[str, int]
    returns: Mapping[str, float]

    @property
    def failures(self) -> int:
        """Activations of K that did not recover the system."""
        return self.counts["hit_the_ground"] + self.counts["not_recovered_in_time"]

    def trials(self) -> pd.DataFrame:
        """One row per trial: step at its end, return, …."""
        return read_table(self.folder / "trials.csv", ("step", "return"), numbers=("step", "return"))

    def curve(self) -> pd.DataFrame:
        """The learning curve: step, mean_return, mean_length, …, a row per window of steps."""
        return read_table(self.folder / "curve.csv", ("step", "mean_return", "mean_length"))

    def evaluations(self) -> pd.DataFrame:
        """Trials of the mean policy without a supervisor: step, return, length, outcome."""
        return read_table(self.folder / "evaluations.csv", ("step", "return"), numbers=("step", "return"))

    def visited(self) -> Floats:
        """States [N, 2n] that the learner's steps reached, rad and rad/s, in their order."""
        path, size = self.folder / "visited.npz", len(self.config.paper.state_max)
        x = read_arrays(path, VISITED_FORMAT, ("x",))["x"]
        fits = x.dtype.kind == "f" and x.ndim == 2 and x.shape[1] == size and len(x) > 0
        if not fits or not np.isfinite(x).all():
            raise ResultError(f"{path} holds no states [N, {size}] of finite numbers")
        return np.asarray(x, np.float64)


def read_run(place: str | Path) -> TrainedRun:
    """The run in a folder, or of a run.json.

    Raises:
        ResultError: there is none, it is not of a training run, or it rests on another arithmetic.
    """
    path = Path(place) if Path(place).name == RECORD else Path(place, RECORD)
    return as_run(read_json(path), path)


def as_run(found: Any, path: Path) -> TrainedRun:
    """The run that a record, read from a path, tells of; `ResultError`: it is not of a training run."""
    try:
        run, config = found["run"], Config().with_values(**found["config"])
        lacking = config.as_dict().keys() - found["config"].keys()
        if lacking:
            raise ValueError(f"it lacks the value of {min(lacking)}")
        if found.get("arithmetic", 0) != ARITHMETIC:
            raise ValueError(f"its arithmetic is {found.get('arithmetic', 0)!r}, not {ARITHMETIC}")
        return TrainedRun(
            folder=path.parent,
            condition=Condition(run["alpha"], run["delta"], run["seed"]),
            config=config,
            region=str(found["region"]),
            steps=int(run["steps"]),
            steps_done=int(found["steps_done"]),
            counts={name: int(number) for name, number in found["counts"].items()},
            returns={name: float(trial["return"]) for name, trial in found["final_policy"].items()},
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ResultError(f"{path} is not of a training run: {error!r}") from error


def require_same(run: TrainedRun, config: Config, steps: int | None = None) -> None:
    """Raise `ResultError` unless a run was trained under these values, and for these steps, if any."""
    asked = config.as_dict() | {"steps": run.steps if steps is None else steps}
    found = run.config.as_dict() | {"steps": run.steps}
    for name, value in asked.items():
        if found[name] != value:
            raise ResultError(f"{run.folder} was trained with {name} = {found[name]}, not with {value}")


def read_runs(
    results: str | Path, names: Iterable[str], config: Config, steps: int | None = None
) -> pd.DataFrame:
    """The runs of a folder of results that conditions name, such as alpha_0__delta_1.1__seed_0.

    Returns:
        A row per run, with its name as the index: alpha (text), delta, seed, its counts, steps (done) and
        failures (of K).

    Raises:
        ResultError: a run has not been made, or was trained for another condition, under other values, or for
            other steps, if they are given.
    """
    rows = {}
    for name in names:
        run = read_run(Path(results, "runs", name))
        if run.condition.name != name:
            raise ResultError(f"{run.folder} holds a run of {run.condition.name}")
        require_same(run, config, steps)
        counts = {**run.counts, "steps": run.steps_done, "failures": run.failures}
        rows[name] = _cell(run.condition) | counts
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("run")


def read_curves(results: str | Path, names: Iterable[str]) -> pd.DataFrame:
    """The learning curves of the named runs, one below the other, with the columns alpha, delta and seed."""
    runs = [read_run(Path(results, "runs", name)) for name in names]
    return pd.concat([run.curve().assign(**_cell(run.condition)) for run in runs], ignore_index=True)


def read_run_measures(results: str | Path, names: Iterable[str]) -> pd.DataFrame:
    """The tables of measures of the named runs as one; `ResultError`: one is missing or of another run."""
    tables = []
    for name in names:
        path = Path(results, "runs", name, "measures.csv")
        table = read_table(path, MEASURE_COLUMNS, ("delta", "seed", "value"), text=("alpha",))
        of = Condition.parse(name)
        same = np.allclose(table[["delta", "seed"]], [of.delta, of.seed])  # names have few digits
        if not (same and (table["alpha"] == of.alpha_text).all()):
            raise ResultError(f"{path} holds measures of another run")
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def _cell(condition: Condition) -> dict[str, str | float]:
    return {"alpha": condition.alpha_text, "delta": condition.delta, "seed": condition.seed}
