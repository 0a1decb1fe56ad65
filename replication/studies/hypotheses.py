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
from srlrepro.settings.choices import Choices
from srlrepro.settings.condition import NONE, Condition, parse_alpha
from srlrepro.settings.config import Config

ANY = "any"  # stands for α where a hypothesis knows the system and learns from no data
SCORES = ("precision", "recall", "brier")
FREE = "visited, free"  # states that no hypothesis has influenced
FOLLOWED = ("final_return", "success_rate", "violations_per_1000_steps")
SHOWN = {  # measures of learners, and how a figure calls them
    "final_return": "final return",
    "policy_return_share": "final policy's return\n/ that of a perfect one",
    "success_rate": "success rate of K",
    "activations": "activations of K",
    "violations_per_1000_steps": "violations\nper 1000 steps",
}
PAPERS = Choices.hypothesis
BETTER = {"final_return": 1, "success_rate": 1, "violations_per_1000_steps": -1}  # which way


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


def learned_under(tables: Mapping[str, pd.DataFrame], alphas: Sequence[str]) -> pd.DataFrame:
    """Measures of the learners as one table, by hypothesis: measure, alpha, delta, seed, value, hypothesis.

    tables: by hypothesis, as of `read_measures`; the free learner of the paper's is under "no supervisor",
    and a hypothesis that knows the system has α = `ANY` in place of one of the alphas.
    """
    kept = []
    for kind, measures in tables.items():
        table = measures.assign(hypothesis=kind)
        table.loc[table["alpha"] == NONE, "hypothesis"] = "no supervisor"
        kept.append(table.replace({"alpha": dict.fromkeys(alphas, ANY)}) if kind in ORACLES else table)
    return pd.concat(kept, ignore_index=True).dropna(subset="delta")


def summarise(measures: pd.DataFrame) -> pd.DataFrame:
    """Means over seeds of what is `SHOWN`, by Δ, hypothesis and α; measures: as of `learned_under`."""
    shown = measures[measures["measure"].isin(SHOWN)]
    index = ["delta", "hypothesis", "alpha"]
    return shown.pivot_table(index=index, columns="measure", values="value", sort=False)


def better(measures: pd.DataFrame) -> pd.DataFrame:
    """In how many cells (Δ, α) each hypothesis is better than the paper's, in words, by mean over seeds.

    A column per measure of `BETTER`; cells without α are left out. measures: as of `learned_under`.
    """
    of_data = measures[~measures["alpha"].isin([NONE, ANY])]
    index = ["measure", "delta", "alpha"]
    cells = of_data.pivot_table(index=index, columns="hypothesis", values="value")
    rows = {}
    for measure, way in BETTER.items():
        part = cells.loc[measure].mul(way)
        pairs = [(int((own > part[PAPERS]).sum()), own.count()) for _, own in part.items()]
        name = f"{'more' if way > 0 else 'fewer'}: {SHOWN[measure]}".replace("\n", " ")
        rows[name] = [f"{more} of {of}" for more, of in pairs]
    return pd.DataFrame(rows, index=cells.columns).drop(index=PAPERS)
