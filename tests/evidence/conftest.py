"""A run as `train` leaves it, made by hand."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from replication.evidence.results import TrainedRun, read_run
from srlrepro.learner import VISITED_FORMAT
from srlrepro.pins import ARITHMETIC
from srlrepro.settings.condition import Condition
from srlrepro.settings.config import Config
from srlrepro.storage.files import write_arrays, write_json, write_table

COUNTS = {
    "trials": 0,
    "activations": 0,
    "recovered": 0,
    "hit_the_ground": 0,
    "not_recovered_in_time": 0,
    "falls": 0,
}
WriteRun = Callable[..., TrainedRun]


@pytest.fixture
def write_run(tmp_path: Path) -> WriteRun:
    """write_run(condition, …): its products in tmp_path/runs/NAME; 1000 steps, unless they are given."""

    def write(condition: Condition | None = None, **given: Any) -> TrainedRun:
        of = condition or Condition(None, 1.1, 0)
        folder, steps = tmp_path / "runs" / of.name, given.get("steps", 1000)
        returns = {"own condition": 0.0, "no supervisor": 0.0} | given.get("returns", {})
        record = {
            "run": asdict(of) | {"steps": steps},
            "config": given.get("config", Config()).as_dict(),
            "region": given.get("region", "NoneType"),
            "arithmetic": ARITHMETIC,
            "steps_done": given.get("steps_done", steps),
            "counts": COUNTS | given.get("counts", {}),
            "final_policy": {name: {"return": value} for name, value in returns.items()},
        }
        write_json(folder / "run.json", record)
        write_table(folder / "trials.csv", pd.DataFrame(given.get("trials", {"step": [1], "return": [0.0]})))
        curve = np.array(given.get("curve", [0.0]))
        table = {"step": steps * (1 + np.arange(len(curve))) / len(curve), "mean_return": curve}
        write_table(folder / "curve.csv", pd.DataFrame(table | {"mean_length": 1.0 + np.arange(len(curve))}))
        tried = pd.DataFrame(given.get("evaluations", {"step": [steps], "return": [0.0]}))
        write_table(folder / "evaluations.csv", tried)
        visited = np.asarray(given.get("visited", np.zeros((4, 6))), np.float32)
        write_arrays(folder / "visited.npz", VISITED_FORMAT, x=visited)
        return read_run(folder)

    return write
