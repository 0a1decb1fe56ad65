r"""The ladder of hypotheses: state mappings Ψ to one, two or three dimensions, and the whole state.

Each is learned from the same states, and says P(l(x) = 1). With s = x in half ranges of App. C, a mapping is

- "tsne": the paper's region; "tsne_neighbours": the same y_i, with Ψ by nearest neighbours;
- "tsne_1", "tsne_3": the same Ω and Ψ in one and in three dimensions;
- "parametric": the same Ω, and Ψ a perceptron that is trained on t-SNE's divergence itself (`parametric`);
- "autoencoder": the middle layer of a perceptron d → H → 2 → H → d that gives s back;
- "pca": the first two principal components; "lda", "nca": the linear maps of linear discriminant analysis
  (one dimension) and of neighbourhood components analysis, which know the labels;
- "mass": the order reduction of Zhou et al. (2020), the centre of mass as one inverted pendulum.

All have the Γ of `safety_map`. It is asked at y itself, without the grid, except behind "tsne" and
"tsne_neighbours", which are the package's `SafeRegion`. The whole state has "knn", "svm" and "mlp" of
`alternatives`, "boosting", and as a ceiling "nominal": K simulated on the nominal system.

UMAP is not among them: umap-learn compiles for the processor at hand, with sums in any order (fastmath), so
that its bits are not the same on another.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from sklearn.base import clone
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.exceptions import ConvergenceWarning, DataConversionWarning
from sklearn.neighbors import NeighborhoodComponentsAnalysis
from sklearn.neural_network import MLPRegressor

from replication.studies.alternatives import FOLDS, learn_hypothesis
from replication.studies.joints.parametric import affinities, fit_parametric
from srlrepro.dynamics.closed_loop import ClosedLoop, Labels
from srlrepro.dynamics.pendulum import Floats, Pendulum, as_states
from srlrepro.region.mapping import ITERATIONS, Network, fit_network
from srlrepro.region.safe_region import SafeRegion
from srlrepro.region.safety_map import kernel_estimate
from srlrepro.region.tsne import dissimilarity, embed
from srlrepro.samplers import TrainingData, known_states
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check

Scores = Callable[[Floats], Floats]  # P(l(x) = 1) [B] of states x [B, d]
Mapping = Callable[[Floats], Floats]  # y [B, n_y] of states x [B, d]
PATHS = 200  # closed-loop trajectories with all their control periods that are in memory at a time
BATCH = 2**22  # kernel weights that are in memory at a time
NCA_ITERATIONS = 50  # scikit-learn's default; each compares all pairs of states
FOLDED = 1e-6  # of the whole length: a centre of mass so near to the base has no angle


@dataclass(frozen=True, eq=False)
class Known:
    """What a hypothesis is learned from, and what all t-SNE maps of it share."""

    data: TrainingData  # D_tr, d = 2n
    config: Config  # with which they were made
    seed: int  # of t-SNE, of networks, of folds

    @cached_property
    def states(self) -> tuple[Floats, Labels]:
        """x [k, d], z [k]: D_tr, and the origin (`known_states`)."""
        return known_states(self.data, self.config)

    @property
    def scale(self) -> Floats:
        """Half ranges [d] of App. C."""
        return np.array(self.config.paper.state_max)

    @cached_property
    def scaled(self) -> Floats:
        """s [k, d]."""
        return self.states[0] / self.scale

    @cached_property
    def omega(self) -> Floats:
        """Ω [k, k] of the trajectories and labels, as behind the paper's region (`learn_region`)."""
        x, z = self.states
        choices, loop = self.config.choices, ClosedLoop.from_config(self.config)
        stride = max(1, round(choices.omega_step / choices.control_period))
        instants = round(choices.omega_horizon / choices.control_period) + 1
        parts = np.array_split(x, -(-len(x) // PATHS))
        paths = [loop.rollout(part).paths[:, :instants:stride].copy() for part in parts]
        return dissimilarity(np.concatenate(paths), z, self.config.paper.state_max, choices.label_gap)

    @cached_property
    def plane(self) -> Floats:
        """y_i [k, 2] of t-SNE."""
        return embed(self.omega, self.config.choices.perplexity, self.seed)


def smoothed(known: Known, mapping: Mapping, places: Floats) -> Scores:
    """Γ after a mapping, from evidence at the places y_i [k, n_y]; its width is that of `discretise`."""
    choices, (_, z) = known.config.choices, known.states
    radius = np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean())
    width = choices.gamma_bandwidth * radius if radius > 0 else 1.0
    gamma = width, choices.gamma_prior * len(places), choices.gamma_empty

    def scores(x: Floats) -> Floats:
        parts = np.array_split(mapping(x), -(-len(x) * len(places) // BATCH))
        return np.concatenate([kernel_estimate(y, places, z, *gamma) for y in parts])

    return scores


def _of_states(known: Known, mapping: Mapping) -> Scores:
    """Γ after a mapping that places the training states as it places others."""
    return smoothed(known, mapping, mapping(known.states[0]))


def _region(known: Known, psi: str) -> Scores:
    values = {"psi": psi, "gamma_evidence": "embedded"}
    region = SafeRegion.from_config(known.config.with_values(**values), known.seed)
    return region.fit_embedding(*known.states, known.plane).safety


def regression(known: Known, places: Floats) -> Mapping:
    """Ψ of the paper's region, the network of `mapping`, for places [k, n_y] of any dimension."""
    choices = known.config.choices
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataConversionWarning)  # of one dimension, that it stands in a column
        net = fit_network(known.scaled, places, choices.psi_width, choices.psi_penalty, known.seed)

    return _by_network(known, net)


def _by_network(known: Known, net: Network) -> Mapping:
    def mapping(x: Floats) -> Floats:
        hidden = np.maximum(x / known.scale @ net.first + net.first_bias, 0.0)
        return np.asarray(np.maximum(hidden @ net.second + net.second_bias, 0.0) @ net.last + net.last_bias)

    return mapping


def _tsne(known: Known, dimensions: int) -> Scores:
    """As `embed`, which makes a plane, in one or three dimensions."""
    from openTSNE import TSNE  # slow to import

    perplexity = min(known.config.choices.perplexity, (len(known.omega) - 1) / 3)
    tsne = TSNE(
        n_components=dimensions,
        metric="precomputed",
        initialization="spectral",
        perplexity=perplexity,
        negative_gradient_method="bh",  # the other has one or two dimensions
        n_jobs=1,
        random_state=known.seed,
    )
    places = np.array(tsne.fit(known.omega), dtype=np.float64)
    return smoothed(known, regression(known, places), places)


def _parametric(known: Known) -> Scores:
    p = affinities(known.omega, known.config.choices.perplexity)
    net = fit_parametric(known.scaled, p, known.config.choices.psi_width, known.seed)
    return _of_states(known, _by_network(known, net))


def _autoencoder(known: Known) -> Scores:
    width, s = known.config.choices.psi_width, known.scaled
    layers, solver = (width, 2, width), {"solver": "lbfgs", "max_iter": ITERATIONS}
    model = MLPRegressor(hidden_layer_sizes=layers, activation="tanh", random_state=known.seed, **solver)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # it is stopped, as Ψ's network is
        model.fit(s, s)
    first, second = zip(model.coefs_[:2], model.intercepts_[:2], strict=True)

    def encoded(x: Floats) -> Floats:
        return np.asarray(np.tanh(np.tanh(x / known.scale @ first[0] + first[1]) @ second[0] + second[1]))

    return _of_states(known, encoded)


def _linear(known: Known, model: PCA | LinearDiscriminantAnalysis | NeighborhoodComponentsAnalysis) -> Scores:
    """A linear map that scikit-learn learns."""
    model = clone(model)
    if "random_state" in model.get_params():
        model.set_params(random_state=known.seed)
    fitted = model.fit(known.scaled, known.states[1])
    return _of_states(known, lambda x: np.asarray(fitted.transform(x / known.scale), np.float64))


def centre_of_mass(x: Floats, pendulum: Pendulum) -> Floats:
    """Angle (rad) and rate (rad/s) [B, 2] of the centre of mass about the base, clockwise from upright.

    Of a chain of links, as of one inverted pendulum. The centre is Σ_j b_j (sin φ_j, cos φ_j) / Σ m, with
    the b_j of `Pendulum`, in absolute angles φ. Where it comes to lie on the base it has no angle: `FOLDED`
    bounds the rate.
    """
    n, states = pendulum.links, as_states(x, pendulum.dimension)
    phi, rate = np.cumsum(states[:, :n], axis=1), np.cumsum(states[:, n:], axis=1)
    b = pendulum.coefficients.gb / pendulum.gravity / sum(pendulum.masses)  # m
    sine, cosine = b * np.sin(phi), b * np.cos(phi)
    right, up = sine.sum(axis=1), cosine.sum(axis=1)
    turn = (cosine * rate).sum(axis=1) * up + (sine * rate).sum(axis=1) * right
    squared = np.maximum(right**2 + up**2, (FOLDED * pendulum.length) ** 2)
    return np.column_stack([np.arctan2(right, up), turn / squared])


def _mass(known: Known) -> Scores:
    """Angle in units of π; rate in half ranges of θ̇2, where it is cut: beyond, the chain is folded."""
    pendulum = Pendulum(**known.config.arguments_of(Pendulum))
    high = np.array([np.pi, known.config.paper.rate23_max])
    return _of_states(known, lambda x: np.clip(centre_of_mass(x, pendulum) / high, -1.0, 1.0))


def _whole(known: Known, kind: str) -> Scores:
    return learn_hypothesis(known.data, known.config.with_values(hypothesis=kind), known.seed).safety


def _boosting(known: Known) -> Scores:
    model = HistGradientBoostingClassifier(random_state=known.seed).fit(known.scaled, known.states[1])
    return lambda x: np.asarray(model.predict_proba(x / known.scale)[:, 1])


def _nominal(known: Known) -> Scores:
    loop = ClosedLoop.from_config(known.config)
    return lambda x: loop.predict(x).astype(np.float64)


@dataclass(frozen=True)
class Rung:
    """One hypothesis of the ladder."""

    text: str  # what it is
    learn: Callable[[Known], Scores]
    labels: int = 0  # states of each label without which it cannot be learned


MAPS = {
    "tsne": Rung("t-SNE, as written", partial(_region, psi="network")),
    "tsne_neighbours": Rung("t-SNE, Ψ by neighbours", partial(_region, psi="neighbours")),
    "tsne_1": Rung("t-SNE, one dimension", partial(_tsne, dimensions=1)),
    "tsne_3": Rung("t-SNE, three dimensions", partial(_tsne, dimensions=3)),
    "parametric": Rung("parametric t-SNE", _parametric),
    "autoencoder": Rung("autoencoder", _autoencoder),
    "pca": Rung("principal components", partial(_linear, model=PCA(2))),
    "lda": Rung("linear discriminant", partial(_linear, model=LinearDiscriminantAnalysis()), labels=1),
    "nca": Rung(
        "neighbourhood components",
        partial(_linear, model=NeighborhoodComponentsAnalysis(2, max_iter=NCA_ITERATIONS)),
        labels=1,
    ),
    "mass": Rung("centre of mass", _mass),
}
WHOLE = {
    "knn": Rung("nearest neighbours", partial(_whole, kind="knn")),
    "svm": Rung("support vector machine", partial(_whole, kind="svm"), labels=FOLDS),
    "boosting": Rung("gradient boosting", _boosting, labels=1),
    "mlp": Rung("perceptron", partial(_whole, kind="mlp"), labels=1),
}
CEILING = "nominal"
RUNGS = MAPS | WHOLE | {CEILING: Rung("simulation of the nominal system", _nominal)}


def learn(name: str, known: Known) -> Scores:
    """Learn the hypothesis of this name.

    Where it needs states of both labels, and too few are known, it says their share everywhere.

    Raises:
        ParameterError: there is no hypothesis of this name.
    """
    check(name in RUNGS, "hypothesis", name, f"one of {', '.join(RUNGS)}")
    z = known.states[1]
    if min(z.sum(), len(z) - z.sum()) < RUNGS[name].labels:
        return lambda x: np.full(len(x), z.mean())
    return RUNGS[name].learn(known)
