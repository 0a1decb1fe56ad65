"""The safe region: properties of Γ, the threshold, what is known to be safe, and files."""

from collections.abc import Callable
from copy import copy
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from learned import Learned
from sklearn.base import clone

from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.mapping import Network, map_states
from srlrepro.region.safe_region import SafeRegion, learn_region
from srlrepro.region.safety_map import discretise, kernel_estimate, look_up, query, query_batch
from srlrepro.samplers import density_ratios, generate, known_states
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError
from srlrepro.settings.paper import Paper

Draw = Callable[..., Floats]
HIGH = np.array(Config().paper.state_max)


def test_gamma_is_a_share_below_one(rng: np.random.Generator) -> None:
    evidence, y = rng.normal(size=(200, 2)), 3 * rng.normal(size=(500, 2))
    for z in (np.zeros(200, int), np.ones(200, int), rng.integers(0, 2, 200)):
        gamma = kernel_estimate(y, evidence, z, 0.3, 1.0)
        assert (gamma >= 0).all()
        assert (gamma < 1).all()


def test_gamma_counts_weighted_evidence_and_one_prior() -> None:
    """By hand: a safe piece here, an unsafe one at distance b √(2 ln 2), where the kernel weighs one half."""
    far = 0.3 * np.sqrt(2 * np.log(2))
    evidence = (np.zeros((1, 2)), np.array([[0, 0], [far, 0]]), np.array([1, 0]))
    assert kernel_estimate(*evidence, 0.3, 2.5)[0] == pytest.approx(1 / (1 + 0.5 + 2.5))
    assert kernel_estimate(*evidence, 0.3, 2.5, 0.6)[0] == pytest.approx((1 + 2.5 * 0.6) / (1 + 0.5 + 2.5))


def test_a_weight_counts_evidence_several_times(rng: np.random.Generator) -> None:
    evidence, z, y = rng.normal(size=(50, 2)), rng.integers(0, 2, 50), rng.normal(size=(300, 2))
    weights = rng.integers(0, 4, 50)
    weighted = kernel_estimate(y, evidence, z, 0.4, 1.0, 0.2, weights.astype(float))
    repeated = kernel_estimate(y, np.repeat(evidence, weights, axis=0), np.repeat(z, weights), 0.4, 1.0, 0.2)
    np.testing.assert_allclose(weighted, repeated, rtol=1e-12)


def test_weights_reach_gamma_and_bad_ones_are_refused(example: tuple[Floats, ...]) -> None:
    x, z, y = example
    plain = SafeRegion().fit_embedding(x, z, y).arrays_.gamma
    np.testing.assert_array_equal(SafeRegion().fit_embedding(x, z, y, np.ones(30)).arrays_.gamma, plain)
    assert not np.array_equal(SafeRegion().fit_embedding(x, z, y, np.arange(30.0)).arrays_.gamma, plain)
    for bad in (np.ones(29), -np.ones(30), np.full(30, np.nan)):
        with pytest.raises(ParameterError, match="sample_weight"):
            SafeRegion().fit_embedding(x, z, y, bad)


@pytest.mark.parametrize("prior", [0.1, 1.0, 5.0])
def test_gamma_is_monotone_in_evidence(prior: float, rng: np.random.Generator) -> None:
    evidence, z, y = rng.normal(size=(50, 2)), rng.integers(0, 2, 50), 2 * rng.normal(size=(300, 2))
    before = kernel_estimate(y, evidence, z, 0.4, prior)
    for place in rng.normal(size=(20, 2)):
        more = np.vstack([evidence, place])
        assert (kernel_estimate(y, more, np.append(z, 1), 0.4, prior) >= before - 1e-15).all()
        assert (kernel_estimate(y, more, np.append(z, 0), 0.4, prior) <= before + 1e-15).all()


def test_where_there_is_no_evidence_nothing_is_safe(example: tuple[Floats, ...]) -> None:
    x, _, y = example
    region = SafeRegion(gamma_bandwidth=0.05, gamma_prior=0.003, p_t=0.3).fit_embedding(
        x, np.ones(30, int), y
    )
    safe = region.arrays_.gamma > region.p_t
    assert safe.any()
    assert not safe.all()
    corner = region.arrays_.gamma[[0, 0, -1, -1], [0, -1, 0, -1]]
    assert corner.max() < 0.05
    far = kernel_estimate(np.array([[1e3, -1e3]]), region.evidence_, region.labels_, 0.1, 0.1)
    assert far[0] == 0.0
    hopeful = SafeRegion(gamma_bandwidth=0.05, gamma_prior=0.003, gamma_empty=0.5).fit_embedding(
        x, np.ones(30, int), y
    )
    assert hopeful.arrays_.gamma.min() >= 0.5


def test_off_the_grid_nothing_is_safe(small: Learned) -> None:
    a = small[1].arrays_
    full = a._replace(gamma=np.ones_like(a.gamma))
    end = a.origin + a.cell * np.array(a.gamma.shape)
    for y in (
        (a.origin[0] - 1e-6, 0),
        (0, a.origin[1] - 1e-6),
        (end[0] + 1e-6, 0),
        (0, end[1] + 1e-6),
        (1e9, -1e9),
    ):
        for function in (look_up, look_up.py_func):
            assert function(full, *map(float, y)) == 0.0
            assert function(full._replace(empty=0.4), *map(float, y)) == 0.4
    assert look_up(full, *(a.origin + 1e-6)) == 1.0
    assert look_up(full, *(end - 1e-6)) == 1.0


def test_the_grid_holds_the_estimate_at_the_centres_of_its_cells(small: Learned) -> None:
    region = small[1]
    a = region.arrays_
    spread = region.embedding_ - region.embedding_.mean(axis=0)
    bandwidth = region.gamma_bandwidth * np.sqrt((spread**2).sum(axis=1).mean())
    cells = np.random.default_rng(0).integers(0, region.gamma_cells, (200, 2))
    centres = a.origin + a.cell * (cells + 0.5)
    found = [look_up(a, *y) for y in centres]
    expected = kernel_estimate(
        centres, region.evidence_, region.labels_, bandwidth, region.gamma_prior * len(region.labels_)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-300)
    inside = (region.embedding_ >= a.origin) & (region.embedding_ <= a.origin + a.cell * region.gamma_cells)
    assert inside.all()


def test_the_grid_is_a_square_around_the_places_with_three_bandwidths_to_spare(
    rng: np.random.Generator,
) -> None:
    """Its side and its centre in closed form; its values by the sums of the module, term by term."""
    places, z = rng.normal(size=(40, 2)) * [2.0, 0.5] + [5.0, -3.0], rng.integers(0, 2, 40)
    evidence, weights, cells = places + rng.normal(size=(40, 2)), rng.uniform(0, 2, 40), 16
    values = 0.4, 1.5, cells, 0.25
    gamma, origin, cell, empty = discretise(places, evidence, z, *values, weights)
    middle = places.mean(axis=0)
    bandwidth = 0.4 * np.sqrt(np.mean([np.sum((y - middle) ** 2) for y in places]))
    low, high = places.min(axis=0) - 3 * bandwidth, places.max(axis=0) + 3 * bandwidth
    assert cells * cell == pytest.approx((high - low).max()) and empty == 0.25
    np.testing.assert_allclose(origin + 8 * cell, (low + high) / 2)
    for i, j in ((0, 0), (3, 7), (7, 8), (15, 2), (8, 15)):
        centre = origin + cell * np.array([i + 0.5, j + 0.5])
        kernels = [
            w * np.exp(-np.sum((centre - e) ** 2) / (2 * bandwidth**2))
            for w, e in zip(weights, evidence, strict=True)
        ]
        expected = (np.dot(kernels, z) + 1.5 * 0.25) / (sum(kernels) + 1.5)
        assert gamma[i, j] == pytest.approx(expected, rel=1e-9)
    assert gamma.shape == (cells, cells)
    _, origin, cell, _ = discretise(np.ones((5, 2)), np.ones((5, 2)), z[:5], *values)
    assert cells * cell == pytest.approx(6.0)  # one place: a bandwidth of 1
    np.testing.assert_allclose(origin, -2.0)


def test_a_digest_tells_regions_apart_by_all_that_h_depends_on(small: Learned) -> None:
    """By the threshold too: two thresholds are two hypotheses on the same map."""
    region, whole, found = copy(small[1]), small[1].arrays_, [small[1].digest()]
    for name in whole._fields[:-1]:
        region.arrays_ = whole._replace(**{name: np.asarray(getattr(whole, name)) + 1})
        found.append(region.digest())
    for name in Network._fields:
        other = whole.network._replace(**{name: getattr(whole.network, name) + 1})
        region.arrays_ = whole._replace(network=other)
        found.append(region.digest())
    region.arrays_, region.p_t = whole, float(np.nextafter(region.p_t, 1.0))
    found.append(region.digest())
    assert len(set(found)) == len(found) == 16
    region.p_t = small[1].p_t
    assert region.digest() == found[0]


def test_evidence_lies_where_the_other_states_place_it(example: tuple[Floats, ...]) -> None:
    x, z, y = example
    values = {"psi": "neighbours", "gamma_evidence": "held out", "psi_neighbours": 3}
    held_out = SafeRegion(**values).fit_embedding(x, z, y)
    np.testing.assert_array_equal(SafeRegion(gamma_evidence="embedded").fit_embedding(x, z, y).evidence_, y)
    scaled = np.ascontiguousarray((x / HIGH).T)
    np.testing.assert_array_equal(held_out.evidence_, map_states(HIGH, scaled, y, 3, True, x))
    assert (held_out.evidence_ != y).any(axis=1).all()
    of_network = SafeRegion(gamma_evidence="held out").fit_embedding(x, z, y)
    seen = SafeRegion().fit_embedding(x, z, y).transform(x)
    assert np.abs(seen - y).mean() < np.abs(of_network.evidence_ - y).mean()


def test_predictions_are_consistent(small: Learned, draw: Draw) -> None:
    region, x = small[1], draw(300)
    gamma, a = region.safety(x), region.arrays_
    y = region.transform(x)
    np.testing.assert_array_equal(gamma, [look_up(a, *place) for place in y])
    np.testing.assert_array_equal(region.predict_proba(x), np.stack([1 - gamma, gamma], axis=1))
    np.testing.assert_array_equal(region.predict(x), gamma > region.p_t)
    assert 0 < region.predict(x).sum() < 300
    for method in (region.transform, region.safety, region.predict_proba, region.predict):
        np.testing.assert_array_equal(method(x), np.concatenate([method(state) for state in x]))
    assert region.predict(x).dtype.kind == "i"


def test_predicted_safe_states_are_more_often_safe(small: Learned, draw: Draw) -> None:
    """Of 2000 fresh states: the standard error of a share is about 0.02."""
    x = draw(2000, 11)
    labels, h = ClosedLoop().predict(x), small[1].predict(x)
    assert labels[h == 1].mean() > labels.mean() + 0.06
    assert labels[h == 0].mean() < labels.mean() - 0.06


def test_the_threshold_is_strict(small: Learned, draw: Draw) -> None:
    region = clone(small[1]).fit_embedding(
        small[1].arrays_.x_train.T * HIGH, small[1].labels_, small[1].embedding_
    )
    gamma = region.safety(draw(100))
    state, value = draw(100)[gamma.argmax()], gamma.max()
    assert region.set_params(p_t=float(value)).predict(state)[0] == 0
    assert region.set_params(p_t=float(np.nextafter(value, 0.0))).predict(state)[0] == 1


@pytest.mark.slow
@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_the_origin_is_known_to_be_safe(full: dict[float, Learned], alpha: float) -> None:
    data, region = full[alpha]
    assert region.predict(np.zeros(6))[0] == 1
    x, z = known_states(data, Config())
    np.testing.assert_array_equal(region.labels_, z)
    by_neighbours = region.set_params(psi="neighbours").fit_embedding(x, z, region.embedding_)
    np.testing.assert_array_equal(by_neighbours.transform(x), region.embedding_)
    assert 0 < region.predict(x).sum() < len(x)


def test_learning_is_deterministic(small: Learned, small_config: Config) -> None:
    again = learn_region(small[0], small_config)
    *found, network = again.arrays_
    *expected, other = small[1].arrays_
    for part, same in zip((*found, *network), (*expected, *other), strict=True):
        np.testing.assert_array_equal(part, same)


def test_learn_takes_every_value_of_the_configuration(small: Learned, small_config: Config) -> None:
    config = small_config.with_values(
        p_t=0.6,
        label_gap=0.5,
        perplexity=20.0,
        psi="neighbours",
        psi_width=8,
        psi_penalty=0.5,
        psi_neighbours=5,
        gamma_evidence="held out",
        gamma_bandwidth=0.3,
        gamma_prior=0.2,
        gamma_empty=0.3,
        gamma_cells=64,
        known_origin=False,
        omega_step=0.2,
        omega_horizon=1.0,
        theta23_max=3.0,
    )
    region = learn_region(replace(small[0], made_of=None), config, seed=7)
    psi, gamma = ("neighbours", 8, 0.5, 5), ("held out", 0.3, 0.2, 0.3, 64)
    expected = SafeRegion(0.6, 0.5, 20.0, *psi, *gamma, config.paper.state_max, 7)
    assert region.get_params() == expected.get_params()
    assert len(region.labels_) == len(small[0].z)
    paths = ClosedLoop.from_config(small_config).rollout(small[0].x).paths[:, :101:20]
    same = clone(region).fit(small[0].x, small[0].z, paths)
    np.testing.assert_array_equal(same.embedding_, region.embedding_)


def test_weights_are_density_ratios_with_a_mean_of_one(
    small: Learned, small_config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that Γ's prior weighs as much as it does beside evidence without weights."""
    given: list[Floats | None] = []
    fit = SafeRegion.fit
    monkeypatch.setattr(SafeRegion, "fit", lambda *a: (given.append(a[4]), fit(*a))[1])
    data = replace(small[0], made_of=None)
    for law in ("none", "density ratio"):
        learn_region(data, config := small_config.with_values(gamma_weights=law))
    ratios = density_ratios(data, config, known_states(data, config)[0])
    unweighted, weights = given
    assert unweighted is None and weights is not None and weights.mean() == pytest.approx(1)
    np.testing.assert_allclose(weights * ratios.sum(), ratios * len(ratios), rtol=1e-12)


@pytest.mark.parametrize("known_origin", [True, False])
def test_the_smallest_allowed_dataset_gives_a_region(known_origin: bool, small_config: Config) -> None:
    (allowed,) = (f.metadata["allowed"] for f in fields(Paper) if f.name == "k")
    least = int(allowed[1:].split(",")[0])
    config = small_config.with_values(k=least, known_origin=known_origin)
    region = learn_region(generate(0.5, config, 0), config)
    assert region.predict(np.zeros((3, 6))).shape == (3,)


@pytest.mark.parametrize("bad", [np.zeros(5), np.zeros((2, 7)), np.full((3, 6), np.nan), [[np.inf] * 6]])
def test_bad_states_are_refused(small: Learned, bad: Floats) -> None:
    for method in (small[1].transform, small[1].safety, small[1].predict_proba, small[1].predict):
        with pytest.raises(ValueError, match="x = "):
            method(bad)


def test_states_of_any_finite_size_have_a_place_and_a_label(small: Learned) -> None:
    x = np.array([[1e6] * 6, [-1e150] * 6, [1e160] * 6, [1e300, 0, 0, 0, 0, 0]])
    assert np.isfinite(small[1].transform(x)).all()
    assert set(small[1].predict(x)) <= {0, 1}


def test_identical_simplified_states_are_one_place(example: tuple[Floats, ...]) -> None:
    x, z, _ = example
    region = SafeRegion(gamma_prior=1 / 30).fit_embedding(x, z, np.zeros((30, 2)))
    np.testing.assert_allclose(region.safety(x[:3]), z.sum() / 31, rtol=1e-2)


def test_compiled_code_does_what_the_source_says(small: Learned, draw: Draw) -> None:
    a, x = small[1].arrays_, draw(10)
    for state in x:
        np.testing.assert_allclose(query.py_func(a, state), query(a, state), rtol=1e-9)
    np.testing.assert_array_equal(query_batch.py_func(a, x), query_batch(a, x))
    y = small[1].transform(x)
    for place in y:
        assert look_up.py_func(a, *place) == look_up(a, *place)


@pytest.mark.parametrize("links", [1, 2, 4])
def test_a_region_has_the_dimension_of_its_states(links: int, tmp_path: Path) -> None:
    config = Config().with_values(links=links, k=60, random_rollouts=200)
    data = generate(0.5, config, 1)
    region = learn_region(data, config)
    assert region.state_max == config.paper.state_max and region.arrays_.x_train.shape == (2 * links, 61)
    region.save(tmp_path / "region.npz")
    loaded = SafeRegion.load(tmp_path / "region.npz")
    np.testing.assert_array_equal(loaded.safety(data.x), region.safety(data.x))
    assert loaded.digest() == region.digest() and loaded.made_of_ == region.made_of_
    with pytest.raises(ParameterError, match=rf"x = shape \(1, 7\): must be .* \[B, {2 * links}\]"):
        loaded.predict(np.zeros((1, 7)))


def test_any_dimension_will_do(rng: np.random.Generator) -> None:
    """Odd ones too: the trajectories may come from any simulator."""
    x, z = rng.normal(size=(40, 3)), rng.integers(0, 2, 40)
    region = SafeRegion(state_max=(1.0, 2.0, 3.0)).fit(x, z, x[:, None] + rng.normal(size=(40, 5, 3)))
    assert region.safety(x).shape == (40,)
