"""The paper's claims as data (``claims.toml``), and the code that judges them on tables of measures.

A claim is tested on *measures*: a table with the columns measure, alpha, delta, seed, value, in which alpha
is the text of α or "none", delta is empty where the measure does not depend on it, and seed is that of the
run and of its dataset. Every test becomes one or more *contrasts*, sums of means over seeds with weights of
1 and −1. A contrast has a range in which the claim holds:

=================  ==========================================================  ==========================
kind               contrast, positive towards the claim                        the claim holds
=================  ==========================================================  ==========================
decreasing         m(a) − m(b) for neighbours a < b along ``over``             above 0
increasing         m(b) − m(a)                                                 above 0
greater, less      ± (m(where) − m(than)), for every pair                      above 0
larger_gap         gap(high) − gap(low), gap = m(where) − m(than)              above 0
smallest_drop      drop(than) − drop(where), drop = m(low) − m(high)           above 0
at_least, at_most  ± (m(where) − value)                                        from 0 on
most_runs          share of the runs with m(where) ≥ value                     above one half
near               m(where) − value                                            within ± tolerance
predicts           m(where) − value                                            by its prediction interval
=================  ==========================================================  ==========================

``for_each`` repeats the test for every value of that column, or for those in ``only``. It and ``over`` run
over the paper's grid, so that a level that was not measured leaves the claim undecided instead of dropping
out.

**Intervals.** Conditions are independent groups: a contrast has Welch's interval, with Satterthwaite's
degrees of freedom. They are never paired by seed. What they may share (the normal distribution behind the
data of one seed, the states of a free run) makes them alike, and such an interval wide rather than narrow.

**States of a contrast**, the first that applies:

- *supports*: the whole 95 % interval lies where the claim holds;
- *contradicts*: the whole interval lies outside;
- *practically nothing*: the interval of a difference lies within ± the smallest effect that matters for its
  measure. The sign comes first: a sentence that says "larger" is true of a small difference too. So this
  state says that little is there, where else only would be said that nothing is known;
- *open*: none of these; *not measured*: a group is empty.

For the paper's rates (predicts) the interval is that of the mean of three runs on one new dataset, as the
paper reports it. If it misses the paper's number, it *contradicts*; if it contains that number and misses at
least one of the paper's other two rates, it *supports*; if it contains all three, it cannot tell them apart,
and is *open*. Our runs have a dataset each, so that only the sum of the two variances is known; all of it is
taken as the dataset's, which three runs on one dataset do not average out.

**Verdicts.** A claim is

- **reproduced** if every contrast supports it,
- **partly** reproduced if some support it and others do not,
- **not reproduced** if none supports it, and one contradicts it or all are practically nothing,
- **not measured** if a contrast was not, and **open** otherwise.

That *all* contrasts support is an intersection-union test (Berger, 1982), whose error is at most that of a
single one, 2.5 %, without any correction. Other verdicts rest on *some* contrast, and have no such bound.
"""

import itertools
import math
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import date
from importlib.resources import files
from typing import Any, NamedTuple

import pandas as pd

from replication.evidence.statistics import LEVEL, contrast_interval, prediction_interval, share_interval
from srlrepro.dynamics.pendulum import Floats

MEASURE_COLUMNS = ("measure", "alpha", "delta", "seed", "value")
DIFFERENCES = ("decreasing", "increasing", "greater", "less", "larger_gap", "smallest_drop")
NUMBERS = ("near", "predicts")  # both sides of a number count
INCLUSIVE = ("at_least", "at_most", *NUMBERS)  # the border belongs to the range in which the claim holds
KINDS = (*DIFFERENCES, *INCLUSIVE, "most_runs")
LAYERS = {  # of claims
    "a": "the paper's sentences, each tested as it says and no harder",
    "b": "sharper tests of the same sentences",
    "c": "questions of our own",
}
STATES = ("supports", "contradicts", "practically nothing", "open", "not measured")
VERDICTS = ("reproduced", "partly", "not reproduced", "open", "not measured")
PAPER_SEEDS = 3  # Sec. IV-A
RATES = ("rate-mnd", "rate-mix", "rate-ud")  # 80.8, 91.0 and 99.7 %
SYMBOLS = {"alpha": "α", "delta": "Δ"}
Cell = dict[str, Any]
Grid = dict[str, list[Any]]
GRID: Grid = {"alpha": ["0", "0.5", "1"], "delta": [1.1, 1.5, 4.0]}  # Sec. IV


@dataclass(frozen=True)
class Claim:
    """One claim and its test; ``claims.toml`` says what the fields mean."""

    id: str
    statement: str
    place: str
    layer: str
    date: date
    known: str
    measure: str
    kind: str
    reason: str
    row: str = ""
    sharpens: str = ""
    paper: str = ""
    where: dict[str, list[Any]] = field(default_factory=dict)
    than: dict[str, list[Any]] = field(default_factory=dict)
    for_each: str = ""
    only: tuple[Any, ...] = ()
    over: str = ""
    value: float = 0.0
    others: tuple[float, ...] = ()
    tolerance: float = 0.0
    low: float = 0.0
    high: float = 0.0
    effect: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "row", self.row or self.statement)
        for name, allowed in (("kind", KINDS), ("layer", tuple(LAYERS))):
            if getattr(self, name) not in allowed:
                raise ValueError(f"claim {self.id}: unknown {name} {getattr(self, name)!r}")

    @property
    def holds_within(self) -> tuple[float, float]:
        """(least, most) value of a contrast for which the claim holds."""
        if self.kind in NUMBERS:
            return -self.tolerance, self.tolerance
        return 0.5 if self.kind == "most_runs" else 0.0, math.inf


class Contrast(NamedTuple):
    """What is compared: its name, the Δ that it is about (NaN: several, or none), and a weighted sum."""

    name: str
    delta: float
    groups: list[Floats]  # values of the runs or datasets; empty if the cell was not measured
    weights: list[float]
    constant: float = 0.0  # is subtracted from the sum of the groups' means


def load_claims() -> list[Claim]:
    """The claims, in the order of the file, layer a first."""
    data = tomllib.loads(files("replication.evidence").joinpath("claims.toml").read_text(encoding="utf-8"))
    claims = []
    for entry in data["claim"]:
        lists = {name: tuple(entry.get(name, ())) for name in ("only", "others")}
        effect = data["effects"].get(entry["measure"], {"least": 0.0})["least"]
        claims.append(Claim(**entry | lists | {"known": data["known"][entry["known"]], "effect": effect}))
    return claims


def _cells(selection: dict[str, list[Any]]) -> list[Cell]:
    return [dict(zip(selection, values, strict=True)) for values in itertools.product(*selection.values())]


def _text(cell: Cell) -> str:
    text = ", ".join(f"{SYMBOLS[name]} = {value}" for name, value in cell.items())
    return text.replace("α = none", "no supervisor")


def _contrasts(claim: Claim, table: pd.DataFrame, fixed: Cell, grid: Grid) -> Iterator[Contrast]:
    """The contrasts of a claim on the rows of its measure, for one value of ``for_each``."""
    prefix = f"{_text(fixed)}: " if fixed else ""

    def contrast(name: str, *parts: tuple[float, Cell], constant: float = 0.0) -> Contrast:
        groups = []
        for _, cell in parts:
            own = table
            for column, value in (fixed | cell).items():
                own = own[own[column] == value]
            groups.append(own["value"].dropna().to_numpy())
        delta = float(fixed.get("delta", math.nan))
        return Contrast(prefix + name, delta, groups, [weight for weight, _ in parts], constant)

    where, than = _cells(claim.where), _cells(claim.than)
    if claim.kind in ("decreasing", "increasing"):
        sign = 1.0 if claim.kind == "increasing" else -1.0
        for first, second in itertools.pairwise(grid[claim.over]):
            name = f"{SYMBOLS[claim.over]} = {first} to {second}"
            yield contrast(name, (sign, {claim.over: second}), (-sign, {claim.over: first}))
    elif claim.kind in ("greater", "less"):
        sign = 1.0 if claim.kind == "greater" else -1.0
        for a, b in itertools.product(where, than):
            yield contrast(f"{_text(a)} against {_text(b)}", (sign, a), (-sign, b))
    elif claim.kind in ("larger_gap", "smallest_drop"):
        low, high = {claim.over: claim.low}, {claim.over: claim.high}
        for a, b in itertools.product(where, than):
            name = f"{_text(a)} against {_text(b)}, {SYMBOLS[claim.over]} = {claim.low} to {claim.high}"
            yield contrast(name, (1.0, a | high), (-1.0, a | low), (-1.0, b | high), (1.0, b | low))
    else:
        for a in where:
            sign = -1.0 if claim.kind == "at_most" else 1.0
            name = f"{_text(a)} {'from' if claim.kind in NUMBERS else 'against'} {claim.value:g}"
            yield contrast(name, (sign, a), constant=sign * claim.value)


def _holds(claim: Claim, low: float, high: float) -> bool:
    """Whether all from low to high lies where the claim holds."""
    least, most = claim.holds_within
    inside = low > least and high < most
    return inside or (claim.kind in INCLUSIVE and low >= least and high <= most)


def _state(claim: Claim, low: float, high: float) -> str:
    """What an interval says of the claim: one of `STATES`, of a contrast that was measured."""
    if math.isnan(low):  # one run has no interval
        return "open"
    if claim.kind == "predicts":
        if not low <= 0 <= high:
            return "contradicts"
        others = [other - claim.value for other in claim.others]
        return "open" if all(low <= other <= high for other in others) else "supports"
    if _holds(claim, low, high):
        return "supports"
    least, most = claim.holds_within
    if high < least or low > most:
        return "contradicts"
    small = claim.kind in DIFFERENCES and -claim.effect <= low and high <= claim.effect
    return "practically nothing" if small else "open"


def contrasts_of(
    claim: Claim, measures: pd.DataFrame, level: float = LEVEL, grid: Grid = GRID
) -> pd.DataFrame:
    """The contrasts of a claim over a grid, a row each.

    Columns: id, contrast; delta: the Δ that it is about, if it is one; estimate, low, high: with its
    interval; least, most: where the claim holds, for ``predicts`` where an estimate without an interval
    points its way; n: runs or datasets of the smallest group; points: whether the estimate alone lies there;
    state: one of `STATES`.
    """
    table = measures[measures["measure"] == claim.measure]
    levels = claim.only or grid.get(claim.for_each, ())
    rows = []
    for fixed in _cells({claim.for_each: list(levels)} if claim.for_each else {}):
        for one in _contrasts(claim, table, fixed, grid):
            n = min(map(len, one.groups))
            if claim.kind == "most_runs":
                held = int((one.groups[0] >= claim.value).sum())
                ends = (held / n if n else math.nan, *share_interval(held, n, level))
            elif claim.kind == "predicts":
                values = one.groups[0] - one.constant
                ends = (float(values.mean()) if n else math.nan, *prediction_interval(values, level))
            else:
                ends = contrast_interval(one.groups, one.weights, one.constant, level)
            row: Cell = {"id": claim.id, "contrast": one.name, "delta": one.delta}
            row |= dict(zip(("estimate", "low", "high"), ends, strict=True))
            row |= dict(zip(("least", "most"), claim.holds_within, strict=True)) | {"n": n}
            row["points"] = _holds(claim, ends[0], ends[0]) if n else None
            row["state"] = _state(claim, *ends[1:]) if n else "not measured"
            rows.append(row)
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


def verdict(states: pd.Series) -> str:
    """One of `VERDICTS`, by the rule that heads this module, for the states of the contrasts of one claim."""
    found = set(states)
    if not found or "not measured" in found:
        return "not measured"
    if "supports" in found:
        return "reproduced" if found == {"supports"} else "partly"
    return "not reproduced" if "contradicts" in found or found == {"practically nothing"} else "open"


def judge_claims(claims: list[Claim], measures: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The verdicts on claims, by tables of measures; and the contrasts of all.

    A row per claim: of its fields, its estimates in words, the least n of its contrasts, how many are in each
    state, its verdict, and the verdict that the first `PAPER_SEEDS` seeds give by the same rule.
    """
    first = measures[measures["seed"].isna() | (measures["seed"] < PAPER_SEEDS)]
    rows, tables = [], []
    for claim in claims:
        table = contrasts_of(claim, measures)
        intervals = (f"{r.estimate:.3g} [{r.low:.3g}, {r.high:.3g}]" for r in table.itertuples())
        counts = {state: int((table["state"] == state).sum()) for state in STATES}
        row = {
            name: getattr(claim, name) for name in ("id", "layer", "statement", "place", "paper", "measure")
        }
        row |= {"estimates": "; ".join(intervals), "n": int(table["n"].min()), **counts}
        row["verdict"] = verdict(table["state"])
        row["verdict_of_three"] = verdict(contrasts_of(claim, first)["state"])
        rows.append(row)
        tables.append(table)
    return pd.DataFrame(rows), pd.concat(tables, ignore_index=True)
