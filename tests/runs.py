"""Small training runs, and what looks on, that the tests of the learner share."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from srlrepro.learner import VISITED_FORMAT
from srlrepro.learner.recording import Recorder
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
    tables = ("trials.csv", "curve.csv", "evaluations.csv", "policy.npz")
    found: dict[str, Any] = {name: (folder / name).read_bytes() for name in tables}
    found |= {name: value.numpy().tobytes() for name, value in policy.state_dict().items()}
    moments = policy.optimizer.state_dict()["state"].items()
    found |= {f"{i} {name}": float(v.double().sum()) for i, state in moments for name, v in state.items()}
    visited = read_arrays(folder / "visited.npz", VISITED_FORMAT, ("x",))["x"]
    return found | {"result": result, "visited": visited.tobytes()}


def learn(model: PPO, steps: int, callback: BaseCallback | None = None, **values: Any) -> None:
    """Learn from the model's own seed on, whatever was drawn before."""
    model.set_random_seed(model.seed)
    model.learn(steps, callback, **values)


def interrupt(case: Case, folder: Path, steps: int) -> Path:
    """Train for a number of steps, with a checkpoint after every update; returns the last checkpoint."""
    file, taken = folder / "checkpoint.zip", [0]

    def stopping(look: Callable[..., Any]) -> Callable[..., Any]:
        def stopping_look(recorder: Recorder, *told: Any) -> Any:
            taken[0] += len(told[0].rewards) if told else 1
            if taken[0] > steps:
                raise KeyboardInterrupt
            return look(recorder, *told)

        return stopping_look

    with pytest.MonkeyPatch.context() as patch:
        for name in ("_on_step", "_on_steps"):
            patch.setattr(Recorder, name, stopping(getattr(Recorder, name)))
        with pytest.raises(KeyboardInterrupt):
            case.train(folder, file)
    return file


class Witness(BaseCallback):
    """Writes down what it is told; says stop at a step."""

    def __init__(self, stop: int = -1) -> None:
        super().__init__()
        self.stop, self.rows = stop, []

    def _on_step(self) -> bool:
        names = ("n_steps", "actions", "clipped_actions", "new_obs", "rewards", "dones")
        told = {name: np.copy(self.locals[name]) for name in names}
        info = dict(self.locals["infos"][0])
        if "episode" in info:
            info["episode"] = {name: info["episode"][name] for name in ("r", "l")}
        self.rows.append(told | info | {"timesteps": self.num_timesteps})
        return self.num_timesteps != self.stop

    def _on_rollout_end(self) -> None:
        assert self.locals["n_rollout_steps"] == self.model.n_steps


def close(a: Any, b: Any, tolerance: float = 1e-3) -> None:
    """The same but for rounding, which the pendulum amplifies in a trial."""
    assert np.shape(a) == np.shape(b)
    np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance)


def agree(told: Sequence[dict[str, Any]], by_stock: Sequence[dict[str, Any]]) -> None:
    """What two witnesses were told is the same but for rounding."""
    for a, b in zip(told, by_stock, strict=True):
        assert a.keys() == b.keys()
        for name in a:
            if isinstance(a[name], (str, bool, dict)):
                assert (
                    a[name] == pytest.approx(b[name], rel=1e-3) if name == "episode" else a[name] == b[name]
                )
            else:
                close(a[name], b[name])
