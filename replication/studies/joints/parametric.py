r"""Parametric t-SNE (van der Maaten, 2009): Ψ is a perceptron from the start, trained on KL(P‖Q) of t-SNE.

t-SNE places the training states one by one, and Ψ is fitted to these places afterwards. Here the places are
y_i = Ψ(x_i) throughout, so that a map that no function of the state can follow is not found. With
u_ij = 1/(1 + ‖y_i − y_j‖²) and q_ij = u_ij/Σu, the slope of the divergence is

    ∂C/∂y_i = 4 Σ_j (p_ij − q_ij) u_ij (y_i − y_j)

(van der Maaten and Hinton, 2008, eq. 5), which is led back through the perceptron. It is written out since
the logarithm and the square root that torch takes of doubles have other last bits on another maker's
processor.
"""

from itertools import pairwise

import numpy as np

from srlrepro.compiled.jit import jit
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.mapping import Network

# At k = 250 and three joints the divergence is 0.34 then, and 0.41 after 500 steps; t-SNE has 0.37. With
# early exaggeration it is larger. At k = 1000 it is 1.3, where t-SNE has 0.59: too much for H units.
STEPS = 2000  # of Adam, with all states in each
RATE = 1e-2  # of Adam; with 5e-3 and 3e-2 the divergence is larger
DECAYS, TINY = (0.9, 0.999), 1e-8  # of Adam, its defaults


def affinities(omega: Floats, perplexity: float) -> Floats:
    """P [k, k] of the dissimilarity Ω [k, k], as openTSNE has it: symmetric, of sum 1."""
    from openTSNE import affinity  # slow to import

    supported = min(perplexity, (len(omega) - 1) / 3)
    found = affinity.PerplexityBasedNN(omega, perplexity=supported, metric="precomputed", n_jobs=1)
    return np.asarray(found.P.toarray(), np.float64)


@jit
def slope(p: Floats, y: Floats) -> Floats:
    """∂C/∂y_i [k, 2] (see the module) of a symmetric P [k, k] at the places y [k, 2]."""
    total, found = 0.0, np.zeros_like(y)
    for i in range(len(y)):
        for j in range(i):
            a, b = y[i, 0] - y[j, 0], y[i, 1] - y[j, 1]
            total += 2.0 / (1.0 + a * a + b * b)
    for i in range(len(y)):
        for j in range(i):
            a, b = y[i, 0] - y[j, 0], y[i, 1] - y[j, 1]
            u = 1.0 / (1.0 + a * a + b * b)
            force = 4.0 * (p[i, j] - u / total) * u
            found[i, 0] += force * a
            found[i, 1] += force * b
            found[j, 0] -= force * a
            found[j, 1] -= force * b
    return found


def fit_parametric(scaled: Floats, p: Floats, width: int, seed: int) -> Network:
    """The perceptron d → H → H → 2 (ReLU) of the scaled states [k, d] with affinities P [k, k].

    Args:
        width: H. seed: of its first weights, which are uniform within ± the root of 1/inputs.
    """
    rng = np.random.default_rng(seed)
    parts: list[Floats] = []
    for a, b in pairwise((scaled.shape[1], width, width, 2)):
        parts += [rng.uniform(-1.0, 1.0, shape) / np.sqrt(a) for shape in ((a, b), (b,))]
    mean, square = [[np.zeros_like(part) for part in parts] for _ in DECAYS]
    left = [1.0, 1.0]  # of the zeros with which the means began
    for _ in range(STEPS):
        first, first_bias, second, second_bias, last, last_bias = parts
        hidden = np.maximum(scaled @ first + first_bias, 0.0)
        following = np.maximum(hidden @ second + second_bias, 0.0)
        y = following @ last + last_bias
        at_y = slope(p, y)
        at_following = (at_y @ last.T) * (following > 0)
        at_hidden = (at_following @ second.T) * (hidden > 0)
        pairs = (scaled, at_hidden), (hidden, at_following), (following, at_y)
        slopes = [found for before, at in pairs for found in (before.T @ at, at.sum(axis=0))]
        left = [decay * rest for decay, rest in zip(DECAYS, left, strict=True)]
        for part, m, v, found in zip(parts, mean, square, slopes, strict=True):
            m += (1 - DECAYS[0]) * (found - m)
            v += (1 - DECAYS[1]) * (found**2 - v)
            part -= RATE * m / (1 - left[0]) / (np.sqrt(v / (1 - left[1])) + TINY)
    return Network(*parts)
