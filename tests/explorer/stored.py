"""Policies as files, which tests share."""

from pathlib import Path

import numpy as np

from srlrepro.learner.policy import TrainedPolicy
from srlrepro.pins import ARITHMETIC
from srlrepro.settings.config import Config

COUNTS = {"activations": 7, "hit_the_ground": 2, "not_recovered_in_time": 1, "falls": 4}
STEPS = 400


def save_policy(folder: Path, alpha: float | None, seed: int, config: Config) -> Path:
    """A policy that pushes a little at random, with a record of its training."""
    rng = np.random.default_rng(seed)
    shapes = (16, 8), (16, 16), (3, 16)
    weights = tuple(0.2 * rng.normal(size=shape).astype(np.float32) for shape in shapes)
    biases = tuple(np.zeros(shape[0], np.float32) for shape in shapes)
    record = {
        "arithmetic": ARITHMETIC,
        "run": {"alpha": alpha, "delta": 1.5, "seed": seed, "steps": STEPS},
        "config": config.as_dict(),
        "region": "none",
        "steps_done": STEPS,
        "counts": COUNTS,
        "final_policy": {"own condition": {"return": 1.0}, "no supervisor": {"return": 2.0}},
    }
    ones = np.ones(3, np.float32)
    name = "none" if alpha is None else f"{alpha:g}"
    path = folder / f"alpha_{name}__delta_1.5__seed_{seed}.npz"
    TrainedPolicy(weights, biases, -ones, ones, record).save(path)
    return path
