"""Every hypothesis behind the supervisor: compiled and plain, knowing the origin, the same each time."""

import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pandas as pd
import pytest
from learned import Learned
from runs import CASES, UPDATE, Case
from sklearn.decomposition import PCA
from sklearn.neighbors import KNeighborsClassifier
from stable_baselines3 import PPO

from replication.evidence.measures import classification, reliability
from replication.studies.alternatives import (
    ORACLES,
    Predictor,
    fit_mlp,
    fit_svm,
    learn_hypothesis,
    read_hypothesis,
)
from srlrepro.dynamics.closed_loop import ClosedLoop, Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.learner.training import Run
from srlrepro.region.hypothesis import CompiledHypothesis, Posterior, safe_probabilities
from srlrepro.region.mapping import map_states
from srlrepro.region.safe_region import SafeRegion
from srlrepro.region.safety_map import discretise, query_batch
from srlrepro.samplers import TrainingData, known_states, sample_uniform
from srlrepro.settings.choices import Choices
from srlrepro.settings.condition import Condition
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError

KINDS = Choices.__dataclass_fields__["hypothesis"].metadata["allowed"].split("|")
SCALE = np.array(Config().paper.state_max)
DELTA = 2.0
CELL = Condition(0.5, DELTA, 0)
ORIGIN = np.zeros((1, 6))


@pytest.fixture(scope="module")
def hypotheses(small: Learned, small_config: Config) -> dict[str, CompiledHypothesis]:
    """Every kind, learned from the same few states."""
    configs = {kind: small_config.with_values(hypothesis=kind) for kind in KINDS}
    return {kind: learn_hypothesis(small[0], config, delta=DELTA) for kind, config in configs.items()}


def plain(kind: str, x: Floats, z: Labels, states: Floats) -> Floats:
    """P(l(x) = 1) of the states by scikit-learn, or by the plain method, from training states x."""
    s, c = x / SCALE, Choices()
    if kind == "knn":
        model = KNeighborsClassifier(c.psi_neighbours, weights="distance").fit(s, z)
    elif kind == "svm":
        model = fit_svm(s, z, 0)
    elif kind == "mlp":
        model = fit_mlp(s, z, 0)
    elif kind == "pca":
        pca = PCA(2).fit(s)
        places = pca.transform(s)
        values = (c.gamma_bandwidth, c.gamma_prior * len(x), c.gamma_cells, c.gamma_empty)
        gamma, origin, cell, _ = discretise(places, places, z, *values)
        cells = np.floor((pca.transform(states / SCALE) - origin) / cell).astype(int)
        inside = ((cells >= 0) & (cells < len(gamma))).all(axis=1)
        return np.where(inside, gamma[*np.clip(cells, 0, len(gamma) - 1).T], 0.0)
    else:
        delta = DELTA if kind == "real" else 1.0
        return ClosedLoop.from_config(Config(), delta).predict(states).astype(float)
    return np.asarray(model.predict_proba(states / SCALE)[:, 1])


@pytest.mark.parametrize("kind", [k for k in KINDS if k not in ("tsne", "euclidean")])
def test_compiled_probabilities_are_the_plain_ones(
    kind: str, hypotheses: dict[str, CompiledHypothesis], small: Learned, small_config: Config
) -> None:
    x, z = known_states(small[0], small_config)
    states = np.concatenate([sample_uniform(400, 1.2 * SCALE, np.random.default_rng(1)), x])
    found, expected = hypotheses[kind].safety(states), plain(kind, x, z, states)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert expected.min() < 0.2 and expected.max() > 0.7
    np.testing.assert_array_equal(hypotheses[kind].predict(states), expected > Config().paper.p_t)


def test_one_compiled_function_serves_all_kinds(hypotheses: dict[str, CompiledHypothesis]) -> None:
    """And an environment that nobody watches: all that simulate no system have the same type."""
    others = [h.posterior for h in hypotheses.values() if h.posterior.loop is None]
    assert 0 < len(others) < len(hypotheses)
    assert len({numba.typeof(posterior) for posterior in [*others, Posterior()]}) == 1


def test_the_safe_region_is_what_it_was(small: Learned, hypotheses: dict[str, CompiledHypothesis]) -> None:
    """Bit by bit, and compiled code asks the same Γ."""
    region, states = small[1], sample_uniform(300, SCALE, np.random.default_rng(2))
    assert hypotheses["tsne"].digest() == region.digest()
    expected = query_batch(region.arrays_, states)
    np.testing.assert_array_equal(safe_probabilities(region.posterior, states), expected)
    np.testing.assert_array_equal(region.safety(states), expected)


def test_plain_distances_know_neither_labels_nor_trajectories(small: Learned, small_config: Config) -> None:
    data, config = small[0], small_config.with_values(hypothesis="euclidean", psi="neighbours")
    region = learn_hypothesis(data, config)
    assert isinstance(region, SafeRegion) and region.label_gap == 0
    flipped = TrainingData(data.x, 1 - data.z, data.n_ud, data.mnd)
    other = learn_hypothesis(flipped, config)
    assert isinstance(other, SafeRegion)
    np.testing.assert_array_equal(other.embedding_, region.embedding_)
    states = sample_uniform(50, SCALE, np.random.default_rng(3))
    a = region.arrays_
    y = map_states(a.scale, a.x_train, a.y_train, a.neighbours, False, states)
    np.testing.assert_array_equal(region.transform(states), y)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_learned_is_the_same_each_time_and_depends_on_the_data(
    kind: str, small: Learned, small_config: Config, hypotheses: dict[str, CompiledHypothesis]
) -> None:
    data, config = small[0], small_config.with_values(hypothesis=kind)
    states = sample_uniform(20, SCALE, np.random.default_rng(4))
    before = hypotheses[kind].digest()
    hypotheses[kind].safety(states)
    assert learn_hypothesis(data, config, delta=DELTA).digest() == before == hypotheses[kind].digest()
    less = TrainingData(data.x[1:], data.z[1:], data.n_ud, data.mnd)
    assert (learn_hypothesis(less, config, delta=DELTA).digest() == before) is (kind in ORACLES)
    assert len({h.digest() for h in hypotheses.values()}) == len(KINDS)
    assert (learn_hypothesis(data, config, delta=3.0).digest() == before) is (kind != "real")


def test_the_digest_of_a_hypothesis_is_the_same_in_another_process() -> None:
    """It tells thresholds and weights apart."""
    code = (
        "from srlrepro import pins; pins.pin()\n"
        "from replication.studies.alternatives import Predictor\n"
        "from srlrepro.region.hypothesis import Posterior\n"
        "print(Predictor(Posterior(bias=0.5), 0.7).digest())"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    own = Predictor(Posterior(bias=0.5), 0.7).digest()
    assert said.strip() == own
    assert own != Predictor(Posterior(bias=0.5), 0.6).digest() != Predictor(Posterior(bias=0.4), 0.6).digest()


@pytest.mark.parametrize("kind", [k for k in KINDS if k not in ORACLES])
def test_the_origin_is_among_what_is_learned(kind: str, small: Learned, small_config: Config) -> None:
    config = small_config.with_values(hypothesis=kind)
    known, unknown = (learn_hypothesis(small[0], config.with_values(known_origin=v)) for v in (True, False))
    assert known.digest() != unknown.digest()


def test_scores_take_any_hypothesis(hypotheses: dict[str, CompiledHypothesis]) -> None:
    states = sample_uniform(300, SCALE, np.random.default_rng(5))
    labels = ClosedLoop.from_config(Config()).predict(states)
    for kind, h in hypotheses.items():
        scores = classification(h, states, labels)
        assert scores["error"] == pytest.approx((h.predict(states) != labels).mean())
        assert (scores["brier"] == 0) is (kind == "nominal")
        assert len(reliability(h, states, labels)) >= 2


def test_nothing_to_learn_from_is_refused(small: Learned, small_config: Config) -> None:
    data = small[0]
    for kind in ("tsne", "mlp"):
        with pytest.raises(ParameterError, match=f"data = None: must be .* hypothesis = {kind}"):
            learn_hypothesis(None, Config().with_values(hypothesis=kind))
    safe = TrainingData(data.x, np.ones_like(data.z), data.n_ud, data.mnd)
    with pytest.raises(ParameterError, match="z = 1 for all states: must be of both kinds"):
        learn_hypothesis(safe, small_config.with_values(hypothesis="svm"))
    assert learn_hypothesis(None, Config().with_values(hypothesis="nominal")).predict(ORIGIN)[0] == 1


def test_the_region_is_read_and_the_others_are_learned_from_the_data_beside_it(
    small: Learned, small_config: Config, hypotheses: dict[str, CompiledHypothesis], tmp_path: Path
) -> None:
    small[0].save(tmp_path / "training_data.npz")
    small[1].save(tmp_path / "region.npz")
    for kind in ("tsne", "knn", "real"):
        varied = small_config.with_values(hypothesis=kind)
        found = read_hypothesis(tmp_path / "region.npz", varied, CELL)
        assert found.digest() == hypotheses[kind].digest()
        for other, condition in ((varied, Condition(0.0, DELTA, 0)), (varied.with_values(k=201), CELL)):
            with pytest.raises(ParameterError, match="with which"):
                read_hypothesis(tmp_path / "region.npz", other, condition)


@pytest.mark.parametrize("learner", ["compiled", "stock"])
def test_without_k_the_learner_learns_the_same(learner: str, tmp_path: Path) -> None:
    """K's steps are no steps of the learner, and every trial starts at the origin."""
    (case,) = (c for c in CASES if c.name == "supervised")
    folders = [tmp_path / value for value in ("K", "none")]
    counts = [case.train(f, corrective=f.name, learner=learner)["counts"] for f in folders]
    with_k, without = (pd.read_csv(f / "trials.csv") for f in folders)
    of_k = ["recovery", "recovery_time"]
    pd.testing.assert_frame_equal(with_k.drop(columns=of_k), without.drop(columns=of_k))
    activated = without[without["activated"]]
    assert set(activated["recovery"]) == {"not tried"} and (activated["recovery_time"] == 0).all()
    policies = [PPO.load(f / "policy.zip", device="cpu").policy.state_dict() for f in folders]
    for name, value in policies[0].items():
        assert value.numpy().tobytes() == policies[1][name].numpy().tobytes()
    assert counts[0]["activations"] == counts[1]["activations"] > 0 and counts[0]["recovered"] > 0
    assert [counts[1][n] for n in ("recovered", "hit_the_ground", "not_recovered_in_time")] == [0, 0, 0]
    assert pd.read_csv(tmp_path / "none" / "curve.csv")["failures"].sum() == 0


@pytest.mark.parametrize("kind", ["knn", "real"])
def test_training_runs_behind_any_hypothesis(
    kind: str, hypotheses: dict[str, CompiledHypothesis], tmp_path: Path
) -> None:
    config = CASES[0].config.with_values(hypothesis=kind)
    result = Case(kind, Run(0.5, DELTA, 3, 2 * UPDATE), hypotheses[kind], config).train(tmp_path)
    assert result["region"] == hypotheses[kind].digest() and result["config"]["hypothesis"] == kind
