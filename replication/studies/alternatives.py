"""The hypotheses that can stand behind the supervisor: does the low dimension help?

The choice ``hypothesis`` names one of

- "tsne": the paper's `SafeRegion`; "euclidean": the same on t-SNE of plain distances of the scaled states;
- "pca": the same Γ, on the first two principal components of the scaled states;
- "knn", "svm", "mlp": classifiers of the scaled state in all its dimensions;
- "nominal": l_n(x), K simulated on the nominal system; "real": l(x), the ideal supervisor of eq. (3).

All of them say h(x) = 1 if P(l(x) = 1) > p_t, as eqs. (5) and (8) do, and all that learn know what the safe
region knows (`known_states`). Only a `SafeRegion` is kept in a file; the others are learned afresh from
their training data, which always gives the same.
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import pdist, squareform
from sklearn.calibration import CalibratedClassifierCV
from sklearn.decomposition import PCA
from sklearn.model_selection import StratifiedKFold
from sklearn.neural_network import MLPClassifier
from sklearn.svm import SVC

from srlrepro.dynamics.closed_loop import ClosedLoop, Labels
from srlrepro.dynamics.pendulum import Floats, as_states
from srlrepro.region import hypothesis as kinds
from srlrepro.region.hypothesis import CompiledHypothesis, Posterior
from srlrepro.region.mapping import NO_TABLE, NO_VALUES
from srlrepro.region.safe_region import SafeRegion, learn_region
from srlrepro.region.safety_map import RegionArrays, discretise
from srlrepro.region.tsne import embed
from srlrepro.samplers import TrainingData, known_states
from srlrepro.settings.condition import Condition
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check
from srlrepro.storage.made_of import require_made_of

ORACLES = ("nominal", "real")
FOLDS = 5  # of the calibration of the SVM: scikit-learn's default
ITERATIONS = 5000  # of the perceptron, at most: L-BFGS converges in a few hundred


@dataclass(frozen=True, eq=False)
class Predictor:
    """h(x) of any posterior."""

    posterior: Posterior  # says P(l(x) = 1)
    p_t: float  # threshold of eq. (5)

    def safety(self, x: ArrayLike) -> Floats:
        """P(l(x) = 1) [B] of the states x [B, d]."""
        return kinds.safe_probabilities(self.posterior, as_states(x, self.posterior.dimension))

    def predict(self, x: ArrayLike) -> Labels:
        """h(x) [B]: 1 if P(l(x) = 1) > p_t, else 0."""
        return (self.safety(x) > self.p_t).astype(np.int64)  # eq. (5)

    def digest(self) -> str:
        """SHA-256 of what h depends on, to tell hypotheses apart."""
        return hashlib.sha256(_bytes((self.posterior, self.p_t))).hexdigest()


def _bytes(part: Any) -> bytes:
    """Of arrays and numbers in tuples; what a posterior lacks has none, as an object's are its address."""
    if part is None:
        return b""
    return b"".join(map(_bytes, part)) if isinstance(part, tuple) else np.asarray(part).tobytes()


def _euclidean(x: Floats, z: Labels, config: Config, seed: int) -> SafeRegion:
    """The safe region on t-SNE of the distances of the scaled states: neither trajectories nor labels."""
    distances = squareform(pdist(x / config.paper.state_max))
    region = SafeRegion.from_config(config.with_values(label_gap=0.0), seed)
    return region.fit_embedding(x, z, embed(distances, config.choices.perplexity, seed))


def _pca(x: Floats, z: Labels, config: Config) -> Posterior:
    """Γ on the plane of the first two principal components; evidence sits where Ψ puts its state."""
    scale, c = np.array(config.paper.state_max), config.choices
    pca = PCA(2).fit(x / scale)
    places = pca.transform(x / scale)
    grid = discretise(
        places, places, z, c.gamma_bandwidth, c.gamma_prior * len(x), c.gamma_cells, c.gamma_empty
    )
    region = RegionArrays(scale, NO_TABLE, NO_TABLE, 0, *grid)
    plane = pca.components_
    return Posterior(kinds.LINEAR, region, np.ascontiguousarray(plane), -plane @ pca.mean_)


def _knn(x: Floats, z: Labels, config: Config) -> Posterior:
    """The vote of Ψ's neighbours with Ψ's weights: sklearn's KNeighborsClassifier(weights="distance")."""
    scale = np.array(config.paper.state_max)
    votes = np.column_stack([z, np.zeros(len(z))]).astype(np.float64)
    neighbours = min(config.choices.psi_neighbours, len(x))
    x_train = np.ascontiguousarray((x / scale).T)
    return Posterior(kinds.VOTE, RegionArrays(scale, x_train, votes, neighbours, NO_TABLE, NO_VALUES, 0.0))


def fit_svm(s: Floats, z: Labels, seed: int) -> CalibratedClassifierCV:
    """An SVM (RBF) of the scaled states s [k, d]; a sigmoid makes probabilities of its held-out decisions."""
    folds = StratifiedKFold(FOLDS, shuffle=True, random_state=seed)  # D_tr: from UD, then from the MND
    return CalibratedClassifierCV(SVC(), method="sigmoid", cv=folds, ensemble=False).fit(s, z)


def _svm(x: Floats, z: Labels, config: Config, seed: int) -> Posterior:
    scale = np.array(config.paper.state_max)
    s = x / scale
    calibrated = fit_svm(s, z, seed).calibrated_classifiers_[0]
    svm, sigmoid = calibrated.estimator, calibrated.calibrators[0]
    width = float(1.0 / (s.shape[1] * s.var()))  # gamma="scale", the default
    bias = float(-sigmoid.a_ * svm.intercept_[0] - sigmoid.b_)  # Platt: P = 1 / (1 + exp(a f + b))
    region = RegionArrays(scale, NO_TABLE, NO_TABLE, 0, NO_TABLE, NO_VALUES, 0.0)
    vectors, weights = np.ascontiguousarray(svm.support_vectors_), -sigmoid.a_ * svm.dual_coef_[0]
    return Posterior(kinds.KERNEL, region, vectors, weights=weights, bias=bias, width=width)


def fit_mlp(s: Floats, z: Labels, seed: int) -> MLPClassifier:
    """A perceptron with one hidden layer of tanh units, of the scaled states s [k, d].

    By L-BFGS, as scikit-learn advises for small datasets: its Adam takes the plateau of a linear function,
    which sees nothing in states that are centred at 0, for convergence.
    """
    return MLPClassifier(activation="tanh", solver="lbfgs", max_iter=ITERATIONS, random_state=seed).fit(s, z)


def _mlp(x: Floats, z: Labels, config: Config, seed: int) -> Posterior:
    scale = np.array(config.paper.state_max)
    mlp = fit_mlp(x / scale, z, seed)
    (hidden, out), (offsets, bias) = mlp.coefs_, mlp.intercepts_
    region, weights = (
        RegionArrays(scale, NO_TABLE, NO_TABLE, 0, NO_TABLE, NO_VALUES, 0.0),
        np.ascontiguousarray(hidden.T),
    )
    return Posterior(kinds.NETWORK, region, weights, offsets, out[:, 0].copy(), float(bias[0]))


def learn_hypothesis(
    data: TrainingData | None, config: Config, seed: int = 0, delta: float = 1.0
) -> CompiledHypothesis:
    """The hypothesis that ``hypothesis`` of the configuration names.

    Args:
        data: what it is learned from; "nominal" and "real" know the system and need none.
        seed: of t-SNE, of the folds of the SVM, of the perceptron.
        delta: mismatch Δ of the real system, for "real".

    Raises:
        ParameterError: no data where they are needed, or data of one label only for "svm" and "mlp".
    """
    kind, p_t = config.choices.hypothesis, config.paper.p_t
    if kind in ORACLES:
        loop = ClosedLoop.from_config(config, delta if kind == "real" else 1.0)
        return Predictor(Posterior(kinds.LOOP, loop=loop.kernel_arguments), p_t)
    check(data is not None, "data", data, f"training data, which hypothesis = {kind} learns from")
    assert data is not None
    if kind == "tsne":
        return learn_region(data, config, seed)
    x, z = known_states(data, config)
    if kind == "euclidean":
        return _euclidean(x, z, config, seed)
    if kind in ("pca", "knn"):
        return Predictor((_pca if kind == "pca" else _knn)(x, z, config), p_t)
    check(0 < z.mean() < 1, "z", f"{z[0]} for all states", f"of both kinds for hypothesis = {kind}")
    return Predictor((_svm if kind == "svm" else _mlp)(x, z, config, seed), p_t)


def read_hypothesis(region: str | Path, config: Config, condition: Condition) -> CompiledHypothesis:
    """The hypothesis of a configuration, from the results of one training dataset.

    Args:
        region: file of the paper's region, read for "tsne"; the others are learned from
            ``training_data.npz`` in the same folder.
        condition: whose α the data must be of; its mismatch Δ is that of the real system, for "real".

    Raises:
        ParameterError: the region or the data were made with other values.
        ResultError: the file is missing or damaged.
    """
    if config.choices.hypothesis == "tsne":
        found = SafeRegion.load(Path(region))
        require_made_of(found.made_of_, config, "region", where=region, alpha=condition.alpha)
        return found
    file = Path(region).with_name("training_data.npz")
    data = TrainingData.load(file)
    require_made_of(data.made_of, config, "data", where=file, alpha=condition.alpha)
    return learn_hypothesis(data, config, delta=condition.delta)
