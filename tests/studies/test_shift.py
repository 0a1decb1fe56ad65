"""Data that move: distances of known distributions, what is measured of a universe, and contrasts."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import ttest_ind

from replication.evidence.measures import classification, labelled, write_measures
from replication.evidence.predictions import FAILS, HOLDS, OPEN
from replication.evidence.results import read_run
from replication.studies.designs import gather
from replication.studies.shift import agreement, contrasts, distance, measure_universes, predicted, sentences
from replication.studies.universe import Universe, conditions, keep, train_cells
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.settings.config import Config
from srlrepro.storage.files import write_table

SMALL = Config().with_values(
    k=100, random_rollouts=200, n_steps=64, n_minibatches=4, n_epochs=1, hidden_width=8, visited_states=64
)
NAMES = {"variant_as-written__dataset_0": ("0", "none"), "variant_weighted-ud__dataset_0": ("1",)}


def test_the_distance_is_zero_of_one_law_and_one_of_two_that_do_not_meet() -> None:
    rng = np.random.default_rng(0)
    x, same, other = rng.normal(size=(400, 2)), rng.normal(size=(900, 2)), rng.normal(10, 1, size=(900, 2))
    assert abs(distance(same, x)) < 0.15 and distance(other, x) > 0.98


@pytest.fixture(scope="module")
def universes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A universe with the data as written and a free learner, and one with weighted UD."""
    place = tmp_path_factory.mktemp("shift")
    for name, alphas in NAMES.items():
        values = {"gamma_weights": "density ratio"} if "1" in alphas else {}
        universe = Universe(SMALL.with_values(**values), alphas, (4.0,), (0,), 0, 256)
        learned = universe.learn_hypotheses(place / name)
        keep(learned, place / name)
        write_measures(place / name / "measures.csv", train_cells(universe, learned, place / name))
        write_table(place / name / "conditions.csv", conditions(universe, learned))
    return {name: place / name for name in NAMES}


def test_a_universe_is_measured_from_what_it_has_kept(universes: dict[str, Path]) -> None:
    measures, _ = gather(universes)
    found = measure_universes(universes, measures)
    table = found.pivot_table(index="measure", columns="variant", values="value")
    assert set(found["delta"]) == {4.0} and list(found) == ["variant", "delta", "dataset", "measure", "value"]
    written, weighted = table["as-written"], table["weighted-ud"]
    assert (
        written["effective_states"] == SMALL.paper.k and 1 <= weighted["effective_states"] < SMALL.paper.k / 2
    )
    free = read_run(universes[next(iter(NAMES))] / "runs" / "alpha_none__delta_4__seed_0")
    region = Universe(SMALL, ("0",), (4.0,), (0,), 0, 256).learn_hypotheses(Path("nowhere"))["0"][1]
    scores = classification(region, *labelled(free.visited(), ClosedLoop.from_config(SMALL, 4.0), 256))
    assert written["free_error"] == scores["error"]
    assert written["free_false_positives"] == scores["false_positives"]
    own = measures[(measures["variant"] == "weighted-ud") & (measures["measure"] == "final_return")]
    assert weighted["final_return"] == own["value"].item()
    x = read_run(universes[next(iter(NAMES))] / "runs" / "alpha_0__delta_4__seed_0").visited()
    assert written["outside"] == (np.abs(x) > SMALL.paper.state_max).any(axis=1).mean()


def test_contrasts_are_differences_of_means_by_variant() -> None:
    rng = np.random.default_rng(2)
    values = {
        "as-written": rng.normal(size=5),
        "refitted": rng.normal(1, 3, size=4),
        "weighted-ud": np.array([2.0]),
    }
    rows = [(v, 4.0, d, "free_error", x) for v, xs in values.items() for d, x in enumerate(xs)]
    table = pd.DataFrame(rows, columns=["variant", "delta", "dataset", "measure", "value"])
    found = contrasts(table).set_index("variant")
    assert found.index.tolist() == ["refitted", "weighted-ud"] and found["n"].tolist() == [4, 1]
    refitted = found.loc["refitted"]
    assert refitted["difference"] == pytest.approx(values["refitted"].mean() - values["as-written"].mean())
    interval = ttest_ind(values["refitted"], values["as-written"], equal_var=False).confidence_interval(0.95)
    assert (refitted["low"], refitted["high"]) == pytest.approx((interval.low, interval.high))
    assert np.isnan(found.loc["weighted-ud", "low"])
    said = sentences(contrasts(table))
    assert len(said) == 2 and said[0].startswith("refitted against as-written, Δ = 4: free error ")


def test_predictions_name_the_least_and_the_nearer() -> None:
    """At Δ = 4 another variant is nearer to D than the refitted one, which then is not the nearest."""
    index = ["variant", "measure", "delta", "mean", "written", "difference", "low", "high"]
    rows = [
        ("refitted", "distance", 1.1, 0.2, 0.5, -0.3, -0.4, -0.2),
        ("learners-law", "distance", 1.1, 0.4, 0.5, -0.1, -0.3, 0.1),
        ("refitted", "distance", 4.0, 0.3, 0.5, -0.2, -0.3, -0.1),
        ("learners-law", "distance", 4.0, 0.2, 0.5, -0.3, -0.4, -0.2),
        ("refitted", "free_error", 1.1, 0.1, 0.3, -0.2, -0.3, 0.1),
        ("weighted-ud", "free_error", 1.1, 0.2, 0.3, -0.1, -0.2, -0.05),
        ("refitted", "violations_per_1000_steps", 1.1, 1.0, 2.0, -1.0, -2.0, 0.0),
        ("weighted-ud", "violations_per_1000_steps", 1.1, 3.0, 2.0, 1.0, -2.0, 4.0),
    ]
    found = pd.DataFrame(rows, columns=index)
    told = dict(predicted(found))
    assert told["refitted is nearest to D"] == {"Δ = 1.1": HOLDS, "Δ = 4": FAILS}
    assert told["refitted has the smallest error on free states"] == {"Δ = 1.1": OPEN}
    assert told["learners-law is nearer to D than the data as written"] == {"Δ = 1.1": OPEN, "Δ = 4": HOLDS}
    assert told["weighted-ud does not help: its error there is larger"] == {"Δ = 1.1": FAILS}
    assert agreement(found) == (1, 2)
