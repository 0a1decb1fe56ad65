"""What the documents tell is what the tables hold."""

import shutil
import tomllib
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from judged import SUCCESS, measures, write_judged
from plans import planned

from replication.documents import DOCS, FIGURES, ROOT
from replication.evidence.claims import LAYERS, RATES, VERDICTS, load_claims
from replication.evidence.verdicts import LONG, OVERALL
from replication.facts import Facts, text_of
from replication.studies import multiverse
from replication.studies.theorem import POOLED
from srlrepro.storage.files import write_json, write_table

KEPT = Facts(ROOT, FIGURES)
GROUPS = ("full", *LONG)
EVIDENCE = "gamma-evidence"  # the choice that decides the made-up rates


def decides() -> pd.Series:
    """Which universes have not the default of `EVIDENCE`."""
    choices = multiverse.load_choices()
    usual = next(choice.levels[0].level for choice in choices if choice.id == EVIDENCE)
    return multiverse.design(choices)[EVIDENCE] != usual


@pytest.fixture
def universes(larger: Path) -> Facts:
    """Tables of a multiverse in which `EVIDENCE` alone decides the three rates; all else is chance."""
    folder = larger / "multiverse"
    folder.mkdir()
    universes, rng = multiverse.design(multiverse.load_choices()), np.random.default_rng(3)
    tables = []
    for claim in load_claims():
        margin = value = rng.normal(size=len(universes))
        if claim.id in multiverse.RATES:
            below = np.where(decides(), 0.1, 0.9) + 1e-6 * margin
            margin, value = claim.tolerance - below, claim.value - below
        table = pd.DataFrame({"id": universes.index, "claim": claim.id, "value": value, "margin": margin})
        tables.append(table.assign(holds=margin > 0, why=""))
    results = pd.concat(tables, ignore_index=True).astype({"holds": object})
    for name in ("shares", "flips", "main_effects", "papers_rates"):
        getattr(multiverse, name)(results, universes).to_csv(folder / f"{name}.csv", index=False)
    write_json(folder / "workflow.json", {"steps": 7})
    return Facts(ROOT, larger)


def test_the_paper_is_counted_by_layer_a_alone(larger: Path) -> None:
    facts = Facts(ROOT, larger)
    assert set(facts.claims) == {claim.id for claim in load_claims()} and list(facts.layers) == list(LAYERS)
    papers = [claim.id for claim in load_claims() if claim.layer == "a"]
    assert [row["id"] for row in facts.layer("a")] == papers
    assert facts.counts() == f"{len(papers)} reproduced" and facts.seeds == 10
    path = larger / "seeds_10" / "claims.csv"
    table = pd.read_csv(path)
    table.loc[table["layer"] != "a", "verdict"] = "open"
    table.loc[table["id"] == "rate-mnd", "verdict"] = "not reproduced"
    table.to_csv(path, index=False)
    facts = Facts(ROOT, larger)
    assert facts.counts() == f"{len(papers) - 1} reproduced, 1 not reproduced"
    assert facts.count("open") == 0 < facts.count("open", "b")
    assert sum(facts.count(verdict) for verdict in VERDICTS) == len(papers)
    assert facts.all("reproduced", "rate-mix", "rate-ud") and not facts.all("reproduced", *RATES)


def test_every_claim_has_a_section_of_the_report(larger: Path) -> None:
    sections = pd.Series([row["section"] for row in Facts(ROOT, larger).layer("a")]).value_counts()
    assert sections.to_dict() == {"safety": 9, "data": 6, "learning": 5, "generalisation": 2}


def test_signs_stand_by_row_and_delta(larger: Path) -> None:
    facts = Facts(ROOT, larger)
    assert {row["row"] for row in facts.signs} == {claim.row for claim in load_claims()}
    assert [facts.sign("success-grows-at-1-1", delta) for delta in ("1.1", "1.5", "4")] == ["✓"] * 3
    assert facts.sign("rate-mnd", "4") == "" and facts.sign("success-falls-with-delta", OVERALL) == "✓"
    write_judged(larger / "seeds_10", measures(turned=True))
    assert Facts(ROOT, larger).sign("success-grows-at-1-1", "4") == "✗"


def test_how_often_k_fails_in_each_arm(larger: Path) -> None:
    for alpha, rate in zip(("0", "0.5", "1"), SUCCESS[4.0], strict=True):
        assert Facts(ROOT, larger).failures["as written"]["4"][alpha]["mean"] == pytest.approx(1 - rate)
    assert list(Facts(ROOT, larger).failures) == ["as written"]
    (larger / "calibrated").mkdir()
    write_table(larger / "calibrated" / "measures.csv", measures(turned=True))
    facts = Facts(ROOT, larger)
    assert facts.failures["calibrated"]["4"]["1"]["mean"] == pytest.approx(1 - SUCCESS[4.0][0])
    other = facts.calibrated()
    differ = {row["id"]: row["other"] for row in other["differ"]}
    assert differ["rate-mnd"] == "not reproduced" and "separated-in-y" not in differ
    assert set(differ.values()) == {"partly", "not reproduced"}
    kept = sum(verdict == "partly" for verdict in differ.values())
    assert other["counts"].startswith(f"{len(facts.layer('a')) - len(differ)} reproduced, {kept} partly, ")


def test_verdicts_by_step_are_counted_from_half_the_steps_on(larger: Path) -> None:
    """Of the made-up steps the first is half of the last; there α = 0 and 1 have changed places."""
    found = Facts(ROOT, larger).by_step()
    table = pd.read_csv(larger / "seeds_10" / "verdict_by_step.csv")
    wide = table.pivot_table("sign", ["row", table["delta"].fillna(0)], "step", aggfunc="first")
    assert found == {"half": 500, "of": len(wide), "same": int((wide[500] == wide[1000]).sum())}
    assert 0 < found["same"] < found["of"]
    (larger / "seeds_10" / "verdict_by_step.csv").unlink()
    assert Facts(ROOT, larger).by_step() == {}


def made(table: dict[str, dict[str, str]]) -> list[str]:
    """The figures of the table whose study, if they are of one, has been run."""
    return [name for name, told in table.items() if "study" not in told or KEPT.is_there(told["study"])]


def test_every_picture_has_a_caption_and_a_notebook_that_draws_it() -> None:
    table = tomllib.loads((DOCS / "figures.toml").read_text(encoding="utf-8"))
    pictures = [
        path for group in GROUPS for path in (FIGURES / group).rglob("*") if path.suffix in (".png", ".gif")
    ]
    assert len(pictures) > 20

    def entry(path: Path) -> str:
        return (
            path.stem
            if path.stem in table
            else "behaviour"
            if path.parent.name == "behaviour"
            else "spec_curve"
        )

    assert {entry(path) for path in pictures} == set(made(table))
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
    assert found["universes"] == len(design) and found["violated"] == 0 and found["steps"] == 7
    assert all(found["moved"][rate] == [EVIDENCE] for rate in RATES)
    assert found["hits"] == decides().sum()
    nearest = found["nearest"][0]
    levels = {c.id: c.levels[0].level for c in multiverse.load_choices()}
    assert nearest["differ"] == sum(
        design.loc[nearest["id"], name] != level for name, level in levels.items()
    )
    told = [row for part in ("often", "between", "seldom") for row in found[part]]
    assert len(told) == found["tested"] == sum(row["section"] != "learning" for row in universes.layer("a"))
    drawn = decides()[design["design"] == multiverse.RANDOM]
    [mnd] = [row for row in told if row["id"] == "rate-mnd"]
    assert (mnd["held"], mnd["decided"]) == (drawn.sum(), len(drawn))
    for part, low, high in (("seldom", 0, 0.25), ("often", 0.75, 1)):
        assert all(low <= Fraction(int(row["held"]), int(row["decided"])) <= high for row in found[part])
    between = {row["id"] for row in found["between"]}
    marked = {row["id"] for row in universes.layer("a") if row["under_determined"] is not None}
    assert marked == between != set()


def test_a_multiverse_that_was_asked_about_other_tests_tells_nothing_of_these(
    universes: Facts, larger: Path
) -> None:
    before, shares = universes.multiverse(), pd.read_csv(larger / "multiverse" / "shares.csv")
    shares[shares["claim"] != "rate-mnd"].to_csv(larger / "multiverse" / "shares.csv", index=False)
    rates = pd.read_csv(larger / "multiverse" / "papers_rates.csv")
    rates.drop(columns="rate-mnd").to_csv(larger / "multiverse" / "papers_rates.csv", index=False)
    found = Facts(ROOT, larger).multiverse()
    assert found["rated"] == found["hits"] == 0 < before["hits"]
    assert found["tested"] == before["tested"] - 1


def test_what_is_said_of_the_discrepancy_in_words_is_what_the_table_says() -> None:
    table = pd.DataFrame(KEPT.table(KEPT.grid, "discrepancy_outcomes.csv")).sort_values("delta")
    for _, cells in table.groupby("alpha"):
        assert all(cells[name].is_monotonic_increasing for name in ("unexplained", "surprises", "slower"))


def test_regions_that_deny_the_origin_are_counted_without_those_that_know_it(larger: Path) -> None:
    path, rows = larger / "full" / "choices_origin.csv", [(0, False, 0.8), (0, True, 0.5), (1, False, 0.81)]
    pd.DataFrame(rows, columns=["dataset", "known origin", "Γ(origin)"]).to_csv(path, index=False)
    assert Facts(ROOT, larger).origins == {"of": 2, "denied": 1}


def test_what_rises_with_delta_and_which_alpha_a_user_would_take_are_read(larger: Path) -> None:
    explored, got = (larger / "seeds_10" / f"discrepancy{name}.csv" for name in ("", "_outcomes"))
    rows = [
        (1.1, 0.1, 0.2, 0.3),
        (1.1, 0.3, 0.2, 0.3),
        (4, 0.25, 0.1, 0.3),
    ]
    pd.DataFrame(rows, columns=["delta", "unexplained", "surprises", "slower"]).to_csv(explored, index=False)
    rows = [(1.1, 0, 0.9, 500), (1.1, 1, 0.7, 700), (1.1, 0.5, 0.8, 600), (1.5, 0, 0.79, 700)]
    columns = ["delta", "alpha", "success_rate", "final_return"]
    pd.DataFrame(rows, columns=columns).to_csv(got, index=False)
    found = Facts(ROOT, larger).explored()
    assert found == {"rise": ["unexplained", "slower"], "alpha": {1.1: 0.5, 1.5: None}}


def test_theorem_counts_trainings_and_leaves_pools_out(larger: Path) -> None:
    path = larger / "seeds_10" / "theorem_divergence.csv"
    table = pd.read_csv(path)
    before = Facts(ROOT, larger).theorem()["classes"]
    assert sum(c["of"] for c in before) == (table["seed"] != POOLED).sum()
    assert [c["class"] for c in before] == list(table["class"].unique())
    first = table[(table["seed"] != POOLED) & (table["class"] == "regions")].index[0]
    table.loc[first, "(11) minimum"], table.loc[first, "bound"] = -0.1, 1.2
    table.to_csv(path, index=False)
    regions, (*same, minimum) = Facts(ROOT, larger).theorem()["classes"][1], before[1]["fails"]
    assert regions["fails"] == [*same, minimum + 1] and regions["vacuous"] == before[1]["vacuous"] + 1


def test_that_every_step_of_the_proof_holds_is_what_the_table_says() -> None:
    steps = KEPT.table(KEPT.grid, "theorem_steps.csv")
    assert all(step["holds"] == step["of"] == KEPT.theorem()["classes"][0]["of"] for step in steps)


def test_computing_takes_times_from_results(tmp_path: Path) -> None:
    """Further seeds are what is beyond the grid that they share; an unfinished run is not told of."""
    (tmp_path / "docs" / "records").mkdir(parents=True)
    shutil.copy(ROOT / "docs" / "records" / "computing.csv", tmp_path / "docs" / "records")
    for name, trainings, hours in (("full", 36, 1.5), ("seeds_10", 120, 5.0), ("crossed", 9, 1.0)):
        (tmp_path / name).mkdir(parents=True)
        time = {"trainings": trainings, "core_hours": hours, "minutes": 3.0, "steps": 7}
        write_json(tmp_path / "docs" / "records" / f"{name}.json", time)
    (tmp_path / "seeds_10" / LONG["seeds_10"][0]).touch()
    table = {row["what"]: row for row in Facts(tmp_path, tmp_path).computing()}
    more = table["further seeds"]
    assert (more["trainings"], more["core_hours"], more["ran"]) == (84, 3.5, True)
    assert (
        not table["datasets crossed with learners"]["ran"]
        and table["datasets crossed with learners"]["core_hours"] is None
    )
    first = table["first full grid, three seeds"]
    assert first["most"] == pytest.approx(first["minutes"] * first["cores"] / 60)


def test_every_figure_is_shown_with_where_it_comes_from() -> None:
    rows = KEPT.gallery()
    named = tomllib.loads((DOCS / "figures.toml").read_text(encoding="utf-8"))
    assert [row["name"] for row in rows] == made(named)
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
    paper = "figures/full/fig3_def_counts.png"
    assert by_name["fig3_def_counts"]["elsewhere"] == (paper if KEPT.grid != "full" else "")


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
