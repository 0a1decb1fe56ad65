"""The universes of the studies: which cells each has, and that no two of a study are the same."""

from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from plans import planned

from replication.evidence.claims import MEASURE_COLUMNS
from replication.studies.designs import (
    AS_WRITTEN,
    CALIBRATED,
    HYPOTHESES,
    REFITTED,
    THRESHOLDS,
    VARIANTS,
    WEIGHTED,
    Jobs,
    gather,
    learners_of,
    tells,
    universes,
)
from replication.studies.joints.chains import learning
from srlrepro.settings.config import Config
from srlrepro.storage.files import ResultError, write_table
from workflow.command_line import ALPHAS, STUDIES
from workflow.notebooks import check_parameters

ROOT = Path(__file__).parents[2]
SUPERVISED = ["0", "0.5", "1"]


def designed(study: str, few: bool = False) -> Jobs:
    _, deltas, seeds, _ = STUDIES[study]
    return universes(study, ALPHAS, deltas, list(range(seeds)), few)


def runs(jobs: Jobs) -> int:
    return sum(len(job["ALPHAS"]) * len(job["DELTAS"]) * len(job["SEEDS"]) for job in jobs.values())


@pytest.mark.parametrize("study", STUDIES)
@pytest.mark.parametrize("few", [False, True])
def test_universes_are_different_and_their_notebook_takes_them(study: str, few: bool) -> None:
    jobs = designed(study, few)
    notebook = ROOT / "notebooks" / "13_universe.ipynb"
    told = []
    for name, job in jobs.items():
        check_parameters(notebook, job)
        assert job["ID"] == name
        told.append(str(sorted((key, value) for key, value in job.items() if key != "ID")))
    assert len(set(told)) == len(jobs)
    assert planned(f"--{study}")["deltas"] == STUDIES[study].deltas


def test_calibrated_is_the_grid_with_a_dataset_for_each_learner() -> None:
    jobs = designed("calibrated")
    assert len(jobs) == 10 and runs(jobs) == 90
    for job in jobs.values():
        assert job["SEEDS"] == [job["DATA_SEED"]] and job["SETTINGS"] == CALIBRATED
        assert (job["ALPHAS"], job["DELTAS"]) == (SUPERVISED, [1.1, 1.5, 4.0])


def test_crossed_has_every_learner_on_every_dataset() -> None:
    jobs = designed("crossed")
    assert runs(jobs) == 4 * 4 * 3
    for job in jobs.values():
        assert (job["SEEDS"], job["DELTAS"], job["SETTINGS"]) == ([0, 1, 2, 3], [1.1], {})
    assert [job["DATA_SEED"] for job in jobs.values()] == [0, 1, 2, 3]


def test_caution_crosses_thresholds_with_hypotheses_and_has_one_free_learner_for_each_dataset() -> None:
    jobs = designed("caution")
    free = [name for name, job in jobs.items() if "none" in job["ALPHAS"]]
    assert len(jobs) == len(THRESHOLDS) * len(HYPOTHESES) * 3 and len(free) == 3
    assert runs(jobs) == 30 * 6 + 3 * 2
    for name, job in jobs.items():
        told = tells(name)
        assert job["SETTINGS"] == {"hypothesis": told["hypothesis"], "p_t": float(told["threshold"])}
        assert job["SEEDS"] == [job["DATA_SEED"]] == [int(told["dataset"])]
    papers = Config()
    assert all(papers.with_values(**jobs[name]["SETTINGS"]) == papers for name in free)


def test_shift_has_one_refitted_universe_for_each_mismatch() -> None:
    jobs = designed("shift")
    by_variant: dict[str, list[dict[str, Any]]] = {}
    for name, job in jobs.items():
        by_variant.setdefault(tells(name)["variant"], []).append(job)
    assert {name: len(of) for name, of in by_variant.items()} == dict.fromkeys(VARIANTS, 5) | {REFITTED: 10}
    assert all(job["REFIT_STEPS"] > 0 and len(job["DELTAS"]) == 1 for job in by_variant[REFITTED])
    assert all(job["ALPHAS"] == ["0", "none"] for job in by_variant[AS_WRITTEN])
    assert all(job["ALPHAS"] == ["1"] for job in by_variant[WEIGHTED])
    assert runs(jobs) == 5 * (4 + 2 + 2 + 2)


def test_joints_have_both_hypotheses_at_the_ends_of_alpha_and_a_free_learner_for_each_dataset() -> None:
    jobs = designed("joints")
    assert len(jobs) == 4 * 2 * 3 and runs(jobs) == 4 * 3 * 2 * (2 + 2 + 1)
    free = {name for name, job in jobs.items() if "none" in job["ALPHAS"]}
    assert free == {learners_of(f"links_{n}__dataset_{d}") for n, d in product((2, 3, 4, 5), range(3))}
    assert {job["RECALL"] for job in jobs.values()} == {0.8}
    assert jobs["links_3__hypothesis_svm__dataset_1"]["SETTINGS"] == {"hypothesis": "svm"}
    five = jobs["links_5__hypothesis_tsne__dataset_0"]["SETTINGS"]
    assert set(five) == {"links", "control_period", "lqr_angle_weight", "action_unit"}
    assert Config().with_values(**five) == learning(5)


def a_universe(folder: Path, value: float) -> Path:
    rows = [("safe_share", "0", None, 3, 0.5), ("activations", "0", 1.1, 3, value)]
    write_table(folder / "measures.csv", pd.DataFrame(rows, columns=list(MEASURE_COLUMNS)))
    met = [("0", "the region accepts the origin", 0.9, True)]
    write_table(folder / "conditions.csv", pd.DataFrame(met, columns=["alpha", "condition", "value", "met"]))
    return folder


def test_gathered_tables_say_of_which_universe_a_row_is(tmp_path: Path) -> None:
    """What a universe of one mismatch measures before any training is of that mismatch."""
    names = ["variant_as-written__dataset_3", "variant_refitted__dataset_3__delta_1.1"]
    folders = [a_universe(tmp_path / name, i) for i, name in enumerate(names)]
    by_name = {folder.name: folder for folder in folders}
    measures, met = gather(by_name)
    assert list(measures) == [*MEASURE_COLUMNS, "variant", "dataset"] and len(measures) == 4
    assert measures["dataset"].tolist() == [3] * 4
    assert measures["variant"].tolist() == ["as-written"] * 2 + ["refitted"] * 2
    assert measures["value"].tolist() == [0.5, 0, 0.5, 1]
    assert measures["delta"].isna().tolist() == [True, False, False, False]
    assert met["delta"].isna().tolist() == [True, False] and met["met"].all()
    (folders[1] / "conditions.csv").unlink()
    with pytest.raises(ResultError, match="missing"):
        gather(by_name)
