"""What the documents tell is what the tables hold."""

import shutil
import tomllib
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from plans import planned

from replication.documents import DOCS, FIGURES, ROOT
from replication.evidence.claims import VERDICTS, load_claims
from replication.evidence.verdicts import LONG
from replication.facts import Facts, sign, text_of
from replication.studies import multiverse
from replication.studies.theorem import POOLED
from srlrepro.storage.files import write_json

KEPT = Facts(ROOT, FIGURES)
BRIER = {"tsne": 0.2, "mlp": 0.1, "pca": 0.3}  # of hypotheses, the same in every cell but one
GROUPS = ("full", "seeds_10", "multiverse", "hypotheses")


@pytest.fixture(scope="module")
def universes(tmp_path_factory: pytest.TempPathFactory) -> Facts:
    """Tables of a multiverse in which Γ's evidence alone decides the three rates; all else is chance."""
    folder = tmp_path_factory.mktemp("figures") / "multiverse"
    folder.mkdir()
    universes, rng = multiverse.design(multiverse.load_choices()), np.random.default_rng(3)
    embedded = (universes["gamma-evidence"] == "embedded").to_numpy()
    tables = []
    for claim in load_claims():
        margin = value = rng.normal(size=len(universes))
        if claim.id in multiverse.RATES:
            below = np.where(embedded, 0.03, 0.09) + 1e-6 * margin
            margin, value = claim.tolerance - below, claim.value - below
        table = pd.DataFrame({"id": universes.index, "claim": claim.id, "value": value, "margin": margin})
        tables.append(table.assign(holds=margin > 0, why=""))
    results = pd.concat(tables, ignore_index=True).astype({"holds": object})
    for name in ("shares", "flips", "main_effects", "papers_rates"):
        getattr(multiverse, name)(results, universes).to_csv(folder / f"{name}.csv", index=False)
    write_json(folder / "workflow.json", {"steps": 7})
    for name in ("full", "seeds_10"):
        (folder.parent / name).symlink_to(FIGURES / name)
    return Facts(ROOT, folder.parent)


@pytest.mark.parametrize(
    ("states", "expected"),
    [
        ("supports supports", "✓"),
        ("contradicts contradicts", "✗"),
        ("contradicts unresolved", "✗"),
        ("supports contradicts", "±"),
        ("supports unresolved", "○"),
        ("unresolved", "○"),
    ],
)
def test_signs_follow_the_rule_of_the_verdicts(states: str, expected: str) -> None:
    assert sign(pd.Series(states.split())) == expected


def test_claims_by_delta() -> None:
    """Every well-posed claim that is tested for each Δ, and no other; each sign by its own contrasts."""
    tested = {claim.id for claim in load_claims() if claim.for_each == "delta" and not claim.ill_posed}
    assert set(KEPT.by_delta) == tested
    assert all(list(signs) == [1.1, 1.5, 4.0] for signs in KEPT.by_delta.values())
    contrasts = pd.read_csv(FIGURES / "seeds_10" / "contrasts.csv")
    for name, signs in KEPT.by_delta.items():
        verdict = KEPT.claims[name]["verdict"]
        assert (set(signs.values()) == {"✓"}) == (verdict == "reproduced")
        for delta, shown in signs.items():
            own = contrasts[contrasts["id"] == name]
            own = own[own["contrast"].str.startswith(f"Δ = {delta}: ")]
            assert shown == sign(own["state"])


def test_every_claim_stands_once() -> None:
    tests = {claim.id: claim for claim in load_claims()}
    assert set(KEPT.claims) == set(tests)
    sections = pd.Series({row["id"]: row["section"] for row in KEPT.posed}).value_counts().to_dict()
    assert sections == {"safety": 9, "learning": 6, "data": 5, "generalisation": 2}
    assert sum(KEPT.count(v) for v in VERDICTS) == len(KEPT.posed)
    assert KEPT.late() == sum(bool(test.joins) for test in tests.values()) + 1  # safer-with-alpha joins none


def test_what_was_not_measured_is_not_called_inconclusive() -> None:
    row = KEPT.claims["early-stop-is-what-helps"]
    assert row["n"] == 0 and row["verdict"] == "not measured"


def test_every_picture_has_a_caption_and_a_notebook_that_draws_it() -> None:
    table = tomllib.loads((DOCS / "figures.toml").read_text(encoding="utf-8"))
    pictures = [
        path for group in GROUPS for path in (FIGURES / group).rglob("*") if path.suffix in (".png", ".gif")
    ]
    assert len(pictures) > 50

    def entry(path: Path) -> str:
        return (
            path.stem
            if path.stem in table
            else "behaviour"
            if path.parent.name == "behaviour"
            else "spec_curve"
        )

    assert {entry(path) for path in pictures} == set(table)
    assert all(path.stem.startswith("spec_curve_") for path in pictures if entry(path) == "spec_curve")
    for name, told in table.items():
        source = (ROOT / "notebooks" / f"{told['notebook']}.ipynb").read_text(encoding="utf-8")
        drawn = name.replace("reliability_nominal", "nominal").replace("reliability_real", "real")
        assert (
            drawn in source
            and "\n" not in told["text"]
            and set(told) <= {"paper", "notebook", "text", "study"}
        )
        assert told.get("study", "grid") in ("grid", *LONG)


def test_every_parameter_stands_in_the_ledger() -> None:
    names = [row["name"] for rows in KEPT.ledger().values() for row in rows]
    constants = KEPT.constants
    assert len(names) == len(set(names)) == constants["stated"] + constants["chosen"]
    assert [text_of(value) for value in (True, 1e-4, 20480, "held out")] == [
        "true",
        "0.0001",
        "20480",
        "held out",
    ]


def test_what_the_multiverse_says(universes: Facts) -> None:
    found, design = universes.multiverse(), multiverse.design(multiverse.load_choices())
    embedded = design["gamma-evidence"] == "embedded"
    assert found["universes"] == len(design) and found["violated"] == 0 and found["steps"] == 7
    assert all(found["moved"][rate] == ["gamma-evidence"] for rate in multiverse.RATES)
    assert found["hits"] == embedded.sum()
    nearest = found["nearest"][0]
    levels = {c.id: c.levels[0].level for c in multiverse.load_choices()}
    assert nearest["differ"] == sum(
        design.loc[nearest["id"], name] != level for name, level in levels.items()
    )
    told = [row for part in ("often", "between", "seldom") for row in found[part]]
    assert len(told) == found["tested"] == sum(row["section"] != "learning" for row in universes.posed)
    drawn = embedded[design["design"] == multiverse.RANDOM]
    [mnd] = [row for row in told if row["id"] == "success-mnd"]
    assert (mnd["held"], mnd["decided"]) == (drawn.sum(), len(drawn))
    for part, low, high in (("seldom", 0, 0.25), ("often", 0.75, 1)):
        assert all(low <= Fraction(int(row["held"]), int(row["decided"])) <= high for row in found[part])


def test_what_hypotheses_are_worth(tmp_path: Path) -> None:
    """Four cells, in three of which the perceptron halves the score; PCA for α = 1 was not trained."""
    cells = [
        {"hypothesis": kind, "alpha": alpha, "states": states, "delta": 1.0, "brier": brier}
        for kind, brier in BRIER.items()
        for alpha in ("0", "1")
        for states in ("UD", "MND")
    ]
    scores = pd.DataFrame(cells)
    other = (scores["hypothesis"] == "mlp") & (scores["alpha"] == "1") & (scores["states"] == "UD")
    scores.loc[other, "brier"] = 0.15
    (tmp_path / "hypotheses").mkdir()
    scores.to_csv(tmp_path / "hypotheses" / "hypotheses_classification.csv", index=False)
    trained = scores[(scores["hypothesis"] != "pca") | (scores["alpha"] != "1")].assign(success_rate=0.9)
    trained.to_csv(tmp_path / "hypotheses" / "hypotheses_summary.csv", index=False)
    found = Facts(ROOT, tmp_path).hypotheses()
    assert (found["cells"], found["better"], found["halved"]) == (4, 4, 3)
    assert found["untrained"] == {"pca": ["1"]}
    ratios = {row["states"]: row for row in found["ratio"]}
    assert ratios["UD"]["mlp"] == pytest.approx(0.625) and ratios["MND"]["mlp"] == pytest.approx(0.5)
    assert ratios["MND"]["pca"] == pytest.approx(1.5)


def test_what_is_said_of_hypotheses_in_words_is_what_the_tables_say() -> None:
    """Sentences that no number fills in: the careful hypothesis protects; the exact labels come too late."""
    ranks = KEPT.table("hypotheses", "hypotheses_ranks.csv")
    assert max(row["success_rate"] for row in ranks if row["score"] == "recall") < -0.5
    oracles = KEPT.hypotheses()["oracles"]
    assert max(row["success_rate"] for row in oracles if row["hypothesis"] == "real") == 0


def test_what_is_said_of_the_discrepancy_in_words_is_what_the_table_says() -> None:
    table = pd.DataFrame(KEPT.table("seeds_10", "discrepancy_outcomes.csv")).sort_values("delta")
    for _, cells in table.groupby("alpha"):
        assert all(cells[name].is_monotonic_increasing for name in ("unexplained", "surprises", "slower"))


def test_theorem_counts_trainings_and_leaves_pools_out(larger: Path) -> None:
    path = larger / "seeds_10" / "theorem_divergence.csv"
    table = pd.read_csv(path)
    before = Facts(ROOT, larger).theorem()["classes"]
    assert sum(c["of"] for c in before) == (table["seed"] != POOLED).sum()
    assert [c["class"] for c in before] == list(table["class"].unique())
    first = table[(table["seed"] != POOLED) & (table["class"] == "regions")].index[0]
    table.loc[first, "(11) minimum"], table.loc[first, "bound"] = -0.1, 1.2
    table.to_csv(path, index=False)
    regions = Facts(ROOT, larger).theorem()["classes"][1]
    assert regions["fails"] == [0, 0, 1] and regions["vacuous"] == before[1]["vacuous"] + 1


def test_that_every_step_of_the_proof_holds_is_what_the_table_says() -> None:
    steps = KEPT.table("seeds_10", "theorem_steps.csv")
    assert all(step["holds"] == step["of"] == KEPT.theorem()["classes"][0]["of"] for step in steps)


def test_computing_takes_times_from_results(tmp_path: Path) -> None:
    """Further seeds are what is beyond the grid that they share; an unfinished run is not told of."""
    (tmp_path / "docs" / "records").mkdir(parents=True)
    shutil.copy(ROOT / "docs" / "records" / "computing.csv", tmp_path / "docs" / "records")
    for name, trainings, hours in (("full", 36, 1.5), ("seeds_10", 120, 5.0), ("multiverse", 9, 1.0)):
        (tmp_path / name).mkdir(parents=True)
        time = {"trainings": trainings, "core_hours": hours, "minutes": 3.0, "steps": 7}
        write_json(tmp_path / "docs" / "records" / f"{name}.json", time)
    (tmp_path / "seeds_10" / LONG["seeds_10"][0]).touch()
    table = {row["what"]: row for row in Facts(tmp_path, tmp_path).computing()}
    more = table["further seeds"]
    assert (more["trainings"], more["core_hours"], more["ran"]) == (84, 3.5, True)
    assert not table["multiverse"]["ran"] and table["multiverse"]["core_hours"] is None
    first = table["first full grid, three seeds"]
    assert first["most"] == pytest.approx(first["minutes"] * first["cores"] / 60)


def test_every_figure_is_shown_with_where_it_comes_from() -> None:
    rows = KEPT.gallery()
    named = tomllib.loads((DOCS / "figures.toml").read_text(encoding="utf-8"))
    assert [row["name"] for row in rows] == list(named)
    for row in rows:
        for place in [
            *row["pictures"],
            *filter(None, (row[key] for key in ("executed", "table", "pdf", "elsewhere"))),
        ]:
            assert (ROOT / place).is_file(), place
        assert row["executed"].endswith(f"{row['notebook']}.ipynb")
        assert Path(row["pictures"][0]).parts[1] in Path(row["executed"]).parts
        plan = planned(*row["command"].split()[1:])  # refuses a figure that it cannot make
        assert plan["only"] == row["notebook"] and plan["name"] in row["executed"]
    by_name = {row["name"]: row for row in rows}
    assert len(by_name["behaviour"]["pictures"]) == 12 and len(by_name["reliability"]["pictures"]) == 1
    assert by_name["fig3_def_counts"]["elsewhere"] == "figures/full/fig3_def_counts.png"


def test_what_has_not_been_made_is_not_named(tmp_path: Path) -> None:
    empty = Facts(tmp_path, FIGURES)
    assert not empty.has_page("check") and not empty.has_policies and empty.explorer == ""
    (tmp_path / "docs").mkdir()
    (tmp_path / "policies").mkdir()
    for name in ("docs/check.md", "docs/explorer.html", "policies/a.npz"):
        (tmp_path / name).touch()
    assert empty.has_page("check") and empty.has_policies and empty.explorer == "docs/explorer.html"


def test_sets_of_another_arithmetic_are_named(tmp_path: Path) -> None:
    for name, held in (("a", {}), ("b", {"arithmetic": KEPT.arithmetic}), ("c", {"arithmetic": 99})):
        (tmp_path / name).mkdir()
        write_json(tmp_path / name / "workflow.json", held)
    assert Facts(ROOT, tmp_path).earlier == ["a", "c"]
