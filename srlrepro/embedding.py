r"""From trajectories to the plane: the dissimilarity Ω, t-SNE, and the state mapping Ψ.

t-SNE embeds a dissimilarity of training states that knows how they behave under K:

    Ω_ij = ω_ij / max ω + δ·[z_i ≠ z_j],

where ω_ij is the root-mean-square distance, over time and over the states scaled by the ranges of
App. C, between the closed-loop trajectories of the nominal system that start at x_i and x_j, and δ
(``label_gap``) keeps safe and unsafe states apart. A new state x has neither label nor trajectory, so
y = Ψ(x) interpolates the pairs (x_i, y_i): the mean of the y_i of the k nearest x_i, in the scaled
states, weighted by inverse distance.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import pdist, squareform

from srlrepro.config import check
from srlrepro.labels import Labels
from srlrepro.pendulum import Floats, as_state, jit


def trajectory_distances(paths: ArrayLike, state_max: ArrayLike) -> Floats:
    """ω [k, k]: RMS distance over the T instants of the scaled paths [k, T, 6], each entry within ±1.

    Scaled states are limited to ±1: where K has lost control the velocities run far out of the state
    space of App. C, and how far they run says nothing about the state that they started from.
    """
    array = np.asarray(paths, dtype=np.float64)
    check(
        array.ndim == 3 and array.shape[2] == 6, "trajectories", f"shape {array.shape}", "of shape [k, T, 6]"
    )
    check(bool(np.isfinite(array).all()), "trajectories", "NaN or infinity", "finite numbers (rad, rad/s)")
    scaled = np.clip(array / np.asarray(state_max), -1.0, 1.0)
    flat = scaled.reshape(len(scaled), -1) / np.sqrt(scaled.shape[1])
    return np.asarray(squareform(pdist(flat)), np.float64)


def dissimilarity(paths: ArrayLike, z: ArrayLike, state_max: ArrayLike, label_gap: float) -> Floats:
    """Ω [k, k] of the paths [k, T, 6] and labels z [k]; symmetric, with a zero diagonal.

    Raises:
        ValueError: shapes that do not fit, NaN, or δ < 0.
    """
    check(label_gap >= 0, "label_gap", label_gap, "a number >= 0")
    omega, labels = trajectory_distances(paths, state_max), np.asarray(z)
    check(labels.shape == (len(omega),), "z", f"shape {labels.shape}", f"labels of shape [{len(omega)}]")
    largest = omega.max()
    if largest > 0:
        omega /= largest
    omega += label_gap * (labels[:, None] != labels[None, :])
    return omega


def embed(omega: ArrayLike, perplexity: float, seed: int) -> Floats:
    """Simplified states y [k, 2] from the dissimilarity Ω [k, k] by t-SNE (openTSNE's defaults).

    One thread: openTSNE is then deterministic. The spectral start is the one that means something for
    a precomputed dissimilarity. A perplexity that the k points cannot support is lowered to
    (k − 1) / 3, openTSNE's own limit.
    """
    from openTSNE import TSNE  # here, since it is slow to import and a training run needs Ψ only

    matrix = np.asarray(omega, dtype=np.float64)
    supported = min(perplexity, (len(matrix) - 1) / 3)
    tsne = TSNE(
        metric="precomputed",
        initialization="spectral",
        perplexity=supported,
        n_jobs=1,
        random_state=seed,
    )
    return np.array(tsne.fit(matrix), dtype=np.float64)


FAR = 1e6  # half ranges: beyond, all training states are equally far away


@jit
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
    """Ψ of one state x [6]: (y_1, y_2).

    scale [6]: half ranges; x_train [6, k]: scaled training states, one row per coordinate, so that the
    distances are computed several at a time; y_train [k, 2]; ``skip``: index of a training state to
    leave out, or -1.
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


def label_purity(distances: ArrayLike, z: Labels, neighbours: int = 10) -> float:
    """Mean share of the nearest points that carry the same label, from distances [k, k]."""
    matrix = np.array(distances, dtype=np.float64)
    np.fill_diagonal(matrix, np.inf)
    nearest = np.argsort(matrix, axis=1)[:, :neighbours]
    return float((z[nearest] == z[:, None]).mean())
