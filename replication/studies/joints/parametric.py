"""Parametric t-SNE (van der Maaten, 2009): Ψ is a perceptron from the start, trained on KL(P‖Q) of t-SNE.

t-SNE places the training states one by one, and Ψ is fitted to these places afterwards. Here the places are
y_i = Ψ(x_i) throughout, so that a map that no function of the state can follow is not found.
"""

from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from srlrepro.dynamics.pendulum import Floats

STEPS = 500  # of Adam; at k = 250 twice as many lower the divergence from 0.47 to 0.42, where t-SNE has 0.37
EXAGGERATED, EXAGGERATION = 125, 12.0  # steps, and factor of P in them: openTSNE's; it has them in 250 of 750
RATE = 1e-2  # of Adam; with its default, 1e-3, the divergence is twice as large
BATCH = 1000  # states in a step, so that all pairs among them fit; more are taken in turns, in random order
TINY = 1e-12  # below, a probability has no logarithm


def affinities(omega: Floats, perplexity: float) -> Floats:
    """P [k, k] of the dissimilarity Ω [k, k], as openTSNE has it: symmetric, of sum 1."""
    from openTSNE import affinity  # slow to import

    supported = min(perplexity, (len(omega) - 1) / 3)
    found = affinity.PerplexityBasedNN(omega, perplexity=supported, metric="precomputed", n_jobs=1)
    return np.asarray(found.P.toarray(), np.float64)


def divergence(p: Tensor, y: Tensor) -> Tensor:
    """KL(P‖Q) of P [B, B] and the places y [B, 2], with Student's t for Q; P and Q have a sum of 1."""
    q = 1.0 / (1.0 + ((y[:, None] - y[None]) ** 2).sum(dim=2))
    q = q * (1.0 - torch.eye(len(y), dtype=y.dtype))
    return (p * (torch.log(p.clamp_min(TINY)) - torch.log((q / q.sum()).clamp_min(TINY)))).sum()


def fit_parametric(scaled: Floats, p: Floats, width: int, seed: int) -> nn.Sequential:
    """The perceptron d → H → H → 2 (ReLU) of the scaled states [k, d] with affinities P [k, k].

    Args:
        width: H. seed: of its first weights and of the batches; nothing else of torch is touched.
    """
    torch.set_num_threads(1)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        sizes = (scaled.shape[1], width, width, 2)
        layers = [nn.Linear(a, b, dtype=torch.float64) for a, b in pairwise(sizes)]
        model = nn.Sequential(layers[0], nn.ReLU(), layers[1], nn.ReLU(), layers[2])
    x, whole, rng = torch.from_numpy(scaled), torch.from_numpy(p), np.random.default_rng(seed)
    adam = torch.optim.Adam(model.parameters(), RATE)
    batches = -(-len(x) // BATCH)
    parts: list[Floats] = []
    for step in range(STEPS):
        parts = parts or np.array_split(rng.permutation(len(x)), batches)
        chosen = torch.from_numpy(np.sort(parts.pop()))
        own = whole[chosen][:, chosen]
        own = own / own.sum().clamp_min(TINY) * (EXAGGERATION if step < EXAGGERATED else 1.0)
        loss = divergence(own, model(x[chosen]))
        adam.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        adam.step()
    return model


def place(model: nn.Sequential, scaled: Floats) -> Floats:
    """y [B, 2] of the scaled states [B, d]."""
    with torch.no_grad():
        return np.asarray(model(torch.from_numpy(np.ascontiguousarray(scaled))).numpy(), np.float64)
