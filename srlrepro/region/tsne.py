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

from srlrepro.dynamics.closed_loop import Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.settings.config import check_parameters
from srlrepro.settings.fields import check


def trajectory_distances(paths: ArrayLike, state_max: ArrayLike) -> Floats:
    """ω [k, k]: RMS distance over the T instants of the scaled paths [k, T, d], each entry limited to ±1.

    Where K has lost control the velocities run far out of the state space of App. C, and how far they run
    says nothing about the state that they started from.
    """
    array, high = np.asarray(paths, dtype=np.float64), np.asarray(state_max)
    fits = array.ndim == 3 and array.shape[2] == high.size
    check(fits, "trajectories", f"shape {array.shape}", f"of shape [k, T, {high.size}]")
    check(bool(np.isfinite(array).all()), "trajectories", "NaN or infinity", "finite numbers (rad, rad/s)")
    scaled = np.clip(array / high, -1.0, 1.0)
    flat = scaled.reshape(len(scaled), -1) / np.sqrt(scaled.shape[1])
    return np.asarray(squareform(pdist(flat)), np.float64)


def dissimilarity(paths: ArrayLike, z: ArrayLike, state_max: ArrayLike, label_gap: float) -> Floats:
    """Ω [k, k] of the paths [k, T, d] and labels z [k]; symmetric, with a zero diagonal."""
    check_parameters({"label_gap": label_gap})
    omega, labels = trajectory_distances(paths, state_max), np.asarray(z)
    check(labels.shape == (len(omega),), "z", f"shape {labels.shape}", f"labels of shape [{len(omega)}]")
    largest = omega.max()
    if largest > 0:
        omega /= largest
    omega += label_gap * (labels[:, None] != labels[None, :])
    return omega


def embed(omega: ArrayLike, perplexity: float, seed: int) -> Floats:
    """Simplified states y [k, 2] from the dissimilarity Ω [k, k] by t-SNE (openTSNE's defaults).

    One thread: openTSNE is then deterministic. The spectral start is the one that means something for a
    given dissimilarity. A perplexity is lowered to (k − 1) / 3, openTSNE's own limit.
    """
    from openTSNE import TSNE  # here, since it is slow to import and a training run needs Ψ only

    matrix = np.asarray(omega, dtype=np.float64)
    supported = min(perplexity, (len(matrix) - 1) / 3)
    tsne = TSNE(
        metric="precomputed", initialization="spectral", perplexity=supported, n_jobs=1, random_state=seed
    )
    return np.array(tsne.fit(matrix), dtype=np.float64)


def label_purity(distances: ArrayLike, z: Labels, neighbours: int = 10) -> float:
    """Mean share of the nearest points that carry the same label, from distances [k, k]."""
    matrix = np.array(distances, dtype=np.float64)
    np.fill_diagonal(matrix, np.inf)
    nearest = np.argsort(matrix, axis=1)[:, :neighbours]
    return float((z[nearest] == z[:, None]).mean())
