"""K against its Riccati equations solved otherwise, scipy's zero-order hold and the separation principle."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov
from scipy.signal import cont2discrete

from srlrepro.dynamics.lqg import LQG, lqg_update
from srlrepro.dynamics.pendulum import Floats, Pendulum

OTHER = {"lqr_angle_weight": 1.0, "lqr_torque_weight": 0.1, "torque_noise": 1.0}
CONTROLLERS = [LQG(), LQG(control_period=0.02, **OTHER), *(LQG(Pendulum(links=n)) for n in (1, 2, 4))]
DELTAS = (1.0, 1.1, 1.5, 4.0)
Update = Callable[..., None]


def iterate(step: Callable[[Floats], Floats], start: Floats) -> Floats:
    """The limit of a contraction of matrices."""
    for _ in range(5_000):
        start = step(start)
    np.testing.assert_allclose(step(start), start, rtol=1e-9)
    return start


@pytest.mark.parametrize("k", CONTROLLERS, ids=str)
def test_feedback_gain_is_the_limit_of_dynamic_programming(k: LQG) -> None:
    (a, b), (q, r) = k.model, k.weights

    def back(p: Floats) -> Floats:
        gain = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
        return q + gain.T @ r @ gain + (a - b @ gain).T @ p @ (a - b @ gain)

    p = iterate(back, q)
    np.testing.assert_allclose(k.gain, np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a), rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("k", CONTROLLERS, ids=str)
def test_filter_gain_is_the_limit_of_the_kalman_filter(k: LQG) -> None:
    (a, _), (w, v) = k.model, k.noise

    def onwards(s: Floats) -> Floats:
        gain = s @ np.linalg.inv(s + v)
        rest = np.eye(len(a)) - gain
        return a @ (rest @ s @ rest.T + gain @ v @ gain.T) @ a.T + w

    s = iterate(onwards, np.eye(len(a)))
    np.testing.assert_allclose(k.filter_gain, s @ np.linalg.inv(s + v), rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("k", CONTROLLERS, ids=str)
def test_gains_satisfy_both_riccati_equations(k: LQG) -> None:
    """P and S belong to the gains by Lyapunov equations; the Riccati equations then leave no residual."""
    (a, b), (q, r), (w, v) = k.model, k.weights, k.noise
    regulated, blind = a - b @ k.gain, np.eye(len(a)) - k.filter_gain
    p = solve_discrete_lyapunov(regulated.T, q + k.gain.T @ r @ k.gain)
    residual = a.T @ p @ a + q - a.T @ p @ b @ np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a) - p
    assert np.abs(residual).max() < 1e-9 * np.abs(p).max()
    s = solve_discrete_lyapunov(a @ blind, a @ k.filter_gain @ v @ k.filter_gain.T @ a.T + w)
    residual = a @ s @ a.T + w - a @ s @ np.linalg.solve(s + v, s) @ a.T - s
    assert np.abs(residual).max() < 1e-9 * np.abs(s).max()


@pytest.mark.parametrize("delta", DELTAS)
def test_sampling_is_zero_order_hold(delta: float) -> None:
    k, system = LQG(), Pendulum(delta)
    a, b = system.linearize()
    expected = cont2discrete((a, b, np.eye(6), np.zeros((6, 3))), k.control_period)[:2]
    for found, wanted in zip(k.sampled(system), expected, strict=True):
        assert np.array_equal(found, wanted)


def test_noise_is_that_of_a_held_torque_and_of_the_encoders(rng: np.random.Generator) -> None:
    k = LQG(torque_noise=3.0, angle_noise=0.2, rate_noise=0.7)
    w, v = k.noise
    disturbed = rng.normal(0.0, 3.0, (200_000, 3)) @ k.model[1].T
    np.testing.assert_allclose(np.cov(disturbed.T), w, atol=0.02 * np.abs(w).max())
    np.testing.assert_allclose(np.sqrt(np.diag(v)), [0.2] * 3 + [0.7] * 3)
    assert np.count_nonzero(v) == 6


def test_regulator_and_filter_separate() -> None:
    """With the error e = x − x̄: e' = A (I − K_f) e and x' = (A − B L) x + B L (I − K_f) e."""
    k = LQG()
    a, b = k.model
    blind = np.eye(6) - k.filter_gain
    by_error = np.block([[a - b @ k.gain, b @ k.gain @ blind], [np.zeros((6, 6)), a @ blind]])
    to_error = np.block([[np.eye(6), np.zeros((6, 6))], [np.eye(6), -np.eye(6)]])
    found = to_error @ k.closed_loop(k.nominal) @ np.linalg.inv(to_error)
    np.testing.assert_allclose(found, by_error, atol=1e-10)
    parts = np.concatenate([np.linalg.eigvals(a - b @ k.gain), np.linalg.eigvals(a @ blind)])
    assert k.spectral_radius(k.nominal) == pytest.approx(np.abs(parts).max(), rel=1e-6)


@pytest.mark.parametrize("delta", DELTAS)
def test_upright_is_stable_for_every_mismatch(delta: float) -> None:
    assert LQG().spectral_radius(Pendulum(delta)) < 1.0


def test_more_links_stay_upright_for_smaller_mismatches() -> None:
    """K's weights are chosen for three links; where it loses the others is known, and is here."""
    lost = {(4, 4.0), (5, 4.0), (6, 4.0), (7, 1.1), (7, 4.0), (8, 1.1), (8, 4.0)}
    for links in range(1, 9):
        k = LQG(Pendulum(links=links))
        for delta in (1.0, 1.1, 4.0):
            stable = k.spectral_radius(Pendulum(delta, links)) < 1.0
            assert stable == ((links, delta) not in lost), (links, delta)


def test_a_weak_regulator_loses_the_heavy_system() -> None:
    assert LQG(lqr_angle_weight=1.0).spectral_radius(Pendulum(4.0)) > 1.0


@pytest.mark.parametrize("update", [lqg_update, lqg_update.py_func], ids=["compiled", "source"])
def test_update_filters_saturates_and_predicts_with_the_saturated_torque(
    update: Update, draw: Callable[..., Floats]
) -> None:
    k, u, saturated = LQG(), np.empty(3), 0
    a, b = k.model
    for xbar, y in zip(draw(50, 1), draw(50, 2), strict=True):
        estimate = xbar + k.filter_gain @ (y - xbar)
        expected = np.clip(-k.gain @ estimate, -k.torque_limit, k.torque_limit)
        update(k.arrays, xbar, y, u)
        np.testing.assert_allclose(u, expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(xbar, a @ estimate + b @ expected, rtol=1e-9, atol=1e-9)
        saturated += int((np.abs(u) == k.torque_limit).sum())
    assert saturated > 50


@pytest.mark.parametrize("delta", DELTAS)
def test_closed_loop_is_one_period_of_the_update(delta: float, rng: np.random.Generator) -> None:
    """Near upright, where nothing saturates."""
    k, system, u = LQG(), Pendulum(delta), np.empty(3)
    a, b = k.sampled(system)
    x, xbar = 1e-3 * rng.normal(size=(2, 6))
    after = k.closed_loop(system) @ np.concatenate([x, xbar])
    lqg_update(k.arrays, xbar, x, u)
    assert np.abs(u).max() < k.torque_limit
    np.testing.assert_allclose(np.concatenate([a @ x + b @ u, xbar]), after, rtol=1e-9, atol=1e-14)


def test_torques_never_exceed_the_limit(draw: Callable[..., Floats]) -> None:
    k, u = LQG(torque_limit=7.0), np.empty(3)
    for x in draw(100) * 1e6:
        lqg_update(k.arrays, x.copy(), x, u)
        assert np.abs(u).max() <= 7.0


def test_the_controller_of_a_real_system_is_refused() -> None:
    with pytest.raises(ValueError, match=r"nominal.delta = 1.1"):
        LQG(nominal=Pendulum(1.1))
