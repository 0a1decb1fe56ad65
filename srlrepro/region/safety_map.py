r"""The safety assessment function Γ(y): its estimate from evidence, and its value at a state, compiled.

Γ has one value per cell of a grid. With the kernel weights w_i(y) = exp(−‖y − e_i‖² / 2b²) of the pieces
of evidence (e_i, z_i), times a weight of each where there are such, and the pseudo-count c of evidence with
the mean Γ_0,

    Γ(y) = (Σ_i w_i(y) z_i + c Γ_0) / (Σ_i w_i(y) + c),

which lies in [0, 1), grows with every safe and falls with every unsafe piece of evidence, and goes to Γ_0
where there is none. With Γ_0 = 0 unknown is unsafe.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.distance import cdist

from srlrepro.compiled.jit import jit
from srlrepro.dynamics.closed_loop import Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.mapping import Network, apply_network, map_state

MARGIN = 3.0  # bandwidths around the evidence that the grid covers: beyond, a kernel weighs under 1.2 %


class RegionArrays(NamedTuple):
    """A fitted region as compiled code takes it."""

    scale: Floats  # [d] half ranges
    x_train: Floats  # [d, k] scaled
    y_train: Floats  # [k, 2]
    neighbours: int  # of Ψ, where it is by neighbours
    gamma: Floats  # [G, G], cell (i, j) covers y = origin + cell·([i, i + 1), [j, j + 1))
    origin: Floats  # [2]
    cell: float  # its side
    empty: float = 0.0  # Γ_0, and so Γ outside the grid
    network: Network = Network()  # Ψ, where it is not by neighbours


@jit
def look_up(region: RegionArrays, y1: float, y2: float) -> float:
    """Γ of the cell that holds (y1, y2); Γ_0 outside the grid, where there is no evidence."""
    origin, cell, gamma = region.origin, region.cell, region.gamma
    i, j = int(np.floor((y1 - origin[0]) / cell)), int(np.floor((y2 - origin[1]) / cell))
    if i < 0 or j < 0 or i >= gamma.shape[0] or j >= gamma.shape[1]:
        return region.empty
    return gamma[i, j]  # type: ignore[no-any-return]


@jit
def place(region: RegionArrays, x: Floats) -> tuple[float, float]:
    """Ψ of one state x [d]: (y_1, y_2)."""
    if region.network.first.size > 0:
        return apply_network(region.network, region.scale, x)
    return map_state(region.scale, region.x_train, region.y_train, region.neighbours, -1, x)


@jit
def place_batch(region: RegionArrays, x: Floats) -> Floats:
    """Ψ of states x [B, d]: y [B, 2]."""
    y = np.empty((x.shape[0], 2))
    for i in range(x.shape[0]):
        y[i, 0], y[i, 1] = place(region, x[i])
    return y


@jit
def query(region: RegionArrays, x: Floats) -> tuple[float, float, float]:
    """(y_1, y_2, Γ) of one state x [d]: Ψ, then Γ."""
    y1, y2 = place(region, x)
    return y1, y2, look_up(region, y1, y2)


@jit
def query_batch(region: RegionArrays, x: Floats) -> Floats:
    out = np.empty(x.shape[0])
    for i in range(x.shape[0]):
        out[i] = query(region, x[i])[2]
    return out


def kernel_estimate(
    y: Floats,
    evidence: Floats,
    z: Labels,
    bandwidth: float,
    prior: float,
    empty: float = 0.0,
    sample_weight: Floats | None = None,
) -> Floats:
    """Γ [B] at the points y [B, 2] from the evidence [k, 2] with labels z [k]: see the module.

    sample_weight: [k] of the evidence; None: 1.
    """
    weights = np.exp(-0.5 * (cdist(y, evidence) / bandwidth) ** 2)
    if sample_weight is not None:
        weights *= sample_weight
    return np.asarray((weights @ z + prior * empty) / (weights.sum(axis=1) + prior), np.float64)


def discretise(
    places: Floats,
    evidence: Floats,
    z: Labels,
    bandwidth: float,
    prior: float,
    cells: int,
    empty: float,
    sample_weight: Floats | None = None,
) -> tuple[Floats, Floats, float, float]:
    """Γ on a grid around the places y_i [k, 2].

    Args:
        evidence, z, sample_weight: [k, 2], [k] and [k], as `kernel_estimate` takes them.
        bandwidth: b in RMS radii of the places; prior: c; cells: G; empty: Γ_0.

    Returns:
        (Γ [G, G] at the cells' centres, origin [2], side of a cell, Γ_0).
    """
    radius = np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean())
    width = bandwidth * radius if radius > 0 else 1.0
    low, high = places.min(axis=0) - MARGIN * width, places.max(axis=0) + MARGIN * width
    cell = float((high - low).max() / cells)
    origin = (low + high) / 2 - cell * cells / 2
    centres = cell * (np.arange(cells) + 0.5)
    grid = np.stack(np.meshgrid(origin[0] + centres, origin[1] + centres, indexing="ij"), axis=-1)
    gamma = kernel_estimate(grid.reshape(-1, 2), evidence, z, width, prior, empty, sample_weight)
    return gamma.reshape(cells, cells), origin, cell, empty
