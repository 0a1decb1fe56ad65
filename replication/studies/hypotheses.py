"""The hypotheses side by side: how well they predict, and how learners fare under their supervision."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.random import Generator

from replication.evidence.measures import TEST_STATES, classification, held_out_states
from replication.evidence.results import read_run
from replication.studies.alternatives import ORACLES, learn_hypothesis
from srlrepro.dynamics.closed_loop import ClosedLoop, Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.samplers import TrainingData, generate
from srlrepro.settings.condition import NONE, Condition, parse_alpha
from srlrepro.settings.config import Config

ANY = "any"  # stands for α where a hypothesis knows the system and learns from no data
SCORES = ("precision", "recall", "brier")
FREE = "visited, free"  # states that no hypothesis has influenced
FOLLOWED = ("final_return", "success_rate", "violations_per_1000_steps")


def scored_states(
    data: Mapping[str, TrainingData],
    config: Config,
    paper: Path,
    deltas: Iterable[float],
    seeds: Sequence[int],
    rng: Generator,
) -> Iterator[tuple[str, float, str, Floats, Labels]]:
    """(states, Δ, α that they belong to, x [B, 2n], labels [B]) of everything that hypotheses are judged on.

    UD and MND, labelled on the nominal system (Δ = 1); `TEST_STATES` of those that the free learner, and the
    learner under the paper's region, visited, labelled on the real one. Those under the region are of the
    region's α, and for a hypothesis without α (`ANY`) of all. ``paper``: folder of the paper's universe.
    """

    def visited(alphas: Iterable[str], delta: float) -> Floats:
        names = [Condition(parse_alpha(a), delta, s).name for a in alphas for s in seeds]
        states = np.concatenate([read_run(paper / "runs" / name).visited() for name in names])
        return rng.choice(states, TEST_STATES)

    for name, (x, labels) in held_out_states(next(iter(data.values())).mnd, config, rng).items():
        for alpha in (*data, ANY):
            yield name, 1.0, alpha, x, labels
    for delta in deltas:
        real, free = ClosedLoop.from_config(config, delta), visited([NONE], delta)
        of_free = real.predict(free)
        for alpha in (*data, ANY):
            yield FREE, delta, alpha, free, of_free
            x = visited(data if alpha == ANY else [alpha], delta)
            yield "visited, supervised", delta, alpha, x, real.predict(x)


def classify(
    kinds: Iterable[str],
    alphas: Iterable[str],
    config: Config,
    paper: Path,
    deltas: Iterable[float],
    seeds: Sequence[int],
    data_seed: int,
) -> pd.DataFrame:
    """One row per hypothesis, α and set of `scored_states`: hypothesis, alpha, states, delta, scores."""
    data = {alpha: generate(float(alpha), config, data_seed) for alpha in alphas}
    sets = list(scored_states(data, config, paper, deltas, seeds, np.random.default_rng([data_seed, 15])))
    rows = []
    for kind in kinds:
        varied = config.with_values(hypothesis=kind)
        conditions: Mapping[str, TrainingData | None] = {ANY: None} if kind in ORACLES else data
        fitted = {alpha: learn_hypothesis(d, varied, data_seed) for alpha, d in conditions.items()}
        for states, delta, alpha, x, labels in sets:
            if alpha in fitted:
                h = learn_hypothesis(None, varied, delta=delta) if kind == "real" else fitted[alpha]
                cell = {"hypothesis": kind, "alpha": alpha, "states": states, "delta": delta}
                rows.append(cell | classification(h, x, labels))
    return pd.DataFrame(rows)


def ranks(scores: pd.DataFrame, learned: pd.DataFrame) -> pd.DataFrame:
    """Spearman's rank correlation of each score on the states `FREE` with what learners got, for each Δ.

    Columns: delta, score, cells (compared pairs of a hypothesis and an α), `FOLLOWED`. Hypotheses that know
    the system are left out, as they learn from no data. scores: as of `classify`; learned: hypothesis, alpha,
    delta and `FOLLOWED`, means over seeds, of what was trained.
    """
    judged = scores[(scores["states"] == FREE) & (scores["alpha"] != ANY)]
    joined = judged.merge(learned, on=["hypothesis", "alpha", "delta"])
    rows = []
    for delta, cells in joined.groupby("delta"):
        for score in SCORES:
            found = (cells[score].corr(cells[name], method="spearman") for name in FOLLOWED)
            rows.append((delta, score, len(cells), *found))
    return pd.DataFrame(rows, columns=["delta", "score", "cells", *FOLLOWED])
