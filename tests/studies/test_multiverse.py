"""The multiverse: levels are allowed, designs cover them, and the aggregation counts what it is given."""

import re
from dataclasses import fields
from datetime import date
from typing import Any

import numpy as np
import pandas as pd
import pytest

from replication.evidence import claims
from replication.evidence.claims import Claim
from replication.studies.multiverse import (
    ALONE,
    FEW,
    RANDOM,
    VIOLATED,
    Choice,
    Level,
    design,
    flips,
    jobs,
    load_choices,
    main_effects,
    outcomes,
    papers_rates,
    settings,
    shares,
)
from srlrepro.settings.choices import Choices
from srlrepro.settings.config import Config
from workflow.command_line import STUDIES

CHOICES = load_choices()
SEEDS = {"data_seed", "seed"}
TOY = [
    Choice("a", (Level("0", {}, ""), Level("1", {"k": 10}, ""))),
    Choice("b", (Level("0", {}, ""), Level("1", {}, ""), Level("2", {}, ""))),
]
WORDS = {"statement": "m is at least 1.", "place": "", "layer": "a", "known": "", "reason": ""}
ONE: dict[str, Any] = WORDS | {"date": date(2026, 11, 25), "measure": "m", "where": {"alpha": ["0"]}}
CLAIM = Claim("above", kind="at_least", value=1.0, **ONE)
MET = pd.DataFrame({"condition": ["stable"], "met": [True]})
BROKEN = pd.DataFrame({"condition": ["stable", "origin"], "met": [True, False]})


def measured(value: float, measure: str = "m", alpha: str = "0") -> pd.DataFrame:
    return pd.DataFrame([(measure, alpha, 1.1, 0, value)], columns=list(claims.MEASURE_COLUMNS))


def toy(values: dict[str, float], conditions: dict[str, pd.DataFrame] | None = None) -> pd.DataFrame:
    tables = {name: measured(value) for name, value in values.items()}
    return outcomes([CLAIM], tables, dict.fromkeys(values, MET) | (conditions or {}), claims.GRID)


def test_every_level_is_allowed_differs_from_the_default_and_has_a_reason() -> None:
    default = Config().as_dict()
    for choice in CHOICES:
        for level in choice.levels[1:]:
            values = {n: v for n, v in level.set.items() if n not in SEEDS}
            assert level.set and level.reason
            assert all(Config().with_values(**values).as_dict()[n] != default[n] for n in values)


def test_no_value_belongs_to_two_choices() -> None:
    """Otherwise a universe would not have the levels that its row names."""
    names = [sorted({n for level in c.levels for n in level.set}) for c in CHOICES]
    flat = [name for part in names for name in part]
    assert len(flat) == len(set(flat))
    assert set(flat) - SEEDS <= {f.name for f in fields(Choices)}


def test_one_at_a_time_takes_every_alternative_once() -> None:
    rows = design(CHOICES, 0)
    default = {c.id: c.levels[0].level for c in CHOICES}
    changed = [
        {n: v for n, v in row.items() if n != "design" and v != default[str(n)]} for _, row in rows.iterrows()
    ]
    expected = [{c.id: level.level} for c in CHOICES for level in c.levels[1:]]
    assert changed == [{}, *expected] and set(rows["design"]) == {ALONE}


def test_random_levels_are_balanced_and_reproducible() -> None:
    drawn = design(CHOICES, 48)[lambda t: t["design"] == RANDOM]
    assert len(drawn) == 48
    for choice in CHOICES:
        counts = drawn[choice.id].value_counts()
        assert len(counts) == len(choice.levels) and counts.max() - counts.min() <= 1
    assert design(CHOICES, 48).equals(design(CHOICES, 48))
    assert not design(CHOICES, 48).equals(design(CHOICES, 48, seed=1))


def test_ids_are_unique_and_fit_for_files() -> None:
    index = design(CHOICES).index
    assert index.is_unique and all(re.fullmatch(r"[a-z0-9][A-Za-z0-9_.-]*", name) for name in index)


def test_settings_are_those_of_the_levels() -> None:
    rows = design(CHOICES)
    assert settings(CHOICES, rows.loc["default"]) == {}
    period = settings(CHOICES, rows.loc["control-period__5-ms"])
    assert period == {"control_period": 0.005, "substeps": 4}


def test_jobs_are_the_design_with_seeds_of_their_own() -> None:
    found = jobs(["0", "none"], few=False)
    assert list(found) == list(design(CHOICES).index)
    assert found["learner__2"]["SEEDS"] == [2] and found["dataset__1"]["DATA_SEED"] == 1
    assert found["early-stop__truncate"]["SETTINGS"] == {"early_stop": "truncate"}
    assert all(SEEDS.isdisjoint(job["SETTINGS"]) and job["ALPHAS"] == ["0", "none"] for job in found.values())
    few = jobs(["0"], few=True)
    assert 3 < len(few) <= FEW and next(iter(few)) == "default" and set(few) < set(found)


def test_outcomes_name_why_a_claim_cannot_be_evaluated() -> None:
    results = toy({"x": 1.5, "y": 0.5, "z": 2.0, "nan": np.nan}, {"z": BROKEN}).set_index("id")
    assert results["holds"].tolist() == [True, False, None, None]
    assert results["margin"].tolist()[:2] == [0.5, -0.5] and results["margin"].isna().tolist()[2:] == [
        True,
        True,
    ]
    assert results.loc["z", "why"] == VIOLATED + "origin" and results.loc["nan", "why"] == "not measured"


@pytest.mark.parametrize(("value", "held"), [(0.76, True), (0.85, True), (0.74, False), (0.9, False)])
def test_the_value_of_a_rate_keeps_its_side(value: float, held: bool) -> None:
    claim = Claim("c", kind="near", tolerance=0.05, value=0.8, for_each="delta", only=(1.1,), **ONE)
    row = outcomes([claim], {"x": measured(value)}, {"x": MET}, claims.GRID).iloc[0]
    assert row["value"] == pytest.approx(value) and row["holds"] == held
    assert row["margin"] == pytest.approx(0.05 - abs(value - 0.8))


def test_shares_count_what_is_there() -> None:
    rows = design(TOY, 4)
    values = dict.fromkeys(rows.index, 2.0) | {"a__1": 0.0, "random_000": 0.0, "random_001": np.nan}
    table = shares(toy(values, {"b__2": BROKEN}), rows).set_index("design")
    alone, random = table.loc[ALONE], table.loc[RANDOM]
    assert (alone["universes"], alone["violated"], alone["unmeasured"], alone["held"]) == (4, 1, 0, 2)
    assert (random["universes"], random["violated"], random["unmeasured"], random["held"]) == (4, 0, 1, 2)
    assert alone["share"] == pytest.approx(2 / 3) and random["share"] == pytest.approx(2 / 3)
    n, p, z = 3, 2 / 3, 1.959964  # Wilson's interval by its formula
    centre, half = p + z**2 / (2 * n), z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    assert [alone["low"], alone["high"]] == pytest.approx(
        [(centre + s * half) / (1 + z**2 / n) for s in (-1, 1)]
    )


def test_flips_are_the_alternatives_that_turn_the_default() -> None:
    rows = design(TOY, 3)
    values = dict.fromkeys(rows.index, 2.0) | {"b__1": 0.0, "b__2": np.nan, "random_000": 0.0}
    found = flips(toy(values), rows)
    assert found.to_dict("records") == [{"claim": "above", "choice": "b", "level": "1", "holds": False}]
    assert flips(toy(values | {"default": np.nan}), rows).empty


def test_a_choice_that_decides_is_found_and_others_are_not() -> None:
    rows, rng = design(TOY, 60), np.random.default_rng(3)
    values = {n: 2.0 * (row["a"] == "1") + 0.1 * rng.normal() for n, row in rows.iterrows()}
    found = main_effects(toy(values), rows).set_index("choice")
    assert found.loc["a", "q"] < 1e-6 and found.loc["a", "spread"] == 1.0 and found.loc["a", "effect"] > 0.7
    assert found.loc["b", "q"] > 0.05
    assert "1: 1.00 (30)" in found.loc["a", "levels"] and "0: 0.00 (30)" in found.loc["a", "levels"]


def test_values_that_differ_by_rounding_alone_have_the_same_rank() -> None:
    """A choice that does no more than turn the order of a sum moves nothing."""
    rows, noise = design(TOY, 60), np.random.default_rng(3).integers(0, 2, 62)
    plain = {n: 0.3 + value for n, value in zip(rows.index, noise, strict=False)}
    turned = {n: value + 1e-13 * (rows.loc[n, "a"] == "1") for n, value in plain.items()}
    assert any(turned[n] != plain[n] for n in plain)
    pd.testing.assert_frame_equal(main_effects(toy(turned), rows), main_effects(toy(plain), rows))


def test_a_choice_that_carries_a_rate_over_the_papers_number_is_found() -> None:
    """From 0.1 below to 0.1 above the log odds: the distance from it, and so the margin, stays as it was."""
    near = next(c for c in claims.load_claims() if c.id == "rate-mnd")
    rows, rng = design(TOY, 60), np.random.default_rng(3)
    values = {
        n: near.value + (0.1 if row["a"] == "1" else -0.1) + 0.01 * rng.normal() for n, row in rows.iterrows()
    }
    tables = {name: measured(value, near.measure) for name, value in values.items()}
    found = main_effects(outcomes([near], tables, dict.fromkeys(tables, MET), claims.GRID), rows)
    assert found.set_index("choice").loc["a", "q"] < 1e-6


def test_universes_are_sorted_by_their_distance_from_the_papers_rates() -> None:
    tested = [c for c in claims.load_claims() if c.id in claims.RATES]

    def rates(shift: float) -> pd.DataFrame:
        return pd.concat([measured(c.value - shift, c.measure, c.where["alpha"][0]) for c in tested])

    rows = design(TOY, 0)
    tables = {"default": rates(0.4), "a__1": rates(0.03), "b__1": rates(0.1)}
    table = papers_rates(outcomes(tested, tables, dict.fromkeys(tables, MET), claims.GRID), rows)
    assert table["id"].tolist() == ["a__1", "b__1", "default"]
    assert table["margin"].tolist() == pytest.approx([0.3, 0.23, -0.07])
    assert table.loc[0, "rate-mnd"] == pytest.approx(1.407)


def test_claims_over_the_studies_grid_need_no_other_mismatch() -> None:
    """A claim "for every Δ" is evaluated at the two ends where only these are measured."""
    claim = next(c for c in claims.load_claims() if c.id == "fewer-violations")
    cells: list[Any] = [
        (claim.measure, a, d, 0, float(a == "none")) for a in ("0", "0.5", "1", "none") for d in (1.1, 4.0)
    ]
    table = pd.DataFrame(cells, columns=list(claims.MEASURE_COLUMNS))
    ends = claims.GRID | {"delta": STUDIES["multiverse"].deltas}
    assert claims.points(claims.contrasts_of(claim, table, grid=ends)) is True
    assert claims.points(claims.contrasts_of(claim, table)) is None
