"""The benchmark's arithmetic; its timings are the machine's."""

import pytest

from benchmarks.learner import Timing, in_turns, summary


def test_the_summary_of_known_timings() -> None:
    table = summary([Timing("work", [0.4, 0.2, 0.6], [0.01, 0.02, 0.02])])
    assert table.iloc[0].tolist() == pytest.approx(["work", 400.0, 20.0, 20.0, 10.0, 40.0, 20.0])


def test_works_take_turns() -> None:
    order: list[str] = []
    seconds = in_turns([lambda: order.append("a"), lambda: order.append("b")], 3)
    assert order == ["a", "b"] * 3
    assert [len(taken) for taken in seconds] == [3, 3]
    assert all(s >= 0 for taken in seconds for s in taken)
