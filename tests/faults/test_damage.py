"""Damaged results, regions and checkpoints: random bytes flipped, or cut off at a random place.

Noticed means: a table or a JSON file that a notebook wrote, when ``./reproduce.sh`` is started; an archive (a
region, states, a checkpoint), when it is read, unless all that is read of it is as it was.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from runs import CASES, UPDATE, narrow_region

from srlrepro.learner.checkpoint import Progress, restore, save
from srlrepro.learner.training import identify, make_env, make_learner
from srlrepro.region.safe_region import SafeRegion
from srlrepro.storage.files import ResultError, read_arrays, sha256, write_arrays, write_json, write_table
from workflow.notebooks import require_undamaged

TRIES = 60  # of each kind


def damage(content: bytes, rng: np.random.Generator) -> bytes:
    """Flip one to eight bytes, or cut the end off."""
    if rng.random() < 0.3:
        return content[: rng.integers(len(content))]
    flipped = bytearray(content)
    for place in rng.integers(len(content), size=rng.integers(1, 9)):
        flipped[place] ^= int(rng.integers(1, 256))
    return bytes(flipped)


def noticed(path: Path, read: Callable[[], Any], same: Callable[[Any], bool], seed: int) -> list[bool]:
    """Whether each damage of a file is refused in one line, or what is read is as it was."""
    content, rng, outcomes = path.read_bytes(), np.random.default_rng(seed), []
    for _ in range(TRIES):
        path.write_bytes(damage(content, rng))
        try:
            outcomes.append(same(read()))
        except ResultError as error:
            outcomes.append("\n" not in str(error) and path.name in str(error))
    path.write_bytes(content)
    assert same(read())
    return outcomes


@pytest.mark.parametrize("name", ["run.json", "curve.csv"])
def test_a_damaged_result_is_noticed_at_the_next_start(name: str, tmp_path: Path, count: list[bool]) -> None:
    result = tmp_path / "results" / name
    table = pd.DataFrame({"step": range(50), "mean_return": np.random.default_rng(0).normal(size=50)})
    if name == "run.json":
        write_json(result, {"counts": table["mean_return"].to_list()})
    else:
        write_table(result, table)
    executed = tmp_path / "executed"
    write_json(executed / "05_run.json", {"sha256": {f"results/{name}": sha256(result)}})
    (executed / "05_run.ipynb").touch()
    content = result.read_bytes()
    count += noticed(
        result, lambda: require_undamaged([executed], tmp_path), lambda _: result.read_bytes() == content, 1
    )
    assert len(count) == TRIES and all(count)


def test_a_damaged_record_is_refused(tmp_path: Path) -> None:
    (tmp_path / "05_run.ipynb").touch()
    (tmp_path / "05_run.json").write_text('{"sha256": {')
    with pytest.raises(ResultError, match="truncated or not JSON"):
        require_undamaged([tmp_path], tmp_path)


def test_missing_and_unrecorded_results_are_no_damage(tmp_path: Path) -> None:
    write_json(tmp_path / "05_run.json", {"sha256": {"gone.csv": "0"}})
    (tmp_path / "05_run.ipynb").touch()
    write_json(tmp_path / "04_run.json", {"parameters": {}})
    (tmp_path / "04_run.ipynb").touch()
    write_json(tmp_path / "03_run.json", {"sha256": {"03_run.json": "0"}})  # not executed to its end
    require_undamaged([tmp_path], tmp_path)
    (tmp_path / "gone.csv").touch()  # the only one of them that is looked at, once it is there
    with pytest.raises(ResultError, match=r"gone\.csv is not as 05_run\.ipynb wrote it"):
        require_undamaged([tmp_path], tmp_path)


def test_a_damaged_region_is_noticed(tmp_path: Path, count: list[bool]) -> None:
    region, path = narrow_region(), tmp_path / "region.npz"
    region.save(path)
    count += noticed(path, lambda: SafeRegion.load(path), lambda r: r.digest() == region.digest(), 2)
    assert len(count) == TRIES and all(count)


def test_damaged_arrays_are_noticed(tmp_path: Path, count: list[bool]) -> None:
    x, path = np.random.default_rng(0).normal(size=(200, 6)), tmp_path / "visited.npz"
    write_arrays(path, "test", x=x)
    count += noticed(
        path, lambda: read_arrays(path, "test", ("x",))["x"], lambda back: np.array_equal(x, back), 3
    )
    assert len(count) == TRIES and all(count)


def test_a_damaged_checkpoint_is_noticed(tmp_path: Path, count: list[bool]) -> None:
    case, path = CASES[0], tmp_path / "checkpoint.zip"
    identity = identify(case.run, case.config, None)
    model = make_learner(make_env(case.run, case.config, None), case.config, 3).learn(UPDATE)
    save(path, model, Progress(seconds=1.5), identity)

    def read() -> dict[str, bytes]:
        fresh = make_learner(make_env(case.run, case.config, None), case.config, 3)
        progress = restore(path, fresh, json.loads(json.dumps(identity)), 2 * UPDATE)
        found = {name: value.numpy().tobytes() for name, value in fresh.policy.state_dict().items()}
        return found | {"seconds": np.float64(progress.seconds).tobytes()}

    whole = read()
    count += noticed(path, read, lambda back: bool(back == whole), 4)
    assert len(count) == TRIES and all(count)


@pytest.mark.parametrize(
    "record",
    [
        [],
        3,
        {"sha256": []},
        {"sha256": {"../secret": "0"}},
        {"sha256": {"a/../../secret": "0"}},
        {"sha256": {"/etc/passwd": "0"}},
        {"sha256": {"a\0": "0"}},
    ],
)
def test_a_forged_record_is_refused_and_looks_at_nothing_outside(record: Any, tmp_path: Path) -> None:
    (tmp_path / "secret").touch()
    write_json(tmp_path / "root" / "05_run.json", record)
    (tmp_path / "root" / "05_run.ipynb").touch()
    with pytest.raises(ResultError, match=r"05_run\.json (is no record|names a file outside)"):
        require_undamaged([tmp_path / "root"], tmp_path / "root")
