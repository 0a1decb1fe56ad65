"""REPORT.md says what the results say, and what was not run it does not claim."""

import shutil
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from replication import report
from replication.documents import FIGURES, ROOT
from replication.evidence.claims import load
from replication.evidence.verdicts import LONG
from replication.studies import multiverse
from replication.studies.hypotheses import FOLLOWED
from srlrepro.storage.files import ResultError, write_json

DOCUMENT = report.DOCUMENT
NOT_RUN = "*Not run: `./reproduce.sh --"
BRIER = {"tsne": 0.2, "mlp": 0.1, "pca": 0.3}  # of hypotheses, the same in every cell but one


def rendered(figures: Path) -> str:
    return replace(DOCUMENT, context=lambda: report.context(figures)).render()


def make_multiverse(folder: Path) -> None:
    """Tables of a multiverse in which Γ's evidence alone decides the three rates; all else is chance."""
    choices, rng = multiverse.load(), np.random.default_rng(3)
    universes = multiverse.design(choices)
    embedded = (universes["gamma-evidence"] == "embedded").to_numpy()
    tables = []
    for claim in load():
        margin = value = rng.normal(size=len(universes))
        if claim.id in multiverse.RATES:
            below = np.where(embedded, 0.03, 0.09) + 1e-6 * margin
            margin, value = claim.tolerance - below, claim.value - below
        table = pd.DataFrame({"id": universes.index, "claim": claim.id, "value": value, "margin": margin})
        tables.append(table.assign(holds=margin > 0, why=""))
    results = pd.concat(tables, ignore_index=True).astype({"holds": object})
    for name, made in {
        "shares": multiverse.shares(results, universes),
        "flips": multiverse.flips(results, universes),
        "main_effects": multiverse.main_effects(results, universes),
        "papers_rates": multiverse.papers_rates(results, universes),
    }.items():
        made.to_csv(folder / f"{name}.csv", index=False)


def make_hypotheses(folder: Path) -> None:
    """Tables of hypotheses with the scores of `BRIER`, of which PCA for α = 1 is the only one not trained."""
    cells = [
        {"hypothesis": kind, "alpha": alpha, "states": states, "delta": 1.0, "brier": brier}
        for kind, brier in BRIER.items()
        for alpha in ("0", "1")
        for states in ("UD", "MND")
    ]
    scores = pd.DataFrame(cells)
    scores.loc[
        (scores["hypothesis"] == "mlp") & (scores["alpha"] == "1") & (scores["states"] == "UD"), "brier"
    ] = 0.15
    folder.mkdir()
    scores.to_csv(folder / "hypotheses_classification.csv", index=False)
    trained = scores[["hypothesis", "alpha", "delta"]].drop_duplicates().assign(success_rate=0.9)
    trained[(trained["hypothesis"] != "pca") | (trained["alpha"] != "1")].to_csv(
        folder / "hypotheses_summary.csv", index=False
    )
    better = pd.DataFrame({"hypothesis": ["mlp", "pca"], "more: final return": ["1 of 2", "0 of 1"]})
    better.to_csv(folder / "hypotheses_better.csv", index=False)
    ranked = {"delta": 4.0, "score": "recall", "cells": 5} | dict.fromkeys(FOLLOWED, 0.25)
    pd.DataFrame([ranked]).to_csv(folder / "hypotheses_ranks.csv", index=False)


@pytest.fixture(scope="module")
def universes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the tables of a multiverse."""
    folder = tmp_path_factory.mktemp("multiverse")
    make_multiverse(folder)
    return folder


@pytest.fixture
def complete(larger: Path, universes: Path) -> Path:
    """Figures in which every long run has left its tables."""
    shutil.copytree(universes, larger / "multiverse")
    make_hypotheses(larger / "hypotheses")
    return larger


def test_the_report_is_up_to_date() -> None:
    assert not DOCUMENT.is_stale(), "run: python -m srlrepro report"


def test_a_changed_result_makes_it_stale() -> None:
    values = report.context()
    values["theorem"]["steps"][0]["holds"] -= 1
    assert replace(DOCUMENT, context=lambda: values).is_stale()


def test_every_part_that_was_not_run_says_so(complete: Path) -> None:
    """One long run after the other is taken away, and its part claims nothing."""
    whole = rendered(complete)
    assert NOT_RUN not in whole and "| not run |\n" not in whole
    for option, (name, (table, _)) in zip(
        ("seeds 10", "multiverse", "hypotheses"), LONG.items(), strict=True
    ):
        (complete / name / table).rename(complete / "away")
        text = rendered(complete)
        assert text.count(NOT_RUN) == 1 and f"{NOT_RUN}{option}`" in text
        (complete / "away").rename(complete / name / table)


def test_what_the_multiverse_decides(complete: Path) -> None:
    found = report.context(complete)["multiverse"]
    universes = multiverse.design(multiverse.load())
    assert found["universes"] == len(universes) and found["violated"] == 0
    assert found["rates_decided_by"] == {rate: ["gamma-evidence"] for rate in multiverse.RATES}
    assert found["hits"] == (universes["gamma-evidence"] == "embedded").sum()
    nearest = found["nearest"][0]
    levels = {c.id: c.levels[0].level for c in multiverse.load()}
    differs = {name for name, level in levels.items() if universes.loc[nearest["id"], name] != level}
    assert {part.partition(" = ")[0] for part in nearest["differs"].split(", ")} == differs
    rates = next(row for row in found["claims"] if row["statement"].startswith("At Δ = 1.1 and α = 0, 80.8"))
    drawn = universes[universes["design"] == multiverse.RANDOM]
    assert rates["random"] == f"{(drawn['gamma-evidence'] == 'embedded').sum()} of {len(drawn)}"
    shares = [Fraction(row["random"].replace(" of ", "/")) for row in found["claims"] if not row["ill_posed"]]
    often, seldom = sum(share >= 0.75 for share in shares), sum(share <= 0.25 for share in shares)
    assert (found["posed"], found["often"], found["seldom"]) == (len(shares), often, seldom)


def test_what_hypotheses_are_worth(complete: Path) -> None:
    """Four cells, in three of which the perceptron halves the score; in the fourth it has three quarters."""
    found = report.context(complete)["hypotheses"]
    assert found["perceptron"] == {"cells": 4, "better": 4, "halved": 3}
    assert found["untrained"] == {"pca": ["1"]}
    ratios = {row["states"]: row for row in found["ratio"]}
    assert ratios["UD"]["mlp"] == pytest.approx(0.625) and ratios["MND"]["mlp"] == pytest.approx(0.5)
    assert ratios["MND"]["pca"] == pytest.approx(1.5)


def test_what_is_said_of_hypotheses_in_words_is_what_the_tables_say() -> None:
    """Headlines that no number fills in: care protects, accuracy and the low dimension do not."""
    found = report.context()["hypotheses"]
    success = {(row["score"], row["delta"]): row["success_rate"] for row in found["ranks"]}
    recall, brier = (
        [value for (score, _), value in success.items() if score == name] for name in ("recall", "brier")
    )
    assert max(recall) < -0.5 and min(brier) > -0.5
    (svm,) = found["svm"]
    for better in ("more: success rate of K", "fewer: violations per 1000 steps"):
        times, of = map(int, svm[better].split(" of "))
        assert times > of / 2
    assert max(row["success_rate"] for row in found["oracles"] if row["hypothesis"] == "real") == 0


def test_theorem_counts_trainings_and_leaves_pools_out(larger: Path) -> None:
    path = larger / "seeds_10" / "theorem_divergence.csv"
    table = pd.read_csv(path)
    before = report.context(larger)["theorem"]["classes"]
    assert sum(c["of"] for c in before) == (table["seed"] != "pooled").sum()
    assert [c["class"] for c in before] == list(table["class"].unique())
    first = table[(table["seed"] != "pooled") & (table["class"] == "regions")].index[0]
    table.loc[first, "(11) minimum"], table.loc[first, "bound"] = -0.1, 1.2
    table.to_csv(path, index=False)
    regions = report.context(larger)["theorem"]["classes"][1]
    assert regions["fails"] == [0, 0, 1] and regions["vacuous"] == before[1]["vacuous"] + 1


def test_computing_takes_times_from_results(tmp_path: Path) -> None:
    """Further seeds are what is beyond the grid that they share; an unfinished run is not told of."""
    for name, trainings, hours in (("full", 36, 1.5), ("seeds_10", 120, 5.0), ("multiverse", 9, 1.0)):
        (tmp_path / name).mkdir()
        time = {"trainings": trainings, "core_hours": hours, "minutes": 3.0, "steps": 7}
        write_json(tmp_path / name / "run_time.json", time)
    (tmp_path / "seeds_10" / LONG["seeds_10"][0]).touch()
    table = {row["what"]: row for row in report.computing(tmp_path)}
    more = table["further seeds"]
    assert (more["trainings"], more["core_hours"], more["ran"]) == (84, 3.5, True)
    assert not table["multiverse"]["ran"] and table["multiverse"]["core_hours"] is None
    first = table["first full grid, three seeds"]
    assert first["most_core_hours"] == pytest.approx(first["minutes"] * first["cores"] / 60)


def test_a_missing_table_is_named(larger: Path) -> None:
    (larger / "seeds_10" / "theorem_orders.csv").unlink()
    with pytest.raises(ResultError, match="theorem_orders"):
        rendered(larger)


def test_the_tests_that_it_names_exist() -> None:
    """A finding that rests on a test is worth as much as the test."""
    text = (ROOT / "docs" / "REPORT.md.jinja").read_text(encoding="utf-8")
    sources = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").glob("test_*.py"))
    named = [word for word in text.split("`") if word.startswith("test_")]
    assert named and all(f"def {name}(" in sources for name in named)


def test_results_that_it_does_not_tell_of_render_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("replication.documents.ROOT", tmp_path)
    for name in ("quick", "custom", "seeds_5", "multiverse_quick"):
        assert list(report.refresh(name)) == []
    assert not list(tmp_path.iterdir())
    assert list(report.refresh("full")) == ["README.md", "REPORT.md"]
    assert (tmp_path / "REPORT.md").read_text(encoding="utf-8") == DOCUMENT.render()


def test_figures_that_it_shows_are_there() -> None:
    text = DOCUMENT.render()
    shown = [part.partition(")")[0] for part in text.split("](figures/")[1:]]
    assert shown and all((FIGURES / name).is_file() for name in shown)
