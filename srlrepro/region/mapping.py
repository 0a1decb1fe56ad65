"""The state mapping Ψ: y of a new state, from the pairs (x_i, y_i), compiled (see `tsne`)."""

import numpy as np

from srlrepro.compiled.jit import inner, jit
from srlrepro.dynamics.pendulum import Floats, as_state

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
    """Ψ of one state x [6]: (y_1, y_2); ``skip``: index of a training state to leave out, or -1.

    scale [6]: half ranges; x_train [6, k]: scaled training states, one row per coordinate, so that the
    distances are computed several at a time; y_train [k, 2].
    """
    k, squared = x_train.shape[1], np.empty(x_train.shape[1])
    v = scale.copy()
    for j in range(6):
        v[j] = min(max(x[j] / scale[j], -FAR), FAR)
    v0, v1, v2, v3, v4, v5 = as_state(v)
    for i in range(k):
        d0, d1, d2 = x_train[0, i] - v0, x_train[1, i] - v1, x_train[2, i] - v2
        d3, d4, d5 = x_train[3, i] - v3, x_train[4, i] - v4, x_train[5, i] - v5
        squared[i] = d0 * d0 + d1 * d1 + d2 * d2 + d3 * d3 + d4 * d4 + d5 * d5
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
    """Ψ of states x [B, 6]: y [B, 2]. ``leave_one_out``: x are the training states, each without itself."""
    y = np.empty((x.shape[0], 2))
    for i in range(x.shape[0]):
        skip = i if leave_one_out else -1
        y[i, 0], y[i, 1] = map_state(scale, x_train, y_train, neighbours, skip, x[i])
    return y
