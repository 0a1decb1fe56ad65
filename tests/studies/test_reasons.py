"""The measurements behind the choices."""

import numpy as np
import pytest

from replication.evidence.measures import classification
from replication.studies.reasons import (
    PRIORS,
    calibration,
    exploration,
    integration,
    mappings,
    origin_safety,
    random_policies,
    recoveries,
    stability,
)
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.region.safe_region import learn_region
from srlrepro.samplers import generate
from srlrepro.settings.config import Config

CONFIG = Config().with_values(k=80, random_rollouts=300)


def test_more_substeps_agree_more_with_a_fine_integration() -> None:
    table = integration(CONFIG, [1, CONFIG.choices.substeps, 96], 500, seed=0)
    shares = table["equal labels"].to_numpy()
    assert shares[2] == 1.0 and shares[1] > 0.99 and shares[0] < shares[1]


def test_the_defaults_keep_every_system_stable_and_a_soft_k_does_not() -> None:
    table = stability(CONFIG, [1.0, 4.0], [{}, {"lqr_angle_weight": 1.0, "lqr_torque_weight": 1.0}])
    assert table["variation"].tolist() == ["default", "lqr_angle_weight = 1.0, lqr_torque_weight = 1.0"]
    assert (table.loc[0, ["Δ = 1", "Δ = 4"]] < 1).all() and table.loc[1, "Δ = 4"] > 1


def test_recoveries_end_before_the_horizon_and_below_the_bound() -> None:
    table = recoveries(CONFIG, [1.0, 4.0], 300, seed=0)
    assert (table["slowest / s"] < CONFIG.choices.recovery_horizon).all()
    assert (table["largest rate / (rad/s)"] < CONFIG.choices.rate_bound).all()
    assert table["recovered"].is_monotonic_decreasing


def test_a_torque_held_longer_makes_less_of_the_mnd_safe() -> None:
    table = random_policies(CONFIG, [0.01, 0.5], 1000, seed=0)
    assert table["safe share"][0] > table["safe share"][1] and (table["correlation"] > 0).all()


def test_calibration_reuses_embeddings_without_changing_a_score() -> None:
    table = calibration(CONFIG, [1.0], [0], [{}, {"psi_penalty": 0.1}], 200, {}).set_index("variation")
    data, varied = generate(1.0, CONFIG, 0), CONFIG.with_values(psi_penalty=0.1)
    region = learn_region(data, varied, 0)
    x = np.random.default_rng([0, 2]).uniform(
        *(np.array(s) * CONFIG.paper.state_max for s in (-1, 1)), (200, 6)
    )
    brier = classification(region, x, ClosedLoop.from_config(CONFIG).predict(x))["brier"]
    assert table.loc["psi_penalty = 0.1", "α = 1"] == brier
    assert table.loc["default", "α = 1"] != brier


def test_mappings_have_the_gamma_that_is_best_for_them() -> None:
    """Two of them against regions whose cells are fine enough."""
    config = CONFIG.with_values(gamma_cells=1024)
    table = mappings(config, [1.0], [0], 300, {})
    assert table["mean"].is_monotonic_increasing and table["Ψ"].is_unique
    known = {"network of 32, penalty 0.1": {"psi_penalty": 0.1}}
    known["8 neighbours"] = {"psi": "neighbours", "psi_neighbours": 8}
    for name, values in known.items():
        (best,) = table[table["Ψ"] == name].to_dict("records")
        shape = {"gamma_bandwidth": best["bandwidth"], "gamma_prior": best["prior"]}
        (found,) = calibration(config, [1.0], [0], [values | shape], 300, {})["mean"]
        assert best["mean"] == pytest.approx(found, abs=1e-3)
        others = [values | shape | {"gamma_prior": prior} for prior in PRIORS]
        varied = calibration(config, [1.0], [0], others, 300, {})
        assert found <= varied.loc[varied["h(origin)"] == 1, "mean"].min() + 1e-3


def test_the_origin_is_asked_of_the_regions_and_what_is_embedded_is_taken_again() -> None:
    embeddings: dict[tuple[object, ...], np.ndarray] = {}
    calibration(CONFIG, [1.0], [0], [{}], 50, embeddings)
    (kept,) = embeddings.values()
    table = origin_safety(CONFIG, 1.0, [0], embeddings)
    assert len(embeddings) == 2 and next(iter(embeddings.values())) is kept
    for known, found in zip(table["known origin"], table["Γ(origin)"], strict=True):
        region = learn_region(generate(1.0, CONFIG, 0), CONFIG.with_values(known_origin=known), 0)
        assert region.safety(np.zeros((1, 6)))[0] == found


def test_a_quieter_policy_stays_longer_in_the_state_space() -> None:
    table = exploration(CONFIG, [0.0, -3.0], 1.1, trials=5, seed=0)
    assert table["states in App. C"][1] > table["states in App. C"][0]
