r"""The low-dimensional safe region: Γ on a grid over the y-plane, S_y, and the hypothesis h(x).

    P(l(x) = 1) = Γ(y)|_{y = Ψ(x)}                                        (eq. 4)
    S_y = {y : Γ(y) > p_t},   h(x) = 1 if Ψ(x) ∈ S_y, else 0              (eqs. 5, 8)

Γ, a value for each cell of a grid, is estimated in `assessment` from pieces of evidence (e_i, z_i). The
evidence of the training state x_i sits at e_i = Ψ₋ᵢ(x_i), where the *other* training states place it ("held
out"): a new state is placed by Ψ too, and eq. (4) asks for the probability at that place. ("embedded":
e_i = y_i, where t-SNE, which knows the label, has put it.)
"""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, ClassifierMixin, TransformerMixin
from sklearn.utils.validation import check_is_fitted

from srlrepro.dynamics.closed_loop import ClosedLoop, Labels
from srlrepro.dynamics.pendulum import Floats, as_states
from srlrepro.region.hypothesis import MAP, Posterior
from srlrepro.region.mapping import map_states
from srlrepro.region.safety_map import RegionArrays, discretise, query_batch
from srlrepro.region.tsne import dissimilarity, embed
from srlrepro.samplers import TrainingData, known_states
from srlrepro.settings.choices import Choices
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check
from srlrepro.settings.paper import Paper
from srlrepro.storage.files import ResultError, read_arrays, write_arrays

FORMAT = "srlrepro-safe-region-2"


class SafeRegion(ClassifierMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Ψ, Γ and h of one training dataset, by scikit-learn's conventions.

    Args:
        p_t: threshold of eq. (5).
        label_gap, perplexity: δ of Ω, and of t-SNE.
        neighbours: of Ψ.
        evidence: "held out" or "embedded"; bandwidth: b in RMS radii of the y_i; prior: c; empty: Γ_0;
            cells: G.
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
        empty: float = Choices.gamma_empty,
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
        self.empty = empty
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
            empty=c.gamma_empty,
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
        self._check_parameters(len(as_states(x)))
        omega = dissimilarity(trajectories, z, self.state_max, self.label_gap)
        return self.fit_embedding(x, z, embed(omega, self.perplexity, self.random_state))

    def fit_embedding(self, x: ArrayLike, z: ArrayLike, y: ArrayLike) -> "SafeRegion":
        """Learn Ψ and Γ from states x [k, 6], labels z [k] and given simplified states y [k, 2]."""
        states, labels, places = as_states(x), np.asarray(z), np.ascontiguousarray(y, dtype=np.float64)
        k = len(states)
        self._check_parameters(k)
        check(labels.shape == (k,), "z", f"shape {labels.shape}", f"labels of shape [{k}]")
        check(bool(np.isin(labels, (0, 1)).all()), "z", "other values", "labels 0 or 1")
        check(places.shape == (k, 2), "y", f"shape {places.shape}", f"simplified states of shape [{k}, 2]")
        scale = np.array(self.state_max, dtype=np.float64)
        neighbours = min(self.neighbours, k - 1)
        x_train = np.ascontiguousarray((states / scale).T)
        held_out = map_states(scale, x_train, places, neighbours, True, states)
        self.classes_ = np.array([0, 1])
        self.embedding_ = places
        self.labels_ = labels.astype(np.int64)
        self.evidence_ = held_out if self.evidence == "held out" else places
        grid = discretise(
            places, self.evidence_, self.labels_, self.bandwidth, self.prior, self.cells, self.empty
        )
        self.arrays_ = RegionArrays(scale, x_train, places, neighbours, *grid)
        return self

    def _check_parameters(self, k: int) -> None:
        """See that the parameters are allowed, and that there are k ≥ 2 training states."""
        check(isinstance(self.p_t, float) and 0 < self.p_t < 1, "p_t", self.p_t, "a number in (0, 1)")
        for name, least in (("neighbours", 1), ("cells", 1), ("random_state", 0)):
            value = getattr(self, name)
            check(isinstance(value, int) and value >= least, name, value, f"a whole number in [{least}, inf)")
        for name in ("bandwidth", "prior", "perplexity"):
            value = getattr(self, name)
            check(isinstance(value, (float, int)) and 0 < value < np.inf, name, value, "a number in (0, inf)")
        gap, high = self.label_gap, self.state_max
        check(isinstance(gap, (float, int)) and 0 <= gap < np.inf, "label_gap", gap, "a number in [0, inf)")
        empty = self.empty
        check(isinstance(empty, (float, int)) and 0 <= empty < 1, "empty", empty, "a number in [0, 1)")
        check(self.evidence in ("held out", "embedded"), "evidence", self.evidence, "held out or embedded")
        six = isinstance(high, tuple) and len(high) == 6
        ok = six and all(isinstance(v, (float, int)) and 0 < v < np.inf for v in high)
        check(ok, "state_max", high, "six numbers in (0, inf)")
        check(k >= 2, "k", k, "a whole number in [2, inf)")

    def transform(self, x: ArrayLike) -> Floats:
        """Ψ: simplified states y [B, 2] of the states x [B, 6]."""
        check_is_fitted(self)
        a = self.arrays_
        return map_states(a.scale, a.x_train, a.y_train, a.neighbours, False, as_states(x))

    def safety(self, x: ArrayLike) -> Floats:
        """Γ(Ψ(x)) [B], the probability that x is safe (eq. 4)."""
        check_is_fitted(self)
        return query_batch(self.arrays_, as_states(x))

    def predict_proba(self, x: ArrayLike) -> Floats:
        """[B, 2]: the probabilities of unsafe (0) and safe (1), the latter Γ(Ψ(x))."""
        safe = self.safety(x)
        return np.stack([1.0 - safe, safe], axis=1)

    def predict(self, x: ArrayLike) -> Labels:
        """h(x) [B] of eq. (8): 1 if Γ(Ψ(x)) > p_t, else 0."""
        return (self.safety(x) > self.p_t).astype(np.int64)  # eq. (5)

    @property
    def posterior(self) -> Posterior:
        """This hypothesis for `safe_probability`."""
        return Posterior(MAP, self.arrays_)

    def digest(self) -> str:
        """SHA-256 of what h depends on, to tell regions apart."""
        check_is_fitted(self)
        parts = (*self.arrays_, self.p_t)
        return hashlib.sha256(b"".join(np.asarray(part).tobytes() for part in parts)).hexdigest()

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
        if isinstance(values["state_max"], list):
            values["state_max"] = tuple(values["state_max"])
        region = cls(**values)
        a = {n: stored[f"array_{n}"] for n in fields}
        labels, evidence = stored["labels"], stored["evidence"]
        k, cells = labels.size, region.cells
        shapes = {
            "scale": (6,),
            "x_train": (6, k),
            "y_train": (k, 2),
            "gamma": (cells, cells),
            "origin": (2,),
        }
        shapes |= {"neighbours": (), "cell": (), "empty": ()}
        try:
            region._check_parameters(k)
            fits = all(a[n].shape == shape for n, shape in shapes.items()) and evidence.shape == (k, 2)
            fits = fits and all(np.isfinite(v).all() for v in (*a.values(), evidence))
            fits = fits and labels.shape == (k,) and bool(np.isin(labels, (0, 1)).all())
            fits = fits and (a["scale"] > 0).all() and a["cell"] > 0 and 1 <= a["neighbours"] < k
            fits = fits and 0 <= a["empty"] < 1
            fits = fits and a["gamma"].min() >= 0 and a["gamma"].max() < 1
        except (ValueError, TypeError) as error:
            raise ResultError(f"{path} holds a region whose parts do not fit together") from error
        if not fits:
            raise ResultError(f"{path} holds a region whose parts do not fit together")
        a["neighbours"], a["cell"], a["empty"] = int(a["neighbours"]), float(a["cell"]), float(a["empty"])
        region.arrays_ = RegionArrays(**a)
        region.classes_, region.embedding_ = np.array([0, 1]), a["y_train"]
        region.evidence_, region.labels_ = stored["evidence"], stored["labels"]
        return region


def learn_region(data: TrainingData, config: Config, seed: int = 0) -> SafeRegion:
    """The safe region of training data: their closed-loop trajectories on the nominal system, Ω, t-SNE, Ψ, Γ.

    With ``known_origin`` the origin joins the training states as one more safe state; it comes last.
    """
    choices = config.choices
    loop = ClosedLoop.from_config(config)
    x, z = known_states(data, config)
    stride = max(1, round(choices.omega_step / choices.control_period))
    instants = round(choices.omega_horizon / choices.control_period) + 1
    return SafeRegion.from_config(config, seed).fit(x, z, loop.rollout(x).paths[:, :instants:stride])
