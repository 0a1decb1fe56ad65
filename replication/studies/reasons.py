"""Where the defaults of `Choices` come from: the measurements behind their reasons, each as one table.

None of them looks at an outcome of Fig. 3: they check conditions that the paper states as its set-up, the
accuracy of the integration, and the calibration of Ψ and Γ on held-out *nominal* data.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.distance import cdist
from scipy.special import softmax
from sklearn.kernel_ridge import KernelRidge
from sklearn.neighbors import KNeighborsRegressor

from replication.evidence.measures import classification
from srlrepro import samplers
from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.dynamics.closed_loop import RECOVERED, ClosedLoop
from srlrepro.dynamics.pendulum import Floats
from srlrepro.learner.trials import transitions, untrained
from srlrepro.region.mapping import fit_network
from srlrepro.region.safe_region import SafeRegion, learn_region
from srlrepro.region.safety_map import RegionArrays, place_batch
from srlrepro.settings.condition import alpha_text
from srlrepro.settings.config import Config

FINE = 96  # substeps of the integration that labels are compared with
EMBEDDING_CHOICES = ("known_origin", "label_gap", "perplexity")
# The state mappings Ψ that the calibration compares: neurons and penalties of a network, numbers of
# neighbours, widths (half ranges) of kernels; and with each Γ's bandwidths (RMS radii) and pseudo-counts
# (shares of k).
NETWORKS = ((16, 1.0), (32, 0.1), (32, 1.0), (32, 10.0), (64, 1.0))
NEIGHBOURS, RIDGES, MEANS = (2, 4, 8, 16, 32), (0.5, 1.0, 2.0), (0.1, 0.2, 0.3)
RIDGE = 0.1  # penalty of the kernel ridge: less or more is worse
BANDWIDTHS, PRIORS = (0.2, 0.3, 0.4, 0.6), (0.001, 0.003, 0.01, 0.03)
Variations = Iterable[Mapping[str, Any]]  # values other than the default, by name
Embeddings = dict[tuple[object, ...], Floats]  # by α, seed and the `EMBEDDING_CHOICES`


def integration(config: Config, substeps: Iterable[int], n: int, seed: int) -> pd.DataFrame:
    """Share of n UD states whose nominal label equals that of a much finer integration, by substeps."""
    x = samplers.sample_uniform(n, config.paper.state_max, np.random.default_rng(seed))
    loops = [ClosedLoop.from_config(config.with_values(substeps=count)) for count in (FINE, *substeps)]
    exact, *labels = (loop.predict(x) for loop in loops)
    return pd.DataFrame({"substeps": list(substeps), "equal labels": [(l == exact).mean() for l in labels]})


def stability(config: Config, deltas: Iterable[float], variations: Variations) -> pd.DataFrame:
    """Spectral radius of the closed loop near upright, by variation of the LQG and Δ."""
    rows = []
    for values in variations:
        varied = config.with_values(**values)
        loops = {delta: ClosedLoop.from_config(varied, delta) for delta in deltas}
        radii = {f"Δ = {d:g}": loop.controller.spectral_radius(loop.system) for d, loop in loops.items()}
        rows.append({"variation": _text(values)} | radii)
    return pd.DataFrame(rows)


def recoveries(config: Config, deltas: Iterable[float], n: int, seed: int) -> pd.DataFrame:
    """Of n UD states under K: share recovered, the slowest recovery (s) and its largest rate (rad/s)."""
    x = samplers.sample_uniform(n, config.paper.state_max, np.random.default_rng(seed))
    rows = []
    for delta in deltas:
        rollouts = ClosedLoop.from_config(config, delta).rollout(x)
        safe = rollouts.outcomes == RECOVERED
        fastest = np.abs(rollouts.paths[safe][..., config.paper.links :]).max()
        rows.append((delta, safe.mean(), rollouts.durations[safe].max(), fastest))
    return pd.DataFrame(rows, columns=["delta", "recovered", "slowest / s", "largest rate / (rad/s)"])


def random_policies(config: Config, holds: Iterable[float], n: int, seed: int) -> pd.DataFrame:
    """The MND by the time that a random torque is held: correlation of θ1 and θ̇1, safe share of n samples."""
    nominal, rows = ClosedLoop.from_config(config), []
    for hold in holds:
        rng = np.random.default_rng(seed)
        visited = samplers.visited_states(config.with_values(random_hold=hold), rng)
        mnd = samplers.MultivariateNormal.fit(visited)
        std = np.sqrt(np.diag(mnd.covariance))
        links = config.paper.links
        correlation = mnd.covariance[0, links] / (std[0] * std[links])
        rows.append((hold, correlation, nominal.predict(mnd.sample(n, rng)).mean()))
    return pd.DataFrame(rows, columns=["hold / s", "correlation", "safe share"])


def _learn(
    data: samplers.TrainingData, config: Config, alpha: float, seed: int, embeddings: Embeddings
) -> SafeRegion:
    """The region of training data (of α and a seed), with an embedding that is known, or will be from now on.

    t-SNE takes most of the time and knows nothing of Ψ and Γ: one run does for all that differ in these.
    """
    key = (alpha, seed, *(getattr(config.choices, name) for name in EMBEDDING_CHOICES))
    if key in embeddings:
        region = SafeRegion.from_config(config, seed)
        return region.fit_embedding(*samplers.known_states(data, config), embeddings[key])
    region = learn_region(data, config, seed)
    embeddings[key] = region.embedding_
    return region


def calibration(
    config: Config,
    alphas: Iterable[float],
    seeds: Iterable[int],
    variations: Variations,
    n: int,
    embeddings: Embeddings,
) -> pd.DataFrame:
    """Brier score of Γ on n fresh nominal states of D_n, drawn like the training data, by variation and α.

    Means over training datasets (seeds); ``h(origin)`` is the share of them, over all α, that predict the
    origin as safe. What is embedded is read from ``embeddings`` and kept there.
    """
    nominal, rows = ClosedLoop.from_config(config), []
    datasets = {(a, s): samplers.generate(a, config, s) for a in alphas for s in seeds}
    tests = {cell: fresh_states(cell[0], data, config, n, cell[1]) for cell, data in datasets.items()}
    labels = {cell: nominal.predict(x) for cell, x in tests.items()}
    for values in variations:
        varied = config.with_values(**values)
        scores: dict[str, list[float]] = {}
        origin = []
        for cell, data in datasets.items():
            region = _learn(data, varied, *cell, embeddings)
            brier = classification(region, tests[cell], labels[cell])["brier"]
            scores.setdefault(f"α = {alpha_text(cell[0])}", []).append(brier)
            origin.append(region.predict(np.zeros_like(data.x[:1]))[0])
        means = {name: float(np.mean(values)) for name, values in scores.items()}
        row = {"variation": _text(values)} | means
        rows.append(row | {"mean": float(np.mean(list(means.values()))), "h(origin)": float(np.mean(origin))})
    return pd.DataFrame(rows)


def _places(scaled: Floats, y: Floats, new: Floats, seed: int) -> Iterator[tuple[str, Floats]]:
    """(Ψ in words, places [B, 2] of new states [B, d]) by every mapping that learns from (scaled, y)."""
    d, ones = scaled.shape[1], np.ones(scaled.shape[1])
    for width, penalty in NETWORKS:
        learned = fit_network(scaled, y, width, penalty, seed)
        arrays = RegionArrays(ones, np.empty((d, 0)), y, 0, y, ones, 1.0, 0.0, learned)
        yield f"network of {width}, penalty {penalty:g}", place_batch(arrays, new)
    for count in NEIGHBOURS:
        nearest = KNeighborsRegressor(count, weights="distance").fit(scaled, y)
        yield f"{count} neighbours", nearest.predict(new)
    mean, spread = y.mean(axis=0), y.std()
    for reach in RIDGES:
        ridge = KernelRidge(alpha=RIDGE, kernel="rbf", gamma=0.5 / reach**2).fit(scaled, (y - mean) / spread)
        yield f"kernel ridge, width {reach:g}", ridge.predict(new) * spread + mean
    squared = cdist(new, scaled) ** 2
    for reach in MEANS:
        yield f"kernel mean, width {reach:g}", softmax(-0.5 * squared / reach**2, axis=1) @ y


def mappings(
    config: Config, alphas: Iterable[float], seeds: Iterable[int], n: int, embeddings: Embeddings
) -> pd.DataFrame:
    """Every Ψ with the Γ that is best for it, given the evidence at the y_i; the best first.

    As `calibration`, by mean Brier score; but where a region of some α and dataset denies the origin, the
    pair of Ψ and Γ violates a condition of the set-up and is left out.
    """
    nominal, scale, rows = ClosedLoop.from_config(config), np.array(config.paper.state_max), []
    for alpha, seed in product(alphas, seeds):
        data = samplers.generate(alpha, config, seed)
        region, (x, z) = _learn(data, config, alpha, seed, embeddings), samplers.known_states(data, config)
        y = region.embedding_
        radius = np.sqrt(((y - y.mean(axis=0)) ** 2).sum(axis=1).mean())
        new = fresh_states(alpha, data, config, n, seed)
        labels, new = nominal.predict(new), np.concatenate([new, np.zeros((1, scale.size))])
        for psi, places in _places(x / scale, y, new / scale, seed):
            squared = cdist(places, y, "sqeuclidean")
            for width in BANDWIDTHS:  # as `kernel_estimate`, whose weights do not depend on the prior
                weights = np.exp(-0.5 * squared / (width * radius) ** 2)
                safe, every = weights @ z, weights.sum(axis=1)
                for prior in PRIORS:
                    gamma = safe / (every + prior * len(y))
                    brier = float(((gamma[:-1] - labels) ** 2).mean())
                    known = gamma[-1] > config.paper.p_t
                    rows.append((psi, width, prior, f"α = {alpha_text(alpha)}", brier, known))
    of = ["Ψ", "bandwidth", "prior"]
    table = pd.DataFrame(rows, columns=[*of, "alpha", "brier", "origin"])
    means = table.pivot_table(index=of, columns="alpha", values="brier").assign(mean=lambda t: t.mean(axis=1))
    allowed = means[table.groupby(of)["origin"].all()].sort_values("mean")
    return allowed.reset_index().drop_duplicates("Ψ", ignore_index=True).rename_axis(columns=None)


def fresh_states(alpha: float, data: samplers.TrainingData, config: Config, n: int, seed: int) -> Floats:
    """n states of D_n = αUD + (1 − α)MND that are not among the training data, whose MND is taken."""
    rng = np.random.default_rng([seed, 2])
    n_ud, n_mnd = samplers.split(alpha, n)
    ud = samplers.sample_uniform(n_ud, config.paper.state_max, rng)
    return np.concatenate([ud, samplers.sample_mnd(n_mnd, data.mnd, config, rng)])


def origin_safety(config: Config, alpha: float, seeds: Iterable[int], embeddings: Embeddings) -> pd.DataFrame:
    """Γ at the origin with and without ``known_origin``, by training dataset (seed); as `calibration`."""
    rows = []
    for seed in seeds:
        data = samplers.generate(alpha, config, seed)
        for known in (False, True):
            region = _learn(data, config.with_values(known_origin=known), alpha, seed, embeddings)
            rows.append((seed, known, float(region.safety(np.zeros_like(data.x[:1]))[0])))
    return pd.DataFrame(rows, columns=["dataset", "known origin", "Γ(origin)"])


def exploration(
    config: Config, log_stds: Iterable[float], delta: float, trials: int, seed: int
) -> pd.DataFrame:
    """Free trials of an untrained policy (mean 0), by log std: share of states in the ranges of App. C."""
    rows, high = [], np.array(config.paper.state_max)
    env = ThreeLinkCircleEnv(delta, config=config)
    for log_std in log_stds:
        rng = np.random.default_rng(seed)
        policy, inside, diverged = untrained(rng, log_std, config.paper.links), [], 0
        for _ in range(trials):
            steps = list(transitions(env, policy))
            inside += [bool((np.abs(step.following) <= high).all()) for step in steps]
            diverged += steps[-1].info["outcome"] == "diverged"
        rows.append((log_std, np.mean(inside), diverged / trials))
    return pd.DataFrame(rows, columns=["log std", "states in App. C", "trials beyond the rate bound"])


def _text(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in values.items()) or "default"
