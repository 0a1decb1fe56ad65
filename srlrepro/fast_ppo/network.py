r"""A multilayer perceptron with tanh units and Adam, compiled; on arrays that torch may share.

A layer computes a_l = tanh(W_l a_{l-1} + b_l), the last one W a + b. Columns are samples: activations are
[units, B], weights [out, in] as torch stores them, so that no product has a transposed right factor.
The passes work for float32 and float64. In float32, tanh is the twelfth-order Lambert continued fraction
x / (1 + x² / (3 + x² / (5 + …))): it differs from the exact value by three units of rounding at most, and it
vectorises where the C library's function does not.
"""

from fractions import Fraction
from typing import Any, NamedTuple, cast

import numpy as np
from numba import njit
from numpy.polynomial.polynomial import polyadd, polymulx
from numpy.typing import NDArray

from srlrepro.compiled.jit import Function, jit

Reals = NDArray[np.floating[Any]]
Integers = NDArray[np.int64]
FLAT = np.float32(9.0)  # |x| beyond which tanh x is 1 in float32
LEVELS = 13  # of the continued fraction
TINY = 1e-30  # keeps the reciprocal root of Adam's second moment finite where that moment is 0


def fused(function: Function) -> Function:
    """`jit` for float32 loops: products and sums fuse; a reciprocal root is an estimate and a Newton step."""
    return cast(Function, njit(cache=True, error_model="numpy", fastmath={"contract", "arcp"})(function))


def _lambert(levels: int) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Coefficients in x², highest first, of P and Q, where x P(x²) / Q(x²) is the truncated fraction."""
    p, q = np.array([Fraction(1)]), np.array([Fraction(2 * levels - 1)])
    for odd in range(2 * levels - 3, 0, -2):
        p, q = q, polyadd(odd * q, polymulx(p))
    return tuple(np.float32(c / q[0]) for c in p[::-1]), tuple(np.float32(c / q[0]) for c in q[::-1])


P, Q = _lambert(LEVELS)


class Network(NamedTuple):
    """Weights [out, in] and biases [out] of the layers, first to last; also their gradients."""

    weights: tuple[Reals, ...]
    biases: tuple[Reals, ...]


class Optimizer(NamedTuple):
    """Of Adam: learning rate, (β1, β2), ε, and the number of steps done."""

    rate: float
    betas: tuple[float, float]
    eps: float
    steps: int


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
    """Fresh memory for a number of samples, in the precision of the network."""
    shapes = [w.shape for w in network.weights]
    kind = network.weights[0].dtype
    return Passes(
        tuple(np.zeros((inputs, samples), kind) for _, inputs in shapes),
        tuple(np.zeros((samples, inputs), kind) for _, inputs in shapes),
        tuple(np.zeros((outputs, samples), kind) for outputs, _ in shapes),
        np.zeros((shapes[-1][0], samples), kind),
        np.ones(samples, kind),
    )


@fused
def _fraction(x: np.float32) -> np.float32:
    """tanh x of a float32 number."""
    v = min(max(x, -FLAT), FLAT)
    s = v * v
    p, q = P[0], Q[0]
    for i in range(1, len(P)):
        p, q = p * s + P[i], q * s + Q[i]
    return v * p / q  # type: ignore[no-any-return]


@jit
def tanh(x: Reals) -> None:
    """Replace x [N] by its hyperbolic tangent."""
    for i in range(x.size):
        x[i] = np.tanh(x[i]) if x.itemsize == 8 else _fraction(x[i])


@jit
def _activate(sums: Reals, bias: Reals) -> None:
    """Replace sums [units, B] by tanh(sums + bias), bias [units]."""
    for i in range(sums.shape[0]):
        for j in range(sums.shape[1]):
            x = sums[i, j] + bias[i]
            sums[i, j] = np.tanh(x) if sums.itemsize == 8 else _fraction(x)


@jit
def forward(network: Network, memory: Passes) -> None:
    """From ``inputs[0]`` to ``output``; keeps what each layer received."""
    last = len(network.weights) - 1
    for layer in range(last + 1):
        into = memory.output if layer == last else memory.inputs[layer + 1]
        np.dot(network.weights[layer], memory.inputs[layer], into)
        if layer < last:
            _activate(into, network.biases[layer])
        else:
            into += network.biases[layer].reshape(-1, 1)


@jit
def forward_one(network: Network, memory: Passes) -> None:
    """`forward` for one sample ([in, 1]), with matrix-vector products."""
    last = len(network.weights) - 1
    for layer in range(last + 1):
        into = (memory.output if layer == last else memory.inputs[layer + 1]).ravel()
        np.dot(network.weights[layer], memory.inputs[layer].ravel(), into)
        bias = network.biases[layer]
        for i in range(into.size):
            into[i] += bias[i]
        if layer < last:
            tanh(into)


@jit
def backward(network: Network, memory: Passes, gradient: Network) -> None:
    """From the last of ``deltas`` to the gradient of every weight and bias."""
    last = len(network.weights) - 1
    for layer in range(last, -1, -1):
        delta, received = memory.deltas[layer], memory.inputs[layer]
        if layer == last:  # few rows: a transposed right factor costs less than a transposition
            np.dot(delta, received.T, gradient.weights[layer])
        else:
            memory.across[layer][:] = received.T
            np.dot(delta, memory.across[layer], gradient.weights[layer])
        np.dot(delta, memory.ones, gradient.biases[layer])
        if layer > 0:
            below = memory.deltas[layer - 1]
            np.dot(network.weights[layer].T, delta, below)
            flat, unit, one = below.ravel(), received.ravel(), below.dtype.type(1)
            for i in range(flat.size):
                flat[i] *= one - unit[i] * unit[i]  # tanh' = 1 − tanh²


@fused
def adam(
    values: Reals, gradient: Reals, mean: Reals, square: Reals, factor: float, optimizer: Optimizer, step: int
) -> None:
    """One step of Adam with bias correction (Kingma & Ba, 2015), as torch does it, on flat arrays.

    values: the parameters, updated; mean, square: running moments, updated; factor: multiplies the gradient;
    step: from 1, beyond those that the optimizer has done. √v is computed as v / √v, whose reciprocal root
    the processor estimates faster than it divides.
    """
    number = values.dtype.type
    (keep1, keep2), step = optimizer.betas, optimizer.steps + step
    fresh1, fresh2, old2 = number(1 - keep1), number(1 - keep2), number(keep2)
    size = number(optimizer.rate / (1 - keep1**step))
    scale = number(1 / np.sqrt(1 - keep2**step))
    small, clip, one, tiny = number(optimizer.eps), number(factor), number(1), number(TINY)
    for i in range(values.size):
        g = clip * gradient[i]
        m = mean[i] + fresh1 * (g - mean[i])
        v = old2 * square[i] + fresh2 * g * g
        mean[i], square[i] = m, v
        root = v * (one / np.sqrt(v + tiny))
        values[i] -= size * m / (root * scale + small)
