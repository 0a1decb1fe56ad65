"""The discrepancy of systems: none between equal ones, more the more they differ, and some by hand."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from replication.studies.discrepancy import (
    KINDS,
    OUTCOMES,
    Experience,
    beside_outcomes,
    discrepancy,
    explore,
    predict,
    rank_correlations,
)
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.dynamics.pendulum import Floats
from srlrepro.settings.config import Config

CONFIG = Config()
SCALE = np.array(CONFIG.paper.state_max)


class Narrow:
    """Safe while |θ1| stays small: K is activated in time to recover."""

    def predict(self, x: Floats) -> np.ndarray:
        return (np.abs(np.atleast_2d(x)[:, 0]) < 0.2).astype(int)


def explored(delta: float, trials: int = 5) -> Experience:
    return explore(delta, Narrow(), CONFIG, trials, np.random.default_rng(1))


def test_equal_systems_do_not_differ() -> None:
    experience = explored(1.0)
    assert len(experience.activated) > 0
    assert discrepancy(experience, CONFIG) == {"unexplained": 0.0, "surprises": 0.0, "slower": 0.0}


def test_the_unexplained_motion_grows_with_the_mismatch() -> None:
    values = [discrepancy(explored(delta), CONFIG)["unexplained"] for delta in (1.0, 1.1, 1.5, 4.0)]
    assert values == sorted(values) and values[1] > 0.005 and values[-1] > 5 * values[1]


def test_transitions_are_those_of_the_real_system() -> None:
    """The end of a period is the begin of the next; K is activated where a trial ended."""
    experience = explored(1.5, trials=1)
    assert np.array_equal(experience.following[:-1], experience.x[1:])
    assert np.array_equal(experience.x[0], np.zeros(6)) and experience.actions.shape == (len(experience.x), 3)
    assert np.array_equal(experience.activated, experience.following[-1:])
    assert experience.safe == ClosedLoop.from_config(CONFIG, 1.5).predict(experience.activated)


def test_measures_by_hand() -> None:
    """The motion is missed by a tenth; of three recoveries one ends otherwise, one takes e times as long."""
    experience = explored(1.0)
    following = predict(experience, CONFIG)
    states = np.zeros((3, 6))
    states[:, 0] = (0.3, 0.4, 0.5)
    nominal = ClosedLoop.from_config(CONFIG).rollout(states, record=False)
    assert nominal.labels.all()
    times = nominal.durations * np.array([1.0, np.e, 1.0])
    # where x̂ − x = m, a motion of m / 1.1 is missed by a tenth of itself
    moved = experience.x + (following - experience.x) / 1.1
    made = Experience(experience.x, experience.actions, moved, states, np.array([0, 1, 1]), times)
    expected = {"unexplained": 0.1, "surprises": 1 / 3, "slower": 0.5}
    assert discrepancy(made, CONFIG) == pytest.approx(expected)


def test_without_activations_there_is_nothing_to_compare() -> None:
    some = explored(1.5, trials=1)
    empty = replace(some, activated=np.zeros((0, 6)), safe=np.zeros(0, int), times=np.zeros(0))
    measures = discrepancy(empty, CONFIG)
    assert measures["unexplained"] > 0 and np.isnan([measures["surprises"], measures["slower"]]).all()


def test_means_stand_beside_what_learners_got() -> None:
    """Four Δ, two repeats and two seeds; one α was not trained, one Δ not explored."""
    deltas = [1.0, 2.0, 3.0, 4.0]
    measured = pd.DataFrame(
        [{"alpha": a, "delta": d} | dict.fromkeys(KINDS, d + i) for a in "01" for d in deltas for i in (0, 2)]
    )
    rows = [(m, "0", d, s, -d + s) for m in (*OUTCOMES, "falls") for d in (*deltas, 5.0) for s in (0, 1)]
    both = beside_outcomes(
        measured, pd.DataFrame(rows, columns=["measure", "alpha", "delta", "seed", "value"])
    )
    assert both.index.tolist() == [(d, "0") for d in deltas] and list(both) == [*KINDS, *OUTCOMES]
    assert both["slower"].tolist() == [d + 1 for d in deltas]
    assert both["success_rate"].tolist() == [0.5 - d for d in deltas]
    assert rank_correlations(both).to_numpy() == pytest.approx(-np.ones((3, 3)))
    assert rank_correlations(both[:2]).isna().all(axis=None)
