"""Scores of hypotheses and what learners got under them: ranks of a case that is known."""

import pandas as pd
import pytest

from replication.studies.hypotheses import (
    ANY,
    FOLLOWED,
    FREE,
    SCORES,
    SHOWN,
    better,
    learned_under,
    ranks,
    summarise,
)


def cells(values: list[float], alpha: str = "0", kind: str = "h") -> pd.DataFrame:
    """Hypotheses h0, h1, … with all scores, and all that followed, of these values."""
    named = {"hypothesis": [f"{kind}{i}" for i in range(len(values))], "alpha": alpha, "delta": 4.0}
    return pd.DataFrame(named | dict.fromkeys((*SCORES, *FOLLOWED), values))


def test_scores_that_order_cells_as_what_followed_have_rank_correlation_one() -> None:
    """Any rising function keeps ranks; one exchange of neighbours among four costs 6 · 2 / (4 · 15) = 0.2."""
    scores = cells([0.1, 0.2, 0.3, 0.4])[["hypothesis", "alpha", "delta", *SCORES]].assign(states=FREE)
    learned = cells([1.0, 10.0, 1000.0, 100.0])[["hypothesis", "alpha", "delta", *FOLLOWED]]
    learned["violations_per_1000_steps"] = [4.0, 3.0, 2.0, 1.0]
    found = ranks(scores, learned)
    assert found["score"].tolist() == list(SCORES) and found["cells"].eq(4).all()
    assert found["final_return"].tolist() == pytest.approx([0.8] * 3)
    assert found["violations_per_1000_steps"].tolist() == pytest.approx([-1] * 3)


def test_oracles_other_states_and_what_was_not_trained_do_not_count() -> None:
    known = cells([0.9], ANY, "known")
    scores = pd.concat([cells([0.1, 0.2, 0.3]), known])[["hypothesis", "alpha", "delta", *SCORES]]
    scores = pd.concat([scores.assign(states=FREE), scores.assign(states="UD", brier=0.7)])
    learned = pd.concat([cells([0.3, 0.4]), known])[["hypothesis", "alpha", "delta", *FOLLOWED]]
    found = ranks(scores, learned)
    assert found["cells"].tolist() == [2] * 3 and found["final_return"].tolist() == pytest.approx([1] * 3)


def test_learners_are_gathered_by_hypothesis() -> None:
    """The paper's with the free learner, one without α = 1, and one that knows the system."""

    def table(values: dict[str, float]) -> pd.DataFrame:
        rows = [
            (m, a, d, s, v + s) for m in SHOWN for a, v in values.items() for d in (1.1, 4.0) for s in (0, 1)
        ]
        rows += [("safe_share", a, None, 0, 9.0) for a in values]
        return pd.DataFrame(rows, columns=["measure", "alpha", "delta", "seed", "value"])

    tables = {
        "tsne": table({"0": 1.0, "1": 2.0, "none": 3.0}),
        "knn": table({"0": 0.5}),
        "real": table({"1": 4.0}),
    }
    found = learned_under(tables, ["0", "1"])
    cells = found[["hypothesis", "alpha"]].drop_duplicates()
    pairs = [("tsne", "0"), ("tsne", "1"), ("no supervisor", "none"), ("knn", "0"), ("real", ANY)]
    assert sorted(map(tuple, cells.to_numpy())) == sorted(pairs) and found["delta"].notna().all()
    means = summarise(found)
    assert means.loc[(4.0, "real", ANY), "activations"] == 4.5 and set(means) == set(SHOWN)
    wins = better(found)
    assert wins.index.tolist() == ["knn"]
    assert wins.loc["knn"].tolist() == ["0 of 2", "0 of 2", "2 of 2"]  # less is better of violations alone
