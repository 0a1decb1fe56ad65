"""One universe: the whole replication, from training data to measures, under one set of values.

Where a condition that the paper states as its set-up is violated, nothing is trained: no claim of the paper
is about it. If it is a condition on the data or the region of one α, the others are trained. The conditions,
the measures of all regions, and data and regions themselves are kept.
"""

import shutil
from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from replication.evidence.measures import TEST_STATES, Labelled, Learned, Row, measure_run
from replication.evidence.results import DATA, RECORD, REGION, TrainedRun, read_run
from replication.studies.alternatives import ORACLES, Predictor, learn_hypothesis
from replication.studies.joints.chains import data_of, exploring
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.learner.training import Run, identify, train
from srlrepro.region.hypothesis import CompiledHypothesis, Hypothesis
from srlrepro.region.safe_region import SafeRegion
from srlrepro.samplers import (
    MultivariateNormal,
    TrainingData,
    sample_mnd,
    sample_uniform,
    split,
    visited_states,
)
from srlrepro.settings.condition import parse_alpha
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check
from srlrepro.storage.files import beside, read_json
from srlrepro.storage.provenance import code_hash

REFIT_STREAM = 2  # of the random numbers of a dataset's seed; `measure_regions` takes the first
VISITS_STREAM = 4  # of these too; the third makes test states in the study of joints
EXTREME = 1e-9  # the nearest that p_t comes to 0 or 1, which it must not be
REACHED = 0.02  # by which a recall may miss what was asked for: Γ of a grid has steps


@dataclass(frozen=True)
class Universe:
    """Values, and the cells that are trained under them."""

    config: Config
    alphas: tuple[str, ...]  # texts of α, with "none" for the free learner
    deltas: tuple[float, ...]  # mismatches Δ
    seeds: tuple[int, ...]  # of the learner
    data_seed: int  # of the training data and of t-SNE
    steps: int  # training steps of a cell
    finished: tuple[Path, ...] = ()  # folders of other results that may hold the same runs
    refit_steps: int = 0  # of the learner whose states the MND is fitted to anew; 0: it stays
    recall: float = 0.0  # at which p_t of every α is set, see `with_recall`; 0: it stays

    @property
    def runs(self) -> list[Run]:
        """The training runs, the free learner's first."""
        alphas = sorted(map(parse_alpha, self.alphas), key=lambda alpha: alpha is not None)
        return [Run(a, d, s, self.steps) for a in alphas for d in self.deltas for s in self.seeds]

    def learn_hypotheses(self, folder: Path) -> Learned:
        """The training data and the hypothesis of every α, as it is on the nominal system; see `refit`.

        folder: of the universe, for what a refit trains.
        """
        learned = {}
        for alpha in self.alphas:
            share = parse_alpha(alpha)
            if share is not None:
                data = data_of(share, self.config, self.data_seed)
                found = data, learn_hypothesis(data, self.config, self.data_seed)
                found = refit(self, share, *found, folder) if self.refit_steps else found
                learned[alpha] = with_recall(self, *found) if self.recall else found
        return learned


def refit(
    universe: Universe, share: float, data: TrainingData, region: CompiledHypothesis, folder: Path
) -> tuple[TrainingData, CompiledHypothesis]:
    """Data and hypothesis anew, where the MND is fitted to what an early learner visits on the real system.

    That learner is supervised by the region, for ``refit_steps``. Labels stay those of the nominal system.
    What cannot be trained under, as it denies the origin, is returned as it was. The new data, and what is
    learned from them, do not say what they were made of: no seed and no values alone make them.

    Args:
        share: α. folder: of the universe; the products go to ``folder/first``.

    Raises:
        ParameterError: the universe has several mismatches or learners.
    """
    alone = len(universe.deltas) == len(universe.seeds) == 1
    check(alone, "refit_steps", universe.refit_steps, "0, for several mismatches or learners")
    config, seed = universe.config, universe.data_seed
    if region.predict(np.zeros_like(data.x[:1]))[0] == 0:
        return data, region
    run = Run(share, universe.deltas[0], universe.seeds[0], universe.refit_steps)
    mnd = MultivariateNormal.fit(trained(run, config, region, folder / "first").visited())
    (n_ud, n_mnd), rng = split(share, config.paper.k), np.random.default_rng([seed, REFIT_STREAM])
    ud = sample_uniform(n_ud, config.paper.state_max, rng)
    x = np.concatenate([ud, sample_mnd(n_mnd, mnd, config, rng)])
    anew = TrainingData(x, ClosedLoop.from_config(config).predict(x), n_ud, mnd)
    return anew, learn_hypothesis(anew, config, seed)


def visits(universe: Universe) -> Labelled:
    """States that a random policy visits, none of them learned from, with their nominal labels."""
    rng = np.random.default_rng([universe.data_seed, VISITS_STREAM])
    x = visited_states(exploring(universe.config), rng)
    x = x[rng.choice(len(x), min(TEST_STATES, len(x)), replace=False)]
    return x, ClosedLoop.from_config(universe.config).predict(x)


def with_recall(
    universe: Universe, data: TrainingData, region: CompiledHypothesis
) -> tuple[TrainingData, CompiledHypothesis]:
    """A hypothesis with the p_t at which it accepts the share ``recall`` of the safe states among `visits`.

    Known before any training. If Γ is the same at many states there may be none; the nearest is taken.
    """
    check(0 < universe.recall < 1, "recall", universe.recall, "a number in (0, 1), or 0 to leave p_t")
    x, z = visits(universe)
    p_t = float(np.quantile(region.safety(x[z == 1]), 1 - universe.recall))
    p_t = min(max(p_t, EXTREME), 1 - EXTREME)
    if isinstance(region, SafeRegion):
        return data, copy(region).set_params(p_t=p_t)
    check(
        isinstance(region, Predictor) and region.posterior.loop is None, "hypothesis", "an oracle", "learned"
    )
    return data, Predictor(region.posterior, p_t)


def keep(learned: Learned, folder: Path) -> None:
    """Write data and regions to ``folder/alpha_α/``; other hypotheses are learned anew from their data."""
    for alpha, (data, region) in learned.items():
        data.save(folder / f"alpha_{alpha}" / DATA)
        if isinstance(region, SafeRegion):
            region.save(folder / f"alpha_{alpha}" / REGION)


def conditions(universe: Universe, learned: Learned) -> pd.DataFrame:
    """What the paper states as its set-up and can be seen without a training: alpha, condition, value, met.

    alpha is empty for a condition on the whole universe.

    The origin is asymptotically stable under K for every Δ, and known to be safe (Sec. II-A): near upright
    the spectral radius is below 1, and Γ(Ψ(0)) > p_t. Fig. 2 (a)-(c): states of both labels; θ1 and θ̇1 of
    the MND correlate positively. That free PPO learns to track cannot be seen at a reduced budget.
    With a ``recall``, its p_t is told, and whether it gives this recall, to `REACHED`.
    """
    rows: list[tuple[str, str, float, bool]] = []
    for delta in universe.deltas:
        loop = ClosedLoop.from_config(universe.config, delta)
        radius = loop.controller.spectral_radius(loop.system)
        rows.append(("", f"upright is stable under K at Δ = {delta:g}", radius, radius < 1))
    for alpha, (data, region) in learned.items():
        share, gamma = float(data.z.mean()), float(region.safety(np.zeros_like(data.x[:1]))[0])
        accepted = gamma > (region.p_t if universe.recall else universe.config.paper.p_t)
        rows.append((alpha, f"safe and unsafe states in D_tr of α = {alpha}", share, 0 < share < 1))
        rows.append((alpha, f"the region of α = {alpha} accepts the origin", gamma, accepted))
        if universe.recall:
            x, z = visits(universe)
            reached = float(region.predict(x[z == 1]).mean())
            near = abs(reached - universe.recall) <= REACHED
            rows.append((alpha, f"p_t of α = {alpha}", region.p_t, True))
            rows.append((alpha, f"the recall of α = {alpha} is {universe.recall:g}", reached, near))
    drawn = [] if universe.refit_steps else list(learned.values())
    for data, _ in drawn[:1]:  # the MND of the random policy is the same for every α
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
    cell that the same code has finished with the same values, here or among ``finished``, is not trained
    again. Common errors are on the states of the free run, if that is of this universe and of one p_t with
    the others.
    """
    rows: list[Row] = []
    free: dict[tuple[float, int], TrainedRun] = {}  # by Δ and seed
    for run in universe.runs:
        region = learned[run.alpha_text][1] if run.alpha_text in learned else None
        if region is not None and universe.config.choices.hypothesis in ORACLES:
            region = learn_hypothesis(None, universe.config, delta=run.delta)
        config = universe.config if region is None else universe.config.with_values(p_t=region.p_t)
        found = trained(run, config, region, folder, universe.finished)
        cell = run.delta, run.seed
        rows += measure_run(found, region, None if region is None or universe.recall else free.get(cell))
        if region is None:
            free[cell] = found
    return rows


def trained(
    run: Run,
    config: Config,
    region: CompiledHypothesis | None,
    folder: Path,
    finished: Iterable[Path] = (),
) -> TrainedRun:
    """The run in a folder, see `train_cells`: as it is there, copied from elsewhere, or trained."""
    products = folder / "runs" / run.name
    if not _is_finished(products, run, config, region):
        (products / RECORD).unlink(missing_ok=True)  # of other values: `train` would refuse
        same = (place / run.name for place in finished)
        if place := next((p for p in same if _is_finished(p, run, config, region)), None):
            _copy(place, products)
        else:
            train(run, config, region, products, folder / "checkpoints" / f"{run.name}.zip")
    return read_run(products)


def _copy(source: Path, target: Path) -> None:
    """Copy the products of a run; the record, which says that all are there, comes last."""
    shutil.copytree(source, target, ignore=shutil.ignore_patterns(RECORD), dirs_exist_ok=True)
    with beside(target / RECORD) as temporary:
        shutil.copy(source / RECORD, temporary)


def _is_finished(folder: Path, run: Run, config: Config, region: Hypothesis | None) -> bool:
    """Whether the run.json in a folder is of this run and of this code."""
    if not (folder / RECORD).exists():  # it is written last
        return False
    result = read_json(folder / RECORD)
    same = {key: result[key] for key in ("run", "config", "region")} == identify(run, config, region)
    return same and bool(result["provenance"]["code"] == code_hash())
