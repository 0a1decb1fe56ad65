"""Claims: each can hold and can fail on made-up measures, and says nothing where none were taken."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import ttest_rel

from replication.evidence.claims import (
    INCLUSIVE,
    KINDS,
    MEASURE_COLUMNS,
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
    parts: dict[str, Any] = {"tolerance": 0.0} | values
    return Claim("an-id", "statement", "place", "m", kind, reason="reason", **parts)


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
    if one.kind == "near":
        return lambda c: one.value + (0.0 if sign > 0 else one.tolerance + 0.01)
    return lambda c: margin if matches(c, one.where) and c[one.over] == one.high else 0.0


def test_the_file_holds_known_claims_with_one_id_each() -> None:
    ids = [c.id for c in CLAIMS]
    assert len(ids) == len(set(ids)) > 0
    for c in CLAIMS:
        assert c.kind in KINDS
        assert all((c.id, c.statement, c.place, c.measure, c.reason))
        assert c.tolerance >= 0
        for column in (c.for_each, c.over, *c.where, *c.than):
            assert column in ("", *MEASURE_COLUMNS[1:4])
        for cell in (c.where, c.than):
            assert all(isinstance(a, str) for a in cell.get("alpha", []))
            assert all(d in DELTAS for d in cell.get("delta", []))


def test_an_ill_posed_claim_is_joined_by_another() -> None:
    """And nothing else is: a better test says which one it joins, and is itself well-posed."""
    joined = {c.joins for c in CLAIMS if c.joins}
    assert joined == {c.id for c in CLAIMS if c.ill_posed} != set()
    assert not any(c.joins and c.ill_posed for c in CLAIMS)


def test_every_kind_but_none_other_is_known() -> None:
    for kind in KINDS:
        claim(kind)
    with pytest.raises(ValueError, match="claim an-id: unknown kind"):
        claim("equal")


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
    assert way(claim("increasing", over="delta", tolerance=0.3), lambda c: c["delta"]) is True
    assert way(claim("increasing", over="delta", tolerance=0.5), lambda c: c["delta"]) is False


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
    for value, least, most in ((0.6, True, False), (0.4, False, True), (0.5, True, True)):
        assert way(claim("at_least", **cells, tolerance=0.0), lambda c: value) is least  # noqa: B023
        assert way(claim("at_most", **cells, tolerance=0.0), lambda c: value) is most  # noqa: B023
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


def test_estimates_are_differences_of_means_over_seeds() -> None:
    one = claim("greater", where={"alpha": ["0"], "delta": [4.0]}, than={"alpha": ["none"], "delta": [4.0]})
    table = grid("m", lambda c: 0.0)
    table.loc[(table["alpha"] == "0") & (table["delta"] == 4.0), "value"] = [1.0, 2.0, 6.0]
    (row,) = contrasts_of(one, table).to_dict("records")
    assert row["estimate"] == pytest.approx(3.0)
    assert row["n"] == 3 and row["points"]
    assert (row["id"], row["least"], row["most"]) == ("an-id", 0.0, math.inf)
    assert row["spread"] == pytest.approx(np.std([1.001, 2.0, 5.999], ddof=1))
    assert (row["low"], row["high"]) == pytest.approx(
        ttest_rel([1.0, 2, 6], [-0.001, 0, 0.001]).confidence_interval()
    )


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
        ("supports supports", "reproduced"),
        ("supports contradicts unresolved", "partly"),
        ("contradicts unresolved", "not reproduced"),
        ("supports unresolved", "inconclusive"),
        ("supports not_measured", "inconclusive"),
        ("unresolved", "inconclusive"),
    ],
)
def test_the_rule_of_the_verdict(states: str, expected: str) -> None:
    assert verdict(pd.DataFrame({"state": [s.replace("_", " ") for s in states.split()]})) == expected


def single(*values: float) -> pd.DataFrame:
    """Measures of one cell, a seed a value."""
    rows = [("m", "0", 1.1, seed, value) for seed, value in enumerate(values)]
    return pd.DataFrame(rows, columns=list(MEASURE_COLUMNS))


@pytest.mark.parametrize("kind", [*INCLUSIVE, "most_runs"])
def test_an_interval_wholly_on_one_side_decides(kind: str) -> None:
    one = claim(kind, where={"alpha": ["0"]}, value=1.0, tolerance=0.2)
    sides = {"at_least": (2.0, 0.0, 1.2), "at_most": (0.0, 2.0, 0.8), "near": (1.0, 2.0, 1.2)}
    inside, outside, border = sides.get(kind, (2.0, 0.0, 0.0))
    jitter = 0.01 * np.arange(-5, 6)
    noise = 0.5 * jitter if kind != "most_runs" else np.where(np.arange(11) < 6, 1.5, 0.0)
    for middle, state in ((inside, "supports"), (outside, "contradicts")):
        assert contrasts_of(one, single(*(middle + jitter)))["state"].tolist() == [state]
    assert contrasts_of(one, single(*(border + noise)))["state"].tolist() == ["unresolved"]
    assert contrasts_of(one, single(inside))["state"].tolist() == ["unresolved"]  # one run has no interval


def test_pairs_are_taken_by_seed_and_runs_without_partner_left_out() -> None:
    """A difference that is the same in every seed is known exactly, however far the seeds lie apart."""
    one = claim("greater", where={"alpha": ["1"]}, than={"alpha": ["0"]})
    low, high = single(1.0, 5.0, 9.0, 2.0), single(2.0, 6.1, 9.9).assign(alpha="1")
    (row,) = contrasts_of(one, pd.concat([low, high])).to_dict("records")
    assert row["n"] == 3 and row["estimate"] == pytest.approx(1.0)
    assert row["state"] == "supports" and row["correlation"] > 0.99


def test_what_three_seeds_could_not_have_resolved() -> None:
    one = claim("at_least", where={"alpha": ["0"]}, value=0.0)
    values = 1.0 + np.array([-1.0, 1.0] * 5)  # s about 1: half-widths 0.75 of ten and 2.6 of three
    (row,) = contrasts_of(one, single(*values)).to_dict("records")
    assert (row["state"], row["state_of_three"]) == ("supports", "unresolved")


def test_a_verdict_that_rests_on_one_contrast_of_many_is_corrected() -> None:
    """p = 0.03 contradicts, but not among six; a claim whose contrasts all support it needs no correction."""
    one = claim("greater", where={"alpha": ["0", "0.5"]}, than={"alpha": ["none"]}, for_each="delta")
    noise = np.array([-1.0, 1.0] * 5)
    rows = []
    for alpha, delta in itertools.product(("0", "0.5", "none"), DELTAS):
        shift = -0.85 if (alpha, delta) == ("0", 4.0) else 0.0
        values = np.zeros(10) if alpha == "none" else noise + shift
        rows.append(single(*values).assign(alpha=alpha, delta=delta))
    table = pd.concat(rows)
    summary, contrasts = judge_claims([one], table)
    assert sorted(set(contrasts["state"])) == ["contradicts", "unresolved"]
    assert summary[["verdict", "corrected"]].iloc[0].tolist() == ["not reproduced", "inconclusive"]
    table.loc[table["alpha"] != "none", "value"] += 1.8
    assert judge_claims([one], table)[0][["verdict", "corrected"]].iloc[0].tolist() == [
        "reproduced",
        "reproduced",
    ]
