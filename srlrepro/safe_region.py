r"""The low-dimensional safe region: Γ on a grid over the y-plane, S_y, and the hypothesis h(x).

    P(l(x) = 1) = Γ(y)|_{y = Ψ(x)}                                        (eq. 4)
    S_y = {y : Γ(y) > p_t},   h(x) = 1 if Ψ(x) ∈ S_y, else 0              (eqs. 5, 8)

Γ has one value per cell of a grid. With the kernel weights w_i(y) = exp(−‖y − e_i‖² / 2b²) of the pieces
of evidence (e_i, z_i) and the pseudo-count c of unsafe evidence,

    Γ(y) = Σ_i w_i(y) z_i / (Σ_i w_i(y) + c),

which lies in [0, 1), grows with every safe and falls with every unsafe piece of evidence, and goes to 0
where there is none: unknown is unsafe. The evidence of the training state x_i sits at e_i = Ψ₋ᵢ(x_i), where
the *other* training states place it ("held out"): a new state is placed by Ψ too, and eq. (4) asks for
the probability at that place. ("embedded": e_i = y_i, where t-SNE, which knows the label, has put it.)
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import cdist
from sklearn.base import BaseEstimator, ClassifierMixin, TransformerMixin
from sklearn.utils.validation import check_is_fitted

from srlrepro.config import Choices, Config, Paper, check
from srlrepro.embedding import dissimilarity, embed, map_state, map_states
from srlrepro.files import ResultError, read_arrays, write_arrays
from srlrepro.labels import ClosedLoop, Labels
from srlrepro.pendulum import Floats, as_states, jit
from srlrepro.sampling import TrainingData, known_states

FORMAT = "srlrepro-safe-region-1"
MARGIN = 3.0  # bandwidths around the evidence that the grid covers: beyond, a kernel weighs under 1.2 %


class RegionArrays(NamedTuple):
    """A fitted region as compiled code takes it.

    Attributes:
        scale: [6]; x_train: [6, k] scaled; y_train: [k, 2]; neighbours: of Ψ.
        gamma: [G, G], cell (i, j) covers y = origin + cell·([i, i + 1), [j, j + 1)).
        origin: [2]; cell: side of a cell.
    """

    scale: Floats
    x_train: Floats
    y_train: Floats
    neighbours: int
    gamma: Floats
    origin: Floats
    cell: float


@jit
def look_up(gamma: Floats, origin: Floats, cell: float, y1: float, y2: float) -> float:
    """Γ of the cell that holds (y1, y2); 0 outside the grid, where there is no evidence."""
    i, j = int(np.floor((y1 - origin[0]) / cell)), int(np.floor((y2 - origin[1]) / cell))
    if i < 0 or j < 0 or i >= gamma.shape[0] or j >= gamma.shape[1]:
        return 0.0
    return gamma[i, j]  # type: ignore[no-any-return]


@jit
def query(region: RegionArrays, x: Floats) -> tuple[float, float, float]:
    """(y_1, y_2, Γ) of one state x [6]: Ψ, then Γ."""
    y1, y2 = map_state(region.scale, region.x_train, region.y_train, region.neighbours, -1, x)
    return y1, y2, look_up(region.gamma, region.origin, region.cell, y1, y2)


@jit
def _query_batch(region: RegionArrays, x: Floats) -> Floats:
    out = np.empty(x.shape[0])
    for i in range(x.shape[0]):
        out[i] = query(region, x[i])[2]
    return out


def kernel_estimate(y: Floats, evidence: Floats, z: Labels, bandwidth: float, prior: float) -> Floats:
    """Γ [B] at the points y [B, 2] from the evidence [k, 2] with labels z [k]: see the module."""
    weights = np.exp(-0.5 * (cdist(y, evidence) / bandwidth) ** 2)
    return np.asarray((weights @ z) / (weights.sum(axis=1) + prior), np.float64)


class SafeRegion(ClassifierMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Ψ, Γ and h of one training dataset, by scikit-learn's conventions.

    Args:
        p_t: threshold of eq. (5).
        label_gap, perplexity: δ of Ω, and of t-SNE.
        neighbours: of Ψ.
        evidence: "held out" or "embedded"; bandwidth: b in RMS radii of the y_i; prior: c; cells: G.
        state_max: [6] half ranges that scale the states.
        random_state: seed of t-SNE.

    Attributes:
        embedding_: [k, 2] simplified states y_i.
        evidence_: [k, 2] places e_i of the evidence; labels_: [k] their labels z_i.
        arrays_: `RegionArrays`.
        classes_: [0, 1].
    """

    def __init__(
        self,
        p_t: float = Paper.p_t,
        label_gap: float = Choices.label_gap,
        perplexity: float = Choices.perplexity,
        neighbours: int = Choices.psi_neighbours,
        evidence: str = Choices.gamma_evidence,
        bandwidth: float = Choices.gamma_bandwidth,
        prior: float = Choices.gamma_prior,
        cells: int = Choices.gamma_cells,
        state_max: tuple[float, ...] = Paper().state_max,
        random_state: int = 0,
    ) -> None:
        self.p_t = p_t
        self.label_gap = label_gap
        self.perplexity = perplexity
        self.neighbours = neighbours
        self.evidence = evidence
        self.bandwidth = bandwidth
        self.prior = prior
        self.cells = cells
        self.state_max = state_max
        self.random_state = random_state

    @classmethod
    def from_config(cls, config: Config, seed: int = 0) -> "SafeRegion":
        """An unfitted region with the values of a configuration."""
        p, c = config.paper, config.choices
        return cls(
            p_t=p.p_t,
            label_gap=c.label_gap,
            perplexity=c.perplexity,
            neighbours=c.psi_neighbours,
            evidence=c.gamma_evidence,
            bandwidth=c.gamma_bandwidth,
            prior=c.gamma_prior,
            cells=c.gamma_cells,
            state_max=p.state_max,
            random_state=seed,
        )

    def fit(self, x: ArrayLike, z: ArrayLike, trajectories: ArrayLike) -> "SafeRegion":
        """Learn Ψ and Γ.

        Args:
            x: [k, 6] training states, rad and rad/s.
            z: [k] their labels l_n(x), 0 or 1.
            trajectories: [k, T, 6] closed-loop trajectories of the nominal system from x.

        Raises:
            ValueError: shapes or values that are not allowed; p_t outside (0, 1).
        """
        omega = dissimilarity(trajectories, z, self.state_max, self.label_gap)
        return self.fit_embedding(x, z, embed(omega, self.perplexity, self.random_state))

    def fit_embedding(self, x: ArrayLike, z: ArrayLike, y: ArrayLike) -> "SafeRegion":
        """Learn Ψ and Γ from states x [k, 6], labels z [k] and given simplified states y [k, 2]."""
        states, labels, places = as_states(x), np.asarray(z), np.asarray(y, dtype=np.float64)
        k = len(states)
        check(isinstance(self.p_t, float) and 0 < self.p_t < 1, "p_t", self.p_t, "a number in (0, 1)")
        check(k >= 2, "k", k, "a whole number in [2, inf)")
        check(labels.shape == (k,), "z", f"shape {labels.shape}", f"labels of shape [{k}]")
        check(bool(np.isin(labels, (0, 1)).all()), "z", "other values", "labels 0 or 1")
        check(places.shape == (k, 2), "y", f"shape {places.shape}", f"simplified states of shape [{k}, 2]")
        check(self.evidence in ("held out", "embedded"), "evidence", self.evidence, "held out or embedded")
        scale = np.array(self.state_max, dtype=np.float64)
        neighbours = min(self.neighbours, k - 1)
        x_train = np.ascontiguousarray((states / scale).T)
        held_out = map_states(scale, x_train, places, neighbours, True, states)
        self.classes_ = np.array([0, 1])
        self.embedding_ = places
        self.labels_ = labels.astype(np.int64)
        self.evidence_ = held_out if self.evidence == "held out" else places
        radius = np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean())
        bandwidth = self.bandwidth * radius if radius > 0 else 1.0
        low, high = places.min(axis=0) - MARGIN * bandwidth, places.max(axis=0) + MARGIN * bandwidth
        cell = float((high - low).max() / self.cells)
        origin = (low + high) / 2 - cell * self.cells / 2
        centres = cell * (np.arange(self.cells) + 0.5)
        grid = np.stack(np.meshgrid(origin[0] + centres, origin[1] + centres, indexing="ij"), axis=-1)
        gamma = kernel_estimate(grid.reshape(-1, 2), self.evidence_, self.labels_, bandwidth, self.prior)
        gamma = gamma.reshape(self.cells, self.cells)
        self.arrays_ = RegionArrays(scale, x_train, places, neighbours, gamma, origin, cell)
        return self

    def transform(self, x: ArrayLike) -> Floats:
        """Ψ: simplified states y [B, 2] of the states x [B, 6]."""
        check_is_fitted(self)
        a = self.arrays_
        return map_states(a.scale, a.x_train, a.y_train, a.neighbours, False, as_states(x))

    def safety(self, x: ArrayLike) -> Floats:
        """Γ(Ψ(x)) [B], the probability that x is safe (eq. 4)."""
        check_is_fitted(self)
        return _query_batch(self.arrays_, as_states(x))

    def predict_proba(self, x: ArrayLike) -> Floats:
        """[B, 2]: the probabilities of unsafe (0) and safe (1), the latter Γ(Ψ(x))."""
        safe = self.safety(x)
        return np.stack([1.0 - safe, safe], axis=1)

    def predict(self, x: ArrayLike) -> Labels:
        """h(x) [B] of eq. (8): 1 if Γ(Ψ(x)) > p_t, else 0."""
        return (self.safety(x) > self.p_t).astype(np.int64)  # eq. (5)

    def save(self, path: Path) -> None:
        """Write the fitted region as npz: parameters as numbers and text, no pickle."""
        check_is_fitted(self)
        arrays: dict[str, Any] = {f"param_{name}": np.array(v) for name, v in self.get_params().items()}
        arrays |= {f"array_{name}": np.array(value) for name, value in self.arrays_._asdict().items()}
        write_arrays(path, FORMAT, **arrays, evidence=self.evidence_, labels=self.labels_)

    @classmethod
    def load(cls, path: Path) -> "SafeRegion":
        """Read a region that `save` wrote.

        Raises:
            ResultError: the file is missing, truncated, not a region, or holds values that are not allowed.
        """
        params, fields = tuple(cls().get_params()), RegionArrays._fields
        names = (*(f"param_{n}" for n in params), *(f"array_{n}" for n in fields), "evidence", "labels")
        stored = read_arrays(path, FORMAT, names)
        values = {n: stored[f"param_{n}"].tolist() for n in params}
        values["state_max"] = tuple(values["state_max"])
        region = cls(**values)
        a = {n: stored[f"array_{n}"] for n in fields}
        k = len(stored["labels"])
        fits = a["x_train"].shape == (6, k) and a["y_train"].shape == (k, 2) and a["gamma"].ndim == 2
        numbers = [v for v in a.values() if v.dtype.kind == "f"]
        if not (fits and 0 < region.p_t < 1 and all(np.isfinite(v).all() for v in numbers)):
            raise ResultError(f"{path} holds a region whose parts do not fit together")
        a["neighbours"], a["cell"] = int(a["neighbours"]), float(a["cell"])
        region.arrays_ = RegionArrays(**a)
        region.classes_, region.embedding_ = np.array([0, 1]), a["y_train"]
        region.evidence_, region.labels_ = stored["evidence"], stored["labels"]
        return region


def learn(data: TrainingData, config: Config, seed: int = 0) -> SafeRegion:
    """The safe region of training data: their closed-loop trajectories on the nominal system, Ω, t-SNE, Ψ, Γ.

    With ``known_origin`` the origin joins the training states as one more safe state; it comes last.
    """
    choices = config.choices
    loop = ClosedLoop.from_config(config)
    x, z = known_states(data, config)
    stride = max(1, round(choices.omega_step / choices.control_period))
    instants = round(choices.omega_horizon / choices.control_period) + 1
    return SafeRegion.from_config(config, seed).fit(x, z, loop.rollout(x).paths[:, :instants:stride])
