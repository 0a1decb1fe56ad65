"""What is told of the claims: signs by Δ and by step, a second arm, the weakest contrast, open choices."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from judged import BUDGETS, SEEDS, budgets, measures

from replication.evidence.claims import LAYERS, STATES, VERDICTS, contrasts_of, judge_claims, load_claims
from replication.evidence.verdicts import (
    OVERALL,
    POLICIES,
    SIGNS,
    by_budget,
    failure_rates,
    failures,
    judged_arm,
    matrix,
    mean_failure,
    of_arm,
    resting,
    rows,
    sign,
    under_determined,
    weakest,
)
from srlrepro.storage.files import ResultError, write_table

CLAIMS = {claim.id: claim for claim in load_claims()}


def measured(name: str, cells: dict[tuple[str, float], list[float]]) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {"measure": name, "alpha": alpha, "delta": delta, "seed": seed, "value": value}
            for (alpha, delta), values in cells.items()
            for seed, value in enumerate(values)
        ]
    )


@pytest.mark.parametrize(
    ("states", "expected"),
    [
        ("supports, supports", "✓"),
        ("contradicts, contradicts", "✗"),
        ("contradicts, open", "✗"),
        ("contradicts, practically nothing", "✗"),
        ("practically nothing, practically nothing", "≈"),
        ("supports, contradicts", "±"),
        ("supports, practically nothing", "±"),
        ("supports, open", "±"),
        ("open, practically nothing", "○"),
        ("open, not measured", "–"),
    ],
)
def test_signs_follow_the_rule_of_the_verdicts(states: str, expected: str) -> None:
    assert set(states.split(", ")) <= set(STATES)
    assert sign(pd.Series(states.split(", "))) == expected


def test_the_matrix_has_every_claim_once_where_it_says_something() -> None:
    """As the paper says, every sentence holds; turned round, those that compare α = 0 with 1 fail."""
    signs = matrix(CLAIMS.values(), judge_claims(list(CLAIMS.values()), measures())[1])
    assert list(signs) == ["layer", "row", "1.1", "1.5", "4", OVERALL]
    assert list(signs["layer"].unique()) == list(LAYERS)
    told = signs.set_index("row").drop(columns="layer")
    assert set(told.to_numpy().ravel()) == {"", SIGNS["reproduced"]}
    for claim in CLAIMS.values():
        own = told.loc[claim.row]
        if claim.for_each != "delta":
            assert own[OVERALL] and not own[["1.1", "1.5", "4"]].any()
        else:
            assert all(own[f"{delta:g}"] for delta in claim.only or (1.1, 1.5, 4.0)) and not own[OVERALL]
    grows = told.loc[CLAIMS["success-grows-at-4"].row]
    assert grows[["1.1", "1.5", "4"]].tolist() == ["✓"] * 3  # three claims in one row
    turned = matrix(CLAIMS.values(), judge_claims(list(CLAIMS.values()), measures(turned=True))[1])
    turned = turned.set_index("row")
    for name in ("ud-generalises-worse-on-common-states", "success-grows-at-4", "ud-fewer-safe-states"):
        assert "✗" in set(turned.loc[CLAIMS[name].row]) and "✓" not in set(turned.loc[CLAIMS[name].row])


def test_claims_about_what_is_learned_are_judged_step_by_step() -> None:
    found = by_budget(CLAIMS.values(), budgets())
    asked = {claim.row for claim in CLAIMS.values() if claim.measure in POLICIES}
    assert set(found["row"]) == asked and set(found["step"]) == set(BUDGETS)
    lower = found[found["row"] == CLAIMS["ud-lower-reward"].row].set_index(["step", "delta"])["sign"]
    assert lower.loc[BUDGETS[0]].tolist() == ["✗", "✗", "✗"]
    assert lower.loc[BUDGETS[1]].tolist() == ["✓", "✓", "✓"]
    more = found[found["row"] == CLAIMS["early-stop-helps-the-search-more-at-4"].row]
    assert more["delta"].isna().all() and len(more) == len(BUDGETS)


def test_a_second_arm_takes_the_free_runs_of_the_first(tmp_path: Path) -> None:
    """It has none of its own; what only a free run has shown stays as it was, all else is the arm's."""
    first, other = measures(), measures(turned=True)
    other = other[other["alpha"] != "none"].assign(dataset=1)  # as the table of a study has more columns
    both = of_arm(first, other)
    assert list(both) == list(first) and len(both) == len(other) + (first["alpha"] == "none").sum()
    for name, table in (("full", first), ("calibrated", other)):
        (tmp_path / name).mkdir()
        write_table(tmp_path / name / "measures.csv", table)
    verdicts = judged_arm(tmp_path, "calibrated")[0].set_index("id")["verdict"]
    assert verdicts["success-grows-at-4"] == "not reproduced" and verdicts["fewer-violations"] == "reproduced"


def test_how_often_k_fails() -> None:
    """As a mean of rates for words; as log odds, which are never without end, for a log axis."""
    rates = {("0", 1.1): [0.8, 0.9], ("1", 1.1): [1.0, 1.0]}
    table = failures(measured("success_rate", rates)).set_index("alpha")
    assert table.loc["0", ["delta", "runs", "mean"]].tolist() == pytest.approx([1.1, 2, 0.15])
    assert (
        table.loc["0", ["least", "most"]].tolist() == pytest.approx([0.1, 0.2])
        and table.loc["1", "mean"] == 0
    )
    odds = measured("success_log_odds", {("0", 4.0): [math.log(3), math.log(3)], ("1", 4.0): [7.0]})
    drawn = failure_rates(odds)
    assert drawn["failure_rate"].tolist() == pytest.approx([0.25, 0.25, 1 / (1 + math.exp(7))])
    assert mean_failure(drawn[drawn["alpha"] == "0"]) == pytest.approx((0.25, 0.25, 0.25))
    middle, low, high = mean_failure(pd.DataFrame({"failure_rate": [0.1, 0.9]}))
    assert middle == pytest.approx(0.5) and 0 < low < 0.1 and high == pytest.approx(1 - low)


@pytest.mark.parametrize(
    ("claim", "alpha", "delta", "values", "words"),
    [
        ("rate-mnd", "0", 1.1, [math.log(9), math.log(9)], "90 [90, 90] %"),
        ("empty-corners", "0", np.nan, [0.004, 0.004], "0.004 [0.004, 0.004]"),
        ("success-as-promised", "0", 1.1, [0.25, 0.25], "0.25 [0.25, 0.25]"),
    ],
)
def test_a_claim_on_a_number_is_told_in_units_of_its_measure(
    claim: str, alpha: str, delta: float, values: list[float], words: str
) -> None:
    test = CLAIMS[claim]
    contrasts = contrasts_of(test, measured(test.measure, {(alpha, delta): values}))
    assert weakest(test, contrasts)["estimate"] == words


def test_at_most_turns_the_interval_round() -> None:
    """Shares of 0.001 and 0.003: a mean of 0.002, whose lower end lies below."""
    test = CLAIMS["empty-corners"]
    words = weakest(test, contrasts_of(test, measured("corner_share", {("0", np.nan): [0.001, 0.003]})))[
        "estimate"
    ]
    low, high = (float(number) for number in words.partition("[")[2].rstrip("]").split(","))
    assert words.startswith("0.002 [") and low < 0.002 < high


def test_the_weakest_contrast_is_the_one_nearest_to_failing() -> None:
    """Falls of 0.3 and 0.1 along α."""
    test = CLAIMS["more-conservative"]
    cells = {("0", np.nan): [0.9, 0.9], ("0.5", np.nan): [0.6, 0.6], ("1", np.nan): [0.5, 0.5]}
    assert weakest(test, contrasts_of(test, measured(test.measure, cells))) == {
        "contrast": "α = 0.5 to 1",
        "estimate": "0.1 [0.1, 0.1]",
    }


def test_an_open_contrast_is_weaker_than_one_that_supports_by_less() -> None:
    """A fall of 0.1 in both datasets, and one of 0.5 and -0.1 in turn: the second is larger, and open."""
    test = CLAIMS["more-conservative"]
    cells = {("0", np.nan): [0.9, 0.9], ("0.5", np.nan): [0.8, 0.8], ("1", np.nan): [0.3, 0.9]}
    assert weakest(test, contrasts_of(test, measured(test.measure, cells)))["contrast"] == "α = 0.5 to 1"


def test_a_contrast_that_was_not_measured_is_not_told_as_a_number() -> None:
    test = CLAIMS["more-conservative"]
    told = weakest(test, contrasts_of(test, measured(test.measure, {("0", np.nan): [0.9]})))
    assert told["estimate"] == "not measured"


def test_verdicts_rest_on_the_larger_set_where_there_is_one(larger: Path) -> None:
    told = rows(larger)
    assert resting(larger) == "seeds_10" and [row["id"] for row in told] == list(CLAIMS)
    assert {row["verdict"] for row in told} == {"reproduced"} and {row["n"] for row in told} == {SEEDS}
    assert {row["verdict_of_three"] for row in told} <= set(VERDICTS)
    first = next(row for row in told if row["id"] == "ud-lower-reward")
    assert (first["states"], first["contrasts"], first["open"]) == ("6/0/0/0", 6, 0)
    (larger / "seeds_10" / "claims.csv").unlink()
    assert resting(larger) == "full" and len(rows(larger)) == len(told)


def test_a_table_of_another_rule_is_refused(larger: Path) -> None:
    path = larger / "seeds_10" / "claims.csv"
    pd.read_csv(path).drop(columns="layer").to_csv(path, index=False)
    with pytest.raises(ResultError, match="lacks the columns layer"):
        rows(larger)


def test_open_choices_decide_what_holds_in_some_universes_and_not_in_others(larger: Path) -> None:
    """Between a quarter and three quarters of the random ones; nothing is said of what is learned."""
    assert all(row["under_determined"] is None for row in rows(larger))
    shares = {"empty-corners": 0.5, "more-conservative": 0.25, "rate-mnd": 0.74, "ud-lower-reward": 0.5}
    table = [(name, "random", share) for name, share in shares.items()]
    table += [("ud-fewer-safe-states", "one at a time", 0.5), ("a-test-that-is-gone", "random", 0.5)]
    (larger / "multiverse").mkdir()
    write_table(
        larger / "multiverse" / "shares.csv", pd.DataFrame(table, columns=["claim", "design", "share"])
    )
    found = under_determined(larger, CLAIMS.values())
    assert found == {"empty-corners": 0.5, "rate-mnd": 0.74}
    told = {row["id"]: row["under_determined"] for row in rows(larger)}
    assert told["empty-corners"] == 0.5 and told["more-conservative"] is None
