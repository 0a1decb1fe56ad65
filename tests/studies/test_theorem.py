"""Theorem 1 on finite spaces, where every term is a finite sum: what holds, and what fails without l_n."""

import itertools

import numpy as np
import pandas as pd
import pytest
from numpy.random import Generator
from scipy import stats

from replication.studies.divergence import finite_class
from replication.studies.theorem import (
    POOLED,
    REGIONS,
    REGIONS_AND_LABELS,
    SMALLEST,
    STEPS,
    Sample,
    across_runs,
    bound,
    class_table,
    finite_divergences,
    orders,
    slacks,
    step_table,
    term_table,
    terms,
)

FINITE = [SMALLEST, REGIONS, REGIONS_AND_LABELS]
NEVER_FAIL = ["(14) insert", "(14) triangle", "(17) insert", "(17) triangle"]
ALWAYS = [*NEVER_FAIL, "(15) for h, l", "(15) for h, l_n", "(11) minimum"]


def row(d: pd.DataFrame, d_n: pd.DataFrame, members: list[str]) -> pd.DataFrame:
    """The terms of the theorem and ½ d of the class with these members, as a table of one row."""
    return pd.DataFrame(
        [terms(d, d_n, "h") | {"half_divergence": finite_class(d[members], d_n[members]).value}]
    )


def labelled(points: str, **labels: str) -> pd.DataFrame:
    """States at the points of a space, labelled by functions that give the label of each point "a", "b", …"""
    at = ["abcdefgh".index(point) for point in points]
    return pd.DataFrame({name: [int(values[i]) for i in at] for name, values in labels.items()})


def random_cases(rng: Generator, count: int) -> list[tuple[pd.DataFrame, pd.DataFrame]]:
    """Random distributions (of a few states) and labellings on spaces of two to eight points."""
    cases = []
    for _ in range(count):
        size = int(rng.integers(2, 9))
        functions = {name: "".join(map(str, rng.integers(0, 2, size))) for name in ("h", "l", "l_n")}
        d, d_n = (
            "".join("abcdefgh"[:size][i] for i in rng.integers(0, size, rng.integers(1, 12)))
            for _ in range(2)
        )
        cases.append((labelled(d, **functions), labelled(d_n, **functions)))
    return cases


def test_terms_by_hand() -> None:
    functions = {"h": "1100", "l": "1010", "l_n": "1001"}
    assert terms(labelled("abcd", **functions), labelled("aaab", **functions), "h") == {
        "error": 0.5,
        "false_positives": 0.25,
        "false_negatives": 0.25,
        "unsafe": 0.5,
        "source_error": 0.25,
        "source_error_real": 0.25,
        "error_nominal": 0.5,
        "e1": 0.0,
        "e2": 0.5,
    }


def test_the_theorem_and_every_step_hold_with_all_three_in_the_class(rng: Generator) -> None:
    """The slacks of either half of the proof add up to the slack of its bound."""
    table = pd.concat([row(d, d_n, ["h", "l", "l_n"]) for d, d_n in random_cases(rng, 300)])
    slack = slacks(table)
    assert list(slack) == list(STEPS["step"]) and set(slack) == set(ALWAYS)
    assert slack.to_numpy().min() >= 0
    rest = table["source_error"] + table["half_divergence"] - table["error"]
    assert np.allclose(
        slack[["(14) insert", "(14) triangle", "(15) for h, l"]].sum(axis=1), rest + table["e1"]
    )
    assert np.allclose(
        slack[["(17) insert", "(17) triangle", "(15) for h, l_n"]].sum(axis=1), rest + table["e2"]
    )
    assert np.allclose(slack["(11) minimum"], bound(table) - table["error"])


def test_the_first_bound_needs_l_in_the_class_and_the_minimum_needs_l_n(rng: Generator) -> None:
    """On every D, D_n with one state each and every labelling of two points."""
    failures: dict[str, list[pd.Series]] = {"l": [], "l_n": []}
    for h, l, l_n in itertools.product(["00", "01", "10", "11"], repeat=3):
        for d, d_n in itertools.product("ab", repeat=2):
            samples = (labelled(p, h=h, l=l, l_n=l_n) for p in (d, d_n))
            target, source = samples
            for kept, lost in (("l", "(15) for h, l_n"), ("l_n", "(15) for h, l")):
                slack = slacks(row(target, source, ["h", kept])).iloc[0]
                assert (slack[NEVER_FAIL] >= 0).all()
                assert slack["(15) for h, l" if kept == "l" else "(15) for h, l_n"] >= 0
                if slack["(11) minimum"] < 0:
                    assert slack[lost] < 0
                    failures[kept].append(slack)
    assert len(failures["l"]) > 0 and len(failures["l_n"]) > 0
    assert min(s["(11) minimum"] for s in failures["l"]) == -1.0


def test_a_counterexample_with_h_and_l_in_the_class_as_the_paper_asks() -> None:
    """D sits at a, D_n at b; h errs everywhere, and l_n equals l at a and h at b.

    ε(h, l) = 1, while ε_n(h, l_n) = 0, ½ d = |P_D(h ≠ l) − P_Dn(h ≠ l)| = 0 and min{E_1, E_2} = E_2 = 0:
    eq. (11) claims 1 ≤ 0. Eq. (16), which E_1 = 1 makes, holds; l_n in H makes ½ d = 1.
    """
    functions = {"h": "00", "l": "11", "l_n": "10"}
    target, source = labelled("a", **functions), labelled("b", **functions)
    table = row(target, source, ["h", "l"])
    values = table.iloc[0]
    assert (values["error"], values["e1"], values["e2"]) == (1, 1, 0)
    assert bound(table)[0] == 0
    assert slacks(table)["(15) for h, l_n"][0] == -1
    assert values["source_error"] + values["half_divergence"] + values["e1"] == 1
    assert bound(row(target, source, ["h", "l", "l_n"]))[0] == 1


def test_the_third_term_changes_with_the_training_distribution() -> None:
    """E_1 is an expectation over D_n: the same l and l_n, another D_n, another min{E_1, E_2}."""
    functions = {"h": "11", "l": "10", "l_n": "11"}
    target = labelled("b", **functions)
    third = [min(terms(target, labelled(d_n, **functions), "h")[e] for e in ("e1", "e2")) for d_n in "ab"]
    assert third == [0.0, 1.0]


class Threshold:
    """Safe where the first coordinate is below a threshold."""

    def __init__(self, threshold: float) -> None:
        self.threshold = threshold

    def predict(self, x: np.ndarray) -> np.ndarray:
        return (x[:, 0] < self.threshold).astype(int)


FUNCTIONS = {"l": Threshold(0.5), "l_n": Threshold(0.6), "first": Threshold(0.4), "second": Threshold(0.9)}


def uniform(rng: Generator, low: float, high: float, n: int) -> Sample:
    return Sample.of(rng.uniform(low, high, (n, 6)), FUNCTIONS)


def test_terms_of_thresholds_under_uniform_laws(rng: Generator) -> None:
    """Each probability is the length of an interval: D is uniform on [0, ½], D_n on [0, 1]."""
    d, d_n = uniform(rng, 0, 0.5, 40_000).labels, uniform(rng, 0, 1, 40_000).labels
    values = terms(d, d_n, "first")
    expected = {"error": 0.2, "source_error": 0.2, "source_error_real": 0.1, "error_nominal": 0.2, "e1": 0.1}
    expected |= {"e2": 0.0, "false_positives": 0.0, "false_negatives": 0.2, "unsafe": 0.0}
    assert values == pytest.approx(expected, abs=0.01)
    halves = finite_divergences(d, d_n, "first")
    assert list(halves) == FINITE
    assert halves[SMALLEST].value == pytest.approx(0.1, abs=0.01)  # l and h, or l and l_n
    assert halves[REGIONS].value == pytest.approx(0.3, abs=0.01)  # 0.2 against 0.5
    assert halves[REGIONS_AND_LABELS].value == pytest.approx(0.4, abs=0.01)  # l and second: 0 against 0.4


def test_tables_of_trainings_and_their_pool(rng: Generator) -> None:
    targets = {seed: uniform(rng, 0, 0.5, 300) for seed in (0, 1)}
    source = uniform(rng, 0, 1, 300)
    table = term_table(targets, source, "first")
    assert table["seed"].unique().tolist() == ["0", "1", POOLED]
    assert (table.groupby("seed")["class"].nunique() == 8).all()
    pooled = table[table["seed"] == POOLED].iloc[0]
    runs = table[(table["seed"] != POOLED) & (table["class"] == SMALLEST)]
    assert pooled["error"] == pytest.approx(runs["error"].mean())
    assert table.loc[table["class"] == "boosted trees", "half_divergence"].min() > 0.9  # of 1 − 2⁻⁶
    assert term_table({0: targets[0]}, source, "first")["seed"].unique().tolist() == ["0"]
    classes = class_table(table[table["seed"] != POOLED])
    assert (classes["of"] == 2).all() and (classes.loc[FINITE, "fails: (11) minimum"] == 0).all()
    assert (classes.loc[FINITE, "vacuous"] == 0).all() and classes.loc["boosted trees", "vacuous"] == 2
    steps = step_table(runs)
    assert (steps["holds"] == 2).all() and (steps["of"] == 2).all()
    assert np.allclose(steps["smallest slack"], slacks(runs).min())


def test_orders_and_intervals_by_hand() -> None:
    cells = [("own", 4.0, alpha, seed) for alpha in ("0", "1") for seed in ("0", "1", "2")]
    table = pd.DataFrame(cells, columns=["visited_by", "delta", "alpha", "seed"])
    table["error"] = [1.0, 2.0, 6.0, 5.0, 4.0, 3.0]
    assert orders(table, ["error"]).to_numpy().tolist() == [["own", 4.0, "error", "0 < 1", 2, 3]]
    summary = across_runs(table, ["alpha"], ["error"])
    assert summary.loc["1", "error"] == 4.0
    low, high = stats.t.interval(0.95, 2, loc=4.0, scale=1 / np.sqrt(3))
    assert summary.loc["1", "error ±"] == pytest.approx((high - low) / 2)


def test_failures_and_vacuous_bounds_are_counted() -> None:
    """The counterexample in the class {h, l}, and its terms with ½ d = 1."""
    functions = {"h": "00", "l": "11", "l_n": "10"}
    table = row(labelled("a", **functions), labelled("b", **functions), ["h", "l"])
    table = pd.concat(
        [table.assign(**{"class": "h, l"}), table.assign(**{"class": "all", "half_divergence": 1.0})]
    )
    counted = class_table(table.assign(bound=bound(table)))
    assert counted["fails: (15) for h, l"].tolist() == [0, 0]
    assert counted["fails: (15) for h, l_n"].tolist() == [1, 0]
    assert counted["fails: (11) minimum"].tolist() == [1, 0]
    assert counted["vacuous"].tolist() == [0, 1]


def test_no_class_of_the_proof_gives_a_bound_below_the_source_errors(rng: Generator) -> None:
    """½ d ≥ ε_n(h, l) − ε(h, l): where D is easier than D_n, a smaller error raises the least bound."""
    for d, d_n in random_cases(rng, 100):
        table = row(d, d_n, ["h", "l", "l_n"])
        least = table["source_error"] + table["source_error_real"] - table["error"]
        assert bound(table)[0] >= least[0] - 1e-12
