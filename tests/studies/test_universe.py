"""One universe: its conditions, its measures, and cells that are not trained twice."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from replication.evidence.claims import load_claims
from replication.evidence.measures import Row, classification, labelled, measure_regions
from replication.evidence.results import read_run
from replication.studies import universe as module
from replication.studies.universe import (
    Learned,
    Universe,
    conditions,
    keep,
    possible,
    train_cells,
)
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.region.safe_region import SafeRegion
from srlrepro.samplers import TrainingData
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError
from srlrepro.storage.files import ResultError

SMALL = Config().with_values(
    k=100, random_rollouts=200, n_steps=64, n_minibatches=4, n_epochs=1, hidden_width=8, visited_states=64
)
UNIVERSE = Universe(SMALL, ("0", "none"), (1.1, 4.0), (0,), 0, 512)
NOWHERE = Path("nowhere")  # nothing is written without a refit


@pytest.fixture(scope="module")
def learned() -> Learned:
    return UNIVERSE.learn_hypotheses(NOWHERE)


@pytest.fixture(scope="module")
def trained(learned: Learned, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, pd.DataFrame]:
    folder = tmp_path_factory.mktemp("universe")
    return folder, table(train_cells(UNIVERSE, learned, folder))


def table(rows: list[Row]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=["measure", "alpha", "delta", "seed", "value"])


def test_runs_are_the_grid_with_the_free_learner_first() -> None:
    runs = replace(UNIVERSE, alphas=("0", "0.5", "none"), seeds=(0, 1)).runs
    assert [r.alpha for r in runs[:4]] == [None] * 4 and len({r.name for r in runs}) == len(runs) == 12
    assert all(r.steps == UNIVERSE.steps for r in runs)


def test_the_default_meets_the_papers_conditions(learned: Learned) -> None:
    met = conditions(UNIVERSE, learned)
    assert len(met) == len(UNIVERSE.deltas) + 2 * len(learned) + 1 and met["met"].all()


@pytest.mark.parametrize(
    ("values", "broken", "left"),
    [
        ({"lqr_angle_weight": 1.0}, "upright is stable under K at Δ = 4", ()),
        ({"p_t": 0.999}, "accepts the origin", ("none",)),
    ],
)
def test_violated_conditions_are_named(
    values: dict[str, float], broken: str, left: tuple[str, ...], learned: Learned
) -> None:
    """With Q = I upright is lost at Δ = 4; no region promises the origin a safety of 0.999.

    The first concerns the whole universe, the second one α, so that the free learner is left.
    """
    met = conditions(replace(UNIVERSE, config=SMALL.with_values(**values)), learned)
    (name,) = met.loc[~met["met"], "condition"]
    assert broken in name
    assert possible(UNIVERSE, met).alphas == left


def test_every_cell_is_measured(trained: tuple[Path, pd.DataFrame]) -> None:
    found = trained[1].set_index(["measure", "alpha", "delta"])["value"]
    for delta in UNIVERSE.deltas:
        assert found["activations", "none", delta] == 0
        assert ("generalization_error", "0", delta) in found and (
            "generalization_error",
            "none",
            delta,
        ) not in found
        assert found["policy_return_share", "0", delta] <= 1
    assert not list((trained[0] / "checkpoints").glob("*"))


def test_a_universe_measures_what_the_claims_are_tested_on(
    learned: Learned, trained: tuple[Path, pd.DataFrame]
) -> None:
    regions = {row[0] for row in measure_regions(learned, SMALL, 0)}
    assert {claim.measure for claim in load_claims()} <= regions | set(trained[1]["measure"])


def test_common_errors_are_of_the_free_run_with_the_same_mismatch(
    trained: tuple[Path, pd.DataFrame], learned: Learned
) -> None:
    folder, rows = trained
    found = rows.set_index(["measure", "alpha", "delta"])["value"]
    for run in UNIVERSE.runs[: len(UNIVERSE.deltas)]:
        visited, real = (
            read_run(folder / "runs" / run.name).visited(),
            ClosedLoop.from_config(SMALL, run.delta),
        )
        scores = classification(learned["0"][1], *labelled(visited, real, run.steps))
        assert found["common_error", "0", run.delta] == scores["error"]
        assert found["common_false_positives", "0", run.delta] == scores["false_positives"]


def test_runs_that_are_finished_elsewhere_are_copied(
    trained: tuple[Path, pd.DataFrame], learned: Learned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of another universe with the same values; of other steps, none fits, and all are trained."""
    elsewhere, before = trained
    again: list[str] = []
    monkeypatch.setattr(module, "train", lambda run, *rest: again.append(run.name))
    same = replace(UNIVERSE, finished=(NOWHERE, elsewhere / "runs"))
    assert table(train_cells(same, learned, tmp_path)).equals(before) and again == []
    for run in UNIVERSE.runs:
        names = sorted(path.name for path in (elsewhere / "runs" / run.name).iterdir())
        copies = [tmp_path / "runs" / run.name / name for name in names]
        assert [copy.read_bytes() for copy in copies] == [
            (elsewhere / "runs" / run.name / name).read_bytes() for name in names
        ]
    with pytest.raises(ResultError, match="missing"):  # nothing was trained in truth
        train_cells(replace(same, steps=1024), learned, tmp_path / "longer")
    assert again == [UNIVERSE.runs[0].name]


def test_finished_cells_are_read_and_others_trained(
    trained: tuple[Path, pd.DataFrame], learned: Learned, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Other values, other code, or a missing run.json: the cell is trained again."""
    folder, before = trained
    again: list[str] = []
    original = module.train

    def train(run, *rest):  # type: ignore[no-untyped-def]
        again.append(run.name)
        return original(run, *rest)

    monkeypatch.setattr(module, "train", train)
    assert table(train_cells(UNIVERSE, learned, folder)).equals(before) and again == []
    names = [run.name for run in UNIVERSE.runs]
    (folder / "runs" / names[0] / "run.json").unlink()
    changed = json.loads((folder / "runs" / names[1] / "run.json").read_text())
    changed["provenance"]["code"] = "other"
    (folder / "runs" / names[1] / "run.json").write_text(json.dumps(changed))
    assert table(train_cells(UNIVERSE, learned, folder)).equals(before) and again == names[:2]
    other = replace(UNIVERSE, config=SMALL.with_values(clip_range=0.1))
    train_cells(other, learned, folder)
    assert again[2:] == names


def test_an_oracle_knows_the_system_of_its_cell(tmp_path: Path) -> None:
    """The ideal supervisor stops where K fails on the real system, so that no activation succeeds."""
    config = SMALL.with_values(hypothesis="real", n_steps=256, log_std_init=1.0)
    ideal = Universe(config, ("1",), (4.0,), (0,), 0, 512)
    found = table(train_cells(ideal, ideal.learn_hypotheses(NOWHERE), tmp_path)).set_index("measure")["value"]
    assert found["activations"] > 0 and found["success_rate"] == 0 and found["generalization_error"] == 0


def test_a_refitted_normal_distribution_is_that_of_what_the_learner_visits(tmp_path: Path) -> None:
    """Its mean and covariance are those of the visited states; data and regions are kept, and found again."""
    one = replace(UNIVERSE, alphas=("0",), deltas=(4.0,), refit_steps=256)
    found = one.learn_hypotheses(tmp_path)
    data, region = found["0"]
    visited = read_run(tmp_path / "first" / "runs" / "alpha_0__delta_4__seed_0").visited()
    assert data.mnd.mean == pytest.approx(visited.mean(axis=0))
    assert data.mnd.covariance == pytest.approx(np.cov(visited.T))
    assert data.n_ud == 0 and len(data.x) == SMALL.paper.k and data.made_of is None
    assert (data.z == ClosedLoop.from_config(SMALL).predict(data.x)).all()
    keep(found, tmp_path)
    assert TrainingData.load(tmp_path / "alpha_0" / "training_data.npz").x.tolist() == data.x.tolist()
    assert SafeRegion.load(tmp_path / "alpha_0" / "region.npz").digest() == region.digest()
    again = one.learn_hypotheses(tmp_path)["0"][1]
    assert again.digest() == region.digest() != UNIVERSE.learn_hypotheses(NOWHERE)["0"][1].digest()
    assert not any("correlate" in name for name in conditions(one, found)["condition"])


def test_a_refit_is_of_one_mismatch_and_under_a_region_that_can_guard(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="refit_steps = 256"):
        replace(UNIVERSE, refit_steps=256).learn_hypotheses(tmp_path)
    denying = replace(UNIVERSE, config=SMALL.with_values(p_t=0.999), deltas=(4.0,), refit_steps=256)
    found = denying.learn_hypotheses(tmp_path)
    assert not conditions(denying, found)["met"].all() and not list(tmp_path.iterdir())
