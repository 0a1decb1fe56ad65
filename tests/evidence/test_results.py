"""What is read of trained runs, and that a run of something else is refused."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learned import Learned

from replication.evidence.measures import measure_rows, write_measures
from replication.evidence.results import (
    TrainedRun,
    read_curves,
    read_learned,
    read_run,
    read_run_measures,
    read_runs,
)
from srlrepro.settings.condition import Condition
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError
from srlrepro.storage.files import ResultError

CONFIG = Config()
SUPERVISED = Condition(0.5, 4.0, 1)
WriteRun = Callable[..., TrainedRun]


def test_a_run_says_what_was_trained(write_run: WriteRun) -> None:
    config = CONFIG.with_values(p_t=0.7, mass=2)
    visited = np.arange(12.0).reshape(2, 6)
    run = write_run(SUPERVISED, config=config, visited=visited, region="digest", steps_done=1024)
    assert run.condition == SUPERVISED and run.config == config and run.region == "digest"
    assert (run.steps, run.steps_done) == (1000, 1024)
    assert run.visited().dtype == np.float64 and np.array_equal(run.visited(), visited)
    assert read_run(run.folder / "run.json") == run


def test_runs_are_a_table_of_counts(write_run: WriteRun, tmp_path: Path) -> None:
    write_run(steps_done=1024)
    write_run(SUPERVISED, counts={"activations": 6, "hit_the_ground": 2, "not_recovered_in_time": 1})
    names = [SUPERVISED.name, Condition(None, 1.1, 0).name]
    table = read_runs(tmp_path, names, CONFIG)
    assert list(table.index) == names and table["alpha"].tolist() == ["0.5", "none"]
    assert table["failures"].tolist() == [3, 0] and table["steps"].tolist() == [1000, 1024]
    curves = read_curves(tmp_path, names)
    assert curves[["alpha", "delta", "seed"]].to_numpy().tolist() == [["0.5", 4.0, 1], ["none", 1.1, 0]]
    assert curves.index.tolist() == [0, 1]  # one below the other, so that a row has one number


@pytest.mark.parametrize(
    ("asked", "steps", "message"),
    [
        ({"p_t": 0.5}, None, "p_t = 0.8, not with 0.5"),
        ({"gamma_evidence": "held out"}, None, "gamma_evidence = embedded, not with held out"),
        ({"checkpoint_updates": 1}, None, "checkpoint_updates"),
        ({}, 2000, "steps = 1000, not with 2000"),
    ],
)
def test_a_run_of_other_values_is_refused(
    asked: dict[str, Any], steps: int | None, message: str, write_run: WriteRun, tmp_path: Path
) -> None:
    name = write_run().condition.name
    read_runs(tmp_path, [name], CONFIG, 1000)
    with pytest.raises(ResultError, match=message):
        read_runs(tmp_path, [name], CONFIG.with_values(**asked), steps)


def test_a_run_in_the_folder_of_another_is_refused(write_run: WriteRun, tmp_path: Path) -> None:
    run = write_run()
    run.folder.rename(run.folder.with_name(SUPERVISED.name))
    with pytest.raises(ResultError, match=r"holds a run of alpha_none__delta_1\.1__seed_0"):
        read_runs(tmp_path, [SUPERVISED.name], CONFIG)


def test_a_missing_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="missing result"):
        read_runs(tmp_path, [SUPERVISED.name], CONFIG)
    with pytest.raises(ResultError, match="missing result"):
        read_run_measures(tmp_path, [SUPERVISED.name])


def without(record: dict[str, Any], *path: str) -> dict[str, Any]:
    inner = record
    for key in path[:-1]:
        inner = inner[key]
    del inner[path[-1]]
    return record


@pytest.mark.parametrize(
    "damage",
    [
        lambda record: [],
        lambda record: "run",
        lambda record: without(record, "run"),
        lambda record: without(record, "run", "seed"),
        lambda record: without(record, "config", "p_t"),
        lambda record: without(record, "final_policy", "own condition", "return"),
        lambda record: record | {"counts": []},
        lambda record: without(record, "arithmetic"),
        lambda record: record | {"arithmetic": record["arithmetic"] + 1},
        lambda record: record | {"counts": {"falls": "many"}},
        lambda record: record | {"run": record["run"] | {"alpha": 2}},
        lambda record: record | {"run": record["run"] | {"delta": "1.1"}},
        lambda record: record | {"config": record["config"] | {"p_t": 2}},
    ],
)
def test_a_record_of_something_else_is_refused(damage: Callable[[Any], Any], write_run: WriteRun) -> None:
    path = write_run().folder / "run.json"
    path.write_text(json.dumps(damage(json.loads(path.read_text()))))
    with pytest.raises(ResultError, match=r"run\.json is not of a training run"):
        read_run(path)


def test_measures_of_another_run_are_refused(tmp_path: Path) -> None:
    names = [SUPERVISED.name, Condition(None, 1.1, 0).name]
    for name, cell in zip(names, (("0.5", 4.0, 1), ("none", 1.1, 0)), strict=True):
        write_measures(tmp_path / "runs" / name / "measures.csv", measure_rows({"m": 1.0}, *cell))
    assert read_run_measures(tmp_path, names)["alpha"].tolist() == ["0.5", "none"]
    for cell in (("0", 4.0, 1), ("0.5", 1.1, 1), ("0.5", 4.0, 0)):
        write_measures(tmp_path / "runs" / names[0] / "measures.csv", measure_rows({"m": 1.0}, *cell))
        with pytest.raises(ResultError, match="measures of another run"):
            read_run_measures(tmp_path, names)


def test_data_and_regions_of_other_values_are_refused(
    small: Learned, small_config: Config, tmp_path: Path
) -> None:
    """Another α, seed, value of the data, or value of the region alone."""

    def save(folder: str) -> None:
        small[0].save(tmp_path / folder / "training_data.npz")
        small[1].save(tmp_path / folder / "region.npz")

    save("data_0/alpha_0.5")
    found = read_learned(tmp_path, ["0.5"], 0, small_config)
    assert list(found) == ["0.5"] and found["0.5"][1].digest() == small[1].digest()
    for name, config in {
        "k": small_config.with_values(k=201),
        "p_t": small_config.with_values(p_t=0.7),
    }.items():
        with pytest.raises(ParameterError, match=f"{name} = .* with which"):
            read_learned(tmp_path, ["0.5"], 0, config)
    for folder, alpha, seed, name in (
        ("data_0/alpha_1", "1", 0, "alpha"),
        ("data_1/alpha_0.5", "0.5", 1, "seed"),
    ):
        save(folder)
        with pytest.raises(ParameterError, match=f"{name} = 1.* with which"):
            read_learned(tmp_path, [alpha], seed, small_config)
