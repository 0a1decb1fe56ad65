"""One universe: the whole replication, from training data to measures, under one set of values.

Where a condition that the paper states as its set-up is violated, nothing is trained: no claim of the paper
is about it. If it is a condition on the data or the region of one α, the others are trained. The conditions
and the measures of all regions are kept.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.distance import cdist

from replication.evidence.joined_measures import (
    common_errors,
    learning_measures,
    new_state_purity,
    promise_gap,
    success_log_odds,
)
from replication.evidence.measures import (
    classification,
    first_link_shares,
    measure_rows,
    run_measures,
    test_states,
)
from replication.studies.alternatives import ORACLES, learn_hypothesis
from srlrepro.dynamics.closed_loop import ClosedLoop, Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.learner.training import VISITED_FORMAT, Run, identify, train
from srlrepro.region.hypothesis import CompiledHypothesis, Hypothesis
from srlrepro.region.safe_region import SafeRegion
from srlrepro.region.tsne import label_purity
from srlrepro.samplers import TrainingData, generate
from srlrepro.settings.config import Config
from srlrepro.storage.files import read_arrays, read_json, read_table
from srlrepro.storage.provenance import code_hash

Learned = dict[str, tuple[TrainingData, CompiledHypothesis]]  # by the text of α
Labelled = tuple[Floats, Labels]  # states [N, 6] and their labels [N]
LABEL_EVERY = 25  # steps of a training between two labelled states, at least: nearer ones are much the same


@dataclass(frozen=True)
class Universe:
    """Values, and the cells that are trained under them.

    Attributes:
        config: every value.
        alphas: texts of α, with "none" for the free learner.
        deltas, seeds: mismatches Δ, and seeds of the learner.
        data_seed: of the training data and of t-SNE.
        steps: training steps of a cell.
    """

    config: Config
    alphas: tuple[str, ...]
    deltas: tuple[float, ...]
    seeds: tuple[int, ...]
    data_seed: int
    steps: int

    @property
    def runs(self) -> list[Run]:
        """The training runs, the free learner's first."""
        alphas = sorted((None if a == "none" else float(a) for a in self.alphas), key=lambda a: a is not None)
        return [Run(a, d, s, self.steps) for a in alphas for d in self.deltas for s in self.seeds]

    def learn(self) -> Learned:
        """The training data and the hypothesis of every α, as it is on the nominal system."""
        numbers = {a: float(a) for a in self.alphas if a != "none"}
        datasets = {a: generate(value, self.config, self.data_seed) for a, value in numbers.items()}
        return {
            a: (data, learn_hypothesis(data, self.config, self.data_seed)) for a, data in datasets.items()
        }


def conditions(universe: Universe, learned: Learned) -> pd.DataFrame:
    """What the paper states as its set-up and can be seen without a training: alpha, condition, value, met.

    alpha is empty for a condition on the whole universe.

    The origin is asymptotically stable under K for every Δ, and known to be safe (Sec. II-A): near upright
    the spectral radius is below 1, and Γ(Ψ(0)) > p_t. Fig. 2 (a)-(c): states of both labels; θ1 and θ̇1 of
    the MND correlate positively. That free PPO learns to track cannot be seen at a reduced budget.
    """
    rows: list[tuple[str, str, float, bool]] = []
    for delta in universe.deltas:
        loop = ClosedLoop.from_config(universe.config, delta)
        radius = loop.controller.spectral_radius(loop.system)
        rows.append(("", f"upright is stable under K at Δ = {delta:g}", radius, radius < 1))
    for alpha, (data, region) in learned.items():
        share, gamma = float(data.z.mean()), float(region.safety(np.zeros((1, 6)))[0])
        accepted = gamma > universe.config.paper.p_t
        rows.append((alpha, f"safe and unsafe states in D_tr of α = {alpha}", share, 0 < share < 1))
        rows.append((alpha, f"the region of α = {alpha} accepts the origin", gamma, accepted))
    for data, _ in list(learned.values())[:1]:  # the MND is the same for every α
        covariance = float(data.mnd.covariance[0, 3])
        rows.append(("", "θ1 and θ̇1 correlate positively in the MND", covariance, covariance > 0))
    return pd.DataFrame(rows, columns=["alpha", "condition", "value", "met"])


def possible(universe: Universe, met: pd.DataFrame) -> Universe:
    """The universe with those α only that violate nothing; met: of `conditions`."""
    violated = set(met.loc[~met["met"], "alpha"])
    alphas = () if "" in violated else tuple(a for a in universe.alphas if a not in violated)
    return replace(universe, alphas=alphas)


def region_measures(universe: Universe, learned: Learned) -> list[tuple[Any, ...]]:
    """Rows of measures of the training data and of the regions, on fresh states of the nominal system."""
    rows: list[tuple[Any, ...]] = []
    if not learned:
        return rows
    mnd = next(iter(learned.values()))[0].mnd  # the same for every α, and so are the test states
    tests = test_states(mnd, universe.config, np.random.default_rng([universe.data_seed, 1]))
    for alpha, (data, region) in learned.items():
        values = {"safe_share": float(data.z.mean()), **first_link_shares(data.x, universe.config)}
        if isinstance(region, SafeRegion):
            y = region.embedding_
            values["embedding_purity"] = label_purity(cdist(y, y), region.labels_)
            values["new_state_purity"] = new_state_purity(region, tests, data.n_ud, universe.config.paper.k)
        scores = {source: classification(region, x, labels) for source, (x, labels) in tests.items()}
        for source, score in scores.items():
            values |= {f"{name}_{source}": score[name] for name in ("precision", "recall", "brier")}
        values["accepted_share"] = float(np.mean([score["accepted"] for score in scores.values()]))
        rows += measure_rows(values, alpha, seed=universe.data_seed)
    return rows


def train_cells(universe: Universe, learned: Learned, folder: Path) -> list[tuple[Any, ...]]:
    """Train every cell, and return the rows of its measures.

    Products go to ``folder/runs/NAME/`` as `train` writes them, checkpoints to ``folder/checkpoints/``. A
    cell that the same code has finished with the same values is read, not trained again.
    """
    rows: list[tuple[Any, ...]] = []
    common: dict[tuple[float, int], Labelled] = {}  # states of the free run of this Δ and seed
    for run in universe.runs:
        alpha = "none" if run.alpha is None else f"{run.alpha:g}"
        region = learned[alpha][1] if alpha in learned else None
        if region is not None and universe.config.choices.hypothesis in ORACLES:
            region = learn_hypothesis(None, universe.config, delta=run.delta)
        products = folder / "runs" / run.name
        result = _finished(products, run, universe.config, region)
        if result is None:
            checkpoint = folder / "checkpoints" / f"{run.name}.zip"
            result = train(run, universe.config, region, products, checkpoint)
        counts = result["counts"]
        measures = run_measures(result, read_table(products / "trials.csv", ("step", "return")))
        measures |= {"activations": counts["activations"], "falls": counts["falls"]}
        measures["failures"] = counts["hit_the_ground"] + counts["not_recovered_in_time"]
        measures |= learning_measures(products)
        if counts["activations"]:
            measures["success_log_odds"] = success_log_odds(counts["recovered"], measures["failures"])
        visited, real = _visited(products), ClosedLoop.from_config(universe.config, run.delta)
        own = labelled(visited, real, run.steps)
        if region is None:
            common[run.delta, run.seed] = own
        else:
            measures |= _errors(region, own, common.get((run.delta, run.seed)))
        if isinstance(region, SafeRegion):
            measures["promise_gap"] = promise_gap(region, visited, real)
        rows += measure_rows(measures, alpha, run.delta, run.seed)
    return rows


def _visited(products: Path) -> Floats:
    return np.asarray(read_arrays(products / "visited.npz", VISITED_FORMAT, ("x",))["x"], np.float64)


def labelled(visited: Floats, real: ClosedLoop, steps: int) -> Labelled:
    """(x, l(x)) of the visited states [N, 6] of a training, thinned to one in `LABEL_EVERY` of its steps."""
    x = visited[:: max(1, LABEL_EVERY * len(visited) // steps)]
    return x, real.predict(x)


def _errors(region: CompiledHypothesis, own: Labelled, common: Labelled | None) -> dict[str, float]:
    """Measures of h on states that its own run visited, and on those of the free run, if there is one."""
    errors = classification(region, *own)
    measures = {"generalization_error": errors["error"]}
    measures |= {name: errors[name] for name in ("false_positives", "brier")}
    return measures if common is None else measures | common_errors(region, *common)


def _finished(folder: Path, run: Run, config: Config, region: Hypothesis | None) -> dict[str, Any] | None:
    """What run.json holds, if it is of this run and of this code."""
    if not (folder / "run.json").exists():  # it is written last
        return None
    result: dict[str, Any] = read_json(folder / "run.json")
    same = {key: result[key] for key in ("run", "config", "region")} == identify(run, config, region)
    return result if same and result["provenance"]["code"] == code_hash() else None
