"""Stock and compiled PPO side by side: the same work, in turns, in one process with one thread."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
import torch
from stable_baselines3 import PPO

from srlrepro.compiled.jit import jit
from srlrepro.fast_ppo.network import Network, Optimizer, Passes, Reals, adam, tanh
from srlrepro.fast_ppo.ppo import CompiledPPO
from srlrepro.fast_ppo.update import Learner
from srlrepro.learner.training import Run, make_env, make_learner
from srlrepro.region.safe_region import SafeRegion, learn_region
from srlrepro.samplers import generate
from srlrepro.settings.config import Config

ALPHA, DELTA = 0.5, 1.1
REPEATS = 1000  # of a kernel in one turn
BEFORE = 100  # updates before anything is timed: trials then last tenths of a second, as often in a training
Work = Callable[[], object]


@dataclass(frozen=True)
class Timing:
    """Seconds of two ways to do the same work, one entry per turn."""

    work: str
    plain: list[float]
    fast: list[float]


def summary(timings: list[Timing]) -> pd.DataFrame:
    """Per work: median milliseconds of both ways, the ratio of the medians, its range over the turns, and the
    ratio of the fastest turns, which other users of the machine disturb least (as `timeit` has it).
    """
    rows = []
    for timing in timings:
        plain, fast = np.array(timing.plain), np.array(timing.fast)
        row = {"work": timing.work, "plain_ms": 1e3 * np.median(plain), "fast_ms": 1e3 * np.median(fast)}
        row |= {"ratio": row["plain_ms"] / row["fast_ms"]}
        row |= {"lowest": min(plain / fast), "highest": max(plain / fast)}
        rows.append(row | {"undisturbed": min(plain) / min(fast)})
    return pd.DataFrame(rows)


def learners(config: Config, region: SafeRegion | None) -> list[PPO]:
    """Stock and compiled PPO of one run, with the same networks, trained a little."""
    run = Run(None if region is None else ALPHA, DELTA, 0, config.paper.n_steps)
    stock, compiled = (
        make_learner(make_env(run, config, region), config.with_values(learner=kind), 0)
        for kind in ("stock", "compiled")
    )
    assert isinstance(compiled, CompiledPPO) and not isinstance(stock, CompiledPPO)
    compiled.learn(BEFORE * config.paper.n_steps)
    stock.learn(config.paper.n_steps)  # whatever it does only once
    stock.policy.load_state_dict(compiled.policy.state_dict())
    stock.policy.optimizer.load_state_dict(deepcopy(compiled.policy.optimizer.state_dict()))
    return [stock, compiled]


def collecting(model: PPO) -> Work:
    """A rollout without callbacks."""
    _, callback = model._setup_learn(model.n_steps, reset_num_timesteps=False)
    env = model.env
    assert env is not None
    return lambda: model.collect_rollouts(env, callback, model.rollout_buffer, model.n_steps)


def updating(model: PPO) -> Work:
    """A rollout, and the update that follows."""
    works = (collecting(model), model.train)
    return lambda: [work() for work in works]


def in_turns(works: list[Work], turns: int) -> list[list[float]]:
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
        moments = learner.mean, learner.square
        adam(learner.parameters, learner.gradient, *moments, 1.0, Optimizer(0.0, (0.9, 0.999), 1e-5, step), 1)


def floor(model: CompiledPPO, count: int) -> Work:
    """The matrix products of so many gradient steps and as many passes of Adam, and nothing else."""
    learner = deepcopy(model.views().learner)
    return lambda: _floor(learner, count)


def measure(turns: int) -> list[Timing]:
    """Stock against compiled; and the compiled gradient step against its floor, which is the faster way."""
    torch.set_num_threads(1)
    config = Config()
    region = learn_region(generate(ALPHA, config, 0), config)
    free, supervised = learners(config, None), learners(config, region)
    compiled = free[1]
    assert isinstance(compiled, CompiledPPO)
    steps = config.paper.n_epochs * config.paper.n_minibatches
    lower = floor(compiled, steps)
    lower()
    works = [free[0].train, compiled.train, lower]
    stock, fast, least = ([s / steps for s in seconds] for seconds in in_turns(works, turns))
    return [
        Timing("gradient step", stock, fast),
        Timing("gradient step, compiled, against its products and Adam alone", fast, least),
        Timing("rollout, free", *in_turns([collecting(m) for m in free], turns)),
        Timing("rollout, supervised", *in_turns([collecting(m) for m in supervised], turns)),
        Timing("whole update, supervised", *in_turns([updating(m) for m in supervised], turns)),
    ]


@jit
def _multiply(a: Reals, b: Reals, out: Reals) -> None:
    for _ in range(REPEATS):
        np.dot(a, b, out)


@jit
def _library_tanh(x: Reals) -> None:
    for _ in range(REPEATS):
        for i in range(x.size):
            x[i] = np.tanh(x[i])


@jit
def _own_tanh(x: Reals) -> None:
    for _ in range(REPEATS):
        tanh(x)


def kernels(turns: int) -> list[Timing]:
    """What two choices inside the gradient step give, at its sizes (minibatches of 16, layers of 128)."""
    paper = Config().paper
    batch, width = paper.n_steps // paper.n_minibatches, paper.hidden_width
    generator = np.random.default_rng(0)
    a, b, x = (
        generator.standard_normal(shape).astype(np.float32)
        for shape in ((batch, width), (width, width), batch * width)
    )
    out = np.empty_like(a)
    works: list[Work] = [
        lambda: _multiply(a, b.T, out),
        lambda: _multiply(a, b, out),
        lambda: _library_tanh(x.copy()),
        lambda: _own_tanh(x.copy()),
    ]
    for work in works:
        work()
    seconds = [[s / REPEATS for s in taken] for taken in in_turns(works, turns)]
    return [
        Timing("product with a transposed right factor, against a plain one", *seconds[:2]),
        Timing("tanh of the C library, against the continued fraction", *seconds[2:]),
    ]


def start() -> Timing:
    """A training of one update in a new process: the first ever, which compiles, against a later one."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "srlrepro", "train", "--alpha", "none", "--delta", str(DELTA)]
        command += ["--seed", "0", "--steps", "1", "--out", f"{folder}/run"]
        environment = os.environ | {"NUMBA_CACHE_DIR": f"{folder}/cache"}
        train = partial(subprocess.run, command, env=environment, check=True, capture_output=True)
        ((first, later),) = in_turns([train], 2)
    return Timing("first process with one update, against later ones", [first], [later])
