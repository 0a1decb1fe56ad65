"""How well a hypothesis predicts safety, and the measures that the claims are tested on."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.random import Generator
from numpy.typing import ArrayLike
from sklearn.calibration import calibration_curve
from sklearn.metrics import brier_score_loss, confusion_matrix

from replication.evidence.claims import MEASURE_COLUMNS
from srlrepro.dynamics.circle_env import perfect_return
from srlrepro.dynamics.closed_loop import ClosedLoop, Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.hypothesis import CompiledHypothesis
from srlrepro.samplers import MultivariateNormal, sample_mnd, sample_uniform
from srlrepro.settings.condition import alpha_text
from srlrepro.settings.config import Config
from srlrepro.storage.files import read_json, read_table, write_table

TEST_STATES = 5000  # per distribution: the standard error of a share is at most 0.007
BINS = 10
LAST_SHARE = 10  # the end of a training is the last tenth of its steps


def classification(region: CompiledHypothesis, x: Floats, labels: Labels) -> dict[str, float]:
    """Errors of any hypothesis h, and of its Γ = P(l(x) = 1), on the states x [B, 6] with true labels [B].

    ``error``: E[I(h ≠ l)], eq. (9); ``false_positives``, ``false_negatives``: its two parts, eq. (12);
    ``accepted``: share with h = 1; ``safe``: share with l = 1; ``precision``: P(l = 1 | h = 1); ``recall``:
    P(h = 1 | l = 1); ``brier``: mean squared error of Γ. A ratio of nothing is NaN.
    """
    probability = region.safety(x)
    h = (probability > region.p_t).astype(np.int64)
    (_, fp), (fn, tp) = confusion_matrix(labels, h, labels=[0, 1]) / len(x)
    return {
        "error": fp + fn,
        "false_positives": fp,
        "false_negatives": fn,
        "accepted": tp + fp,
        "safe": tp + fn,
        "precision": tp / (tp + fp) if tp + fp > 0 else float("nan"),
        "recall": tp / (tp + fn) if tp + fn > 0 else float("nan"),
        "brier": float(brier_score_loss(labels, probability, pos_label=1)),
    }


def test_states(mnd: MultivariateNormal, config: Config, rng: Generator) -> dict[str, tuple[Floats, Labels]]:
    """{"UD": (x, l_n(x)), "MND": …}: fresh states of both distributions, labelled on the nominal system."""
    nominal = ClosedLoop.from_config(config)
    states = {
        "UD": sample_uniform(TEST_STATES, config.paper.state_max, rng),
        "MND": sample_mnd(TEST_STATES, mnd, config, rng),
    }
    return {name: (x, nominal.predict(x)) for name, x in states.items()}


def reliability(region: CompiledHypothesis, x: Floats, labels: Labels) -> pd.DataFrame:
    """Observed share of safe states against the mean predicted Γ, in bins of equal width of Γ."""
    observed, predicted = calibration_curve(labels, region.safety(x), n_bins=BINS)
    return pd.DataFrame({"predicted": predicted, "observed": observed})


def first_link_shares(x: ArrayLike, config: Config) -> dict[str, float]:
    """Shares of states in two parts of the plane (θ1, θ̇1) of Fig. 2 (a)-(c).

    ``near_origin_share``: both within half their ranges; ``corner_share``: both beyond, with opposite signs.
    """
    states, high = np.asarray(x), config.paper.state_max
    angle, rate = states[:, 0] / high[0], states[:, 3] / high[3]
    near = (np.abs(angle) < 0.5) & (np.abs(rate) < 0.5)
    corner = (np.abs(angle) > 0.5) & (np.abs(rate) > 0.5) & (angle * rate < 0)
    return {"near_origin_share": float(near.mean()), "corner_share": float(corner.mean())}


def measure_rows(
    values: Mapping[str, float], alpha: str, delta: float | None = None, seed: int | None = None
) -> list[tuple[Any, ...]]:
    """Rows of a table of measures for one cell of the grid."""
    return [(name, alpha, delta, seed, value) for name, value in values.items()]


def write_measures(path: str | Path, rows: list[tuple[Any, ...]]) -> pd.DataFrame:
    """Write rows of `measure_rows` as a table of measures (columns as in `claims`), and return it."""
    table = pd.DataFrame(rows, columns=list(MEASURE_COLUMNS))
    write_table(Path(path), table)
    return table


def read_measures(folder: str | Path) -> pd.DataFrame:
    """All tables of measures in a folder as one."""
    tables = [pd.read_csv(path, dtype={"alpha": str}) for path in sorted(Path(folder).glob("*.csv"))]
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=list(MEASURE_COLUMNS))


def read_runs(results: str | Path, names: Iterable[str]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """(learning curves, counts) of the named runs, with the columns alpha, delta and seed.

    Raises:
        ResultError: a run has not been made.
    """
    curves, counts = [], []
    for name in names:
        folder = Path(results, "runs", name)
        result = read_json(folder / "run.json")
        run = result["run"]
        cell = {"alpha": alpha_text(run["alpha"]), "delta": run["delta"], "seed": run["seed"]}
        curves.append(read_table(folder / "curve.csv", ("step", "mean_return")).assign(**cell))
        counts.append(cell | result["counts"] | {"steps": result["steps_done"]})
    return pd.concat(curves, ignore_index=True), pd.DataFrame(counts)


def run_measures(result: Mapping[str, Any], trials: pd.DataFrame) -> dict[str, float]:
    """Measures of one training run.

    ``final_return``: mean return of the trials that end in the last tenth of the steps; ``success_rate``:
    recovered / activations where K was tried; ``violations_per_1000_steps``: failures of K and falls of π;
    ``policy_return_share``: return of the final mean policy in its own condition over a perfect one.
    """
    counts, steps = result["counts"], result["steps_done"]
    last = trials[trials["step"] > steps * (1 - 1 / LAST_SHARE)]
    tried = counts["recovered"] + counts["hit_the_ground"] + counts["not_recovered_in_time"]
    failures = tried - counts["recovered"]
    best = perfect_return(Config().with_values(**result["config"]))
    measures = {
        "final_return": float(last["return"].mean()),
        "violations_per_1000_steps": 1000.0 * (failures + counts["falls"]) / steps,
        "policy_return_share": result["final_policy"]["own condition"]["return"] / best,
    }
    if tried:
        measures["success_rate"] = counts["recovered"] / tried
    return measures
