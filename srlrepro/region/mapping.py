r"""The state mapping Ψ: y of a new state, from the pairs (x_i, y_i), compiled (see `tsne`).

With s = x in half ranges of App. C, Ψ is by ``psi``

- "network": W_3 r(W_2 r(W_1 s + b_1) + b_2) + b_3 with r(v) = max(v, 0), a perceptron with two hidden
  layers. Its weights minimise the mean squared distance of Ψ(x_i) from y_i, in standard deviations of all
  y_i, with a penalty on their squares (scikit-learn's ``MLPRegressor``);
- "neighbours": the mean of the y_i of the k nearest s_i, weighted by inverse distance.
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from srlrepro.compiled.jit import inner, jit
from srlrepro.dynamics.pendulum import Floats

FAR = 1e6  # half ranges: beyond, all training states are equally far away
ITERATIONS = 500  # of L-BFGS, at most: the score on held-out states has long ceased to change
FOLDS = 10  # of the training states, each placed by a network that has learned the others
NO_TABLE, NO_VALUES = np.zeros((0, 0)), np.zeros(0)  # in the place of what is not there


class Network(NamedTuple):
    """The weights of a perceptron [d] → [H] → [H] → [2], a row for each unit before; empty: there is none."""

    first: Floats = NO_TABLE  # [d, H]
    first_bias: Floats = NO_VALUES  # [H]
    second: Floats = NO_TABLE  # [H, H]
    second_bias: Floats = NO_VALUES  # [H]
    last: Floats = NO_TABLE  # [H, 2]
    last_bias: Floats = NO_VALUES  # [2]


def _regression(width: int, penalty: float, seed: int) -> Any:
    """The regression behind a network, unfitted."""
    from sklearn.neural_network import MLPRegressor  # here, since a training run needs the fitted one only

    layers, own = (width, width), {"alpha": penalty, "random_state": seed}
    return MLPRegressor(hidden_layer_sizes=layers, solver="lbfgs", max_iter=ITERATIONS, **own)


def _moments(y: Floats) -> tuple[Floats, float]:
    """The mean [2] of the points [k, 2], and the standard deviation of all their coordinates."""
    return y.mean(axis=0), float(y.std()) or 1.0


@contextmanager
def _stopped() -> Iterator[None]:
    """Without the warning that `ITERATIONS` end a fit: it is stopped, not left to converge."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        yield


def fit_network(scaled: Floats, y: Floats, width: int, penalty: float, seed: int) -> Network:
    """The network of the pairs (s_i, y_i), [k, d] and [k, 2]; ``seed``: of its first weights."""
    mean, spread = _moments(y)
    model = _regression(width, penalty, seed)
    with _stopped():
        model.fit(scaled, (y - mean) / spread)
    weights, biases = [*model.coefs_], [*model.intercepts_]
    weights[-1], biases[-1] = spread * weights[-1], spread * biases[-1] + mean
    parts = [part for pair in zip(weights, biases, strict=True) for part in pair]
    return Network(*(np.ascontiguousarray(part, np.float64) for part in parts))


def held_out_places(scaled: Floats, y: Floats, width: int, penalty: float, seed: int) -> Floats:
    """[k, 2]: each s_i [d] as placed by a network that has learned from the other folds alone."""
    from sklearn.model_selection import KFold, cross_val_predict

    mean, spread = _moments(y)
    folds = KFold(min(FOLDS, len(y)), shuffle=True, random_state=seed)
    with _stopped():
        model = _regression(width, penalty, seed)
        found = cross_val_predict(model, scaled, (y - mean) / spread, cv=folds)
    return np.asarray(found * spread + mean, np.float64)


@jit
def apply_network(network: Network, scale: Floats, x: Floats) -> tuple[float, float]:
    """Ψ of one state x [d] by a network: (y_1, y_2). Sums run over the units before, in their order."""
    hidden, following = network.first_bias.copy(), network.second_bias.copy()
    for i in range(scale.size):
        v, row = min(max(x[i] / scale[i], -FAR), FAR), network.first[i]
        for j in range(hidden.size):
            hidden[j] += row[j] * v
    for i in range(hidden.size):
        v, row = max(hidden[i], 0.0), network.second[i]
        for j in range(following.size):
            following[j] += row[j] * v
    y1, y2 = network.last_bias[0], network.last_bias[1]
    for i in range(following.size):
        v = max(following[i], 0.0)
        y1 += network.last[i, 0] * v
        y2 += network.last[i, 1] * v
    return y1, y2


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
