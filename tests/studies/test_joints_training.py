"""Learners of more joints: contrasts that were put in, matched recall, caution of what was trained."""

import json
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from replication.evidence.measures import measure_regions, write_measures
from replication.evidence.predictions import FAILS, HOLDS, OPEN
from replication.evidence.results import read_run
from replication.studies import designs
from replication.studies.designs import gather, learners_of, tells
from replication.studies.joints.cells import learners_states
from replication.studies.joints.chains import controlled, data_of, learning, normal, training_data
from replication.studies.joints.training import (
    CELL,
    CONTRASTS,
    OUTCOMES,
    Prediction,
    beside_chance,
    best_of_whole,
    choice_sentence,
    contrasts,
    differences,
    held,
    judged,
    learners,
    load_predictions,
    sentences,
)
from replication.studies.universe import Universe, conditions, keep, train_cells, visits
from srlrepro.samplers import generate
from srlrepro.settings.fields import ParameterError
from srlrepro.storage.files import ResultError, write_table

TINY = {
    "k": 100,
    "random_rollouts": 200,
    "n_steps": 64,
    "n_minibatches": 4,
    "n_epochs": 1,
    "hidden_width": 8,
    "visited_states": 64,
    "gamma_cells": 128,
}


def planted(datasets: int = 3) -> pd.DataFrame:
    """Under the map the return is 0.1 less, at n = 5 more, and with UD 0.2 more; free learners have 0.5.

    All else is 0. Datasets differ by as much in all learners, which cancels.
    """
    rows = []
    of = [("tsne", "0"), ("tsne", "1"), ("svm", "0"), ("svm", "1"), ("none", "none")]
    for n, (kind, alpha), delta, d in product((2, 3, 5), of, (1.1, 4.0), range(datasets)):
        value = 0.5 + 0.03 * d + 0.002 * (d == 1) * (kind == "tsne")
        value += {"tsne": -0.1 if n < 5 else 0.1}.get(kind, 0.0) + {"1": 0.2}.get(alpha, 0.0)
        rows.append((n, kind, alpha, delta, d, 0.9, 10.0, value, *[0.0] * (len(OUTCOMES) - 1)))
    return pd.DataFrame(rows, columns=[*CELL, "p_t", "activations", *OUTCOMES])


def test_differences_are_taken_within_a_dataset_and_what_holds_at_three_is_compared() -> None:
    found = contrasts(planted()).set_index(["contrast", "outcome", "links", "delta"]).sort_index()
    assert len(found) == ((len(CONTRASTS) - 1) * len(OUTCOMES) + 2) * 3 * 2
    of_map = found.loc["map − whole state", "return_share"]
    assert of_map["estimate"].to_numpy() == pytest.approx([-0.1 + 0.002 / 3] * 4 + [0.1 + 0.002 / 3] * 2)
    assert of_map["sign"].tolist() == ["less"] * 4 + ["more"] * 2 and set(of_map["datasets"]) == {3}
    alpha = found.loc["α = 1 − α = 0, map", "return_share"]
    assert alpha["estimate"].to_numpy() == pytest.approx([0.2] * 6) and set(alpha["sign"]) == {"more"}
    free = found.loc["map − free learner", "return_share"]
    assert free["estimate"].to_numpy() == pytest.approx([0.002 / 3] * 4 + [0.2 + 0.002 / 3] * 2)
    table = contrasts(planted())
    assert held(table) == (
        "Of the 34 contrasts at n = 3, 6 are decided. With fewer or more joints the sign is the same in "
        "10 of 12 cases, the opposite in 2, and open in 0."
    )
    assert beside_chance(table) == (
        "Over all n, between supervised learners 18 of 90 contrasts are decided, 4.5 would be by chance; "
        "against a free one 2 of 12 contrasts are decided, 0.6 would be by chance."
    )
    first = sentences(table)[0]
    assert "final return, share of a perfect one: more at n = 5, less at n = 2–3" in first
    assert first.startswith("Δ = 1.1, map − whole state: ") and "open at every n: share of K's" in first


def test_what_one_side_lacks_is_left_out_of_both() -> None:
    """Without α = 1 under the map, it is compared at α = 0 alone; without a side there is no difference."""
    runs = planted()
    lacking = runs[~((runs["hypothesis"] == "tsne") & (runs["alpha"] == "1") & (runs["dataset"] == 0))]
    found = differences(lacking, "map − whole state", "return_share")
    assert found.loc[(found["links"] == 2) & (found["dataset"] == 0), "value"].to_numpy() == pytest.approx(
        -0.1
    )
    assert set(differences(lacking, "α = 1 − α = 0, map", "return_share")["dataset"]) == {1, 2}
    assert contrasts(runs[runs["dataset"] == 0])["low"].isna().all()


@pytest.mark.parametrize(
    ("links", "than", "expected", "bound", "state"),
    [
        ((2, 3), (), "below", 0.0, HOLDS),
        ((2, 3), (), "within", 0.05, FAILS),
        ((5,), (2,), "above", 0.19, HOLDS),
        ((4,), (), "above", 0.0, OPEN),
    ],
)
def test_a_prediction_is_judged_by_its_interval(
    links: tuple[int, ...], than: tuple[int, ...], expected: str, bound: float, state: str
) -> None:
    p = Prediction("id", "words", "map − whole state", "return_share", 4.0, links, expected, bound, than)
    (row,) = judged(planted(), [p]).to_dict("records")
    assert row["state"] == state and row["datasets"] == (0 if 4 in links else 3)


def test_the_predictions_are_of_runs_that_the_study_has() -> None:
    known = load_predictions()
    assert len({p.id for p in known}) == len(known) == 8
    assert {n for p in known for n in (*p.links, *p.than)} <= set(designs.LINKS)
    assert {p.delta for p in known} == {1.1, 4.0}
    with pytest.raises(ParameterError, match="outcome = speed"):
        replace(known[0], outcome="speed")
    with pytest.raises(ParameterError, match="contrast = all"):
        replace(known[0], contrast="all")


def test_another_best_of_the_whole_state_is_said_in_words() -> None:
    rows = [
        (n, k, a, d, "visits", 1.1, 0.2, 0.1 if n == 5 else 0.3)
        for n, k, a, d in product((2, 5), (250, 1000, 4000), ("0", "0.5", "1"), (0, 1))
    ]
    columns = ["links", "k", "alpha", "dataset", "law", "delta", "svm", "boosting"]
    recall = pd.DataFrame(rows, columns=columns)
    best = best_of_whole(recall, (2, 5))
    assert best["best"].tolist() == ["svm", "boosting"] and "gradient boosting at n = 5." in choice_sentence(
        best
    )
    assert "is the best of the whole state at n = 2." in choice_sentence(best_of_whole(recall, (2,)))
    assert choice_sentence(best_of_whole(recall, (7,))).startswith("No cells tell")


def test_data_of_more_joints_are_those_of_the_cells_and_up_to_three_those_of_the_grid() -> None:
    three, four = (controlled(n).with_values(k=40, random_rollouts=200) for n in (3, 4))
    assert np.array_equal(data_of(0.5, three, 2).x, generate(0.5, three, 2).x)
    assert np.array_equal(data_of(0.5, four, 2).x, training_data(0.5, four, 2, normal(four, 2)).x)
    assert learning(3) == controlled(3) and learning(2) == controlled(2)
    assert learning(5).choices.action_unit == pytest.approx(100 * 0.6**3)
    assert learning(5).with_values(action_unit=100.0) == controlled(5)


@pytest.fixture(scope="module", params=[2, 5])
def trained(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Universes of two or five joints with short runs, under both hypotheses; their folders by their ids."""
    place, folders = tmp_path_factory.mktemp("joints"), {}
    for kind in ("tsne", "svm"):
        config = learning(request.param).with_values(**TINY, hypothesis=kind)
        alphas = ("0", "none") if kind == "tsne" else ("0",)
        universe = Universe(config, alphas, (1.1, 4.0), (0,), 0, 256, recall=0.8)
        folder = place / f"links_{request.param}__hypothesis_{kind}__dataset_0"
        if request.param == 5 and kind == "svm":  # so few states of the MND hold too few unsafe ones
            universe = replace(universe, alphas=("1",))
        learned = universe.learn_hypotheses(folder)
        keep(learned, folder)
        write_table(folder / "conditions.csv", conditions(universe, learned))
        rows = measure_regions(learned, config, 0) + train_cells(universe, learned, folder)
        write_measures(folder / "measures.csv", rows)
        x, z = visits(universe)
        for alpha, (_, h) in learned.items():
            reached = float(h.predict(x[z == 1]).mean())
            assert reached == pytest.approx(0.8, abs=0.02), (kind, alpha)
        folders[folder.name] = folder
    return folders


@pytest.mark.slow
def test_every_learner_has_the_threshold_of_its_recall_in_its_record(trained: dict[str, Path]) -> None:
    """And the caution of its hypothesis on the free learner's states, which are a law of test states."""
    runs = learners(trained, gather(trained)[0])
    supervised = runs[runs["hypothesis"] != "none"]
    assert len(runs) == 2 * 3 and supervised["caution"].between(0, 1).all()
    assert runs.loc[runs["hypothesis"] == "none", ["p_t", "caution", "failure_rate"]].isna().all(axis=None)
    n = int(runs["links"].iloc[0])
    met = gather(trained)[1].set_index(["hypothesis", "condition"])
    for row in supervised.itertuples():
        folder = trained[f"links_{n}__hypothesis_{row.hypothesis}__dataset_0"]
        run = read_run(folder / "runs" / f"alpha_{row.alpha}__delta_{row.delta:g}__seed_0")
        assert run.config.paper.p_t == row.p_t != 0.8
        assert met.loc[(row.hypothesis, f"p_t of α = {row.alpha}"), "value"] == pytest.approx(row.p_t)
        assert met.loc[(row.hypothesis, f"the recall of α = {row.alpha} is 0.8"), "met"]
    free = trained[learners_of(f"links_{n}__dataset_0")]
    states = learners_states(free, 0, 40)
    visited = [read_run(free / "runs" / f"alpha_none__delta_{d:g}__seed_0").visited() for d in (1.1, 4.0)]
    assert states.shape == (40, 2 * n)
    for half, of in zip((states[:20], states[20:]), visited, strict=True):
        assert {x.tobytes() for x in half} <= {x.tobytes() for x in of}


@pytest.mark.slow
def test_a_hypothesis_that_did_not_supervise_a_run_is_refused(
    trained: dict[str, Path], tmp_path: Path
) -> None:
    name = next(name for name in trained if tells(name)["hypothesis"] == "svm")
    (record,) = sorted(trained[name].glob("runs/alpha_*__delta_4__seed_0/run.json"))
    before = record.read_text()
    record.write_text(json.dumps(json.loads(before) | {"region": "another"}))
    with pytest.raises(ResultError, match="does not hold what supervised"):
        learners(trained, gather(trained)[0])
    record.write_text(before)


def test_a_recall_that_cannot_be_is_refused() -> None:
    universe = Universe(learning(2).with_values(**TINY), ("0",), (1.1,), (0,), 0, 256, recall=1.0)
    with pytest.raises(ParameterError, match="recall = 1"):
        universe.learn_hypotheses(Path("nowhere"))
