"""Claims: each can hold and can fail on made-up measures, and says nothing where none were taken."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import pandas as pd
import pytest

from srlrepro.claims import KINDS, MEASURE_COLUMNS, VERDICTS, Cell, Claim, evaluate, holds, load

ALPHAS, DELTAS, SEEDS = ("0", "0.5", "1", "none"), (1.1, 1.5, 4.0), (0, 1, 2)
Value = Callable[[Cell], float]
CLAIMS = load()


def grid(measure: str, value: Value, alphas: tuple[str, ...] = ALPHAS) -> pd.DataFrame:
    """Measures of every cell: seeds differ by ±0.001 around the value of the cell."""
    rows = [
        (measure, a, d, s, value({"alpha": a, "delta": d}) + 0.001 * (s - 1))
        for a, d, s in itertools.product(alphas, DELTAS, SEEDS)
    ]
    return pd.DataFrame(rows, columns=list(MEASURE_COLUMNS))


def claim(kind: str, **values: Any) -> Claim:
    parts: dict[str, Any] = {"tolerance": 0.0, "verdict": "open"} | values
    return Claim("an-id", "statement", "place", "m", kind, reason="reason", **parts)


def judge(one: Claim, value: Value, **options: Any) -> bool | None:
    return holds(evaluate(one, grid(one.measure, value, **options)))


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
    if one.kind == "near":
        return lambda c: one.value + (0.0 if sign > 0 else one.tolerance + 0.01)
    return lambda c: margin if matches(c, one.where) and c[one.over] == one.high else 0.0


def test_the_file_holds_known_claims_with_one_id_each() -> None:
    ids = [c.id for c in CLAIMS]
    assert len(ids) == len(set(ids)) > 0
    for c in CLAIMS:
        assert c.kind in KINDS
        assert c.verdict in VERDICTS
        assert all((c.id, c.statement, c.place, c.measure, c.reason))
        assert c.tolerance >= 0
        for column in (c.for_each, c.over, *c.where, *c.than):
            assert column in ("", *MEASURE_COLUMNS[1:4])
        for cell in (c.where, c.than):
            assert all(isinstance(a, str) for a in cell.get("alpha", []))
            assert all(d in DELTAS for d in cell.get("delta", []))


def test_every_kind_but_none_other_is_known() -> None:
    for kind in KINDS:
        claim(kind)
    for bad in ({"kind": "equal"}, {"kind": "near", "verdict": "sure"}):
        with pytest.raises(ValueError, match="claim an-id: unknown kind"):
            claim(**bad)


@pytest.mark.parametrize("one", CLAIMS, ids=lambda c: c.id)
def test_every_claim_of_the_file_can_hold_and_can_fail(one: Claim) -> None:
    extra = {*one.where.get("alpha", []), *one.than.get("alpha", [])} - set(ALPHAS)
    alphas = (*ALPHAS, *extra) if one.over != "alpha" and one.for_each != "alpha" else ALPHAS[:-1]
    assert judge(one, truth(one), alphas=alphas) is True
    assert judge(one, truth(one, -1.0), alphas=alphas) is False
    assert holds(evaluate(one, grid("another measure", truth(one)))) is None


def test_order_along_a_column() -> None:
    up, down = claim("increasing", over="delta"), claim("decreasing", over="delta")
    assert judge(up, lambda c: c["delta"]) is True
    assert judge(down, lambda c: c["delta"]) is False
    assert judge(down, lambda c: -c["delta"]) is True
    for one in (up, down):
        assert judge(one, lambda c: 1.0) is False
        assert judge(one, lambda c: (c["delta"] - 1.5) ** 2) is False  # neighbours, not the ends
    assert judge(claim("increasing", over="delta", tolerance=0.3), lambda c: c["delta"]) is True
    assert judge(claim("increasing", over="delta", tolerance=0.5), lambda c: c["delta"]) is False


def test_other_conditions_are_no_level_of_alpha() -> None:
    """Neither the free runs nor a condition outside the paper's grid has an α."""
    up = claim("increasing", over="alpha")
    trend = claim("increasing", over="delta", for_each="alpha")

    def value(cell: Cell) -> float:
        return float(cell["alpha"]) if cell["alpha"] in ("0", "0.5", "1") else -5.0

    for name in ("none", "early stop without K"):
        assert judge(up, value, alphas=("0", "0.5", "1", name)) is True
        assert judge(trend, lambda c: c["delta"] * (value(c) + 1), alphas=("0", "0.5", "1", name)) is True


def test_a_level_of_the_grid_that_was_not_measured_leaves_the_claim_undecided() -> None:
    trend = claim("increasing", over="delta", for_each="alpha")
    assert judge(trend, lambda c: c["delta"], alphas=("0", "0.5", "1")) is True
    assert judge(trend, lambda c: c["delta"], alphas=("0.5", "1")) is None


def test_comparison_of_cells() -> None:
    sides: dict[str, Any] = {
        "where": {"alpha": ["0", "0.5"]},
        "than": {"alpha": ["none"]},
        "for_each": "delta",
    }
    more, less = claim("greater", **sides), claim("less", **sides)
    assert judge(more, lambda c: 0.0 if c["alpha"] == "none" else 1.0) is True
    assert judge(less, lambda c: 0.0 if c["alpha"] == "none" else 1.0) is False
    assert judge(less, lambda c: 0.0 if c["alpha"] == "none" else -1.0) is True
    assert judge(more, lambda c: 1.0 if c["alpha"] == "0" else 0.0) is False  # every pair must hold
    assert judge(more, lambda c: 1.0 if c["alpha"] != "none" and c["delta"] < 4 else 0.0) is False  # every Δ
    assert len(evaluate(more, grid("m", lambda c: 0.0))) == 2 * 3


def test_comparison_with_a_value() -> None:
    cells: dict[str, Any] = {"where": {"alpha": ["0", "1"], "delta": [1.1]}, "value": 0.5}
    for value, least, most in ((0.6, True, False), (0.4, False, True), (0.5, True, True)):
        assert judge(claim("at_least", **cells, tolerance=0.0), lambda c: value) is least  # noqa: B023
        assert judge(claim("at_most", **cells, tolerance=0.0), lambda c: value) is most  # noqa: B023
    for distance, near in ((0.0, True), (0.09, True), (-0.09, True), (0.11, False), (-0.11, False)):
        assert judge(claim("near", **cells, tolerance=0.1), lambda c: 0.5 + distance) is near  # noqa: B023
    assert judge(claim("at_least", **cells), lambda c: 0.6 if c["alpha"] == "0" else 0.4) is False


def test_comparison_of_changes() -> None:
    ends: dict[str, Any] = {"over": "delta", "low": 1.1, "high": 4.0}
    gap = claim("larger_gap", where={"alpha": ["0"]}, than={"alpha": ["none"]}, **ends)
    assert judge(gap, lambda c: c["delta"] if c["alpha"] == "0" else 0.0) is True
    assert judge(gap, lambda c: -c["delta"] if c["alpha"] == "0" else 0.0) is False
    assert judge(gap, lambda c: 5.0 if c["alpha"] == "0" else 0.0) is False  # a gap, but no larger one
    drop = claim("smallest_drop", where={"alpha": ["1"]}, than={"alpha": ["0", "0.5"]}, **ends)
    assert judge(drop, lambda c: -0.1 * c["delta"] if c["alpha"] == "1" else -c["delta"]) is True
    assert judge(drop, lambda c: -c["delta"] if c["alpha"] == "1" else -0.1 * c["delta"]) is False
    assert judge(drop, lambda c: -c["delta"] if c["alpha"] != "0.5" else 0.0) is False


def test_estimates_are_differences_of_means_over_seeds() -> None:
    one = claim("greater", where={"alpha": ["0"], "delta": [4.0]}, than={"alpha": ["none"], "delta": [4.0]})
    table = grid("m", lambda c: 0.0)
    table.loc[(table["alpha"] == "0") & (table["delta"] == 4.0), "value"] = [1.0, 2.0, 6.0]
    (row,) = evaluate(one, table).to_dict("records")
    assert row["estimate"] == pytest.approx(3.0)
    assert row["seeds"] == 3
    assert row["holds"] is True or row["holds"] == 1
    assert (row["id"], row["threshold"]) == ("an-id", 0.0)


@pytest.mark.parametrize("one", [c for c in CLAIMS if c.than or c.where], ids=lambda c: c.id)
def test_a_cell_that_was_not_measured_leaves_the_claim_open(one: Claim) -> None:
    extra = {*one.where.get("alpha", []), *one.than.get("alpha", [])} - set(ALPHAS)
    table = grid(one.measure, truth(one), alphas=(*ALPHAS, *extra))
    cell = {name: values[-1] for name, values in one.where.items()}
    missing = table[[not matches(row, {n: [v] for n, v in cell.items()}) for row in table.to_dict("records")]]
    assert len(missing) < len(table)
    assert holds(evaluate(one, missing)) is None


def test_a_gap_in_the_grid_leaves_a_trend_open() -> None:
    one = claim("increasing", over="alpha", for_each="delta")
    table = grid("m", lambda c: level(one, c))
    gap = (table["alpha"] == "0.5") & (table["delta"] == 1.5)
    assert holds(evaluate(one, table[~gap])) is None
    assert holds(evaluate(one, table)) is True


def test_nothing_measured_is_no_verdict() -> None:
    nothing = pd.DataFrame(columns=list(MEASURE_COLUMNS))
    for one in CLAIMS:
        assert holds(evaluate(one, nothing)) is None


def test_measures_without_delta_and_seed_can_be_judged() -> None:
    """As those of a region, which knows neither."""
    rows = [("m", alpha, None, None, value) for alpha, value in (("0", 0.9), ("0.5", 0.8), ("1", 0.6))]
    table = pd.DataFrame(rows, columns=list(MEASURE_COLUMNS))
    assert holds(evaluate(claim("decreasing", over="alpha"), table)) is True
    assert holds(evaluate(claim("at_least", where={"alpha": ["0", "1"]}, value=0.7), table)) is False
