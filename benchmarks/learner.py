"""Stock and compiled PPO side by side: the same work, in turns, in one process with one thread."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from srlrepro.compiled_ppo import CompiledPPO
from srlrepro.config import Config
from srlrepro.network import Network, Passes, adam
from srlrepro.pendulum import jit
from srlrepro.safe_region import SafeRegion, learn
from srlrepro.sampling import generate
from srlrepro.training import Run, make_env, make_learner
from srlrepro.updating import Learner

ALPHA, DELTA = 0.5, 1.1
EPOCHS = 2  # for the time of a gradient step: enough of them, in less time than a whole update
BEFORE = (
    100  # updates before anything is timed: trials then take tenths of a second, as in much of a training
)


class Silent(BaseCallback):
    """Looks at nothing."""

    def _on_step(self) -> bool:
        return True


@dataclass(frozen=True)
class Timing:
    """Seconds of the same work, one entry per turn."""

    work: str
    stock: list[float]
    compiled: list[float]


def learners(config: Config, region: SafeRegion | None) -> list[PPO]:
    """Stock and compiled PPO of one run, with the same networks, trained a little."""
    run = Run(None if region is None else ALPHA, DELTA, 0, config.paper.n_steps)
    stock, compiled = (
        make_learner(make_env(run, config, region), config.with_values(learner=kind), 0)
        for kind in ("stock", "compiled")
    )
    assert isinstance(compiled, CompiledPPO) and not isinstance(stock, CompiledPPO)
    compiled.learn(BEFORE * config.paper.n_steps)
    stock.set_parameters(compiled.get_parameters())
    stock.learn(config.paper.n_steps)
    stock.set_parameters(compiled.get_parameters())
    return [stock, compiled]


def collecting(model: PPO) -> Callable[[], None]:
    """A rollout, with a callback that looks at nothing."""
    _, callback = model._setup_learn(model.n_steps, Silent(), False, "", False)
    env = model.env
    assert env is not None
    return lambda: model.collect_rollouts(env, callback, model.rollout_buffer, model.n_steps)


def stepping(model: PPO) -> Callable[[], None]:
    """So many epochs of gradient steps on the last rollout."""

    def work() -> None:
        epochs, model.n_epochs = model.n_epochs, EPOCHS
        model.train()
        model.n_epochs = epochs

    return work


def in_turns(works: list[Callable[[], None]], turns: int) -> list[list[float]]:
    """Seconds of each work in each turn; they take turns, so that a slow moment meets all of them."""
    seconds: list[list[float]] = [[] for _ in works]
    for _ in range(turns):
        for taken, work in zip(seconds, works, strict=True):
            start = time.perf_counter()
            work()
            taken.append(time.perf_counter() - start)
    return seconds


@jit
def _products(network: Network, memory: Passes, gradient: Network) -> None:
    last = len(network.weights) - 1
    for layer in range(last + 1):
        into = memory.output if layer == last else memory.inputs[layer + 1]
        np.dot(network.weights[layer], memory.inputs[layer], into)
    for layer in range(last, -1, -1):
        if layer == last:
            np.dot(memory.deltas[layer], memory.inputs[layer].T, gradient.weights[layer])
        else:
            np.dot(memory.deltas[layer], memory.across[layer], gradient.weights[layer])
        if layer > 0:
            np.dot(network.weights[layer].T, memory.deltas[layer], memory.deltas[layer - 1])


@jit
def _floor(learner: Learner, count: int) -> None:
    for step in range(count):
        _products(learner.actor, learner.actor_passes, learner.actor_gradient)
        _products(learner.critic, learner.critic_passes, learner.critic_gradient)
        adam(
            learner.parameters,
            learner.gradient,
            learner.mean,
            learner.square,
            1.0,
            step + 1,
            0.0,
            (0.9, 0.999),
            1e-5,
        )


def floor(model: CompiledPPO, count: int) -> Callable[[], None]:
    """The matrix products of so many gradient steps and as many passes of Adam, and nothing else."""
    learner = model.arrays().learner
    generator = np.random.default_rng(0)

    def ordinary(a: NDArray[Any]) -> NDArray[Any]:
        return generator.standard_normal(a.shape).astype(a.dtype)

    copied = Learner(*(_mapped(part, ordinary) for part in learner))
    return lambda: _floor(copied, count)


def _mapped(part: Any, function: Callable[[NDArray[Any]], NDArray[Any]]) -> Any:
    if isinstance(part, np.ndarray):
        return function(part)
    parts = [_mapped(p, function) for p in part]
    return type(part)(*parts) if hasattr(part, "_fields") else tuple(parts)


def measure(turns: int) -> list[Timing]:
    """All timings. The last one compares a compiled gradient step (as "stock") with its floor."""
    torch.set_num_threads(1)
    config = Config()
    region = learn(generate(ALPHA, config, 0), config)
    free, supervised = learners(config, None), learners(config, region)
    assert isinstance(free[1], CompiledPPO)
    steps = EPOCHS * config.paper.n_minibatches
    lower = floor(free[1], steps)
    lower()
    stock, fast, least = (
        [s / steps for s in seconds] for seconds in in_turns([*map(stepping, free), lower], turns)
    )
    timings = [Timing("gradient step", stock, fast)]
    for name, pair in (("rollout, free", free), ("rollout, supervised", supervised)):
        timings.append(Timing(name, *in_turns([collecting(m) for m in pair], turns)))
    timings.append(Timing("whole update, supervised", *in_turns([_whole(m) for m in supervised], turns)))
    return [*timings, Timing("gradient step, compiled (left) and its floor (right)", fast, least)]


def _whole(model: PPO) -> Callable[[], None]:
    collect = collecting(model)

    def work() -> None:
        collect()
        model.train()

    return work
