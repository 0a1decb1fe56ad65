"""Checkpoints of a training: everything that the next update depends on, as numbers and text in one file.

A checkpoint is an npz without pickles: the networks, Adam's moments, the last observation, the states of
torch's and numpy's random generators, the state of the task in the middle of its trial, and what was recorded
so far. It is restored into a learner that the code has built; going on from it gives the same numbers as not
having stopped. It is written between two updates, beside and renamed, so that it is whole or absent.

Left out is what no later number depends on: the Monitor's books of trials that are over, the averages of the
log, and the generators of the environment and its spaces, from which neither the task nor PPO draws.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.monitor import Monitor

from srlrepro.dynamics.circle_env import ENDS, ThreeLinkCircleEnv
from srlrepro.storage.files import ResultError, parse_json, read_arrays, write_arrays
from srlrepro.supervisor import RECOVERIES, SUPERVISED

FORMAT = "srlrepro-checkpoint-3"
MOMENTS = ("exp_avg", "exp_avg_sq")
TRIAL = {  # kinds of numbers and text of the columns of a trial
    "step": "i8",
    "length": "i8",
    "return": "f8",
    "outcome": "U",
    "activated": "b1",
    "recovery": "U",
    "recovery_time": "f8",
}
EVALUATION = {"step": "i8", "return": "f8", "length": "i8", "outcome": "U"}  # the same of an evaluation
TABLES = {"trial": TRIAL, "evaluation": EVALUATION}
RECORDED = {f"{table}.{name}": kind for table, kinds in TABLES.items() for name, kind in kinds.items()}
RECORDED |= {"visited": "f4", "rewards": "f8", "seconds": "f8", "identity": "U"}
WORDS = {"outcome": [*ENDS.values(), SUPERVISED], "recovery": ["", *RECOVERIES.values()]}
# Neither numpy nor torch sees that the place in a state of the Mersenne Twister lies within its words. In the
# bytes of torch, LEFT counts the words until the next turn, and NEXT is the place.
KEYS, LEFT, NEXT = 624, slice(8, 12), slice(16, 24)

Arrays = dict[str, NDArray[Any]]


@dataclass
class Progress:
    """What a training has recorded so far."""

    trials: list[dict[str, Any]] = field(default_factory=list)
    evaluations: list[dict[str, Any]] = field(default_factory=list)  # of the mean policy, unsupervised
    visited: list[NDArray[np.float32]] = field(default_factory=list)  # each [2n] in rad and rad/s
    seconds: float = 0.0  # that the training has taken, over all its sittings


def _monitor_and_task(model: BaseAlgorithm) -> tuple[Monitor[Any, Any], ThreeLinkCircleEnv]:
    """The Monitor and the task of a learner with one environment."""
    vectorised = model.get_env()
    assert vectorised is not None
    monitor = vectorised.envs[0]  # type: ignore[attr-defined]
    assert isinstance(monitor, Monitor) and isinstance(monitor.unwrapped, ThreeLinkCircleEnv)
    return monitor, monitor.unwrapped


def _tensors(model: BaseAlgorithm) -> dict[str, torch.Tensor]:
    """Weights, and of each Adam's moments, zero before its first step."""
    found: dict[str, torch.Tensor] = {}
    for name, weight in model.policy.named_parameters():
        state = model.policy.optimizer.state[weight]
        found[f"weight.{name}"] = weight.detach()
        found |= {f"{m}.{name}": state.get(m, torch.zeros_like(weight)).detach() for m in MOMENTS}
    return found


def _learner_arrays(model: BaseAlgorithm) -> Arrays:
    """All of a learner, its task and the generators that has a fixed size."""
    _, task = _monitor_and_task(model)
    # stable-baselines3 draws its minibatches from numpy's global generator
    _, keys, place, has_gauss, cached = np.random.get_state(legacy=True)  # noqa: NPY002
    arrays = {
        "counts": np.array((model.num_timesteps, task.period, place, has_gauss), np.int64),
        "numpy_cached": np.array(cached, np.float64),
        "numpy_keys": np.asarray(keys),
        "torch_rng": torch.get_rng_state().numpy(),
        "state": task.state,
        "observation": np.asarray(model._last_obs),
        "episode_start": np.asarray(model._last_episode_starts),
    }
    return arrays | {name: tensor.numpy() for name, tensor in _tensors(model).items()}


def _rows(found: Arrays, table: str) -> list[dict[str, Any]]:
    """The rows of a table that `save` wrote by its columns."""
    rows = zip(*(found[f"{table}.{name}"].tolist() for name in TABLES[table]), strict=True)
    return [dict(zip(TABLES[table], row, strict=True)) for row in rows]


def save(path: Path, model: BaseAlgorithm, progress: Progress, identity: dict[str, Any]) -> None:
    """Write a checkpoint of a learner between two updates; ``identity`` says of which run (JSON)."""
    monitor, task = _monitor_and_task(model)
    recorded: dict[str, Any] = {}
    for table, rows in (("trial", progress.trials), ("evaluation", progress.evaluations)):
        recorded |= {f"{table}.{name}": [row[name] for row in rows] for name in TABLES[table]}
    recorded |= {"visited": np.reshape(progress.visited, (-1, task.state.size)), "seconds": progress.seconds}
    recorded |= {"rewards": monitor.rewards, "identity": json.dumps(identity)}
    arrays = {name: np.asarray(recorded[name], kind) for name, kind in RECORDED.items()}
    write_arrays(path, FORMAT, **_learner_arrays(model), **arrays)


def _agree(found: Arrays, fresh: PPO, most_steps: int, periods: int) -> dict[str, bool]:
    """{part: whether it can be of a learner between two updates}; all have been read with their kinds."""
    steps, period, place, has_gauss = found["counts"].tolist()
    left, following = found["torch_rng"][LEFT].view(np.int32)[0], found["torch_rng"][NEXT].view(np.int64)[0]
    columns, rows = [found[f"trial.{name}"] for name in TRIAL], found["trial.step"].shape
    ends, lengths = found["trial.step"], found["trial.length"]
    tests, when = [found[f"evaluation.{name}"] for name in EVALUATION], found["evaluation.step"]
    known = [np.isin(found[f"trial.{name}"], words).all() for name, words in WORDS.items()]
    return {
        "the count of steps": 0 <= steps <= most_steps and steps % fresh.n_steps == 0,
        "the trial under way": 0 <= period < periods and found["rewards"].shape == (period,),
        "numpy's generator": 0 <= place <= KEYS and has_gauss in (0, 1),
        "torch's generator": left + following == KEYS + 1 or (left, following) == (1, 0),
        "the visited states": found["visited"].shape[1:] == found["state"].shape
        and len(found["visited"]) <= steps,
        "the table of trials": all(column.shape == rows and len(rows) == 1 for column in columns)
        and bool(((lengths >= 1) & (lengths <= ends) & (ends <= steps)).all() and all(known)),
        "the table of evaluations": all(test.shape == when.shape and len(when.shape) == 1 for test in tests)
        and bool((np.diff(when, prepend=0) > 0).all() and (when <= steps).all())
        and bool(np.isin(found["evaluation.outcome"], list(ENDS.values())).all()),
        "the time": found["seconds"].shape == () and bool(found["seconds"] >= 0),
    }


def _require_fitting(found: Arrays, own: Arrays, fresh: PPO, most_steps: int, periods: int) -> None:
    """Raise `ValueError` unless arrays have the shapes of the learner's ``own``, are finite, and agree."""
    for name, array in found.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise ValueError(f"{name} is not finite")
        if name in own and array.shape != own[name].shape:
            raise ValueError(f"{name} has the shape {array.shape}, not {own[name].shape}")
    for name, ok in _agree(found, fresh, most_steps, periods).items():
        if not ok:
            raise ValueError(f"{name} does not fit")


def restore(path: Path, fresh: PPO, identity: dict[str, Any], most_steps: int) -> Progress:
    """Bring a ``fresh`` learner of the same run, its task and the generators to where a checkpoint stands.

    most_steps: that the training takes in all.

    Returns:
        The progress of the checkpoint.

    Raises:
        ResultError: the file is missing, truncated, not a checkpoint, or of another run.
    """
    environment, (monitor, task) = fresh.get_env(), _monitor_and_task(fresh)
    assert environment is not None
    fresh._last_obs = environment.reset()  # type: ignore[assignment]
    fresh._last_episode_starts = np.ones(1, bool)
    own = _learner_arrays(fresh)
    kinds = {name: array.dtype.str[1:] for name, array in own.items()} | RECORDED
    size = sum(array.nbytes for array in own.values())
    try:
        found = read_arrays(path, FORMAT, kinds, size)
        if parse_json(str(found["identity"])) != json.loads(json.dumps(identity)):
            raise ResultError(f"{path} is a checkpoint of another run or configuration")
        _require_fitting(found, own, fresh, most_steps, task.arrays.periods)
        torch.set_rng_state(torch.from_numpy(found["torch_rng"]))
    except ResultError as error:
        raise ResultError(f"{error}: delete it to start over") from error
    except (ValueError, RuntimeError) as error:  # the latter of torch
        raise ResultError(
            f"{path} is no checkpoint of this run ({error}): delete it to start over"
        ) from error
    steps, period, place, has_gauss = found["counts"].tolist()
    state = "MT19937", found["numpy_keys"], place, has_gauss, float(found["numpy_cached"])
    np.random.set_state(state)  # noqa: NPY002
    fresh.num_timesteps, fresh._n_updates = steps, steps // fresh.n_steps * fresh.n_epochs
    adam_steps = float(fresh._n_updates * (fresh.n_steps // fresh.batch_size))
    for weight in fresh.policy.parameters():
        moments = {name: torch.zeros_like(weight) for name in MOMENTS}
        fresh.policy.optimizer.state[weight] |= {"step": torch.tensor(adam_steps), **moments}
    for name, tensor in _tensors(fresh).items():
        tensor.copy_(torch.from_numpy(found[name]))
    fresh._last_obs, fresh._last_episode_starts = found["observation"], found["episode_start"]
    task.state, task.period, monitor.rewards = found["state"], period, found["rewards"].tolist()
    trials, evaluations = (_rows(found, table) for table in TABLES)
    return Progress(trials, evaluations, list(found["visited"]), float(found["seconds"]))
