"""Equal recall and equal caution: curves of known states, and effects that were put in."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from replication.evidence.measures import Labelled, classification
from replication.evidence.predictions import FAILS, HOLDS, OPEN
from replication.studies.alternatives import learn_hypothesis
from replication.studies.caution import (
    BESIDE,
    CELL,
    NOTHING,
    RECALLS,
    SLOPE,
    SVM,
    at_recall,
    at_recall_differences,
    effects,
    fitted,
    judge,
    learners,
    predicted,
    scored,
    sentences,
)
from replication.studies.designs import THRESHOLDS
from srlrepro.samplers import generate
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError

SMALL = Config().with_values(k=100, random_rollouts=200)


def test_at_a_recall_the_false_positives_are_those_of_the_line_between_corners() -> None:
    """Safe states score 1, 2, 3, 4, unsafe ones 0, 0, 2.5, 2.5: half of the safe ones, then both of 2.5."""
    labels, safety = np.array([1, 1, 1, 1, 0, 0, 0, 0]), np.array([1, 2, 3, 4, 0, 0, 2.5, 2.5])
    assert at_recall(labels, safety) == {0.5: 0.5, 0.8: 0.5}
    assert at_recall(labels, -safety) == {0.5: 1.0, 0.8: 1.0}
    assert at_recall(labels, np.zeros(8)) == pytest.approx({r: r for r in RECALLS})  # says nothing


def test_curves_are_what_each_hypothesis_says_at_each_threshold() -> None:
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, (300, 6)) * SMALL.paper.state_max
    states: dict[tuple[float, int], Labelled] = {(4.0, 3): (x, (x[:, 0] > 0).astype(np.int64))}
    curves, equal = scored(states, SMALL, ["0.5"])
    assert len(equal) == 2 * len(RECALLS) and set(curves["dataset"]) == {3}
    data = generate(0.5, SMALL, 3)
    for kind, p_t in product(("tsne", "svm"), THRESHOLDS):
        h = learn_hypothesis(data, SMALL.with_values(hypothesis=kind, p_t=p_t), 3)
        found = classification(h, *states[4.0, 3])
        (row,) = curves[(curves["hypothesis"] == kind) & (curves["p_t"] == p_t)].to_dict("records")
        assert row["caution"] == pytest.approx(1 - found["accepted"])
        assert row["true_positives"] == pytest.approx(found["recall"])
        assert row["false_positives"] == pytest.approx(found["false_positives"] / (1 - found["safe"]))
    for _, own in curves.groupby("hypothesis"):
        assert own["caution"].is_monotonic_increasing and own["true_positives"].is_monotonic_decreasing


def cells(shift: float = 0.7, noise: float = 0.0, datasets: int = 3) -> pd.DataFrame:
    """Learners whose outcomes follow the model: −1 per ln of caution, α ``shift``, and 0.3 for the SVM."""
    rng, rows = np.random.default_rng(1), []
    for alpha, kind, delta, dataset, p_t in product(
        ("0", "0.5", "1"), ("tsne", "svm"), (1.1, 4.0), range(datasets), THRESHOLDS
    ):
        caution = p_t * (0.3 + 0.1 * float(alpha)) * (1.2 if kind == "svm" else 1.0)
        value = 5 + dataset - np.log(caution) + shift * float(alpha) + 0.3 * (kind == "svm")
        value += noise * rng.normal()
        rows.append((kind, alpha, delta, dataset, p_t, caution, value, *[value] * len(BESIDE)))
    return pd.DataFrame(rows, columns=[*CELL, "p_t", "caution", "log_violations", *BESIDE])


def test_effects_that_were_put_in_are_found() -> None:
    """A dataset's own level is no effect."""
    found = effects(cells()).set_index(["delta", "outcome", "effect"]).sort_index()
    for delta, outcome in product((1.1, 4.0), ("log_violations", "success_log_odds", "policy_alone_share")):
        own = found.loc[delta, outcome]
        assert own["estimate"].to_dict() == pytest.approx({SLOPE: -1, "0.5": 0.35, "1": 0.7, SVM: 0.3})
        assert own["datasets"].eq(3).all() and (own["high"] - own["low"]).max() < 1e-9
    states = {SLOPE: "", "0.5": NOTHING, "1": "matters", SVM: NOTHING}
    assert found.loc[(1.1, "log_violations"), "state"].to_dict() == states
    assert found.loc[(4.0, "policy_alone_share", "0.5"), "state"] == "matters"


def test_an_effect_that_is_not_there_is_seldom_found() -> None:
    """Of 2 Δ × 3 outcomes with noise, the interval of α = 1 holds 0."""
    found = effects(cells(shift=0.0, noise=0.2))
    own = found[found["effect"] == "1"]
    assert ((own["low"] < 0) & (own["high"] > 0)).sum() >= 5


NAN = float("nan")


@pytest.mark.parametrize(
    ("low", "high", "state"),
    [
        (-0.2, 0.3, NOTHING),
        (0.1, 0.3, NOTHING),
        (0.1, 0.9, "matters"),
        (-0.9, -0.1, "matters"),
        (-0.9, 0.1, "open"),
        (NAN, NAN, "open"),
    ],
)
def test_what_lies_within_the_bound_is_practically_nothing(low: float, high: float, state: str) -> None:
    assert judge(low, high, 0.5) == state


def test_without_learners_that_were_equally_cautious_there_is_no_effect() -> None:
    one = cells(datasets=1)[lambda t: t["delta"] == 1.1]
    assert set(fitted(one, "log_violations")) == {SLOPE, "0.5", "1", SVM}
    apart = one.assign(caution=one["caution"].where(one["alpha"] != "1", one["caution"] * 1e3))
    assert set(fitted(apart, "log_violations")) == {SLOPE, "0.5", SVM}
    assert fitted(one[one["hypothesis"] == "tsne"], "log_violations") == {}
    assert fitted(one[:4], "log_violations") == {}
    assert np.isnan(effects(one)["low"]).all()


def test_learners_have_the_caution_of_their_hypothesis() -> None:
    curves = pd.DataFrame([("svm", a, 1.1, 2, p, 0.0, 0.0, p / 2) for a in ("0", "1") for p in (0.5, 0.8)])
    curves.columns = [*CELL, "p_t", "true_positives", "false_positives", "caution"]  # type: ignore[assignment]
    values = {"failures": 3.0, "falls": 1.0, "policy_alone_share": 0.4, "violations_per_1000_steps": 8.0}
    rows = [(m, a, d, 2, v, "svm", 0.8, 2) for m, v in values.items() for a in ("1", "none") for d in (1.1,)]
    rows += [("safe_share", "1", np.nan, 2, 0.5, "svm", 0.8, 2)]
    columns = ["measure", "alpha", "delta", "seed", "value", "hypothesis", "threshold", "dataset"]
    (row,) = learners(pd.DataFrame(rows, columns=columns), curves).to_dict("records")
    assert row["caution"] == 0.4 and row["log_violations"] == pytest.approx(np.log(4.5))
    assert row["violations_per_1000_steps"] == 8 and np.isnan(row["success_log_odds"])
    with pytest.raises(ParameterError, match="curves"):
        learners(pd.DataFrame(rows, columns=columns), curves[curves["alpha"] == "0"])


def test_the_answer_tells_every_effect() -> None:
    every = product(("tsne", "svm"), ("0", "1"), (1.1, 4.0), (0,), RECALLS, (0.25,))
    equal = pd.DataFrame(every, columns=[*CELL, "recall", "false_positives"])
    said = sentences(equal, effects(cells()))
    rates = "0.250 at α = 0, 0.250 at α = 1"
    assert said[1] == f"Δ = 1.1: at a recall of 0.8, tsne accepts {rates} of the unsafe states."
    assert len(said) == 4 + 6 and "e times the caution -1.00 [-1.00, -1.00]; α" in said[4]
    assert "α = 1 +0.70 [0.70, 0.70], matters; SVM +0.30 [0.30, 0.30]" in said[4]


def rates(region: float, of_alpha: float, svm: float, spread: float = 0.0) -> pd.DataFrame:
    """False positives at equal recall: of the region, what α = 1 adds, and what the SVM adds.

    Every dataset has a level of its own; spread is that of the differences between datasets.
    """
    rows = []
    for kind, alpha, d, recall in product(("tsne", "svm"), ("0", "1"), range(3), RECALLS):
        value = region + d / 100 + of_alpha * (alpha == "1") + svm * (kind == "svm")
        value += spread * (d - 1) * (kind == "svm" or alpha == "1")
        rows.append((kind, alpha, 1.1, d, recall, value))
    return pd.DataFrame(rows, columns=[*CELL, "recall", "false_positives"])


def test_differences_at_equal_recall_are_taken_within_datasets() -> None:
    """What all hypotheses of a dataset share is no difference; each is one by `scipy`'s t-interval."""
    exact = at_recall_differences(rates(0.4, 0.1, -0.2)).set_index("what")
    assert exact["estimate"].to_dict() == pytest.approx({"α = 1 − α = 0": 0.1, "SVM − region": -0.2})
    assert exact["datasets"].eq(3).all() and (exact["high"] - exact["low"]).max() < 1e-9
    found = at_recall_differences(rates(0.4, 0.1, -0.2, spread=0.05)).set_index("what")
    low, high = stats.t.interval(0.95, 2, 0.1, 0.05 / np.sqrt(3))
    assert found.loc["α = 1 − α = 0", ["low", "high"]].tolist() == pytest.approx([low, high])


def test_predictions_are_judged_at_each_delta() -> None:
    found = effects(cells())
    told = dict(predicted(rates(0.4, 0.1, -0.2), found))
    states = [list(own.values()) for own in told.values()]
    assert states == [[HOLDS], [HOLDS], [HOLDS] * 2, [FAILS] * 2, [FAILS] * 2]
    assert list(told)[2:4] == [
        f"at equal caution α = {a} changes violations by less than a factor of two" for a in ("0.5", "1")
    ]
    told = dict(predicted(rates(0.4, -0.1, 0.0, spread=0.05), found))
    assert [list(states.values()) for states in told.values()][:2] == [[OPEN], [OPEN]]
