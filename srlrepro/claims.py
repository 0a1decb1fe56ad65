"""The paper's claims as data (``claims.toml``), and the code that evaluates them on result tables.

A claim is tested on *measures*: a table with the columns measure, alpha, delta, seed, value, in which alpha
is the text of α or "none", and delta and seed are empty where the measure does not depend on them. Every
test compares means over seeds and becomes one or more *contrasts*; the claim holds if each contrast exceeds
its tolerance:

=================  =====================================================================
kind               contrasts
=================  =====================================================================
decreasing         m(a) − m(b) for neighbours a < b along ``over``
increasing         m(b) − m(a)
greater, less      ± (m(where) − m(than)), for every pair
at_least, at_most  ± (m(where) − value)
near               −|m(where) − value|, which must exceed −tolerance
larger_gap         gap(high) − gap(low), gap = m(where) − m(than)
smallest_drop      drop(than) − drop(where), drop = m(low) − m(high)
=================  =====================================================================

``for_each`` repeats the test for every value of that column. Both run over the paper's grid, so that a level
that was not measured leaves the claim undecided instead of dropping out.
"""

import itertools
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any

import pandas as pd

MEASURE_COLUMNS = ("measure", "alpha", "delta", "seed", "value")
KINDS = (
    "decreasing",
    "increasing",
    "greater",
    "less",
    "at_least",
    "at_most",
    "near",
    "larger_gap",
    "smallest_drop",
)
VERDICTS = ("open", "reproduced", "partly", "not reproduced", "inconclusive")
Cell = dict[str, Any]
Grid = dict[str, list[Any]]
GRID: Grid = {"alpha": ["0", "0.5", "1"], "delta": [1.1, 1.5, 4.0]}  # Sec. IV


@dataclass(frozen=True)
class Claim:
    """One claim of the paper and its test; ``claims.toml`` says what the fields mean."""

    id: str
    statement: str
    place: str
    measure: str
    kind: str
    tolerance: float
    reason: str
    verdict: str
    where: dict[str, list[Any]] = field(default_factory=dict)
    than: dict[str, list[Any]] = field(default_factory=dict)
    for_each: str = ""
    over: str = ""
    value: float = 0.0
    low: float = 0.0
    high: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS or self.verdict not in VERDICTS:
            raise ValueError(f"claim {self.id}: unknown kind {self.kind!r} or verdict {self.verdict!r}")


def load() -> list[Claim]:
    """The claims, in the order of the file."""
    data = tomllib.loads(files("srlrepro").joinpath("claims.toml").read_text(encoding="utf-8"))
    return [Claim(**entry) for entry in data["claim"]]


def _cells(selection: dict[str, list[Any]]) -> list[Cell]:
    names = list(selection)
    return [dict(zip(names, values, strict=True)) for values in itertools.product(*selection.values())]


def _mean(table: pd.DataFrame, cell: Cell) -> float:
    for column, value in cell.items():
        table = table[table[column] == value]
    return float(table["value"].mean())  # NaN if the cell was not measured


def _contrasts(claim: Claim, table: pd.DataFrame, fixed: Cell, grid: Grid) -> Iterator[tuple[str, float]]:
    """(what is compared, how far it points the claim's way) for one value of ``for_each``."""
    kind, sign = claim.kind, -1.0 if claim.kind in ("less", "at_most", "decreasing") else 1.0
    where, than = _cells(claim.where), _cells(claim.than)
    if kind in ("decreasing", "increasing"):
        for a, b in itertools.pairwise(grid[claim.over]):
            means = [_mean(table, {**fixed, claim.over: level}) for level in (a, b)]
            yield f"{claim.over} {a} to {b}", sign * (means[1] - means[0])
    elif kind in ("greater", "less"):
        for a, b in itertools.product(where, than):
            difference = _mean(table, {**fixed, **a}) - _mean(table, {**fixed, **b})
            yield f"{_text(a)} against {_text(b)}", sign * difference
    elif kind in ("at_least", "at_most"):
        for a in where:
            yield f"{_text(a)} against {claim.value}", sign * (_mean(table, {**fixed, **a}) - claim.value)
    elif kind == "near":
        for a in where:
            yield f"{_text(a)} from {claim.value}", -abs(_mean(table, {**fixed, **a}) - claim.value)
    else:
        low, high = {claim.over: claim.low}, {claim.over: claim.high}
        for a, b in itertools.product(where, than):
            change_a, change_b = (_mean(table, {**c, **high}) - _mean(table, {**c, **low}) for c in (a, b))
            yield (
                f"{_text(a)} against {_text(b)}, {claim.over} {claim.low} to {claim.high}",
                change_a - change_b,
            )


def _text(cell: Cell) -> str:
    return " ".join(f"{name} {value}" for name, value in cell.items())


def evaluate(claim: Claim, measures: pd.DataFrame, grid: Grid = GRID) -> pd.DataFrame:
    """The contrasts of a claim over the grid: columns id, contrast, estimate, threshold, seeds, holds.

    ``holds`` is empty where a cell was not measured; ``seeds`` is the number of seeds behind the means.
    A table with no rows means that nothing was measured at all.
    """
    table = measures[measures["measure"] == claim.measure]
    levels = grid[claim.for_each] if claim.for_each else [None]
    threshold = -claim.tolerance if claim.kind == "near" else claim.tolerance
    strict = claim.kind not in ("near", "at_least", "at_most")
    rows = []
    for level in levels:
        fixed: Cell = {claim.for_each: level} if claim.for_each else {}
        prefix = f"{_text(fixed)}: " if fixed else ""
        for contrast, estimate in _contrasts(claim, table, fixed, grid):
            holds = None if pd.isna(estimate) else estimate > threshold if strict else estimate >= threshold
            rows.append((claim.id, prefix + contrast, estimate, threshold, table["seed"].nunique(), holds))
    columns = ["id", "contrast", "estimate", "threshold", "seeds", "holds"]
    return pd.DataFrame(rows, columns=columns)


def holds(contrasts: pd.DataFrame) -> bool | None:
    """Whether every contrast holds; None if one was not measured, or there is none."""
    if contrasts.empty or contrasts["holds"].isna().any():
        return None
    return bool(contrasts["holds"].all())
