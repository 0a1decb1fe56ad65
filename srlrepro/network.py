r"""A multilayer perceptron with tanh units and Adam, compiled; on arrays that torch may share.

A layer computes a_l = tanh(W_l a_{l-1} + b_l), the last one W a + b. Columns are samples: activations are
[units, B], weights [out, in] as torch stores them, so that no product has a transposed right factor.

The passes work for float32 and float64. In float32, tanh is the twelfth-order Lambert continued fraction
x / (1 + x² / (3 + x² / (5 + …))): it differs from the exact value by three units of rounding at most, and it
vectorises where the C library's function does not.
"""

from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from srlrepro.pendulum import jit

Reals = NDArray[np.floating[Any]]
FLAT = 9.0  # |x| beyond which tanh x is 1 in float32
LEVELS = 13  # of the continued fraction


def _lambert(levels: int) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Coefficients in x², highest first, of P and Q, where x P(x²) / Q(x²) is the truncated fraction."""
    p, q = [Fraction(1)], [Fraction(2 * levels - 1)]
    for odd in range(2 * levels - 3, 0, -2):
        higher = [Fraction(0), *p] + [Fraction(0)] * (len(q) - len(p) - 1)
        p, q = q, [odd * (q[i] if i < len(q) else 0) + higher[i] for i in range(len(higher))]
    return tuple(np.float32(c / q[0]) for c in p[::-1]), tuple(np.float32(c / q[0]) for c in q[::-1])


P, Q = _lambert(LEVELS)


class Network(NamedTuple):
    """Weights [out, in] and biases [out] of the layers, first to last; also their gradients."""

    weights: tuple[Reals, ...]
    biases: tuple[Reals, ...]


class Passes(NamedTuple):
    """Memory of a forward and a backward pass for B samples, one entry per layer.

    Attributes:
        inputs: what the layer receives, [in, B]; the first is the caller's to fill.
        across: the same, [B, in].
        deltas: gradients of the loss by the layer's sums W a + b, [out, B]; the last is the caller's to fill.
        output: [out, B] of the last layer.
        ones: [B], to sum over samples.
    """

    inputs: tuple[Reals, ...]
    across: tuple[Reals, ...]
    deltas: tuple[Reals, ...]
    output: Reals
    ones: Reals


def passes(network: Network, samples: int) -> Passes:
    """Fresh memory for so many samples, in the precision of the network."""
    shapes = [w.shape for w in network.weights]
    kind = network.weights[0].dtype
    return Passes(
        tuple(np.zeros((inputs, samples), kind) for _, inputs in shapes),
        tuple(np.zeros((samples, inputs), kind) for _, inputs in shapes),
        tuple(np.zeros((outputs, samples), kind) for outputs, _ in shapes),
        np.zeros((shapes[-1][0], samples), kind),
        np.ones(samples, kind),
    )


@jit
def tanh(x: Reals) -> None:
    """Replace x [N] by its hyperbolic tangent."""
    if x.itemsize == 8:
        for i in range(x.size):
            x[i] = np.tanh(x[i])
        return
    flat = np.float32(FLAT)
    for i in range(x.size):
        v = min(max(x[i], -flat), flat)
        s = v * v
        p = P[0]
        p = p * s + P[1]
        p = p * s + P[2]
        p = p * s + P[3]
        p = p * s + P[4]
        p = p * s + P[5]
        p = p * s + P[6]
        q = Q[0]
        q = q * s + Q[1]
        q = q * s + Q[2]
        q = q * s + Q[3]
        q = q * s + Q[4]
        q = q * s + Q[5]
        q = q * s + Q[6]
        x[i] = v * p / q


@jit
def transpose(a: Reals, out: Reals) -> None:
    """Write a [N, B] to out [B, N]."""
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            out[j, i] = a[i, j]


@jit
def forward(network: Network, memory: Passes) -> None:
    """From ``inputs[0]`` to ``output``; keeps what each layer received."""
    last = len(network.weights) - 1
    for layer in range(last + 1):
        into = memory.output if layer == last else memory.inputs[layer + 1]
        np.dot(network.weights[layer], memory.inputs[layer], into)
        bias = network.biases[layer]
        for i in range(into.shape[0]):
            for j in range(into.shape[1]):
                into[i, j] += bias[i]
        if layer < last:
            tanh(into.ravel())


@jit
def backward(network: Network, memory: Passes, gradient: Network) -> None:
    """From the last of ``deltas`` to the gradient of every weight and bias."""
    last = len(network.weights) - 1
    for layer in range(last, -1, -1):
        delta, received = memory.deltas[layer], memory.inputs[layer]
        if layer == last:  # few rows: a transposed right factor costs less than a transposition
            np.dot(delta, received.T, gradient.weights[layer])
        else:
            transpose(received, memory.across[layer])
            np.dot(delta, memory.across[layer], gradient.weights[layer])
        np.dot(delta, memory.ones, gradient.biases[layer])
        if layer > 0:
            below = memory.deltas[layer - 1]
            np.dot(network.weights[layer].T, delta, below)
            flat, unit = below.ravel(), received.ravel()
            for i in range(flat.size):
                flat[i] *= 1 - unit[i] * unit[i]  # tanh' = 1 − tanh²


@jit
def forward_one(network: Network, memory: Passes) -> None:
    """`forward` for one sample ([in, 1]), with matrix-vector products."""
    last = len(network.weights) - 1
    for layer in range(last + 1):
        into = (memory.output if layer == last else memory.inputs[layer + 1]).ravel()
        np.dot(network.weights[layer], memory.inputs[layer].ravel(), into)
        into += network.biases[layer]
        if layer < last:
            tanh(into)


@jit
def adam(
    parameters: Reals,
    gradient: Reals,
    mean: Reals,
    square: Reals,
    factor: float,
    step: int,
    rate: float,
    betas: tuple[float, float],
    eps: float,
) -> None:
    """One step of Adam with bias correction (Kingma & Ba, 2015), as torch does it, on flat arrays.

    mean, square: running moments, updated; factor: multiplies the gradient; step: from 1.
    """
    number = parameters.dtype.type
    keep1, keep2 = betas
    fresh1, fresh2, old2 = number(1 - keep1), number(1 - keep2), number(keep2)
    size = number(rate / (1 - keep1**step))
    scale = number(1 / np.sqrt(1 - keep2**step))
    small, clip = number(eps), number(factor)
    for i in range(parameters.size):
        g = clip * gradient[i]
        m = mean[i] + fresh1 * (g - mean[i])
        v = old2 * square[i] + fresh2 * g * g
        mean[i], square[i] = m, v
        parameters[i] -= size * m / (np.sqrt(v) * scale + small)
