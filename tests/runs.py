"""Small training runs that the tests of training and of checkpoints share."""

import json
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from stable_baselines3 import PPO

from srlrepro.learner import VISITED_FORMAT
from srlrepro.learner.training import Run, train
from srlrepro.region.hypothesis import Hypothesis
from srlrepro.region.safe_region import SafeRegion
from srlrepro.settings.config import Config
from srlrepro.storage.files import read_arrays

UPDATE, UPDATES = 64, 6
CONFIG = Config().with_values(
    n_steps=UPDATE, n_minibatches=4, n_epochs=2, hidden_width=16, trial_length=0.7, checkpoint_updates=1
)
STOCK = CONFIG.with_values(learner="stock")
NARROW_ANGLE = 0.1
NARROW: Hypothesis = SimpleNamespace(
    predict=lambda x: (np.abs(np.atleast_2d(x)[:, 0]) < NARROW_ANGLE).astype(int)
)
FREE, SUPERVISED = Run(None, 1.5, 3, UPDATES * UPDATE), Run(0.5, 1.5, 3, UPDATES * UPDATE)


def narrow_region() -> SafeRegion:
    """A region that is about `NARROW`: its y are (θ1, θ2)."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, (400, 6)) * np.array([0.3, 0.5, 0.5, 2.0, 4.0, 4.0])
    x[0] = 0.0
    region = SafeRegion(p_t=0.6, psi_neighbours=8, state_max=Config().paper.state_max)
    return region.fit_embedding(x, np.abs(x[:, 0]) < 2 * NARROW_ANGLE, x[:, :2])


@dataclass(frozen=True)
class Case:
    """A small run, as tests name it."""

    name: str
    run: Run
    region: Hypothesis | None
    config: Config

    def train(self, folder: Path, checkpoint: Path | None = None, **values: Any) -> dict[str, Any]:
        """Train it, with other values of the configuration if there are any."""
        report = values.pop("report", quiet)
        config = self.config.with_values(**values)
        return train(self.run, config, self.region, folder, checkpoint, report)


CASES = [
    Case("free", FREE, None, CONFIG),
    Case("supervised", SUPERVISED, narrow_region(), CONFIG),
    Case("free, stock", FREE, None, STOCK),
    Case("supervised, stock", SUPERVISED, NARROW, STOCK),
]
CONDITIONS = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)


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
