"""Labels: states with known answers, symmetry, a second implementation, and extreme states."""

import warnings
from collections.abc import Callable
from dataclasses import FrozenInstanceError, fields, replace
from itertools import product
from math import pi

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from srlrepro.dynamics.closed_loop import (
    HIT_GROUND,
    NOT_RECOVERED,
    OUTCOMES,
    RECOVERED,
    ClosedLoop,
    RecoveryRule,
    Rollouts,
    _recover_batch,
    hold_torque,
    is_upright,
    recover,
)
from srlrepro.dynamics.lqg import LQG
from srlrepro.dynamics.pendulum import Floats, Pendulum, derivative
from srlrepro.dynamics.stepped_loop import StateRule, SteppedLoop
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError

DELTAS = (1.0, 1.1, 1.5, 4.0)
Draw = Callable[..., Floats]


def loop(delta: float = 1.0, **rule: float) -> ClosedLoop:
    return ClosedLoop(Pendulum(delta), LQG(), replace(RecoveryRule(), **rule))


@pytest.mark.parametrize("delta", DELTAS)
def test_states_with_known_answers(delta: float) -> None:
    known = {
        (0, 0, 0, 0, 0, 0): (RECOVERED, "at once"),
        (0.05, -0.05, 0.02, 0.1, -0.2, 0.1): (RECOVERED, "at once"),
        (0.15, 0, 0, 0, 0, 0): (RECOVERED, "later"),
        (pi / 2, 0, 0, 0, 0, 0): (HIT_GROUND, "at once"),
        (-2.0, 0, 0, 3.0, 0, 0): (HIT_GROUND, "at once"),
        (1.5, 0, 0, 10, 0, 0): (HIT_GROUND, "later"),
        (1.2, 1.5, 0, 10, 20, 20): (HIT_GROUND, "later"),
    }
    found = loop(delta).rollout(list(known))
    answers = zip(found.outcomes, found.durations, known.values(), strict=True)
    for outcome, seconds, (expected, when) in answers:
        assert outcome == expected
        assert seconds == 0 if when == "at once" else seconds > 0
    np.testing.assert_array_equal(found.labels, [outcome == RECOVERED for outcome, _ in known.values()])


@pytest.mark.parametrize("delta", DELTAS)
def test_mirror_images_have_equal_labels(delta: float, draw: Draw) -> None:
    system, states = loop(delta), draw(300)
    left, right = system.rollout(states, record=False), system.rollout(-states, record=False)
    assert 0 < left.labels.sum() < 300
    np.testing.assert_array_equal(left.labels, right.labels)
    np.testing.assert_allclose(left.durations, right.durations, atol=0.05)


def plain_rollout(closed: ClosedLoop, x: Floats) -> tuple[int, list[Floats]]:
    """(outcome, states at the control instants): the same loop, with matrices and an adaptive integrator."""
    k, rule, system = closed.controller, closed.rule, closed.system
    (a, b), xbar, path = k.model, x.copy(), [x]

    def ground(_: float, s: Floats) -> float:
        return rule.theta1_max - abs(s[0])

    ground.terminal = True  # type: ignore[attr-defined]
    for _ in range(rule.periods):
        if (np.abs(x) <= np.repeat([rule.recovered_angle, rule.recovered_rate], system.links)).all():
            return RECOVERED, path
        xhat = xbar + k.filter_gain @ (x - xbar)
        u = np.clip(-k.gain @ xhat, -k.torque_limit, k.torque_limit)
        xbar = a @ xhat + b @ u

        def motion(_: float, s: Floats, u: Floats = u) -> Floats:
            return np.array(derivative(system.coefficients, tuple(s), tuple(u)))

        span = (0.0, rule.control_period)
        solution = solve_ivp(motion, span, x, method="DOP853", rtol=1e-9, atol=1e-9, events=ground)
        x = solution.y[:, -1]
        if solution.status == 1:
            return HIT_GROUND, path
        path.append(x)
    return NOT_RECOVERED, path


@pytest.mark.parametrize("delta", [1.0, 4.0])
def test_rollouts_agree_with_a_second_implementation(delta: float, draw: Draw) -> None:
    closed, states = loop(delta), draw(8, seed=3) * [0.8, 0.5, 0.5, 0.5, 0.5, 0.5]
    fast, fine = closed.rollout(states), loop(delta, substeps=100).rollout(states)
    assert len(set(fast.outcomes)) == 2
    for i, x in enumerate(states):
        outcome, path = plain_rollout(closed, x)
        assert fast.outcomes[i] == outcome
        assert fast.durations[i] == pytest.approx(len(path) * closed.rule.control_period, abs=0.015)
        instants = min(len(path), 100)
        error = np.abs(fine.paths[i, :instants] - path[:instants]) / np.array(Config().paper.state_max)
        assert error.max() < 1e-5


@pytest.mark.parametrize("delta", DELTAS)
@pytest.mark.parametrize("size", [1e2, 1e3, 1e6, 1e150, 1e300])
def test_extreme_states_are_unsafe_without_nan_or_warning(delta: float, size: float, draw: Draw) -> None:
    states = draw(50) * [0.9, 1, 1, size, size, size]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = loop(delta).rollout(states)
    assert np.isfinite(found.paths).all()
    assert np.isfinite(found.durations).all()
    assert set(found.outcomes) <= set(OUTCOMES)
    assert found.labels.sum() == 0


def test_beyond_the_rate_bound_a_rollout_is_given_up() -> None:
    closed = loop(rate_bound=50.0)
    found = closed.rollout([[0, 0, 0, 0, 0, 60.0], [0, 0, 0, 0, 0, -1e5]])
    np.testing.assert_array_equal(found.outcomes, [NOT_RECOVERED] * 2)
    np.testing.assert_allclose(found.durations, closed.rule.control_period)
    assert closed.predict([0, 0, 0, 0, 0, 60.0])[0] == 0


def test_paths_start_at_the_state_and_stay_at_the_last_one(draw: Draw) -> None:
    closed, states = loop(), draw(40)
    found = closed.rollout(states)
    assert found.paths.shape == (40, closed.rule.periods + 1, 6)
    np.testing.assert_array_equal(found.paths[:, 0], states)
    for path, seconds in zip(found.paths, found.durations, strict=True):
        end = round(seconds / closed.rule.control_period)
        np.testing.assert_array_equal(path[end:], np.broadcast_to(path[end], path[end:].shape))
        assert end == 0 or (path[end] != path[end - 1]).any()


def test_recording_changes_nothing_and_predict_is_the_label(draw: Draw) -> None:
    closed, states = loop(1.5), draw(100)
    quick, recorded = closed.rollout(states, record=False), closed.rollout(states)
    assert quick.paths.shape == (100, 0, 6)
    np.testing.assert_array_equal(quick.outcomes, recorded.outcomes)
    np.testing.assert_array_equal(quick.durations, recorded.durations)
    np.testing.assert_array_equal(closed.predict(states), recorded.labels)
    np.testing.assert_array_equal(recorded.labels, recorded.outcomes == RECOVERED)
    np.testing.assert_array_equal(closed.predict(states[3]), recorded.labels[3:4])
    assert closed.predict(np.empty((0, 6))).shape == (0,)


@pytest.mark.parametrize("delta", DELTAS)
def test_from_the_recovered_box_the_system_converges(delta: float, rng: np.random.Generator) -> None:
    """What counts as recovered is no illusion: from the edges of the box K reaches the origin."""
    rule = RecoveryRule()
    half = np.array([rule.recovered_angle] * 3 + [rule.recovered_rate] * 3)
    corners = np.array(list(product((-1.0, 1.0), repeat=6)))
    faces = rng.uniform(-1, 1, (200, 6))
    faces /= np.abs(faces).max(axis=1, keepdims=True)
    strict = loop(delta, recovery_horizon=20.0, recovered_angle=1e-7, recovered_rate=1e-6)
    assert strict.predict(np.concatenate([corners, faces]) * half).all()


def test_a_recovery_that_takes_too_long_is_none() -> None:
    state, closed = [0.3, 0, 0, 0, 0, 0], loop()
    seconds = closed.rollout(state).durations[0]
    period = closed.rule.control_period
    assert seconds > 5 * period
    answers = {seconds: RECOVERED, seconds - period: NOT_RECOVERED, period: NOT_RECOVERED}
    for horizon, outcome in answers.items():
        found = loop(recovery_horizon=horizon).rollout(state)
        assert found.outcomes[0] == outcome
        assert found.durations[0] == pytest.approx(horizon)


def test_a_configuration_reaches_every_part() -> None:
    config = Config().with_values(
        links=2,
        mass=1.2,
        length=0.9,
        gravity=9.0,
        control_period=0.02,
        lqr_angle_weight=90.0,
        lqr_rate_weight=2.0,
        lqr_torque_weight=0.02,
        torque_noise=9.0,
        angle_noise=0.002,
        rate_noise=0.03,
        torque_limit=80.0,
        substeps=5,
        recovery_horizon=3.0,
        theta1_max=1.4,
        recovered_angle=0.2,
        recovered_rate=0.4,
        rate_bound=200.0,
    )
    closed = ClosedLoop.from_config(config, 1.5)
    nominal = Pendulum(1.0, 2, 1.2, 0.9, 9.0)
    assert closed.system == replace(nominal, delta=1.5)
    assert closed.controller == LQG(nominal, 0.02, 90.0, 2.0, 0.02, 9.0, 0.002, 0.03, 80.0)
    assert closed.rule == RecoveryRule(0.02, 5, 3.0, 1.4, 0.2, 0.4, 200.0)
    assert closed.rule.limits == (0.004, 5, 1.4, 0.2, 0.4, 200.0)
    assert closed.rule.periods == 150
    assert ClosedLoop.from_config(Config()) == ClosedLoop()


@pytest.mark.parametrize("links", [1, 2, 5, 8])
def test_other_numbers_of_links_are_labelled_by_the_same_rule(links: int) -> None:
    """Upright is safe, the ground is not; between them labels agree with the second implementation."""
    config = Config().with_values(links=links, substeps=60)  # short links are fast
    closed, high = ClosedLoop.from_config(config), np.array(config.paper.state_max)
    fallen = np.eye(2 * links)[0] * high[0]
    assert closed.predict(np.stack([0 * high, fallen, 0.01 * high])).tolist() == [1, 0, 1]
    states = np.random.default_rng(0).uniform(-high, high, (12, 2 * links)) * 0.2
    found = closed.rollout(states)
    assert found.paths.shape == (12, closed.rule.periods + 1, 2 * links)
    for outcome, path, x in zip(found.outcomes[:4], found.paths, states, strict=False):
        expected, plain = plain_rollout(closed, x)
        assert outcome == expected
        instants = min(len(plain), 20)
        np.testing.assert_allclose(path[:instants], plain[:instants], atol=1e-3 * high[-1])
    with pytest.raises(ParameterError, match=f"controller.nominal.links = 3: must be {links}"):
        ClosedLoop(closed.system, LQG())
    with pytest.raises(ParameterError, match=rf"must be states of shape \[B, {2 * links}\]"):
        closed.predict(np.zeros(6))


@pytest.mark.parametrize("bad", [np.zeros(5), np.zeros((2, 7)), [np.nan] * 6, [np.inf] * 6])
def test_bad_states_are_refused(bad: Floats) -> None:
    with pytest.raises(ValueError, match="x = "):
        loop().predict(bad)


def test_compiled_code_does_what_the_source_says(draw: Draw) -> None:
    closed = loop(recovery_horizon=0.3)
    coefficients, _, limits, periods = closed.kernel_arguments
    on_the_ground, falling, fast = [pi / 2, 0, 0, 0, 0, 0], [1.56, 0, 0, 5, 0, 0], [0, 0, 0, 0, 0, 1e4]
    near = [0.12, 0, 0, 0, 0, 0]
    states = np.concatenate([[[0] * 6, on_the_ground, falling, fast, near], 0.5 * draw(3)])
    for rows in (0, periods + 1):
        paths = [np.empty((len(states), rows, 6)) for _ in range(2)]
        outcomes, durations = np.empty((2, len(states)), np.int64), np.empty((2, len(states)))
        for i, run in enumerate((_recover_batch, _recover_batch.py_func)):
            run(closed.kernel_arguments, states, paths[i], outcomes[i], durations[i])
        assert set(outcomes[0]) == set(OUTCOMES)
        np.testing.assert_array_equal(*outcomes)
        np.testing.assert_array_equal(*durations)
        np.testing.assert_allclose(*paths, rtol=1e-6, atol=1e-9)
        for x, path, outcome, duration in zip(states, paths[0], outcomes[0], durations[0], strict=True):
            copy = np.empty_like(path)
            assert recover.py_func(*closed.kernel_arguments, x, copy) == (outcome, duration)
            np.testing.assert_allclose(copy, path, rtol=1e-6, atol=1e-9)
    for x in states:
        state, u = tuple(x), (1.0, -2.0, 3.0)
        assert is_upright.py_func(limits, state) == is_upright(limits, state)
        ends = [f(coefficients, limits, state, u) for f in (hold_torque, hold_torque.py_func)]
        assert ends[0][1] == ends[1][1]
        np.testing.assert_allclose(ends[0][0], ends[1][0], rtol=1e-9)


@pytest.mark.parametrize("kind", [Pendulum, LQG, RecoveryRule, ClosedLoop, Rollouts, StateRule, SteppedLoop])
def test_what_kernels_were_made_of_cannot_change(kind: type) -> None:
    with pytest.raises(FrozenInstanceError):
        setattr(object.__new__(kind), fields(kind)[0].name, None)
