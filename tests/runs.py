"""Small training runs that the tests of training and of checkpoints share."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from stable_baselines3 import PPO

from srlrepro.config import Config
from srlrepro.files import read_arrays
from srlrepro.supervisor import Hypothesis
from srlrepro.training import VISITED_FORMAT, Run

UPDATE, UPDATES = 64, 6
CONFIG = Config().with_values(
    n_steps=UPDATE, n_minibatches=4, n_epochs=2, hidden_width=16, trial_length=0.7, checkpoint_updates=1
)
NARROW_ANGLE = 0.1
NARROW: Hypothesis = SimpleNamespace(
    predict=lambda x: (np.abs(np.atleast_2d(x)[:, 0]) < NARROW_ANGLE).astype(int)
)
FREE, SUPERVISED = Run(None, 1.5, 3, UPDATES * UPDATE), Run(0.5, 1.5, 3, UPDATES * UPDATE)
PAIRS = [(FREE, None), (SUPERVISED, NARROW)]
CONDITIONS = pytest.mark.parametrize(("run", "region"), PAIRS, ids=["free", "supervised"])


def quiet(_: str) -> None:
    """Reports to nobody."""


def products(folder: Path) -> dict[str, Any]:
    """All that a run has written, but for the time it took; arrays as bytes."""
    result = json.loads((folder / "run.json").read_text())
    result.pop("provenance")
    policy = PPO.load(folder / "policy.zip", device="cpu").policy
    found: dict[str, Any] = {name: (folder / name).read_bytes() for name in ("trials.csv", "curve.csv")}
    found |= {name: value.numpy().tobytes() for name, value in policy.state_dict().items()}
    moments = policy.optimizer.state_dict()["state"].items()
    found |= {f"{i} {name}": float(v.double().sum()) for i, state in moments for name, v in state.items()}
    visited = read_arrays(folder / "visited.npz", VISITED_FORMAT, ("x",))["x"]
    return found | {"result": result, "visited": visited.tobytes()}
