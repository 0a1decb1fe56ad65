"""The state mapping Ψ: y of a new state, from the pairs (x_i, y_i), compiled (see `tsne`)."""

import numpy as np

from srlrepro.compiled.jit import inner, jit
from srlrepro.dynamics.pendulum import Floats

FAR = 1e6  # half ranges: beyond, all training states are equally far away


@inner
def _rank(numbers: Floats, count: int, j: int) -> int:
    """How many of the first ``count`` numbers come before the j-th in order; equal ones keep their order."""
    rank = 0
    for i in range(count):
        rank += (numbers[i] < numbers[j]) | ((numbers[i] == numbers[j]) & (i < j))
    return rank


@jit
def map_state(
    scale: Floats, x_train: Floats, y_train: Floats, neighbours: int, skip: int, x: Floats
) -> tuple[float, float]:
    """Ψ of one state x [d]: (y_1, y_2); ``skip``: index of a training state to leave out, or -1.

    scale [d]: half ranges; x_train [d, k]: scaled training states, one row per coordinate, so that the
    distances are computed several at a time; y_train [k, 2].
    """
    k, squared = x_train.shape[1], np.zeros(x_train.shape[1])
    for j in range(scale.size):
        v, row = min(max(x[j] / scale[j], -FAR), FAR), x_train[j]
        for i in range(k):
            squared[i] += (row[i] - v) * (row[i] - v)
    if skip >= 0:
        squared[skip] = np.inf
    # Of the minima over disjoint sets, the one with the rank sought bounds the distances sought from above.
    sets = 2 * neighbours
    lowest, bound = np.full(sets, np.inf), 0.0
    for start in range(0, k, sets):
        for j in range(min(sets, k - start)):
            lowest[j] = min(lowest[j], squared[start + j])
    for j in range(sets):
        if _rank(lowest, sets, j) < neighbours:
            bound = max(bound, lowest[j])
    candidates, count = np.empty(k, np.int64), 0
    for i in range(k):
        candidates[count] = i
        count += squared[i] <= bound
    near = squared[candidates[:count]]
    exact = near.min() == 0.0
    y1, y2, total = 0.0, 0.0, 0.0
    for j in range(count):
        if _rank(near, count, j) < neighbours:
            at_it = 1.0 if near[j] == 0.0 else 0.0
            weight = at_it if exact else 1.0 / np.sqrt(near[j])
            y1 += weight * y_train[candidates[j], 0]
            y2 += weight * y_train[candidates[j], 1]
            total += weight
    return y1 / total, y2 / total


@jit
def map_states(
    scale: Floats, x_train: Floats, y_train: Floats, neighbours: int, leave_one_out: bool, x: Floats
) -> Floats:
    """Ψ of states x [B, d]: y [B, 2]. ``leave_one_out``: x are the training states, each without itself."""
    y = np.empty((x.shape[0], 2))
    for i in range(x.shape[0]):
        skip = i if leave_one_out else -1
        y[i, 0], y[i, 1] = map_state(scale, x_train, y_train, neighbours, skip, x[i])
    return y
