"""Which tables of results follow from which, and whether the committed ones do; nothing is trained here.

A table is *derived* if it follows from others beside it, and else *primary*: it was made of data, regions
and trainings. Derived tables are made anew, and numbers that stand in several tables are compared. The other
digits of primary tables are left to `replication.digests`.
"""

import csv
import io
import itertools
import math
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from scipy.spatial.distance import cdist

from replication.digests import SET, read_set
from replication.evidence.claims import MEASURE_COLUMNS, judge_claims, load_claims
from replication.evidence.measures import SATISFYING, first_link_shares, log_odds, measure_rows, read_measures
from replication.evidence.statistics import final_performance
from replication.evidence.verdicts import AS_WRITTEN, CALIBRATED, by_budget, failure_rates, matrix, of_arm
from replication.plots.multiverse import curve_table
from replication.studies import caution, crossed, multiverse, shift, theorem
from replication.studies.discrepancy import beside_outcomes, rank_correlations
from replication.studies.joints import answer as joints
from replication.studies.joints import cells, training
from srlrepro.dynamics.circle_env import perfect_return
from srlrepro.region.tsne import label_purity
from srlrepro.settings.condition import NONE
from srlrepro.settings.config import Config
from srlrepro.storage.files import ResultError, existing, read_table

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
# A notebook derives from numbers with all their digits, of which a table has four to six. A difference of two
# of them has fewer, and may differ by so much of itself. A smaller change is left to the digests.
ROUNDED = 1e-2
RUN = ("alpha", "delta", "seed")
SHARED = {  # by two sets that take their runs from the same folder: tables, and what chooses their rows
    "measures": ("measure", *RUN),
    "fig3_def_counts": RUN,
    "fig3_abc_learning": RUN,
    "reward_per_step": RUN,
}


class Difference(NamedTuple):
    """Where a text differs from what is found: its place, and both values."""

    file: str
    line: int  # of the file, from 1
    column: str
    committed: str
    found: str

    def __str__(self) -> str:
        place = f"{self.file}, line {self.line}, {self.column}" if self.line else self.file
        return f"{place}: committed {self.committed or 'nothing'}, found {self.found or 'nothing'}"


def text_of(table: pd.DataFrame, digits: int | None) -> str:
    """A table as `write_table` writes it."""
    return str(table.to_csv(index=False, float_format=None if digits is None else f"%.{digits}g"))


def near(one: str, other: str) -> bool:
    """Whether texts are the same but for the last digits of their numbers (`ROUNDED`)."""
    if one == other:
        return True
    numbers = [[float(number) for number in NUMBER.findall(text)] for text in (one, other)]
    return NUMBER.sub("0", one) == NUMBER.sub("0", other) and all(
        math.isclose(a, b, rel_tol=ROUNDED, abs_tol=1e-9) for a, b in zip(*numbers, strict=True)
    )


def first_difference(
    file: Path,
    found: pd.DataFrame,
    digits: int | None = 6,
    group: Sequence[str] = (),
    same: Callable[[str, str], bool] = str.__eq__,
) -> Difference | None:
    """Where a committed table starts to differ from a table that was found, as texts; None: nowhere.

    Args:
        digits: significant digits of the committed table, as of `write_table`.
        group: columns by which the rows are chosen: all whose values in these stand in ``found`` as well.
            Only the columns of ``found`` are compared.
        same: of two texts.

    Raises:
        ResultError: there is no such table, or it lacks a column.
    """
    name = "/".join(file.parts[-3:])
    lines = csv.reader(io.StringIO(existing(file).read_text(encoding="utf-8")))
    header, *rows = list(lines) or [[]]
    columns, *wanted = csv.reader(io.StringIO(text_of(found, digits)))
    if lacking := [column for column in columns if column not in header]:
        raise ResultError(f"{name} lacks the columns {', '.join(lacking)}")
    places, keys = [header.index(column) for column in columns], [columns.index(column) for column in group]
    chosen = {tuple(row[key] for key in keys) for row in wanted}
    own: list[tuple[tuple[str, ...], int, list[str]]] = []  # key, line and row
    for line, whole in enumerate(rows, 2):
        if len(whole) != len(header):
            return Difference(name, line, "the row", ",".join(whole), f"{len(header)} columns")
        row = [whole[place] for place in places]
        if (key := tuple(row[key] for key in keys)) in chosen:
            own.append((key, line, row))
    own.sort(key=lambda entry: entry[0])
    wanted.sort(key=lambda row: [row[key] for key in keys])
    for entry, row in itertools.zip_longest(own, wanted):
        key, line, committed = entry or ((), len(rows) + 1, [])
        if not committed or not row or key != tuple(row[key] for key in keys):
            return Difference(name, line, "the row", ",".join(committed), ",".join(row or []))
        for column, one, other in zip(columns, committed, row, strict=True):
            if not same(one, other):
                return Difference(name, line, column, one, other)
    return None


# What follows from what: each function takes the folder of a set and gives tables that others in it say.


class Found(NamedTuple):
    """What other tables say of a table."""

    name: str
    table: pd.DataFrame  # its rows, or some of them
    digits: int | None = 6  # significant ones of its numbers
    group: Sequence[str] = ()  # columns that say of which rows; none where the whole table is derived
    exactly: bool = True  # else `near`


def _read(folder: Path, name: str, *columns: str) -> pd.DataFrame:
    return read_table(folder / f"{name}.csv", columns, text=("alpha",))


def is_new(folder: Path) -> bool:
    """Whether a set rests on a numbered arithmetic.

    Older ones judged measures before these were rounded, and ranked what differed by rounding alone.
    """
    return "arithmetic" in read_set(folder / SET)


def judged(folder: Path) -> Iterator[Found]:
    """From the measures: claims, contrasts, their signs, rates of failure, and returns over all cells."""
    exactly, tests = is_new(folder), load_claims()
    measures = read_measures(folder / "measures.csv")
    claims, contrasts = judge_claims(tests, measures)
    yield Found("claims", claims, None, exactly=exactly)
    yield Found("contrasts", contrasts, 4, exactly=exactly)
    yield Found("verdict", matrix(tests, contrasts), None, exactly=exactly)
    rates = failure_rates(measures).assign(arm=AS_WRITTEN)
    beside = folder.parent / CALIBRATED / "measures.csv"
    if beside.exists() and not read_set(folder / SET).get("note"):  # as the workflow draws the arm
        other = failure_rates(of_arm(measures, read_measures(beside)))
        rates = pd.concat([rates, other.assign(arm=CALIBRATED)])
    yield Found("failure_rate", rates, group=("arm", *RUN), exactly=exactly)
    if (folder / "budgets.csv").exists():
        budgets = _read(folder, "budgets", *MEASURE_COLUMNS, "step")
        told = by_budget([claim for claim in tests if claim.layer == "a"], budgets)
        yield Found("verdict_by_step", told, exactly=exactly)
    yield Found(
        "final_performance", final_performance(measures, perfect_return(Config())), 4, exactly=exactly
    )


def counted(folder: Path) -> Iterator[Found]:
    """From counts and curves of the runs: some of their measures, and some counts from the curves."""
    counts, curves = _read(folder, "fig3_def_counts", *RUN), _read(folder, "fig3_abc_learning", *RUN)
    rewards, best = _read(folder, "reward_per_step", *RUN), SATISFYING * perfect_return(Config())
    by_run, rows, sums = dict(iter(curves.groupby(list(RUN)))), [], []
    for run in counts.to_dict("records"):
        cell = tuple(run[name] for name in RUN)
        curve = by_run[cell]
        reached = curve.loc[curve["mean_return"] >= best, "step"]
        values = {"training_left": 1 - float(reached.min()) / run["steps"] if len(reached) else 0.0}
        values |= {name: float(run[name]) for name in ("activations", "failures", "falls")}
        values["violations_per_1000_steps"] = 1000.0 * (run["failures"] + run["falls"]) / run["steps"]
        if run["trials"]:
            values["activated_share"] = run["activations"] / run["trials"]
        if tried := run["recovered"] + run["failures"]:
            values["success_rate"] = run["recovered"] / tried
        if run["activations"]:
            values["success_log_odds"] = log_odds(run["recovered"], run["failures"])
        rows += measure_rows(values, *cell)
        failed = run["hit_the_ground"] + run["not_recovered_in_time"]
        sums.append((*cell, int(curve["trials"].sum()), int(curve["step"].max()), failed))
    measures = pd.DataFrame(rows, columns=list(MEASURE_COLUMNS))
    yield Found("measures", measures, group=("measure", *RUN))
    totals = pd.DataFrame(sums, columns=[*RUN, "trials", "steps", "failures"])
    yield Found("fig3_def_counts", totals, group=RUN)
    yield Found("reward_per_step", curves[[*RUN, "step"]], group=RUN)
    yield Found("fig3_abc_learning", rewards[[*RUN, "step"]], group=RUN)


def sampled(folder: Path) -> Iterator[Found]:
    """From the training data and the embeddings that are drawn: their measures."""
    rows = []
    for alpha, data in _read(folder, "fig2_abc_training_data", "z").groupby("alpha", sort=False):
        values = {"safe_share": float(data["z"].mean())}
        values |= first_link_shares(data.drop(columns=["z", "alpha"]), Config())
        rows += measure_rows(values, str(alpha), seed=0)
    for alpha, data in _read(folder, "fig2_def_embedding", "z").groupby("alpha", sort=False):
        y = data[["y1", "y2"]].to_numpy()
        purity = label_purity(cdist(y, y), data["z"].to_numpy())
        rows += measure_rows({"embedding_purity": purity}, str(alpha), seed=0)
    measures = pd.DataFrame(rows, columns=list(MEASURE_COLUMNS))
    yield Found("measures", measures, group=("measure", *RUN), exactly=False)


def proved(folder: Path) -> Iterator[Found]:
    """From the terms of Theorem 1: its bound, its proof step by step, and the orders of α."""
    terms = {name: _read(folder, name, "seed", "class") for name in ("theorem_terms", "theorem_terms_free")}
    divergence = _read(folder, "theorem_divergence", *theorem.CELL)
    cell = [*theorem.CELL, "class"]
    for name, table in terms.items():
        yield Found(name, table[cell].assign(bound=theorem.bound(table)), group=cell, exactly=False)
    both = pd.concat(terms.values(), ignore_index=True)
    yield Found("theorem_divergence", both[[*cell, "half_divergence", "error", "bound"]], group=cell)
    single = divergence[divergence["seed"].astype(str) != theorem.POOLED]
    slack = single.loc[single["class"] == theorem.SMALLEST, theorem.STEPS["step"]]
    ends = {"smallest slack": slack.min(), "mean slack": slack.mean(), "largest slack": slack.max()}
    steps = theorem.STEPS.assign(holds=(slack >= 0).sum().to_numpy(), of=len(slack))
    yield Found("theorem_steps", steps.assign(**{n: v.to_numpy() for n, v in ends.items()}), 5, exactly=False)
    ranked = both[both["class"] == theorem.SMALLEST].assign(third=lambda t: t[["e1", "e2"]].min(axis=1))
    for column, name in (("regions", theorem.REGIONS), ("boosted_trees", "boosted trees")):
        ranked[column] = single.loc[single["class"] == name, "half_divergence"].to_numpy()
    orders = _read(folder, "theorem_orders", "quantity")
    yield Found("theorem_orders", theorem.orders(ranked, list(orders["quantity"].unique())), None)


def explored(folder: Path) -> Iterator[Found]:
    """From the discrepancies and the measures: the means side by side, and their ranks."""
    both = beside_outcomes(_read(folder, "discrepancy", "delta"), read_measures(folder / "measures.csv"))
    yield Found("discrepancy_outcomes", both.reset_index(), 4, exactly=False)
    yield Found("discrepancy_ranks", rank_correlations(both).reset_index(), 4, exactly=False)


def varied(folder: Path) -> Iterator[Found]:
    """From what each universe says of each claim: shares, flips, main effects, rates and curves.

    Values are taken from the curves, which have more digits; so are the places of those that are equal.
    """
    choices, claims = multiverse.load_choices(), load_claims()
    table = read_table(folder / "outcomes.csv", ("id", "claim", "value", "margin", "holds", "why"))
    results = table[["id", "claim", "value", "margin", "holds", "why"]].fillna({"why": ""})
    results["holds"] = results["holds"].map({True: True, False: False, "True": True, "False": False})
    universes = multiverse.design(choices).loc[list(results["id"].unique())]
    pair = ["id", "claim"]
    yield Found("outcomes", results[pair].join(universes, on="id"), 4, pair)
    curves = {c.id: folder / f"spec_curve_{c.id}.csv" for c in claims}
    drawn = pd.concat(
        [read_table(f, ("id", "value")).assign(claim=c) for c, f in curves.items() if f.exists()]
    )
    finer = results[pair].merge(drawn[["id", "claim", "value"]], how="left")["value"]
    results["value"] = finer.fillna(results["value"])
    yield Found("outcomes", results[[*pair, "value"]], 4, pair, exactly=False)
    shares = multiverse.shares(results, universes)
    yield Found("shares", shares, 4)
    yield Found("multiverse_shares", shares)
    yield Found("flips", multiverse.flips(results, universes), 4)
    effects = multiverse.main_effects(results, universes)
    ranked = [] if is_new(folder) else ["effect", "p", "q"]
    yield Found("main_effects", effects.drop(columns=ranked), 4, exactly=False)
    rates, shown = (
        multiverse.papers_rates(results, universes).set_index("id"),
        _read(folder, "papers_rates", "id"),
    )
    rates = rates.reindex(shown["id"]).sort_values("margin", ascending=False, kind="stable")
    yield Found("papers_rates", rates.reset_index(), 4, exactly=False)
    for claim in claims:
        if (order := list(drawn.loc[drawn["claim"] == claim.id, "id"])) or curves[claim.id].exists():
            own = results[results["claim"] == claim.id].set_index("id").loc[order].reset_index()
            yield Found(f"spec_curve_{claim.id}", curve_table(claim, own, universes))


def _gathered(folder: Path) -> pd.DataFrame:
    return _read(folder, "measures", "measure", *RUN, "value", "dataset")


def parted(folder: Path) -> Iterator[Found]:
    """From the measures of crossed runs: the components of their variance."""
    measures = _gathered(folder)
    chosen = measures["delta"].notna() & (measures["alpha"] != NONE)
    yield Found("crossed_components", crossed.component_table(measures[chosen]), exactly=False)


def cautious(folder: Path) -> Iterator[Found]:
    """From measures and curves: learners by caution, and the effects at equal caution."""
    runs = caution.learners(_gathered(folder), _read(folder, "caution_roc", *caution.CELL, "p_t"))
    for name in ("caution_frontier", "caution_outcomes"):
        yield Found(name, runs, exactly=False)
    yield Found("caution_effects", caution.effects(runs), exactly=False)


def moved(folder: Path) -> Iterator[Found]:
    """From what was measured of every variant of the data: contrasts."""
    table = _read(folder, "shift", *shift.RUN, "measure", "value")
    yield Found("shift_contrasts", shift.contrasts(table), exactly=False)


def of_joints(folder: Path) -> Iterator[Found]:
    """From what hypotheses accept in each cell of the study of joints: advantages, and predictions."""
    table = _read(folder, "joints_recall", *cells.CELL, "law", "delta", "safe")
    yield Found("joints", joints.advantages(table))
    yield Found("joints_predictions", joints.judged(table))


def of_learners(folder: Path) -> Iterator[Found]:
    """From the learners of more joints: their pictures, contrasts, and predictions."""
    table = _read(folder, "joints_learners", *training.CELL, *training.OUTCOMES)
    yield Found("joints_training", table)
    yield Found("joints_contrasts", training.contrasts(table))
    yield Found("joints_trained_predictions", training.judged(table))


# By the tables that each starts from; it is asked where they are.
FOLLOWS = {
    judged: ("measures", "claims"),
    counted: ("fig3_def_counts", "fig3_abc_learning", "reward_per_step"),
    sampled: ("fig2_abc_training_data", "fig2_def_embedding"),
    proved: ("theorem_terms", "theorem_terms_free", "theorem_divergence"),
    explored: ("discrepancy", "measures"),
    varied: ("outcomes",),
    parted: ("measures", "crossed_components"),
    cautious: ("measures", "caution_roc"),
    moved: ("shift",),
    of_joints: ("joints_recall",),
    of_learners: ("joints_learners",),
}


def found_in(folder: Path) -> Iterator[Found]:
    """Everything that tables in the folder of a set say of others there."""
    for function, needed in FOLLOWS.items():
        if all((folder / f"{name}.csv").exists() for name in needed):
            yield from function(folder)


def disagreement(folder: Path, found: Found) -> Difference | None:
    """Where a committed table starts to differ from what others say of it; None: nowhere."""
    same = str.__eq__ if found.exactly else near
    return first_difference(folder / f"{found.name}.csv", found.table, found.digits, found.group, same)


def shared(one: Path, other: Path) -> Iterator[Found]:
    """What a set says of the runs that another set has too, if both have taken them from the same folder."""
    sets = [read_set(folder / SET) for folder in (one, other)]
    keys = ("cells", "steps", "values", "arithmetic")
    if any(sets[0].get(key) != sets[1].get(key) for key in keys) or sets[0].get("study"):
        return
    for name, group in SHARED.items():
        mine, theirs = (read_table(folder / f"{name}.csv", RUN, text=("alpha",)) for folder in (one, other))
        both = mine.merge(theirs[list(group)].drop_duplicates(), on=list(group))
        yield Found(name, both, group=group)
