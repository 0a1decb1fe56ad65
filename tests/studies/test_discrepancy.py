"""The discrepancy of systems: none between equal ones, more the more they differ, and some by hand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from replication.studies.alternatives import Predictor
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
from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.dynamics.lqg import LQG
from srlrepro.learner.trials import transitions, untrained
from srlrepro.region.hypothesis import NETWORK, Posterior
from srlrepro.region.mapping import NO_TABLE, NO_VALUES
from srlrepro.region.safety_map import RegionArrays
from srlrepro.settings.config import Config
from srlrepro.supervisor import Supervisor

CONFIG = Config()
SCALE = np.array(CONFIG.paper.state_max)
STEEP = 1000.0  # 1/rad


def narrow() -> Predictor:
    """Safe while |θ1| < 0.2 rad: K is activated in time to recover. Two steep tanh, one at each border."""
    rows = np.zeros((2, 6))
    rows[:, 0] = STEEP * SCALE[0]
    region = RegionArrays(SCALE, NO_TABLE, NO_TABLE, 0, NO_TABLE, NO_VALUES, 0.0)
    borders, weights = STEEP * np.array([0.2, -0.2]), STEEP * np.array([1.0, -1.0])
    return Predictor(Posterior(NETWORK, region, rows, borders, weights, -STEEP), 0.5)


def explored(delta: float, trials: int = 5) -> Experience:
    return explore(delta, narrow(), CONFIG, trials, np.random.default_rng(1))


@pytest.mark.parametrize(
    ("values", "activations"), [({}, 4), ({"corrective": "none"}, 0), ({"trial_length": 0.05}, 1)]
)
def test_exploration_is_that_of_the_environment_step_by_step(
    values: dict[str, Any], activations: int
) -> None:
    """The second method: the environment under its supervisor, as gymnasium has it."""
    config, rng, trials = CONFIG.with_values(**values), np.random.default_rng(1), 4
    found = explore(1.5, narrow(), config, trials, np.random.default_rng(1))
    env = Supervisor(ThreeLinkCircleEnv(1.5, config=config), narrow(), LQG())
    policy, steps, recoveries = untrained(rng, config.choices.log_std_init, config.paper.links), [], []
    for _ in range(trials):
        steps += transitions(env, policy)
        recoveries += [(env.task.state, env.recovery)] if env.recovery else []
    assert len(found.activated) == len(recoveries) == activations
    x, actions, _, following, _ = (np.array(part) for part in zip(*steps, strict=True))
    assert np.array_equal(found.x, x) and np.array_equal(found.following, following)
    assert np.array_equal(found.actions, actions) and found.actions.dtype == actions.dtype
    for i, (state, rollout) in enumerate(recoveries):
        assert np.array_equal(found.activated[i], state)
        assert (found.safe[i], found.times[i]) == (rollout.labels[0], rollout.durations[0])


def test_predictions_are_steps_of_the_nominal_environment() -> None:
    experience, nominal = explored(1.5, trials=1), ThreeLinkCircleEnv(1.0, config=CONFIG)
    for x, action, expected in zip(
        experience.x, experience.actions, predict(experience, CONFIG), strict=True
    ):
        nominal.reset(options={"state": x})
        nominal.step(action)
        assert np.array_equal(nominal.state, expected)


def test_what_cannot_be_explored_is_refused() -> None:
    with pytest.raises(ValueError, match="trials = 0"):
        explored(1.5, trials=0)
    never = replace(narrow(), p_t=1.0)
    with pytest.raises(ValueError, match="predicts the start of the trial as unsafe"):
        explore(1.5, never, CONFIG, 1, np.random.default_rng(1))


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
