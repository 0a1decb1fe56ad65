"""Ω, t-SNE and Ψ: definitions written out, scikit-learn's regressor, and separation in the plane."""

from collections.abc import Callable

import numpy as np
import pytest
from learned import Learned
from openTSNE import TSNE
from scipy.spatial.distance import cdist
from sklearn.model_selection import KFold
from sklearn.neighbors import KNeighborsRegressor
from sklearn.neural_network import MLPRegressor

from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.mapping import apply_network, fit_network, held_out_places, map_state, map_states
from srlrepro.region.tsne import dissimilarity, embed, label_purity, trajectory_distances
from srlrepro.samplers import known_states
from srlrepro.settings.config import Config

HIGH = np.array(Config().paper.state_max)
Paths = tuple[Floats, Floats]


@pytest.fixture
def paths(rng: np.random.Generator) -> Paths:
    """Random trajectories [12, 9, 6], some beyond the state space, and labels [12]."""
    return 1.5 * rng.normal(size=(12, 9, 6)) * HIGH, rng.integers(0, 2, 12)


def plane(n: int, k: int = 40) -> tuple[Floats, Floats, Floats]:
    """Training states [k, 6] with simplified states [k, 2], and n other states."""
    rng = np.random.default_rng(7)
    return rng.uniform(-HIGH, HIGH, (k, 6)), rng.normal(size=(k, 2)), rng.uniform(-HIGH, HIGH, (n, 6))


def psi(train: Floats, y: Floats, neighbours: int, x: Floats, leave_one_out: bool = False) -> Floats:
    return map_states(HIGH, np.ascontiguousarray((train / HIGH).T), y, neighbours, leave_one_out, x)


def test_distances_of_trajectories_are_those_of_the_definition(paths: Paths) -> None:
    found = trajectory_distances(paths[0], HIGH)
    scaled = np.clip(paths[0] / HIGH, -1, 1)
    for i in range(12):
        for j in range(12):
            squared = [np.sum((a - b) ** 2) for a, b in zip(scaled[i], scaled[j], strict=True)]
            assert found[i, j] == pytest.approx(np.sqrt(np.mean(squared)), abs=1e-12)


def test_beyond_the_state_space_nothing_counts(paths: Paths) -> None:
    """How far a state has run away says nothing: the distance is that of the clipped paths."""
    limited = np.clip(paths[0], -HIGH, HIGH)
    np.testing.assert_allclose(trajectory_distances(paths[0], HIGH), trajectory_distances(limited, HIGH))
    assert trajectory_distances(1e6 * paths[0], HIGH).max() <= 2 * np.sqrt(6)


@pytest.mark.parametrize("gap", [0.0, 0.3, 2.0])
def test_omega_is_a_scaled_distance_plus_a_gap_between_labels(paths: Paths, gap: float) -> None:
    omega, plain = dissimilarity(*paths, HIGH, gap), trajectory_distances(paths[0], HIGH)
    np.testing.assert_array_equal(omega, omega.T)
    np.testing.assert_array_equal(np.diag(omega), 0.0)
    differ = paths[1][:, None] != paths[1][None, :]
    assert 0 < differ.sum() < differ.size
    np.testing.assert_allclose(omega - plain / plain.max(), gap * differ, atol=1e-12)
    assert dissimilarity(*paths, HIGH, 0.0).max() == 1.0


def test_equal_trajectories_differ_by_their_label_only() -> None:
    omega = dissimilarity(np.ones((3, 5, 6)), [0, 1, 1], HIGH, 0.7)
    np.testing.assert_array_equal(omega, [[0, 0.7, 0.7], [0.7, 0, 0], [0.7, 0, 0]])


def test_bad_trajectories_labels_and_gaps_are_refused(paths: Paths) -> None:
    x, z = paths
    spoilt = x.copy()
    spoilt[3, 2, 1] = np.nan
    for bad in (x[0], x[:, :, :5], spoilt):
        with pytest.raises(ValueError, match="trajectories = "):
            dissimilarity(bad, z, HIGH, 1.0)
    for bad in (z[:-1], z[:, None]):
        with pytest.raises(ValueError, match="z = "):
            dissimilarity(x, bad, HIGH, 1.0)
    for gap in (-0.1, np.nan):
        with pytest.raises(ValueError, match="label_gap = "):
            dissimilarity(x, z, HIGH, gap)


def test_embedding_is_deterministic_and_follows_its_seed(rng: np.random.Generator) -> None:
    points = rng.normal(size=(60, 3))
    omega = cdist(points, points)
    first, same = embed(omega, 10.0, 1), embed(omega, 10.0, 1)
    assert first.shape == (60, 2)
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, same)


def test_embedding_keeps_groups_together(rng: np.random.Generator) -> None:
    group = np.repeat([0, 1, 2], 30)
    points = rng.normal(size=(90, 4)) + 20 * np.eye(3, 4)[group]
    y = embed(cdist(points, points), 10.0, 0)
    assert label_purity(cdist(y, y), group) == 1.0


@pytest.mark.parametrize("k", [4, 5, 10, 40])
def test_few_points_lower_the_perplexity_to_a_third(
    k: int, rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    """Of what lies around a point; so that openTSNE, which would say so, need not lower it."""
    points = rng.normal(size=(k, 3))
    omega = cdist(points, points)
    y = embed(omega, 30.0, 0)
    assert y.shape == (k, 2) and np.isfinite(y).all()
    assert not caplog.records
    given = {"metric": "precomputed", "initialization": "spectral", "n_jobs": 1, "random_state": 0}
    np.testing.assert_array_equal(y, TSNE(perplexity=(k - 1) / 3, **given).fit(omega))


def test_safe_and_unsafe_states_separate_in_the_plane(small: Learned, small_config: Config) -> None:
    """Neighbours among the states often have another label, neighbours among the simplified states rarely."""
    data, region = small
    x, z = known_states(data, small_config)
    before = label_purity(cdist(x / HIGH, x / HIGH), z)
    after = label_purity(cdist(region.embedding_, region.embedding_), z)
    assert before < after
    assert after > 0.95


def test_trajectories_alone_bring_equal_labels_together(small: Learned, small_config: Config) -> None:
    """Without the gap between labels."""
    data, _ = small
    paths = ClosedLoop.from_config(small_config).rollout(data.x).paths[:, ::5]
    omega = dissimilarity(paths, data.z, HIGH, 0.0)
    assert label_purity(omega, data.z) > label_purity(cdist(data.x / HIGH, data.x / HIGH), data.z)


def test_purity_counts_equal_labels_among_the_nearest() -> None:
    places = np.array([[0.0], [1.0], [2.5], [10.0], [11.0], [12.5]])
    distances = cdist(places, places)
    assert label_purity(distances, np.array([0, 0, 0, 1, 1, 1]), 2) == 1.0
    assert label_purity(distances, np.array([0, 0, 1, 1, 0, 0]), 1) == pytest.approx(3 / 6)
    np.testing.assert_array_equal(np.diag(distances), 0.0)  # the argument is left as it was


@pytest.mark.parametrize("neighbours", [1, 2, 8, 40])
def test_psi_is_the_distance_weighted_regressor_of_sklearn(neighbours: int) -> None:
    train, y, x = plane(60)
    mixed = np.concatenate([x, train])  # exact hits too
    # its "brute" takes |a|² − 2 a b + |b|² for a distance, which loses half the digits of a small one
    regressor = KNeighborsRegressor(neighbours, weights="distance", algorithm="kd_tree").fit(train / HIGH, y)
    np.testing.assert_allclose(psi(train, y, neighbours, mixed), regressor.predict(mixed / HIGH), rtol=1e-6)


def test_several_training_states_in_one_place_count_equally() -> None:
    train, y, _ = plane(0)
    train[5], train[6] = train[4], train[4]
    np.testing.assert_allclose(psi(train, y, 8, train[4:5])[0], y[4:7].mean(axis=0))


def test_of_equally_near_training_states_the_first_ones_count(rng: np.random.Generator) -> None:
    """All lie at the same distance from the origin, to the last bit."""
    train, y = np.concatenate([np.eye(6), -np.eye(6)]) * HIGH, rng.normal(size=(12, 2))
    for neighbours in range(1, 13):
        found = psi(train, y, neighbours, np.zeros((1, 6)))[0]
        np.testing.assert_allclose(found, y[:neighbours].mean(axis=0), rtol=1e-12)
        left_out = psi(train, y, min(neighbours, 11), np.zeros((1, 6)), leave_one_out=True)[0]
        np.testing.assert_allclose(left_out, y[1 : min(neighbours, 11) + 1].mean(axis=0), rtol=1e-12)


def test_one_by_one_equals_the_batch() -> None:
    train, y, x = plane(20)
    np.testing.assert_array_equal([psi(train, y, 8, state[None])[0] for state in x], psi(train, y, 8, x))


def test_psi_at_a_training_state_is_its_simplified_state() -> None:
    train, y, _ = plane(0)
    np.testing.assert_array_equal(psi(train, y, 8, train), y)


def test_leaving_one_out_is_mapping_by_the_others() -> None:
    train, y, _ = plane(0)
    found = psi(train, y, 8, train, leave_one_out=True)
    for i, x in enumerate(train):
        others = np.delete(train, i, axis=0), np.delete(y, i, axis=0)
        np.testing.assert_allclose(found[i], psi(*others, 8, x[None])[0], rtol=1e-12)


def test_psi_stays_among_the_simplified_states_of_the_neighbours() -> None:
    train, y, x = plane(100)
    mapped = psi(train, y, 8, 100 * x)
    assert (mapped >= y.min(axis=0)).all()
    assert (mapped <= y.max(axis=0)).all()


def test_compiled_code_does_what_the_source_says() -> None:
    train, y, x = plane(5)
    arguments: tuple[Floats, ...] = HIGH, np.ascontiguousarray((train / HIGH).T), y
    mixed = np.concatenate([x, train[:2]])
    single: Callable[..., tuple[float, float]] = map_state.py_func
    for without in (-1, 1):
        expected = [single(*arguments, 6, without, state) for state in mixed]
        found = [map_state(*arguments, 6, without, state) for state in mixed]
        np.testing.assert_allclose(found, expected, rtol=1e-9)
    for left_out in (False, True):
        expected = map_states.py_func(*arguments, 6, left_out, mixed)
        np.testing.assert_allclose(map_states(*arguments, 6, left_out, mixed), expected, rtol=1e-9)


def test_the_network_is_scikit_learns_regression(
    example: tuple[Floats, ...], rng: np.random.Generator
) -> None:
    """Of y in standard deviations, so that a factor of y scales Ψ."""
    x, _, y = example
    scaled, states = x / HIGH, rng.uniform(-2, 2, (50, 6)) * HIGH
    mean, spread = y.mean(axis=0), y.std()
    model = MLPRegressor(hidden_layer_sizes=(7, 7), solver="lbfgs", alpha=0.3, max_iter=500, random_state=4)
    expected = model.fit(scaled, (y - mean) / spread).predict(states / HIGH) * spread + mean
    network = fit_network(scaled, y, 7, 0.3, 4)
    found = [apply_network(network, HIGH, state) for state in states]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(apply_network.py_func(network, HIGH, states[0]), found[0], rtol=1e-12)
    far = apply_network(network, HIGH, np.full(6, 1e300))
    assert np.isfinite(far).all() and far == apply_network(network, HIGH, 1e7 * HIGH)
    larger = fit_network(scaled, 4 * y, 7, 0.3, 4)
    np.testing.assert_allclose([apply_network(larger, HIGH, s) for s in states], 4 * expected, rtol=1e-9)


def test_held_out_places_are_those_of_networks_that_have_not_seen_them(example: tuple[Floats, ...]) -> None:
    x, _, y = example
    found = held_out_places(x / HIGH, y, 5, 1.0, 2)
    expected = np.empty_like(y)
    mean, spread = y.mean(axis=0), y.std()
    for others, held in KFold(10, shuffle=True, random_state=2).split(x):
        model = MLPRegressor(
            hidden_layer_sizes=(5, 5), solver="lbfgs", max_iter=500, alpha=1.0, random_state=2
        )
        model.fit((x / HIGH)[others], ((y - mean) / spread)[others])
        expected[held] = model.predict((x / HIGH)[held]) * spread + mean
    np.testing.assert_allclose(found, expected, rtol=1e-12)
