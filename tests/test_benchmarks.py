"""The benchmark's arithmetic; its timings are the machine's."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.learner import Timing, in_turns, summary
from benchmarks.rounding import compare


def test_the_summary_of_known_timings() -> None:
    table = summary([Timing("work", [0.4, 0.2, 0.6], [0.01, 0.02, 0.02])])
    assert table.iloc[0].tolist() == pytest.approx(["work", 400.0, 20.0, 20.0, 10.0, 40.0, 20.0])


def test_works_take_turns() -> None:
    order: list[str] = []
    seconds = in_turns([lambda: order.append("a"), lambda: order.append("b")], 3)
    assert order == ["a", "b"] * 3
    assert [len(taken) for taken in seconds] == [3, 3]
    assert all(s >= 0 for taken in seconds for s in taken)


def test_rounding_compares_means_of_runs_and_insists_on_equal_data() -> None:
    cells = {"measure": ["safe_share", "final_return", "final_return"], "alpha": "0", "seed": [0, 0, 1]}
    before = pd.DataFrame(cells | {"delta": [np.nan, 4.0, 4.0], "value": [0.5, 100.0, 300.0]})
    after = before.assign(value=[0.5, 140.0, 320.0])
    assert compare(before, after).to_numpy().tolist() == [["final_return", "0", 4.0, 200.0, 230.0]]
    with pytest.raises(ValueError, match="differ"):
        compare(before, before.assign(value=[0.6, 100.0, 300.0]))
