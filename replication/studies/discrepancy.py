r"""How far is the real system from the nominal one? Measured from data that a learner has.

The paper leaves such a measure to future work. A learner knows the nominal model, the transitions
(x_t, u_t, x_{t+1}) that it made on the real system, and how K fared from the states where it was activated.
Three measures, each 0 if the systems are equal:

- ``unexplained``: the motion of a control period that the nominal model misses, relative to the motion,
  (Σ_t ‖x_{t+1} − x̂_{t+1}‖² / Σ_t ‖x_{t+1} − x_t‖²)^½, in half ranges of App. C;
- ``surprises``: share of the activations whose outcome is another than on the nominal model, E[I(l ≠ l_n)] on
  the states in which K is activated: an estimate of E_2 of Theorem 1 where it matters;
- ``slower``: mean of log(time of the recovery / its time on the nominal model), where both recover.

States in which K is activated depend on the region, so that the last two do as well.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.stats import spearmanr

from srlrepro.compiled.jit import jit
from srlrepro.compiled.stack import read, write
from srlrepro.dynamics.circle_env import Task, ThreeLinkCircleEnv, advance
from srlrepro.dynamics.closed_loop import RECOVERED, ClosedLoop, Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.hypothesis import CompiledHypothesis
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check
from srlrepro.supervisor import NOT_TRIED, Supervision, Supervisor, supervise

Counts = NDArray[np.int64]

KINDS = ("unexplained", "surprises", "slower")
OUTCOMES = ("final_return", "success_rate", "violations_per_1000_steps")


@dataclass(frozen=True, eq=False)
class Experience:
    """What a learner has seen of the real system; states are in rad and rad/s."""

    x: Floats  # [N, 2n] at the start of a control period
    actions: NDArray[np.float32]  # [N, n] of π, in units of ``action_unit``
    following: Floats  # [N, 2n] at the end of the control period
    activated: Floats  # [M, 2n] states in which K was activated
    safe: Labels  # [M] whether it recovered the system
    times: Floats  # [M] s, until the outcome


@jit
def _explore(
    task: Task, supervision: Supervision, actions: Floats, x: Floats, following: Floats, ends: Counts
) -> None:
    """Trials one after the other, each from the origin; they take the actions in turn, as many as they need.

    Fills x and following [N, 2n], the states before and after each step, and for each trial a row of
    ends [trials, 3]: steps so far, key of `RECOVERIES` (0: K was not needed), control periods of K.
    """
    n = 0
    for trial in range(ends.shape[0]):
        state, period, ended = task.coefficients.upright, 0, 0
        while ended == 0:
            write(state, x[n])
            state, _, ended = advance(task, state, read(actions[n], task.coefficients.idle), period)
            new = following[n]
            write(state, new)
            n, period = n + 1, period + 1
            recovery, periods = supervise(supervision, task, new, ended)
            ends[trial, 0], ends[trial, 1], ends[trial, 2] = n, recovery, periods
            ended = max(ended, recovery)


def explore(
    delta: float, region: CompiledHypothesis, config: Config, trials: int, rng: Generator
) -> Experience:
    """Trials of an untrained policy (mean 0, the initial std) on the real system of Δ under a supervisor.

    rng: draws the actions of as many steps as the trials can have, more than they need.

    Raises:
        ParameterError: no trial, or h(x) = 0 at the start of a trial.
    """
    check(trials >= 1, "trials", trials, "a whole number in [1, inf)")
    controller = ClosedLoop.from_config(config).controller
    env = Supervisor(ThreeLinkCircleEnv(delta, config=config), region, controller)
    env.reset()  # refuses a region that predicts the origin as unsafe
    task = env.task.arrays
    most = trials * task.periods
    std, shape = np.exp(config.choices.log_std_init), (most, config.paper.links)
    actions = rng.normal(0.0, std, shape).astype(np.float32)
    size = env.task.state.size
    x, following, ends = np.empty((most, size)), np.empty((most, size)), np.empty((trials, 3), np.int64)
    _explore(task, env.arrays, actions.astype(np.float64), x, following, ends)
    steps, of_k = ends[-1, 0], ends[(ends[:, 1] != 0) & (ends[:, 1] != NOT_TRIED)]
    safe, times = (of_k[:, 1] == RECOVERED).astype(int), of_k[:, 2] * task.control_period
    return Experience(x[:steps], actions[:steps], following[:steps], following[of_k[:, 0] - 1], safe, times)


@jit
def _predict(task: Task, x: Floats, actions: Floats, following: Floats) -> None:
    for i in range(x.shape[0]):
        upright, idle = task.coefficients.upright, task.coefficients.idle
        state, _, _ = advance(task, read(x[i], upright), read(actions[i], idle), 0)
        write(state, following[i])


def predict(experience: Experience, config: Config) -> Floats:
    """x̂_{t+1} [N, 2n]: each transition on the nominal model."""
    following = np.empty_like(experience.x)
    task = ThreeLinkCircleEnv(1.0, config=config).arrays
    _predict(task, experience.x, experience.actions.astype(np.float64), following)
    return following


def discrepancy(experience: Experience, config: Config) -> dict[str, float]:
    """The measures of the module; ``surprises`` and ``slower`` are NaN where K gives nothing to compare."""
    scale = np.array(config.paper.state_max)
    missed = (experience.following - predict(experience, config)) / scale
    moved = (experience.following - experience.x) / scale
    measures = {"unexplained": float(np.sqrt((missed**2).sum() / (moved**2).sum()))}
    if len(experience.activated) == 0:
        return measures | {"surprises": float("nan"), "slower": float("nan")}
    nominal = ClosedLoop.from_config(config).rollout(experience.activated, record=False)
    both = (experience.safe == 1) & (nominal.labels == 1) & (nominal.durations > 0) & (experience.times > 0)
    ratio = np.log(experience.times[both] / nominal.durations[both])
    measures["surprises"] = float((experience.safe != nominal.labels).mean())  # l(x) != l_n(x)
    return measures | {"slower": float(ratio.mean()) if both.any() else float("nan")}


def beside_outcomes(measured: pd.DataFrame, measures: pd.DataFrame) -> pd.DataFrame:
    """Means by Δ and α (the index) of the discrepancies, and of what learners got (`OUTCOMES`).

    measured: columns delta, alpha and `KINDS`; measures: a table of measures, as of `claims`.
    """
    got = measures[measures["measure"].isin(OUTCOMES)]
    wide = got.pivot_table(index=["delta", "alpha"], columns="measure", values="value")
    means = measured.groupby(["delta", "alpha"])[list(KINDS)].mean()
    return means.join(wide.reindex(columns=list(OUTCOMES)), how="inner")


def rank_correlations(both: pd.DataFrame) -> pd.DataFrame:
    """Spearman's rank correlation of each discrepancy (the index, measure) with each outcome (a column).

    both: as of `beside_outcomes`; NaN for two rows or fewer.
    """

    def of(kind: str, outcome: str) -> float:
        few = len(both) < 3
        return np.nan if few else float(spearmanr(both[kind], both[outcome], nan_policy="omit").statistic)

    found = {outcome: [of(kind, outcome) for kind in KINDS] for outcome in OUTCOMES}
    return pd.DataFrame(found, index=pd.Index(KINDS, name="measure"))
