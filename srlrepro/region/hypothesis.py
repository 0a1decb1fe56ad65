r"""The posterior P(l(x) = 1 | x) of a hypothesis, compiled once for all kinds of them.

With s = x in half ranges of App. C, the posterior of a hypothesis is, by its kind,

- `MAP`: Γ(Ψ(x)), the safe region of eq. (4);
- `LINEAR`: Γ(A s + b), where the state mapping is linear;
- `VOTE`: the mean label of the nearest training states, weighted by inverse distance;
- `NETWORK`: σ(w·tanh(W s + b) + c), a perceptron, where σ is the logistic function;
- `KERNEL`: σ(Σ_i w_i exp(−γ‖s − s_i‖²) + c), a support vector machine;
- `LOOP`: 1 if K recovers a system from x, else 0: l_n(x) or l(x) itself (eqs. 2, 3).
"""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from srlrepro.compiled.jit import inner, jit
from srlrepro.dynamics.closed_loop import RECOVERED, Labels, Loop, recover
from srlrepro.dynamics.lqg import Gains
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.mapping import map_state
from srlrepro.region.safety_map import RegionArrays, look_up, query

MAP, LINEAR, VOTE, NETWORK, KERNEL, LOOP = range(6)
NONE, TABLE = np.zeros(0), np.zeros((0, 0))
NO_GAINS: Gains = (TABLE, TABLE, TABLE, TABLE, 0.0)
NO_LOOP: Loop = ((0.0,) * 9, NO_GAINS, (0.0, 1, 0.0, 0.0, 0.0, 0.0), 0)


class Posterior(NamedTuple):
    """A hypothesis as compiled code takes it; what its kind does not need is empty.

    ``region`` holds Γ's grid for `LINEAR`, the training states for `VOTE`, with y_train = (z, 0), and the
    scale [6] for all but `LOOP`.
    """

    kind: int = MAP
    region: RegionArrays = RegionArrays(NONE, TABLE, TABLE, 0, TABLE, NONE, 0.0)
    rows: Floats = TABLE  # [H, 6] A, W, or the support vectors s_i
    offsets: Floats = NONE  # [H] b
    weights: Floats = NONE  # [H] w
    bias: float = 0.0  # c
    width: float = 0.0  # γ
    loop: Loop = NO_LOOP  # of the system that `LOOP` simulates


@inner
def safe_probability(posterior: Posterior, x: Floats) -> float:
    """P(l(x) = 1) of one state x [6]."""
    kind, region = posterior.kind, posterior.region
    if kind == MAP:
        return query(region, x)[2]  # eq. (4)
    if kind == VOTE:
        return map_state(region.scale, region.x_train, region.y_train, region.neighbours, -1, x)[0]
    if kind == LOOP:
        outcome, _ = recover(*posterior.loop, x, np.empty((0, 6)))
        return 1.0 if outcome == RECOVERED else 0.0  # eq. (2)
    s = x / region.scale
    if kind == LINEAR:
        y = np.dot(posterior.rows, s) + posterior.offsets
        return look_up(region, y[0], y[1])
    if kind == NETWORK:
        features = np.tanh(np.dot(posterior.rows, s) + posterior.offsets)
    else:
        features = np.empty(len(posterior.rows))
        for i in range(features.size):
            squared = 0.0
            for j in range(s.size):
                squared += (posterior.rows[i, j] - s[j]) ** 2
            features[i] = np.exp(-posterior.width * squared)
    return float(1.0 / (1.0 + np.exp(-np.dot(posterior.weights, features) - posterior.bias)))


@jit
def safe_probabilities(posterior: Posterior, x: Floats) -> Floats:
    """P(l(x) = 1) [B] of the states x [B, 6]."""
    out = np.empty(x.shape[0])
    for i in range(x.shape[0]):
        out[i] = safe_probability(posterior, x[i])
    return out


class Hypothesis(Protocol):
    """Anything that predicts safety: h(x) (a SafeRegion), or l(x) itself (a ClosedLoop, eq. 3)."""

    def predict(self, x: ArrayLike) -> Labels:
        """Labels [B] of the states x [B, 6]: 1 = safe."""


@runtime_checkable
class CompiledHypothesis(Hypothesis, Protocol):
    """A hypothesis that compiled code knows: h(x) = 1 if P(l(x) = 1) > p_t (`hypotheses`)."""

    @property
    def p_t(self) -> float:
        """Threshold of eq. (5)."""

    @property
    def posterior(self) -> Posterior:
        """This hypothesis for `safe_probability`."""

    def safety(self, x: ArrayLike) -> Floats:
        """P(l(x) = 1) [B] of the states x [B, 6]."""

    def digest(self) -> str:
        """SHA-256 of what h depends on, to tell hypotheses apart."""
