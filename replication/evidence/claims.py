"""The paper's claims as data (``claims.toml``), and the code that judges them on tables of measures.

A claim is tested on *measures*: a table with the columns measure, alpha, delta, seed, value, in which alpha
is the text of α or "none", delta is empty where the measure does not depend on it, and seed is that of the
run, or of the dataset where nothing was trained. Every test becomes one or more *contrasts*, each the mean
over seeds of a difference that is taken seed by seed, as every condition has the same seeds. A contrast has a
range in which the claim holds:

=================  ==========================================================  ==========================
kind               contrast, positive towards the claim                        the claim holds
=================  ==========================================================  ==========================
decreasing         m(a) − m(b) for neighbours a < b along ``over``             above tolerance
increasing         m(b) − m(a)                                                 above tolerance
greater, less      ± (m(where) − m(than)), for every pair                      above tolerance
at_least, at_most  ± (m(where) − value)                                        from tolerance on
near               m(where) − value                                            within ± tolerance
larger_gap         gap(high) − gap(low), gap = m(where) − m(than)              above tolerance
smallest_drop      drop(than) − drop(where), drop = m(low) − m(high)           above tolerance
most_runs          share of the runs with m(where) ≥ value                     above one half + tolerance
=================  ==========================================================  ==========================

``for_each`` repeats the test for every value of that column. Both run over the paper's grid, so that a level
that was not measured leaves the claim undecided instead of dropping out.

**The rule**, fixed before the larger set of seeds existed. A contrast *supports* the claim if its whole 95 %
interval lies in that range, *contradicts* it if the whole interval lies outside, and is *unresolved*
otherwise. A claim is

- **reproduced** if every contrast supports it,
- **partly** reproduced if at least one supports and at least one contradicts it,
- **not reproduced** if at least one contradicts and none supports it,
- **inconclusive** otherwise.

Many contrasts: that *all* of them support is an intersection-union test (Berger, 1982), whose error is at
most that of a single one, 2.5 %, without any correction. A verdict that rests on *some* contrast is not
protected in that way: it is also given, as ``corrected``, with intervals that hold for all contrasts of the
claim together (Bonferroni).
"""

import itertools
import math
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any

import pandas as pd

from replication.evidence.statistics import LEVEL, mean_interval, share_interval

MEASURE_COLUMNS = ("measure", "alpha", "delta", "seed", "value")
INCLUSIVE = ("at_least", "at_most", "near")  # the border belongs to the range in which the claim holds
DIFFERENCES = ("decreasing", "increasing", "greater", "less", "larger_gap", "smallest_drop")
KINDS = (*DIFFERENCES, *INCLUSIVE, "most_runs")
STATES = ("supports", "contradicts", "unresolved", "not measured")
VERDICTS = ("reproduced", "partly", "not reproduced", "inconclusive")
PAPER_SEEDS = 3  # Sec. IV-A
RATES = ("success-mnd", "success-mix", "success-ud")  # 80.8, 91.0 and 99.7 %
SYMBOLS = {"alpha": "α", "delta": "Δ"}
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
    paper: str = ""
    ill_posed: str = ""
    joins: str = ""
    where: dict[str, list[Any]] = field(default_factory=dict)
    than: dict[str, list[Any]] = field(default_factory=dict)
    for_each: str = ""
    over: str = ""
    value: float = 0.0
    low: float = 0.0
    high: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"claim {self.id}: unknown kind {self.kind!r}")

    @property
    def holds_within(self) -> tuple[float, float]:
        """(least, most) value of a contrast for which the claim holds."""
        if self.kind == "near":
            return -self.tolerance, self.tolerance
        return self.tolerance + (0.5 if self.kind == "most_runs" else 0.0), math.inf


def load_claims() -> list[Claim]:
    """The paper's claims, in the order of the file."""
    data = tomllib.loads(files("replication.evidence").joinpath("claims.toml").read_text(encoding="utf-8"))
    return [Claim(**entry) for entry in data["claim"]]


def _cells(selection: dict[str, list[Any]]) -> list[Cell]:
    return [dict(zip(selection, values, strict=True)) for values in itertools.product(*selection.values())]


def _text(cell: Cell) -> str:
    text = ", ".join(f"{SYMBOLS[name]} = {value}" for name, value in cell.items())
    return text.replace("α = none", "no supervisor")


def _contrasts(
    claim: Claim, table: pd.DataFrame, fixed: Cell, grid: Grid
) -> Iterator[tuple[str, pd.Series, pd.Series | float]]:
    """(what is compared, a, b) for one value of ``for_each``: the claim says that a − b is large."""

    def values(cell: Cell) -> pd.Series:  # by seed; none if the cell was not measured
        own = table
        for column, value in (fixed | cell).items():
            own = own[own[column] == value]
        return own.groupby("seed")["value"].mean()

    where, than = _cells(claim.where), _cells(claim.than)
    if claim.kind in ("decreasing", "increasing"):
        for levels in itertools.pairwise(grid[claim.over]):
            larger, smaller = levels if claim.kind == "decreasing" else levels[::-1]
            name = f"{SYMBOLS[claim.over]} = {levels[0]} to {levels[1]}"
            yield name, values({claim.over: larger}), values({claim.over: smaller})
    elif claim.kind in ("greater", "less"):
        for a, b in itertools.product(where, than):
            larger, smaller = (a, b) if claim.kind == "greater" else (b, a)
            yield f"{_text(a)} against {_text(b)}", values(larger), values(smaller)
    elif claim.kind in ("larger_gap", "smallest_drop"):
        low, high = {claim.over: claim.low}, {claim.over: claim.high}
        for a, b in itertools.product(where, than):
            name = f"{_text(a)} against {_text(b)}, {SYMBOLS[claim.over]} = {claim.low} to {claim.high}"
            yield name, values(a | high) - values(a | low), values(b | high) - values(b | low)
    else:
        for a in where:
            measured, sign = values(a), -1.0 if claim.kind == "at_most" else 1.0
            name = f"{_text(a)} {'from' if claim.kind == 'near' else 'against'} {claim.value}"
            if claim.kind == "most_runs":
                yield name, (measured >= claim.value).astype(float), 0.0
            else:
                yield name, sign * measured, sign * claim.value


def _state(claim: Claim, low: float, high: float) -> str:
    """What an interval says of the claim: one of `STATES`, of an interval that is there."""
    least, most = claim.holds_within
    if (low > least and high < most) or (claim.kind in INCLUSIVE and low >= least and high <= most):
        return "supports"
    return "contradicts" if high < least or low > most else "unresolved"


def contrasts_of(
    claim: Claim, measures: pd.DataFrame, level: float = LEVEL, grid: Grid = GRID
) -> pd.DataFrame:
    """The contrasts of a claim over a grid, a row each.

    Columns: id, contrast; estimate, low, high: with its interval; least, most: where the claim holds; n: runs
    or datasets; spread: standard deviation over them; correlation: of the two conditions over seeds (pairing
    helps where it is positive); points: whether the estimate alone lies where the claim holds; state: one of
    `STATES`; half_width_of_three, state_of_three: of an interval of three seeds with this mean and spread;
    values: of the seeds, one by one.
    """
    table = measures[measures["measure"] == claim.measure]
    rows = []
    for fixed in _cells({claim.for_each: grid[claim.for_each]} if claim.for_each else {}):
        prefix = f"{_text(fixed)}: " if fixed else ""
        for name, a, b in _contrasts(claim, table, fixed, grid):
            values = (a - b).dropna()
            n, mean, spread = len(values), float(values.mean()), float(values.std())
            if claim.kind == "most_runs":
                low, high = share_interval(int(values.sum()), n, level)
                three = share_interval(round(mean * PAPER_SEEDS), PAPER_SEEDS, level) if n else (low, high)
            else:
                low, high = mean_interval(mean, spread, n, level)
                three = mean_interval(mean, spread, PAPER_SEEDS, level)
            row = {"id": claim.id, "contrast": prefix + name, "estimate": mean, "low": low, "high": high}
            row |= dict(zip(("least", "most"), claim.holds_within, strict=True))
            correlation = a.corr(b) if isinstance(b, pd.Series) and n > 2 and spread > 0 else math.nan
            row |= {"n": n, "spread": spread, "correlation": correlation}
            row["points"] = _state(claim, mean, mean) == "supports" if n else None
            row["state"] = _state(claim, low, high) if n else "not measured"
            row["half_width_of_three"] = (three[1] - three[0]) / 2
            row["state_of_three"] = _state(claim, *three) if n else "not measured"
            rows.append(row | {"values": " ".join(f"{value:.4g}" for value in values)})
    return pd.DataFrame(rows)


def margins(contrasts: pd.DataFrame) -> pd.Series:
    """How far each estimate lies within the range where the claim holds; NaN if it was not measured."""
    reach = contrasts["estimate"] - contrasts["least"], contrasts["most"] - contrasts["estimate"]
    return pd.concat(reach, axis=1).min(axis=1, skipna=False)


def points(contrasts: pd.DataFrame) -> bool | None:
    """Whether every estimate points the claim's way; None if one was not measured, or there is none."""
    if contrasts.empty or contrasts["points"].isna().any():
        return None
    return bool(contrasts["points"].all())


def verdict(contrasts: pd.DataFrame) -> str:
    """One of `VERDICTS`, by the rule that heads this module, for the contrasts of one claim."""
    states = set(contrasts["state"])
    if states == {"supports"}:
        return "reproduced"
    if "contradicts" in states:
        return "partly" if "supports" in states else "not reproduced"
    return "inconclusive"


def judge_claims(claims: list[Claim], measures: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The verdicts on claims, by tables of measures; and the contrasts of all.

    A row per claim: of its fields, its estimates in words, how many of its contrasts are in each state, the
    least n of them, its verdict and the corrected one.
    """
    rows, tables = [], []
    for claim in claims:
        table = contrasts_of(claim, measures)
        found = corrected = verdict(table)
        if found != "reproduced":  # an intersection-union test needs no correction
            corrected = verdict(contrasts_of(claim, measures, 1 - (1 - LEVEL) / len(table)))
        way = {None: "not measured", True: "the claim's way", False: "another way"}[points(table)]
        intervals = (f"{r.estimate:.3g} [{r.low:.3g}, {r.high:.3g}]" for r in table.itertuples())
        counts = {state: int((table["state"] == state).sum()) for state in STATES}
        row = {name: getattr(claim, name) for name in ("id", "statement", "place", "paper", "measure")}
        row |= {"estimates": "; ".join(intervals), "n": int(table["n"].min()), **counts}
        row |= {"points": way, "verdict": found, "corrected": corrected}
        rows.append(row | {name: getattr(claim, name) for name in ("ill_posed", "joins")})
        tables.append(table)
    return pd.DataFrame(rows), pd.concat(tables, ignore_index=True)
