"""What is told of a claim: its weakest contrast, and what three seeds could not have resolved."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from replication.documents import FIGURES
from replication.evidence.claims import contrasts_of, load_claims
from replication.evidence.verdicts import resting, rows, weakest

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
    ("claim", "alpha", "delta", "values", "words"),
    [
        ("success-mnd", "0", 1.1, [0.9, 0.9, 0.9], "90 [90, 90] %"),
        ("empty-corners", "0", np.nan, [0.004, 0.004], "0.004 [0.004, 0.004]"),
        ("success-as-promised", "0", 1.1, [0.25, 0.25], "0.25 [0.25, 0.25]"),
        ("success-ud-odds", "1", 1.1, [6.0, 6.0], "6 [6, 6]"),
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
    test = CLAIMS["safe-share-falls"]
    table = measured(
        "safe_share", {("0", np.nan): [0.9, 0.9], ("0.5", np.nan): [0.6, 0.6], ("1", np.nan): [0.5, 0.5]}
    )
    assert weakest(test, contrasts_of(test, table)) == {
        "contrast": "α = 0.5 to 1",
        "estimate": "0.1 [0.1, 0.1]",
    }


def test_an_open_contrast_is_weaker_than_one_that_supports_by_less() -> None:
    """A fall of 0.1 in both datasets, and one of 0.5 and -0.1 in turn: the second is larger, and open."""
    test = CLAIMS["safe-share-falls"]
    cells = {("0", np.nan): [0.9, 0.9], ("0.5", np.nan): [0.8, 0.8], ("1", np.nan): [0.3, 0.9]}
    assert weakest(test, contrasts_of(test, measured("safe_share", cells)))["contrast"] == "α = 0.5 to 1"


def test_a_contrast_that_was_not_measured_is_not_told_as_a_number() -> None:
    test = CLAIMS["safe-share-falls"]
    told = weakest(test, contrasts_of(test, measured("safe_share", {("0", np.nan): [0.9]})))
    assert told["estimate"] == "not measured"


def test_verdicts_rest_on_the_larger_set_where_there_is_one(larger: Path) -> None:
    """A joined claim follows the one that it joins; what three seeds leave open is listed by its states."""
    contrasts = pd.read_csv(larger / "seeds_10" / "contrasts.csv")
    decided = contrasts["state"].isin(["supports", "contradicts"])
    contrasts.loc[decided[decided].index[0], "state_of_three"] = "unresolved"
    contrasts.to_csv(larger / "seeds_10" / "contrasts.csv", index=False)
    told = rows(larger)
    assert resting(larger) == "seeds_10" and sum(len(claim["lost"]) for claim in told) == 1
    assert {claim["verdict"] for claim in told} == {"partly"}
    kept = pd.read_csv(FIGURES / "full" / "claims.csv").set_index("id")["verdict"]
    assert {claim["id"]: claim["verdict_of_three"] for claim in told} == kept.to_dict()
    last = ""
    for claim in told:
        assert claim["joins"] in ("", last)
        last = claim["joins"] or claim["id"]
