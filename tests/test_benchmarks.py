"""The benchmarks' arithmetic; their timings are the machine's, their mutants a library's."""

import ast
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from benchmarks.learner import Timing, in_turns, summary
from benchmarks.mutants import (
    KILLED,
    ROOMS,
    SURVIVED,
    Mutant,
    annotations,
    at_first,
    known,
    modules,
    ordered,
    recompiled,
    record,
)
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


ROOT = Path(__file__).parent.parent


def at(module: str, text: str) -> Mutant:
    """A mutant of the line that holds a text."""
    lines = (ROOT / module).read_text(encoding="utf-8").splitlines()
    (line,) = (n for n, own in enumerate(lines, 1) if text in own)
    return Mutant(module, "an operator", 0, line, text, "", "")


def test_every_room_has_modules_and_tests() -> None:
    for room in ROOMS.values():
        assert modules(ROOT, room) and all((ROOT / test.partition("::")[0]).exists() for test in room.tests)
    first = ordered(ROOMS["region"], "srlrepro/region/tsne.py", ROOT)
    assert first == ["tests/region/test_tsne.py", *ROOMS["region"].tests]


def test_a_changed_kernel_reaches_those_that_import_it_and_no_others() -> None:
    found = recompiled(ROOT, at("srlrepro/region/mapping.py", "squared[skip] = np.inf"))
    assert {"mapping.*", "safety_map.*", "hypothesis.*", "supervisor.*", "rollout.*"} <= set(found)
    assert not {"pendulum.*", "lqg.*", "closed_loop.*", "network.*"} & set(found)
    assert "rollout.*" in recompiled(ROOT, at("srlrepro/region/mapping.py", "FAR = "))  # kernels may hold it
    assert recompiled(ROOT, at("srlrepro/region/mapping.py", "model.fit(scaled, (y - mean) / spread)")) == []


def test_annotations_are_found() -> None:
    text = "def f(a: int | None = 1 + 2, *b: str) -> list[int]:\n    c: float = a - 1\n    return c\n"
    found = [text.splitlines()[low[0] - 1][low[1] : high[1]] for low, high in annotations(ast.parse(text))]
    assert sorted(found) == ["float", "int | None", "list[int]", "str"]


def test_the_record_keeps_reasons_other_rooms_and_other_draws(tmp_path: Path) -> None:
    def row(room: str, *lines: int, seed: int = 1) -> dict[str, Any]:
        place = {"room": room, "seed": seed}
        survivors = [
            place | {"module": "m.py", "line": n, "before": "a", "after": f"b{n % 10}"} for n in lines
        ]
        return place | {"places": 9, "mutants": 5, "survived": len(lines), "survivors": survivors}

    record([row("evidence", 3)], tmp_path)
    record([row("settings", 1, 2)], tmp_path)
    path = tmp_path / "survivors.csv"
    table = pd.read_csv(path, dtype=str).fillna("")
    assert table["line"].tolist() == ["1", "2", "3"] and set(table["reason"]) == {""}
    table.assign(reason=["why", "", "so"]).to_csv(path, index=False)
    record([row("settings", 11, 14)], tmp_path)  # the same change on another line, and a new one
    table = pd.read_csv(path, dtype=str).fillna("")
    assert table["line"].tolist() == ["11", "14", "3"] and table["reason"].tolist() == ["why", "", "so"]
    assert pd.read_csv(tmp_path / "mutants.csv")["room"].tolist() == ["settings", "evidence"]
    record([row("settings", 21, seed=2)], tmp_path)
    table = pd.read_csv(path, dtype=str)
    assert table[["seed", "line"]].to_numpy().tolist() == [["1", "11"], ["1", "14"], ["1", "3"], ["2", "21"]]
    assert table["reason"].iloc[-1] == "why"


def test_what_was_killed_is_known_and_a_survivor_is_tried_by_the_tests_of_another_commit(
    tmp_path: Path,
) -> None:
    mutants = [Mutant("m.py", "an operator", n, 1, "a", "b", "text") for n in range(3)]
    entries = [
        {"mutant": asdict(mutant), "commit": "first", "outcome": [what, "", 1.0]}
        for mutant, what in zip(mutants, (KILLED, SURVIVED), strict=False)
    ]
    file = tmp_path / "results.jsonl"
    file.write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    told = [[known(file, mutant, commit) for mutant in mutants] for commit in ("first", "second")]
    assert [[found and found.what for found in row] for row in told] == [
        [KILLED, SURVIVED, None],
        [KILLED, None, None],
    ]
    assert [at_first(file, mutant) for mutant in mutants] == [KILLED, SURVIVED, None]
    again = {"mutant": asdict(mutants[1]), "commit": "second", "outcome": [KILLED, "a test", 1.0]}
    file.write_text(file.read_text() + json.dumps(again) + "\n")
    found = known(file, mutants[1], "second")
    assert found is not None and found.what == KILLED and at_first(file, mutants[1]) == SURVIVED
