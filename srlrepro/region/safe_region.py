r"""The low-dimensional safe region: Γ on a grid over the y-plane, S_y, and the hypothesis h(x).

    P(l(x) = 1) = Γ(y)|_{y = Ψ(x)}                                        (eq. 4)
    S_y = {y : Γ(y) > p_t},   h(x) = 1 if Ψ(x) ∈ S_y, else 0              (eqs. 5, 8)

Γ, a value for each cell of a grid, is estimated in `safety_map` from pieces of evidence (e_i, z_i). By the
paper's words the evidence of the training state x_i sits at e_i = y_i, where t-SNE has put it ("embedded"),
which knows its label. Calibrated evidence ("held out") sits at e_i = Ψ₋ᵢ(x_i), where the *other* training
states place x_i: a new state is placed by Ψ too, and eq. (4) asks for the probability at that place.
"""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import issparse
from sklearn.base import BaseEstimator, ClassifierMixin, TransformerMixin
from sklearn.utils import Tags
from sklearn.utils.validation import check_is_fitted, validate_data

from srlrepro.dynamics.closed_loop import ClosedLoop, Labels
from srlrepro.dynamics.pendulum import Floats, as_states
from srlrepro.region.hypothesis import MAP, Posterior
from srlrepro.region.mapping import Network, fit_network, held_out_places, map_states
from srlrepro.region.safety_map import RegionArrays, discretise, place_batch, query_batch
from srlrepro.region.tsne import dissimilarity, embed
from srlrepro.samplers import TrainingData, density_ratios, known_states
from srlrepro.settings.choices import Choices
from srlrepro.settings.condition import MOST_SEED
from srlrepro.settings.config import Config, check_parameters
from srlrepro.settings.fields import check, check_whole, is_number
from srlrepro.settings.paper import Paper
from srlrepro.storage.files import ResultError, read_arrays, write_arrays
from srlrepro.storage.made_of import MadeOf, read_made_of, require_made_of, write_made_of

FORMAT = "srlrepro-safe-region-4"
TINY = float(np.finfo(float).tiny)  # below, numbers lose digits
PARTS = (*RegionArrays._fields[:-1], *Network._fields)  # of the arrays, in a file
LEAST_STATES = 4  # the spectral start of t-SNE needs more than the three vectors that it takes


@dataclass(eq=False, repr=False)
class SafeRegion(ClassifierMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Ψ, Γ and h of one training dataset, by scikit-learn's conventions.

    States may have any dimension d and any units. Messages of what is refused are those of this package.

    Attributes:
        embedding_: [k, 2] simplified states y_i.
        evidence_: [k, 2] places e_i of the evidence; labels_: [k] their labels z_i.
        arrays_: `RegionArrays`.
        classes_: [0, 1]; n_features_in_: d.
        made_of_: α, seed and values behind the region; None for one fitted by hand.
    """

    p_t: float = Paper.p_t  # threshold of eq. (5)
    label_gap: float = Choices.label_gap  # δ of Ω
    perplexity: float = Choices.perplexity  # of t-SNE
    psi: str = Choices.psi  # "network" or "neighbours"
    psi_width: int = Choices.psi_width  # H of the network
    psi_penalty: float = Choices.psi_penalty  # on its squared weights
    psi_neighbours: int = Choices.psi_neighbours  # k of the neighbours
    gamma_evidence: str = Choices.gamma_evidence  # "held out" or "embedded"
    gamma_bandwidth: float = Choices.gamma_bandwidth  # b in RMS radii of the y_i
    gamma_prior: float = Choices.gamma_prior  # c / k
    gamma_empty: float = Choices.gamma_empty  # Γ_0
    gamma_cells: int = Choices.gamma_cells  # G
    # [d] half ranges that scale the states; None: the largest |x| of the training states, each coordinate's
    state_max: tuple[float, ...] | None = Paper().state_max
    random_state: int = 0  # seed of t-SNE, and of the network

    @classmethod
    def from_config(cls, config: Config, seed: int = 0) -> "SafeRegion":
        """An unfitted region with the values of a configuration."""
        return cls(**config.arguments_of(cls), state_max=config.paper.state_max, random_state=seed)

    def fit(
        self,
        x: ArrayLike,
        z: ArrayLike,
        trajectories: ArrayLike | None = None,
        sample_weight: ArrayLike | None = None,
    ) -> "SafeRegion":
        """Learn Ψ and Γ.

        Args:
            x: [k, d] training states, in the units of ``state_max``.
            z: [k] their labels l_n(x), 0 or 1.
            trajectories: [k, T, d] closed-loop trajectories of the nominal system from x, of any simulator;
                None: none are known, and Ω compares the states alone.
            sample_weight: [k] weights of the states as evidence of Γ, at least 0; None: 1.

        Returns:
            The region itself.

        Raises:
            ParameterError: a parameter or an argument is not allowed.
        """
        states = self._states(x, reset=True)
        k = len(states)
        self._check_parameters(k)
        check(k >= LEAST_STATES, "k", k, f"a whole number in [{LEAST_STATES}, inf)")
        paths = states[:, None] if trajectories is None else trajectories
        omega = dissimilarity(paths, z, self._scale(states), self.label_gap)
        y = embed(omega, self.perplexity, self.random_state)
        return self.fit_embedding(x, z, y, sample_weight)

    def fit_embedding(
        self, x: ArrayLike, z: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None
    ) -> "SafeRegion":
        """Learn Ψ and Γ from given simplified states y [k, 2], the rest as for `fit`."""
        states, labels = self._states(x, reset=True), np.asarray(z)
        k, places = len(states), np.ascontiguousarray(y, dtype=np.float64)
        self._check_parameters(k)
        check(labels.shape == (k,), "z", f"shape {labels.shape}", f"labels of shape [{k}]")
        check(bool(np.isin(labels, (0, 1)).all()), "z", "other values", "labels 0 or 1")
        check(places.shape == (k, 2), "y", f"shape {places.shape}", f"simplified states of shape [{k}, 2]")
        weights = None if sample_weight is None else np.asarray(sample_weight, dtype=np.float64)
        if weights is not None:
            fits = weights.shape == (k,) and bool((np.isfinite(weights) & (weights >= 0)).all())
            fits = fits and bool(weights.any())
            check(fits, "sample_weight", "other values", f"{k} finite numbers in [0, inf), not all zero")
        scale = self._scale(states)
        neighbours, scaled = int(min(self.psi_neighbours, k - 1)), states / scale
        x_train, held_out = np.ascontiguousarray(scaled.T), self.gamma_evidence == "held out"
        shape, network, evidence = (self.psi_width, self.psi_penalty, self.random_state), Network(), places
        if self.psi == "network":
            network = fit_network(scaled, places, *shape)
            evidence = held_out_places(scaled, places, *shape) if held_out else places
        elif held_out:
            evidence = map_states(scale, x_train, places, neighbours, True, states)
        self.classes_ = np.array([0, 1])
        self.embedding_ = places
        self.labels_ = labels.astype(np.int64)
        self.evidence_ = evidence
        self.made_of_: MadeOf | None = None
        gamma = self.gamma_bandwidth, self.gamma_prior * k, self.gamma_cells, self.gamma_empty
        grid = discretise(places, self.evidence_, self.labels_, *gamma, weights)
        self.arrays_ = RegionArrays(scale, x_train, places, neighbours, *grid, network)
        return self

    def _states(self, x: ArrayLike, reset: bool = False) -> Floats:
        """States as an array [B, d], of the dimension of ``state_max``, or else of the training states.

        reset: x are the training states, whose dimension and names of columns are kept.
        """
        high = self.state_max
        fits = high is None or (isinstance(high, tuple) and len(high) > 0)
        fits = fits and all(is_number(v) and 0 < v < np.inf for v in high or ())
        check(fits, "state_max", high, "a tuple of numbers in (0, inf), or None")
        check(not issparse(x), "x", "a sparse array", "a dense one")
        array = np.asarray(x)
        check(not np.iscomplexobj(array), "x", "complex numbers", "real ones")
        learned = max((1, *array.shape[-1:])) if reset else getattr(self, "n_features_in_", 1)
        states = as_states(array, learned if high is None else len(high))
        if reset or hasattr(x, "columns"):  # sets or reads n_features_in_ and feature_names_in_
            named = x if hasattr(x, "columns") else states
            validate_data(self, named, reset=reset, skip_check_array=True)
        return states

    def _scale(self, states: Floats) -> Floats:
        """Half ranges [d] that scale the states, of the training states [k, d] if none are given."""
        if self.state_max is not None:
            return np.array(self.state_max, dtype=np.float64)
        largest = np.abs(states).max(axis=0)
        return np.where(largest < TINY, 1.0, largest)  # a coordinate that is always zero tells nothing

    def _check_parameters(self, k: int) -> None:
        """See that the parameters are allowed, and that there are k ≥ 2 training states."""
        check_parameters(self.get_params())
        seed = self.random_state
        check_whole("random_state", int(seed) if is_number(seed, whole=True) else seed, 0, MOST_SEED)
        check(k >= 2, "k", k, "a whole number in [2, inf)")

    def __sklearn_tags__(self) -> Tags:
        """For scikit-learn: there are two classes."""
        tags = super().__sklearn_tags__()
        tags.classifier_tags.multi_class = False
        return tags

    def transform(self, x: ArrayLike) -> Floats:
        """Ψ: simplified states y [B, 2] of the states x [B, d]."""
        check_is_fitted(self)
        return place_batch(self.arrays_, self._states(x))

    def safety(self, x: ArrayLike) -> Floats:
        """Γ(Ψ(x)) [B], the probability that x is safe (eq. 4)."""
        check_is_fitted(self)
        return query_batch(self.arrays_, self._states(x))

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
        *parts, network = self.arrays_
        parts = [*parts, *network, self.p_t]
        return hashlib.sha256(b"".join(np.asarray(part).tobytes() for part in parts)).hexdigest()

    def save(self, path: Path) -> None:
        """Write the fitted region as npz: parameters as numbers and text, no pickle."""
        check_is_fitted(self)
        params = self.get_params() | {"state_max": self.state_max or ()}  # None is no array without a pickle
        arrays: dict[str, Any] = {f"param_{name}": np.array(v) for name, v in params.items()}
        *own, network = self.arrays_
        parts = dict(zip(PARTS, [*own, *network], strict=True))
        arrays |= {f"array_{name}": np.array(value) for name, value in parts.items()}
        arrays |= {"evidence": self.evidence_, "labels": self.labels_}
        write_arrays(path, FORMAT, **arrays, made_of=write_made_of(self._still_made_of()))

    def _still_made_of(self) -> MadeOf | None:
        """`made_of_`, unless a parameter has been changed since."""
        if self.made_of_ is None:
            return None
        config = Config().with_values(**self.made_of_.values)
        same = SafeRegion.from_config(config, self.random_state).get_params() == self.get_params()
        return self.made_of_ if same else None

    @classmethod
    def load(cls, path: Path) -> "SafeRegion":
        """Read what `save` wrote; `ResultError`: a missing, damaged or other file, or values not allowed."""
        names = tuple(cls().get_params())
        params = [f"param_{name}" for name in names]
        kinds = {f"array_{name}": "f8" for name in PARTS} | {"array_neighbours": "i8"}
        kinds |= {"evidence": "f8", "labels": "i8", "made_of": "U"}
        stored = read_arrays(path, FORMAT, kinds) | read_arrays(path, FORMAT, params)
        values = {n: stored[f"param_{n}"].tolist() for n in names}
        if isinstance(values["state_max"], list):
            values["state_max"] = tuple(values["state_max"]) or None
        region = cls(**values)
        a = {n: stored[f"array_{n}"] for n in PARTS}
        labels, evidence = stored["labels"], stored["evidence"]
        k, size, cells = labels.size, np.size(a["scale"]), region.gamma_cells
        parts = (*a.values(), evidence, labels)
        width = region.psi_width if region.psi == "network" else None
        network = [(0, 0), (0,)] * 3 if width is None else _network_shapes(size, width)
        shapes = [(size,), (size, k), (k, 2), (), (cells, cells), (2,), (), (), *network, (k, 2), (k,)]
        try:
            region._check_parameters(k)
            region._states(np.zeros(size), reset=True)
            fits = [part.shape for part in parts] == shapes and all(np.isfinite(part).all() for part in parts)
            fits = fits and bool(np.isin(labels, (0, 1)).all()) and a["cell"] >= TINY
            given = region.state_max is None or np.array_equal(a["scale"], region.state_max)
            fits = fits and bool(given and (a["scale"] >= TINY).all())
            fits = fits and a["neighbours"] == min(region.psi_neighbours, k - 1) and 0 <= a["empty"] < 1
            if not (fits and a["gamma"].min() >= 0 and a["gamma"].max() < 1):
                raise ValueError("shapes or values")
        except (ValueError, TypeError) as error:
            raise ResultError(f"{path} holds a region whose parts do not fit together") from error
        a["neighbours"], a["cell"], a["empty"] = int(a["neighbours"]), float(a["cell"]), float(a["empty"])
        weights = Network(*(a.pop(name) for name in Network._fields))
        region.arrays_ = RegionArrays(**a, network=weights)
        region.classes_, region.embedding_ = np.array([0, 1]), a["y_train"]
        region.evidence_, region.labels_ = evidence, labels
        region.made_of_ = read_made_of(stored["made_of"], "region", path)
        region.made_of_ = region._still_made_of()
        return region


def _network_shapes(size: int, width: int) -> list[tuple[int, ...]]:
    """Of the arrays of a `Network` for states [size]."""
    return [(size, width), (width,), (width, width), (width,), (width, 2), (2,)]


def learn_region(data: TrainingData, config: Config, seed: int = 0) -> SafeRegion:
    """The safe region of training data: their closed-loop trajectories on the nominal system, Ω, t-SNE, Ψ, Γ.

    Args:
        data: D_tr; what they say that they were made of, the region says too.
        config: with the values that the data were made with.
        seed: of t-SNE, and of Ψ's network.

    Raises:
        ParameterError: the data were made with other values than those of the configuration.
    """
    if data.made_of is not None:
        require_made_of(data.made_of, config, "data", where="the set of training data")
    choices = config.choices
    x, z = known_states(data, config)
    paths = ClosedLoop.from_config(config).rollout(x).paths
    stride = max(1, round(choices.omega_step / choices.control_period))
    instants = round(choices.omega_horizon / choices.control_period) + 1
    weights = None
    if choices.gamma_weights == "density ratio":
        ratios = density_ratios(data, config, x)
        weights = ratios / ratios.mean()
    region = SafeRegion.from_config(config, seed).fit(x, z, paths[:, :instants:stride], weights)
    if data.made_of is not None:
        region.made_of_ = replace(data.made_of, values=config.until("region"))
    return region
