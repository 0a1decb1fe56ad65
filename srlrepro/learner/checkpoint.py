"""Checkpoints of a training: everything that the next update depends on, in one file.

A checkpoint is a zip with stable-baselines3's own archive (networks, optimiser, counters, last
observation), the states of torch's and numpy's random generators, the state of the environment in the
middle of its trial, and what was recorded so far. Going on from it gives the same numbers as not having
stopped. It is written between two updates, beside and renamed, so that it is whole or absent.
"""

import io
import json
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.monitor import Monitor

from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.storage.files import ResultError, beside


@dataclass
class Progress:
    """What a training has recorded so far."""

    trials: list[dict[str, Any]] = field(default_factory=list)
    visited: list[NDArray[np.float32]] = field(default_factory=list)  # each [2n] in rad and rad/s
    seconds: float = 0.0  # that the training has taken, over all its sittings


def _monitor_and_task(model: BaseAlgorithm) -> tuple[Monitor[Any, Any], ThreeLinkCircleEnv]:
    """The Monitor and the task of a learner with one environment."""
    vectorised = model.get_env()
    assert vectorised is not None
    monitor = vectorised.envs[0]  # type: ignore[attr-defined]
    assert isinstance(monitor, Monitor) and isinstance(monitor.unwrapped, ThreeLinkCircleEnv)
    return monitor, monitor.unwrapped


def save(path: Path, model: BaseAlgorithm, progress: Progress, identity: dict[str, Any]) -> None:
    """Write a checkpoint of a learner between two updates; ``identity`` says of which run (JSON)."""
    monitor, task = _monitor_and_task(model)
    archive, arrays = io.BytesIO(), io.BytesIO()
    model.save(archive)
    # stable-baselines3 draws its minibatches from numpy's global generator
    name, keys, position, has_gauss, cached = np.random.get_state(legacy=True)  # noqa: NPY002
    np.savez(
        arrays,
        torch_rng=torch.get_rng_state().numpy(),
        numpy_keys=keys,
        state=task.state,
        visited=np.array(progress.visited, np.float32).reshape(-1, task.state.size),
    )
    rest = {
        "identity": identity,
        "numpy_rng": [str(name), int(position), int(has_gauss), float(cached)],
        "period": task.period,
        "rewards": monitor.rewards,
        "trials": progress.trials,
        "seconds": progress.seconds,
    }
    with beside(path) as temporary, zipfile.ZipFile(temporary, "w") as file:
        file.writestr("model.zip", archive.getvalue())
        file.writestr("arrays.npz", arrays.getvalue())
        file.writestr("rest.json", json.dumps(rest))


def restore(path: Path, fresh: PPO, identity: dict[str, Any]) -> tuple[PPO, Progress]:
    """The learner and progress of a checkpoint, on the environment of a ``fresh`` learner of the same run.

    Raises:
        ResultError: the file is truncated, not a checkpoint, or of another run.
    """
    try:
        with zipfile.ZipFile(path) as file:
            rest = json.loads(file.read("rest.json"))
            with np.load(io.BytesIO(file.read("arrays.npz")), allow_pickle=False) as stored:
                arrays = dict(stored)
            archive = io.BytesIO(file.read("model.zip"))
    except (zipfile.BadZipFile, KeyError, ValueError, OSError) as error:
        raise ResultError(f"{path} is truncated or not a checkpoint: delete it to start over") from error
    if rest["identity"] != json.loads(json.dumps(identity)):
        raise ResultError(f"{path} is a checkpoint of another run or configuration: delete it to start over")
    environment = fresh.get_env()
    assert environment is not None
    environment.reset()
    model = type(fresh).load(archive, env=environment, device="cpu", force_reset=False)
    monitor, task = _monitor_and_task(model)
    task.state, task.period = arrays["state"], rest["period"]
    monitor.rewards = rest["rewards"]
    name, position, has_gauss, cached = rest["numpy_rng"]
    np.random.set_state((name, arrays["numpy_keys"], position, has_gauss, cached))  # noqa: NPY002
    torch.set_rng_state(torch.from_numpy(arrays["torch_rng"]))
    return model, Progress(rest["trials"], list(arrays["visited"]), rest["seconds"])
