"""One universe: the whole replication, from training data to measures, under one set of values.

Where a condition that the paper states as its set-up is violated, nothing is trained: no claim of the paper
is about it. If it is a condition on the data or the region of one α, the others are trained. The conditions
and the measures of all regions are kept.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from replication.evidence.measures import Learned, Row, measure_run
from replication.evidence.results import RECORD, TrainedRun, read_run
from replication.studies.alternatives import ORACLES, learn_hypothesis
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.learner.training import Run, identify, train
from srlrepro.region.hypothesis import Hypothesis
from srlrepro.samplers import generate
from srlrepro.settings.condition import parse_alpha
from srlrepro.settings.config import Config
from srlrepro.storage.files import read_json
from srlrepro.storage.provenance import code_hash


@dataclass(frozen=True)
class Universe:
    """Values, and the cells that are trained under them."""

    config: Config
    alphas: tuple[str, ...]  # texts of α, with "none" for the free learner
    deltas: tuple[float, ...]  # mismatches Δ
    seeds: tuple[int, ...]  # of the learner
    data_seed: int  # of the training data and of t-SNE
    steps: int  # training steps of a cell

    @property
    def runs(self) -> list[Run]:
        """The training runs, the free learner's first."""
        alphas = sorted(map(parse_alpha, self.alphas), key=lambda alpha: alpha is not None)
        return [Run(a, d, s, self.steps) for a in alphas for d in self.deltas for s in self.seeds]

    def learn_hypotheses(self) -> Learned:
        """The training data and the hypothesis of every α, as it is on the nominal system."""
        learned = {}
        for alpha in self.alphas:
            share = parse_alpha(alpha)
            if share is not None:
                data = generate(share, self.config, self.data_seed)
                learned[alpha] = data, learn_hypothesis(data, self.config, self.data_seed)
        return learned


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
        share, gamma = float(data.z.mean()), float(region.safety(np.zeros_like(data.x[:1]))[0])
        accepted = gamma > universe.config.paper.p_t
        rows.append((alpha, f"safe and unsafe states in D_tr of α = {alpha}", share, 0 < share < 1))
        rows.append((alpha, f"the region of α = {alpha} accepts the origin", gamma, accepted))
    for data, _ in list(learned.values())[:1]:  # the MND is the same for every α
        covariance = float(data.mnd.covariance[0, universe.config.paper.links])
        rows.append(("", "θ1 and θ̇1 correlate positively in the MND", covariance, covariance > 0))
    return pd.DataFrame(rows, columns=["alpha", "condition", "value", "met"])


def possible(universe: Universe, met: pd.DataFrame) -> Universe:
    """The universe with those α only that violate nothing; met: of `conditions`."""
    violated = set(met.loc[~met["met"], "alpha"])
    alphas = () if "" in violated else tuple(a for a in universe.alphas if a not in violated)
    return replace(universe, alphas=alphas)


def train_cells(universe: Universe, learned: Learned, folder: Path) -> list[Row]:
    """Train every cell, and return the rows of its measures (`measure_run`).

    Products go to ``folder/runs/NAME/`` as `train` writes them, checkpoints to ``folder/checkpoints/``. A
    cell that the same code has finished with the same values is not trained again. Common errors are on the
    states of the free run, if that is of this universe.
    """
    rows: list[Row] = []
    free: dict[tuple[float, int], TrainedRun] = {}  # by Δ and seed
    for run in universe.runs:
        region = learned[run.alpha_text][1] if run.alpha_text in learned else None
        if region is not None and universe.config.choices.hypothesis in ORACLES:
            region = learn_hypothesis(None, universe.config, delta=run.delta)
        products = folder / "runs" / run.name
        if not _is_finished(products, run, universe.config, region):
            (products / RECORD).unlink(missing_ok=True)  # of other values: `train` would refuse
            train(run, universe.config, region, products, folder / "checkpoints" / f"{run.name}.zip")
        trained, cell = read_run(products), (run.delta, run.seed)
        rows += measure_run(trained, region, None if region is None else free.get(cell))
        if region is None:
            free[cell] = trained
    return rows


def _is_finished(folder: Path, run: Run, config: Config, region: Hypothesis | None) -> bool:
    """Whether the run.json in a folder is of this run and of this code."""
    if not (folder / RECORD).exists():  # it is written last
        return False
    result = read_json(folder / RECORD)
    same = {key: result[key] for key in ("run", "config", "region")} == identify(run, config, region)
    return same and bool(result["provenance"]["code"] == code_hash())
