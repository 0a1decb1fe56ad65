r"""The posterior P(l(x) = 1 | x) of a hypothesis, compiled once for all kinds of them.

With s = x in half ranges of App. C, the posterior of a hypothesis is, by its kind,

- `MAP`: Γ(Ψ(x)), the safe region of eq. (4);
- `LINEAR`: Γ(A s + b), where the state mapping is linear;
- `VOTE`: the mean label of the nearest training states, weighted by inverse distance;
- `NETWORK`: σ(w·tanh(W s + b) + c), a perceptron, where σ is the logistic function;
- `KERNEL`: σ(Σ_i w_i exp(−γ‖s − s_i‖²) + c), a support vector machine;
- `LOOP`: 1 if K recovers a system from x, else 0: l_n(x) or l(x) itself (eqs. 2, 3).
"""

import math
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from srlrepro.compiled.jit import inner, jit
from srlrepro.dynamics.closed_loop import RECOVERED, Labels, Loop, recover
from srlrepro.dynamics.lqg import Gains
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.mapping import NO_TABLE, NO_VALUES, map_state
from srlrepro.region.safety_map import RegionArrays, look_up, query

MAP, LINEAR, VOTE, NETWORK, KERNEL, LOOP = range(6)
NO_GAINS: Gains = (NO_TABLE, NO_TABLE, NO_TABLE, NO_TABLE, 0.0)


class Posterior(NamedTuple):
    """A hypothesis as compiled code takes it; what its kind does not need is empty.

    ``region`` holds Γ's grid for `LINEAR`, the training states for `VOTE`, with y_train = (z, 0), and the
    scale [d] for all but `LOOP`.
    """

    kind: int = MAP
    region: RegionArrays = RegionArrays(NO_VALUES, NO_TABLE, NO_TABLE, 0, NO_TABLE, NO_VALUES, 0.0)
    rows: Floats = NO_TABLE  # [H, d] A, W, or the support vectors s_i
    offsets: Floats = NO_VALUES  # [H] b
    weights: Floats = NO_VALUES  # [H] w
    bias: float = 0.0  # c
    width: float = 0.0  # γ
    loop: Loop | None = None  # of the system that `LOOP` simulates

    @property
    def dimension(self) -> int:
        """d, of the state."""
        return self.region.scale.size if self.loop is None else len(self.loop[0].upright)


@jit
def _simulate(loop: Loop | None, x: Floats) -> float:
    """1 if K recovers the system from x, else 0 (eq. 2)."""
    if loop is None:  # known to the compiler, which then leaves out the rest
        return 0.0
    outcome, _ = recover(*loop, x, np.empty((0, x.size)))
    return 1.0 if outcome == RECOVERED else 0.0


@jit
def _project(row: Floats, scale: Floats, x: Floats, offset: float) -> float:
    """Σ_j row_j x_j / scale_j + offset, in this order."""
    total = 0.0
    for j in range(scale.size):
        total += row[j] * (x[j] / scale[j])
    return total + offset


@inner
def safe_probability(posterior: Posterior, x: Floats) -> float:
    """P(l(x) = 1) of one state x [d]."""
    kind, region = posterior.kind, posterior.region
    if kind == MAP:
        return query(region, x)[2]  # eq. (4)
    if kind == VOTE:
        return map_state(region.scale, region.x_train, region.y_train, region.neighbours, -1, x)[0]
    if kind == LOOP:
        return _simulate(posterior.loop, x)
    rows, offsets, scale = posterior.rows, posterior.offsets, region.scale
    if kind == LINEAR:
        y1, y2 = _project(rows[0], scale, x, offsets[0]), _project(rows[1], scale, x, offsets[1])
        return look_up(region, y1, y2)
    total = 0.0
    for i in range(rows.shape[0]):
        if kind == NETWORK:
            feature = math.tanh(_project(rows[i], scale, x, offsets[i]))
        else:
            squared = 0.0
            for j in range(scale.size):
                squared += (rows[i, j] - x[j] / scale[j]) ** 2
            feature = math.exp(-posterior.width * squared)
        total += posterior.weights[i] * feature
    return 1.0 / (1.0 + math.exp(-total - posterior.bias))


@jit
def safe_probabilities(posterior: Posterior, x: Floats) -> Floats:
    """P(l(x) = 1) [B] of the states x [B, d]."""
    out = np.empty(x.shape[0])
    for i in range(x.shape[0]):
        out[i] = safe_probability(posterior, x[i])
    return out


class Hypothesis(Protocol):
    """Anything that predicts safety: h(x) (a SafeRegion), or l(x) itself (a ClosedLoop, eq. 3)."""

    def predict(self, x: ArrayLike) -> Labels:
        """Labels [B] of the states x [B, d]: 1 = safe."""


@runtime_checkable
class CompiledHypothesis(Hypothesis, Protocol):
    """A hypothesis that compiled code knows: h(x) = 1 if P(l(x) = 1) > p_t."""

    @property
    def p_t(self) -> float:
        """Threshold of eq. (5)."""

    @property
    def posterior(self) -> Posterior:
        """This hypothesis for `safe_probability`."""

    def safety(self, x: ArrayLike) -> Floats:
        """P(l(x) = 1) [B] of the states x [B, d]."""

    def digest(self) -> str:
        """SHA-256 of what h depends on, to tell hypotheses apart."""
