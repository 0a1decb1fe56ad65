"""Claims: each can hold and can fail on made-up measures, and says nothing where none were taken."""

import itertools
import math
from collections.abc import Callable
from datetime import date
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import ttest_1samp, ttest_ind

from replication.evidence.claims import (
    DIFFERENCES,
    INCLUSIVE,
    KINDS,
    LAYERS,
    MEASURE_COLUMNS,
    NUMBERS,
    RATES,
    STATES,
    VERDICTS,
    Cell,
    Claim,
    contrasts_of,
    judge_claims,
    load_claims,
    points,
    verdict,
)

ALPHAS, DELTAS, SEEDS = ("0", "0.5", "1", "none"), (1.1, 1.5, 4.0), (0, 1, 2)
Value = Callable[[Cell], float]
CLAIMS = load_claims()


def grid(measure: str, value: Value, alphas: tuple[str, ...] = ALPHAS) -> pd.DataFrame:
    """Measures of every cell: seeds differ by ±0.001 around the value of the cell."""
    rows = [
        (measure, a, d, s, value({"alpha": a, "delta": d}) + 0.001 * (s - 1))
        for a, d, s in itertools.product(alphas, DELTAS, SEEDS)
    ]
    return pd.DataFrame(rows, columns=list(MEASURE_COLUMNS))


def claim(kind: str, **values: Any) -> Claim:
    parts: dict[str, Any] = {"layer": "a"} | values
    of = date(2026, 11, 25)
    return Claim("an-id", "statement", "place", measure="m", kind=kind, date=of, known="", reason="", **parts)


def way(one: Claim, value: Value, **options: Any) -> bool | None:
    return points(contrasts_of(one, grid(one.measure, value, **options)))


def matches(cell: Cell, selection: dict[str, list[Any]]) -> bool:
    return all(cell[name] in values for name, values in selection.items())


def level(one: Claim, cell: Cell) -> float:
    return 10 * float(cell[one.over]) if cell[one.over] != "none" else math.nan


def truth(one: Claim, sign: float = 1.0) -> Value:
    """Values that make the claim true; with ``sign`` −1 they make it false."""
    margin = sign * (one.tolerance + 0.01)
    if one.kind in ("decreasing", "increasing"):
        return lambda c: sign * level(one, c) * (1 if one.kind == "increasing" else -1)
    if one.kind in ("greater", "less"):
        better = 1.0 if one.kind == "greater" else -1.0
        return lambda c: better * margin if matches(c, one.where) else 0.0
    if one.kind in ("at_least", "at_most"):
        better = 1.0 if one.kind == "at_least" else -1.0
        return lambda c: one.value + better * margin
    if one.kind == "most_runs":
        return lambda c: one.value + margin
    if one.kind in NUMBERS:
        return lambda c: one.value + (0.0 if sign > 0 else one.tolerance + 0.01)
    return lambda c: margin if matches(c, one.where) and c[one.over] == one.high else 0.0


def test_the_file_holds_known_claims_with_one_id_each() -> None:
    ids = [c.id for c in CLAIMS]
    assert len(ids) == len(set(ids)) > 0 and set(RATES) < set(ids)
    for c in CLAIMS:
        assert all((c.id, c.statement, c.place, c.measure, c.reason, c.date, c.known))
        for column in (c.for_each, c.over, *c.where, *c.than):
            assert column in ("", *MEASURE_COLUMNS[1:4])
        for cell in (c.where, c.than):
            assert all(isinstance(a, str) for a in cell.get("alpha", []))
        assert all(d in DELTAS for d in c.only)


def test_the_layers_stand_in_order_and_a_sharper_test_names_its_sentence() -> None:
    """Layer a quotes the words that it tests; only layer b sharpens, and only claims of layer a."""
    layers = [c.layer for c in CLAIMS]
    assert layers == sorted(layers) and set(layers) == set(LAYERS)
    told = {c.id for c in CLAIMS if c.layer == "a"}
    for c in CLAIMS:
        assert (c.sharpens in told) == (c.layer == "b") and (c.layer == "b" or not c.sharpens)
    others = {c.id: sorted((c.value, *c.others)) for c in CLAIMS if c.kind == "predicts"}
    assert set(others) == set(RATES)
    for name, rate in zip(RATES, (0.808, 0.910, 0.997), strict=True):
        one = next(c for c in CLAIMS if c.id == name)
        assert one.value == pytest.approx(math.log(rate / (1 - rate)), abs=5e-4)
        assert one.paper == f"{100 * rate:.1f} %" and others[name] == others[RATES[0]]


def test_every_difference_has_a_smallest_effect_that_matters() -> None:
    """Also where it was known: no measured spread of the prototype decides it, but a unit of the measure."""
    for c in CLAIMS:
        assert (c.effect > 0) or c.kind not in DIFFERENCES


def test_every_kind_but_none_other_is_known() -> None:
    for kind in KINDS:
        claim(kind)
    with pytest.raises(ValueError, match="claim an-id: unknown kind 'equal'"):
        claim("equal")
    with pytest.raises(ValueError, match="claim an-id: unknown layer 'd'"):
        claim("near", layer="d")


@pytest.mark.parametrize("one", CLAIMS, ids=lambda c: c.id)
def test_every_claim_of_the_file_can_hold_and_can_fail(one: Claim) -> None:
    extra = {*one.where.get("alpha", []), *one.than.get("alpha", [])} - set(ALPHAS)
    alphas = (*ALPHAS, *extra) if one.over != "alpha" and one.for_each != "alpha" else ALPHAS[:-1]
    assert way(one, truth(one), alphas=alphas) is True
    assert way(one, truth(one, -1.0), alphas=alphas) is False
    assert points(contrasts_of(one, grid("another measure", truth(one)))) is None


def test_order_along_a_column() -> None:
    up, down = claim("increasing", over="delta"), claim("decreasing", over="delta")
    assert way(up, lambda c: c["delta"]) is True
    assert way(down, lambda c: c["delta"]) is False
    assert way(down, lambda c: -c["delta"]) is True
    for one in (up, down):
        assert way(one, lambda c: 1.0) is False
        assert way(one, lambda c: (c["delta"] - 1.5) ** 2) is False  # neighbours, not the ends


def test_other_conditions_are_no_level_of_alpha() -> None:
    """Neither the free runs nor a condition outside the paper's grid has an α."""
    up = claim("increasing", over="alpha")
    trend = claim("increasing", over="delta", for_each="alpha")

    def value(cell: Cell) -> float:
        return float(cell["alpha"]) if cell["alpha"] in ("0", "0.5", "1") else -5.0

    for name in ("none", "early stop without K"):
        assert way(up, value, alphas=("0", "0.5", "1", name)) is True
        assert way(trend, lambda c: c["delta"] * (value(c) + 1), alphas=("0", "0.5", "1", name)) is True


def test_a_level_of_the_grid_that_was_not_measured_leaves_the_claim_undecided() -> None:
    trend = claim("increasing", over="delta", for_each="alpha")
    assert way(trend, lambda c: c["delta"], alphas=("0", "0.5", "1")) is True
    assert way(trend, lambda c: c["delta"], alphas=("0.5", "1")) is None


def test_comparison_of_cells() -> None:
    sides: dict[str, Any] = {
        "where": {"alpha": ["0", "0.5"]},
        "than": {"alpha": ["none"]},
        "for_each": "delta",
    }
    more, less = claim("greater", **sides), claim("less", **sides)
    assert way(more, lambda c: 0.0 if c["alpha"] == "none" else 1.0) is True
    assert way(less, lambda c: 0.0 if c["alpha"] == "none" else 1.0) is False
    assert way(less, lambda c: 0.0 if c["alpha"] == "none" else -1.0) is True
    assert way(more, lambda c: 1.0 if c["alpha"] == "0" else 0.0) is False  # every pair must hold
    assert way(more, lambda c: 1.0 if c["alpha"] != "none" and c["delta"] < 4 else 0.0) is False  # every Δ
    assert len(contrasts_of(more, grid("m", lambda c: 0.0))) == 2 * 3


def test_comparison_with_a_value() -> None:
    cells: dict[str, Any] = {"where": {"alpha": ["0", "1"], "delta": [1.1]}, "value": 0.5}
    for value, least, most in ((0.6, True, False), (0.4, False, True)):
        assert way(claim("at_least", **cells), lambda c: value) is least  # noqa: B023
        assert way(claim("at_most", **cells), lambda c: value) is most  # noqa: B023
    for kind in ("at_least", "at_most"):  # the border belongs to the range
        border = claim(kind, where={"alpha": ["0"]}, value=0.5)
        assert contrasts_of(border, single(0.5, 0.5))["state"].tolist() == ["supports"]
    for distance, near in ((0.0, True), (0.09, True), (-0.09, True), (0.11, False), (-0.11, False)):
        assert way(claim("near", **cells, tolerance=0.1), lambda c: 0.5 + distance) is near  # noqa: B023
    assert way(claim("at_least", **cells), lambda c: 0.6 if c["alpha"] == "0" else 0.4) is False


def test_comparison_of_changes() -> None:
    ends: dict[str, Any] = {"over": "delta", "low": 1.1, "high": 4.0}
    gap = claim("larger_gap", where={"alpha": ["0"]}, than={"alpha": ["none"]}, **ends)
    assert way(gap, lambda c: c["delta"] if c["alpha"] == "0" else 0.0) is True
    assert way(gap, lambda c: -c["delta"] if c["alpha"] == "0" else 0.0) is False
    assert way(gap, lambda c: 5.0 if c["alpha"] == "0" else 0.0) is False  # a gap, but no larger one
    drop = claim("smallest_drop", where={"alpha": ["1"]}, than={"alpha": ["0", "0.5"]}, **ends)
    assert way(drop, lambda c: -0.1 * c["delta"] if c["alpha"] == "1" else -c["delta"]) is True
    assert way(drop, lambda c: -c["delta"] if c["alpha"] == "1" else -0.1 * c["delta"]) is False
    assert way(drop, lambda c: -c["delta"] if c["alpha"] != "0.5" else 0.0) is False


def test_the_levels_of_a_repeated_test_can_be_some_of_the_grid() -> None:
    one = claim("increasing", over="alpha", for_each="delta", only=(4.0,))
    table = grid("m", lambda c: float(c["alpha"]) if c["delta"] == 4.0 else 0.0, alphas=("0", "0.5", "1"))
    found = contrasts_of(one, table)
    assert found["delta"].tolist() == [4.0, 4.0] and points(found) is True
    assert found["contrast"].tolist() == ["Δ = 4.0: α = 0 to 0.5", "Δ = 4.0: α = 0.5 to 1"]
    assert points(contrasts_of(one, table[table["delta"] < 4])) is None


def test_a_contrast_of_two_conditions_is_welchs() -> None:
    """By scipy, with other spreads and sizes; who shares a seed does not matter."""
    one = claim("greater", where={"alpha": ["0"]}, than={"alpha": ["none"]})
    many, few = [1.0, 2.0, 6.0, 7.5, 3.0], [0.5, 0.7, -0.2]
    table = pd.concat([single(*many), single(*few).assign(alpha="none")])
    (row,) = contrasts_of(one, table).to_dict("records")
    expected = ttest_ind(many, few, equal_var=False).confidence_interval()
    assert (row["low"], row["high"]) == pytest.approx((expected.low, expected.high))
    assert row["estimate"] == pytest.approx(np.mean(many) - np.mean(few))
    assert (row["id"], row["least"], row["most"], row["n"]) == ("an-id", 0.0, math.inf, 3)
    assert row["points"] and math.isnan(row["delta"])
    shuffled = pd.concat([single(*many[::-1]), single(*few).assign(alpha="none")])
    assert contrasts_of(one, shuffled)["low"].iloc[0] == pytest.approx(row["low"])


def test_a_contrast_with_a_number_is_students() -> None:
    one = claim("at_least", where={"alpha": ["0"]}, value=1.5)
    (row,) = contrasts_of(one, single(1.0, 2.0, 6.0)).to_dict("records")
    expected = ttest_1samp([1.0, 2.0, 6.0], 1.5).confidence_interval()
    assert (row["low"] + 1.5, row["high"] + 1.5) == pytest.approx((expected.low, expected.high))


@pytest.mark.parametrize("one", [c for c in CLAIMS if c.than or c.where], ids=lambda c: c.id)
def test_a_cell_that_was_not_measured_leaves_the_claim_open(one: Claim) -> None:
    extra = {*one.where.get("alpha", []), *one.than.get("alpha", [])} - set(ALPHAS)
    table = grid(one.measure, truth(one), alphas=(*ALPHAS, *extra))
    cell = {name: values[-1] for name, values in one.where.items()}
    missing = table[[not matches(row, {n: [v] for n, v in cell.items()}) for row in table.to_dict("records")]]
    assert len(missing) < len(table)
    assert points(contrasts_of(one, missing)) is None


def test_a_gap_in_the_grid_leaves_a_trend_open() -> None:
    one = claim("increasing", over="alpha", for_each="delta")
    table = grid("m", lambda c: level(one, c))
    gap = (table["alpha"] == "0.5") & (table["delta"] == 1.5)
    assert points(contrasts_of(one, table[~gap])) is None
    assert points(contrasts_of(one, table)) is True


def test_nothing_measured_is_no_verdict() -> None:
    nothing = pd.DataFrame(columns=list(MEASURE_COLUMNS))
    for one in CLAIMS:
        assert points(contrasts_of(one, nothing)) is None


def test_measures_without_delta_can_be_judged() -> None:
    """As those of a region: its seed is that of the dataset."""
    rows = [("m", alpha, None, 0, value) for alpha, value in (("0", 0.9), ("0.5", 0.8), ("1", 0.6))]
    table = pd.DataFrame(rows, columns=list(MEASURE_COLUMNS))
    assert points(contrasts_of(claim("decreasing", over="alpha"), table)) is True
    assert points(contrasts_of(claim("at_least", where={"alpha": ["0", "1"]}, value=0.7), table)) is False


@pytest.mark.parametrize(
    ("states", "expected"),
    [
        ("supports, supports", "reproduced"),
        ("supports, contradicts, open", "partly"),
        ("supports, open", "partly"),
        ("supports, practically nothing", "partly"),
        ("contradicts, open", "not reproduced"),
        ("contradicts, practically nothing", "not reproduced"),
        ("practically nothing, practically nothing", "not reproduced"),
        ("practically nothing, open", "open"),
        ("open", "open"),
        ("supports, not measured", "not measured"),
        ("contradicts, not measured", "not measured"),
    ],
)
def test_the_rule_of_the_verdict(states: str, expected: str) -> None:
    assert set(states.split(", ")) <= set(STATES) and expected in VERDICTS
    assert verdict(pd.Series(states.split(", "))) == expected


def single(*values: float) -> pd.DataFrame:
    """Measures of one cell, a seed a value."""
    rows = [("m", "0", 1.1, seed, value) for seed, value in enumerate(values)]
    return pd.DataFrame(rows, columns=list(MEASURE_COLUMNS))


@pytest.mark.parametrize("kind", ["at_least", "at_most", "near", "most_runs"])
def test_an_interval_wholly_on_one_side_decides(kind: str) -> None:
    one = claim(kind, where={"alpha": ["0"]}, value=1.0, tolerance=0.2)
    sides = {"at_least": (2.0, 0.0, 1.0), "at_most": (0.0, 2.0, 1.0), "near": (1.0, 2.0, 1.2)}
    inside, outside, border = sides.get(kind, (2.0, 0.0, 0.0))
    jitter = 0.01 * np.arange(-5, 6)
    noise = 0.5 * jitter if kind in INCLUSIVE else np.where(np.arange(11) < 6, 1.5, 0.0)
    for middle, state in ((inside, "supports"), (outside, "contradicts")):
        assert contrasts_of(one, single(*(middle + jitter)))["state"].tolist() == [state]
    assert contrasts_of(one, single(*(border + noise)))["state"].tolist() == ["open"]
    assert contrasts_of(one, single(inside))["state"].tolist() == ["open"]  # one run has no interval


@pytest.mark.parametrize(
    ("middle", "spread", "state"),
    [
        (0.5, 0.1, "supports"),
        (-0.5, 0.1, "contradicts"),
        (0.0, 0.05, "practically nothing"),
        (0.0, 0.5, "open"),
        (0.05, 0.01, "supports"),  # small, but surely there: the sign comes first
        (-0.05, 0.01, "contradicts"),
        (0.095, 0.1, "open"),  # of either sign, and perhaps more than the smallest effect
        (0.0, 0.0, "practically nothing"),
    ],
)
def test_a_difference_is_judged_by_its_sign_and_then_by_its_size(
    middle: float, spread: float, state: str
) -> None:
    """A smallest effect of 0.1; of ten runs each, so that the interval is ± 0.99 times the spread."""
    one = claim("greater", where={"alpha": ["0"]}, than={"alpha": ["none"]}, effect=0.1)
    noise = spread * np.array([-1.0, 1.0] * 5)
    table = pd.concat([single(*(middle + noise)), single(*noise).assign(alpha="none")])
    (row,) = contrasts_of(one, table).to_dict("records")
    assert row["state"] == state
    assert row["high"] - row["low"] == pytest.approx(2 * 0.99 * spread, rel=0.02, abs=1e-12)


def test_a_number_is_not_a_difference_that_could_be_practically_nothing() -> None:
    one = claim("at_least", where={"alpha": ["0"]}, value=1.0, effect=10.0)
    assert contrasts_of(one, single(0.0, 2.0, 1.0, 1.2))["state"].tolist() == ["open"]


@pytest.mark.parametrize(
    ("middle", "spread", "state"),
    [
        (1.4, 0.2, "supports"),
        (1.9, 0.35, "supports"),  # contains 2.314 too, but not 5.806
        (4.0, 0.2, "contradicts"),
        (0.5, 0.2, "contradicts"),
        (3.0, 2.0, "open"),  # contains all three: it cannot tell them apart
    ],
)
def test_a_rate_of_the_paper_is_predicted_and_told_from_its_others(
    middle: float, spread: float, state: str
) -> None:
    one = next(c for c in CLAIMS if c.id == "rate-mnd")
    values = middle + spread * np.array([-1.0, 1.0] * 5)
    table = single(*values).assign(measure=one.measure)
    (row,) = contrasts_of(one, table).to_dict("records")
    assert row["state"] == state
    half = 2.262 * values.std(ddof=1) * math.sqrt(1 + 1 / 10)
    assert (row["low"] + one.value, row["high"] + one.value) == pytest.approx(
        (middle - half, middle + half), abs=1e-2
    )
    assert contrasts_of(one, table[:1])["state"].tolist() == ["open"]


def test_the_verdict_of_the_first_three_seeds_stands_beside_that_of_all() -> None:
    """Ten values decide what three of them leave open; data that have no seed count for both."""
    one = claim("at_least", where={"alpha": ["0"]}, value=0.0)
    values = 1.0 + np.array([-1.0, 1.0] * 5)  # s about 1: half-widths 0.75 of ten and 2.6 of three
    (row,) = judge_claims([one], single(*values))[0].to_dict("records")
    assert (row["verdict"], row["verdict_of_three"], row["n"]) == ("reproduced", "open", 10)
    (row,) = judge_claims([one], single(1.0, 1.0).assign(seed=math.nan))[0].to_dict("records")
    assert row["verdict_of_three"] == row["verdict"] == "reproduced"


def test_every_claim_has_a_verdict_and_every_contrast_a_state() -> None:
    tables = [grid(name, lambda c: 0.5) for name in {c.measure for c in CLAIMS}]
    summary, contrasts = judge_claims(CLAIMS, pd.concat(tables, ignore_index=True))
    assert summary["id"].tolist() == [c.id for c in CLAIMS] and set(contrasts["id"]) == set(summary["id"])
    assert summary["verdict"].isin(VERDICTS).all() and contrasts["state"].isin(STATES).all()
    assert (summary[list(STATES)].sum(axis=1) == contrasts.groupby("id", sort=False).size().to_numpy()).all()
    nothing, _ = judge_claims(CLAIMS, pd.DataFrame(columns=list(MEASURE_COLUMNS)))
    assert set(nothing["verdict"]) == {"not measured"}
