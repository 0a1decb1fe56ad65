"""Training data: statistical tests of the distributions, the exact αk split, the set-up's conditions."""

import itertools
from dataclasses import FrozenInstanceError, fields
from fractions import Fraction
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from srlrepro.dynamics.closed_loop import ClosedLoop, hold_torque
from srlrepro.samplers import (
    FORMAT,
    PARTS,
    MultivariateNormal,
    TrainingData,
    _random_rollouts,
    density_ratios,
    generate,
    known_states,
    sample_mnd,
    sample_uniform,
    split,
    visited_states,
)
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError
from srlrepro.storage.files import ResultError, write_arrays

HIGH = np.array(Config().paper.state_max)
ALPHAS = (0.0, 0.001, 0.1, 0.145, 0.29, 1 / 3, 0.5, 0.57, 2 / 3, 0.7, 0.999, 1.0)
SIGNIFICANCE = 1e-3


def known_normal() -> MultivariateNormal:
    root = np.random.default_rng(5).normal(size=(6, 6))
    return MultivariateNormal(np.arange(6.0), root @ root.T + np.eye(6))


def test_ud_is_uniform_and_its_coordinates_are_independent(rng: np.random.Generator) -> None:
    n = 400_000
    states = sample_uniform(n, HIGH, rng)
    for values, high in zip(states.T, HIGH, strict=True):
        assert stats.kstest(values, stats.uniform(-high, 2 * high).cdf).pvalue > SIGNIFICANCE
    correlations = np.corrcoef(states.T)[np.triu_indices(6, 1)]
    assert np.abs(correlations).max() < 4 / np.sqrt(n)


def test_mnd_is_normal(rng: np.random.Generator) -> None:
    """Each marginal, and the squared Mahalanobis distances, which are χ² with six degrees of freedom."""
    mnd = known_normal()
    states = sample_mnd(20_000, mnd, Config().with_values(mnd_outside="keep"), rng)
    for values, mean, variance in zip(states.T, mnd.mean, np.diag(mnd.covariance), strict=True):
        assert stats.kstest(values, stats.norm(mean, np.sqrt(variance)).cdf).pvalue > SIGNIFICANCE
    centred = states - mnd.mean
    squared = np.einsum("bi,ij,bj->b", centred, np.linalg.inv(mnd.covariance), centred)
    assert stats.kstest(squared, stats.chi2(6).cdf).pvalue > SIGNIFICANCE


def test_the_fit_recovers_a_known_normal(rng: np.random.Generator) -> None:
    mnd, n = known_normal(), 400_000
    fitted = MultivariateNormal.fit(mnd.sample(n, rng))
    variance = np.diag(mnd.covariance)
    standard_error = np.sqrt((np.outer(variance, variance) + mnd.covariance**2) / n)
    assert (np.abs(fitted.mean - mnd.mean) < 5 * np.sqrt(variance / n)).all()
    assert (np.abs(fitted.covariance - mnd.covariance) < 5 * standard_error).all()


def test_the_fit_is_unbiased_for_few_states() -> None:
    states = np.vstack([np.eye(6), -np.eye(6)])
    np.testing.assert_allclose(MultivariateNormal.fit(states).covariance, np.eye(6) * 2 / 11, atol=1e-15)
    with pytest.raises(ValueError, match="states = 6 states: must be at least 7"):
        MultivariateNormal.fit(np.eye(6))


@pytest.mark.parametrize(("states", "least"), [(5.0, 2), ([1.0, 2.0], 3), (np.zeros((6, 6)), 7)])
def test_a_fit_needs_more_states_than_coordinates(states: object, least: int) -> None:
    with pytest.raises(ParameterError, match=f"at least {least} states"):
        MultivariateNormal.fit(states)  # type: ignore[arg-type]


@pytest.mark.parametrize("k", [2, 3, 7, 10, 99, 100, 1000, 12345])
def test_the_split_is_exact_where_it_can_be_and_always_sums_to_k(k: int) -> None:
    for alpha in (*ALPHAS, *(i / 100 for i in range(101))):
        n_ud, n_mnd = split(alpha, k)
        exact = Fraction(str(alpha)) * k
        assert n_ud + n_mnd == k
        assert min(n_ud, n_mnd) >= 0
        assert abs(n_ud - exact) <= Fraction(1, 2)
        if exact.denominator == 1:
            assert n_ud == exact


def test_halves_go_to_ud() -> None:
    assert split(0.5, 3) == (2, 1)
    assert split(0.25, 2) == (1, 1)
    assert split(0.1, 5) == (1, 4)


@pytest.mark.parametrize("alpha", [-0.1, 1.0001, nan, inf, "0.5", None])
def test_an_alpha_outside_its_range_is_refused(alpha: float) -> None:
    with pytest.raises(ValueError, match="alpha = "):
        split(alpha, 10)
    with pytest.raises(ValueError, match="alpha = "):
        generate(alpha, Config(), 0)


@pytest.mark.parametrize("mode", ["keep", "redraw"])
def test_outside_states_are_kept_or_redrawn(mode: str, rng: np.random.Generator) -> None:
    mnd = MultivariateNormal(np.zeros(6), np.diag(HIGH**2))
    states = sample_mnd(3000, mnd, Config().with_values(mnd_outside=mode), rng)
    assert states.shape == (3000, 6)
    inside = (np.abs(states) <= HIGH).all(axis=1).mean()
    expected = stats.norm.cdf([-1, 1]) @ [-1, 1]
    assert inside == 1.0 if mode == "redraw" else inside == pytest.approx(expected**6, abs=0.03)


def test_the_random_policy_visits_what_the_setup_says() -> None:
    """Inside the state space of App. C, from the origin, with θ1 and θ̇1 positively correlated (Fig. 2 a)."""
    visited = visited_states(Config(), np.random.default_rng(1))
    assert (np.abs(visited) <= HIGH).all()
    starts = (visited == 0).all(axis=1)
    assert starts[0]
    assert starts.sum() == Config().choices.random_rollouts
    assert np.corrcoef(visited[:, 0], visited[:, 3])[0, 1] > 0.2


def test_rollouts_of_the_random_policy_hold_each_torque() -> None:
    config = Config().with_values(random_rollouts=20)
    visited, c = visited_states(config, np.random.default_rng(2)), config.choices
    hold, pieces = round(c.random_hold / c.control_period), round(c.random_length / c.random_hold)
    limit = config.paper.torque_limit
    torques = np.random.default_rng(2).uniform(-limit, limit, (20, pieces, 3))
    coefficients, _, limits, _ = ClosedLoop.from_config(config).kernel_arguments
    expected = []
    for held in torques:
        state, outcome = (0.0,) * 6, 0
        for u in itertools.chain.from_iterable([tuple(u)] * hold for u in held):
            if outcome or (np.abs(state) > HIGH).any():
                break
            expected.append(state)
            state, outcome = hold_torque(coefficients, limits, state, u)
    np.testing.assert_array_equal(visited, expected)
    out = np.empty((20 * hold * pieces, 6))
    n = _random_rollouts.py_func(coefficients, limits, HIGH, torques, hold, out)
    np.testing.assert_allclose(out[:n], expected, rtol=1e-9)


def test_the_random_policy_can_have_the_learners_law_and_stop_on_the_ground_alone() -> None:
    """Normal torques, a new one each period: after one period the rates have the spread of the torques."""
    values = {"random_law": "normal", "random_std": 5.0, "random_hold": 0.01, "random_stop": "ground"}
    config = Config().with_values(**values, random_rollouts=2000, random_length=0.02)
    states = visited_states(config, np.random.default_rng(0)).reshape(2000, 2, 6)
    torques = np.clip(np.random.default_rng(0).normal(0.0, 5.0, (2000, 2, 3)), -100, 100)
    system = ClosedLoop.from_config(config)
    after = [hold_torque(*system.kernel_arguments[0:3:2], (0.0,) * 6, tuple(u))[0] for u in torques[:50, 0]]
    np.testing.assert_array_equal(states[:50, 1], after)
    far = visited_states(
        Config().with_values(random_stop="ground", random_rollouts=50), np.random.default_rng(0)
    )
    assert (np.abs(far) > HIGH).any() and (np.abs(far[:, 0]) < HIGH[0]).all()
    assert (
        np.abs(visited_states(Config().with_values(random_rollouts=50), np.random.default_rng(0))) <= HIGH
    ).all()


@pytest.mark.parametrize(("hold", "same"), [(0.018, 0.02), (0.004, 0.01)])
def test_a_torque_is_held_for_the_nearest_number_of_periods_and_for_one_at_least(
    hold: float, same: float
) -> None:
    few = Config().with_values(random_rollouts=20, random_length=0.2)
    found, expected = (
        visited_states(few.with_values(random_hold=value), np.random.default_rng(3)) for value in (hold, same)
    )
    np.testing.assert_array_equal(found, expected)


def test_on_the_ground_alone_no_coordinate_has_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel reads as many ranges as a state has coordinates."""
    given = []
    monkeypatch.setattr("srlrepro.samplers._random_rollouts", lambda *a: given.append(a[2]) or 0)
    visited_states(Config().with_values(random_stop="ground", random_rollouts=1), np.random.default_rng(0))
    assert given[0].tolist() == [inf] * 6


@pytest.mark.parametrize("n_ud", [0, 250, 1000])
def test_density_ratios_turn_training_states_into_the_mnd(n_ud: int, rng: np.random.Generator) -> None:
    """Weighted means over D_n are those of the MND; 1 everywhere for α = 0."""
    mnd = MultivariateNormal(HIGH / 10, np.diag((HIGH / 3) ** 2))
    x = np.concatenate([sample_uniform(200 * n_ud, HIGH, rng), mnd.sample(200 * (1000 - n_ud), rng)])
    data = TrainingData(x, np.ones(len(x), int), 200 * n_ud, mnd)
    ratios = density_ratios(data, Config(), x)
    if n_ud == 0:
        np.testing.assert_allclose(ratios, 1.0, rtol=1e-12)
    inside = (np.abs(x) <= HIGH).all(axis=1)  # beyond, UD has nothing to weigh
    truth = mnd.sample(200_000, rng)
    truth = truth[(np.abs(truth) <= HIGH).all(axis=1)]
    mean = (ratios[inside, None] * x[inside]).sum(axis=0) / ratios[inside].sum()
    np.testing.assert_allclose(mean / HIGH, truth.mean(axis=0) / HIGH, atol=0.01)


def test_many_links_need_a_smaller_torque() -> None:
    """With that of the paper a random policy leaves the state space at once, and few states are left."""
    config = Config().with_values(links=6, k=60, random_rollouts=200)
    with pytest.raises(ParameterError, match=r"states = 20\d states: must be such as vary"):
        generate(0.5, config, 1)
    assert generate(0.5, config.with_values(torque_limit=4.0), 1).x.shape == (60, 12)


@pytest.mark.parametrize("links", [1, 2, 4])
def test_data_of_other_links_have_their_dimension(links: int, tmp_path: Path) -> None:
    config = Config().with_values(links=links, k=60, random_rollouts=200)
    data, high = generate(0.5, config, 1), np.array(config.paper.state_max)
    assert data.x.shape == (60, 2 * links) and (np.abs(data.x[:30]) <= high).all()
    assert data.mnd.covariance.shape == (2 * links, 2 * links)
    np.testing.assert_array_equal(data.z, ClosedLoop.from_config(config).predict(data.x))
    data.save(tmp_path / "data.npz")
    loaded = TrainingData.load(tmp_path / "data.npz")
    np.testing.assert_array_equal(loaded.x, data.x)
    assert loaded.made_of == data.made_of


@pytest.mark.parametrize("alpha", [0, 0.5, 1])
def test_training_data_are_what_their_parts_say(alpha: float, small_config: Config) -> None:
    data = generate(alpha, small_config, seed=3)
    k = small_config.paper.k
    assert data.x.shape == (k, 6)
    assert data.n_ud == round(alpha * k)
    assert (np.abs(data.x[: data.n_ud]) <= HIGH).all()
    assert set(data.z) == {0, 1}
    np.testing.assert_array_equal(data.z, ClosedLoop.from_config(small_config).predict(data.x))
    spread = np.sqrt(np.diag(data.mnd.covariance))
    if data.n_ud < k:
        distance = np.abs(data.x[data.n_ud :].mean(axis=0) - data.mnd.mean)
        assert (distance < 5 * spread / np.sqrt(k - data.n_ud)).all()


def test_the_mnd_is_fitted_to_the_visited_states_whatever_alpha(
    small_config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = generate(0.0, small_config, seed=4), generate(1.0, small_config, seed=4)
    np.testing.assert_array_equal(first.mnd.mean, second.mnd.mean)
    np.testing.assert_array_equal(first.mnd.covariance, second.mnd.covariance)
    states = known_normal().sample(50, np.random.default_rng(0))
    monkeypatch.setattr("srlrepro.samplers.visited_states", lambda config, rng: states)
    mnd = generate(0.0, small_config, seed=4).mnd
    np.testing.assert_allclose(mnd.mean, states.mean(axis=0))
    np.testing.assert_allclose(mnd.covariance, np.cov(states.T))


def test_a_seed_fixes_the_data(small_config: Config) -> None:
    first, same, other = (generate(0.5, small_config, seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.x, same.x)
    np.testing.assert_array_equal(first.z, same.z)
    assert (first.x != other.x).all()


def test_the_known_origin_comes_last_and_is_safe(small_config: Config) -> None:
    data = generate(0.5, small_config, seed=0)
    x, z = known_states(data, small_config.with_values(known_origin=True))
    np.testing.assert_array_equal(x[:-1], data.x)
    np.testing.assert_array_equal(z[:-1], data.z)
    assert (x[-1] == 0).all()
    assert z[-1] == 1
    x, z = known_states(data, small_config.with_values(known_origin=False))
    np.testing.assert_array_equal(x, data.x)
    np.testing.assert_array_equal(z, data.z)


@pytest.mark.parametrize("alpha", [0.0, 1 / 3, 1.0])
def test_saved_data_come_back(small_config: Config, tmp_path: Path, alpha: float) -> None:
    data = generate(alpha, small_config, seed=0)
    data.save(tmp_path / "data.npz")
    back = TrainingData.load(tmp_path / "data.npz")
    for name in ("x", "z", "n_ud"):
        np.testing.assert_array_equal(getattr(back, name), getattr(data, name))
    np.testing.assert_array_equal(back.mnd.mean, data.mnd.mean)
    np.testing.assert_array_equal(back.mnd.covariance, data.mnd.covariance)
    write_arrays(tmp_path / "other.npz", "another-format", x=data.x)
    with pytest.raises(ResultError, match=r"other\.npz"):
        TrainingData.load(tmp_path / "other.npz")


@pytest.mark.parametrize(
    "change",
    [
        {"z": np.ones(3, np.int64)},
        {"z": np.full(4, 2)},
        {"n_ud": np.int64(5)},
        {"n_ud": np.int64(-1)},
        {"mean": np.full(6, nan)},
        {"mean": np.zeros(5)},
        {"covariance": np.full((6, 6), inf)},
        {"x": np.full((4, 6), nan)},
        {"x": np.zeros((1, 6)), "z": np.ones(1, np.int64), "n_ud": np.int64(0)},
    ],
)
def test_parts_that_do_not_fit_together_are_no_data(change: dict[str, np.ndarray], tmp_path: Path) -> None:
    """The same parts unchanged are read."""
    mnd = MultivariateNormal(np.zeros(6), np.eye(6))
    TrainingData(np.zeros((4, 6)), np.array([0, 1, 1, 0]), 4, mnd).save(path := tmp_path / "data.npz")
    assert TrainingData.load(path).n_ud == 4
    with np.load(path) as archive:
        parts = {name: archive[name] for name in PARTS}
    write_arrays(path, FORMAT, **parts | change)
    with pytest.raises(ResultError, match="holds no labelled states"):
        TrainingData.load(path)


@pytest.mark.parametrize("kind", [MultivariateNormal, TrainingData])
def test_data_cannot_change(kind: type) -> None:
    with pytest.raises(FrozenInstanceError):
        setattr(object.__new__(kind), fields(kind)[0].name, None)
