r"""A multilayer perceptron with tanh units and Adam, compiled; on arrays that torch may share.

A layer computes a_l = tanh(W_l a_{l-1} + b_l), the last one W a + b. Columns are samples: activations are
[units, B], weights [out, in] as torch stores them, so that no product has a transposed right factor.
The passes work for float32 and float64. In float32, tanh is the twelfth-order Lambert continued fraction
x / (1 + x² / (3 + x² / (5 + …))): it differs from the exact value by three units of rounding at most, and it
vectorises where the C library's function does not.

Sums are fused in a written order, roots and divisions are exact: the bits depend on no processor.
"""

from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyadd, polymulx
from numpy.typing import NDArray

from srlrepro.compiled.arithmetic import fma
from srlrepro.compiled.jit import inner, jit
from srlrepro.compiled.products import product, product_transposed, transpose

Reals = NDArray[np.floating[Any]]
Integers = NDArray[np.int64]
FLAT = np.float32(9.0)  # |x| beyond which tanh x is 1 in float32
LEVELS = 13  # of the continued fraction


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
    """

    inputs: tuple[Reals, ...]
    across: tuple[Reals, ...]
    deltas: tuple[Reals, ...]
    output: Reals


class Single(NamedTuple):
    """A network for one sample at a time, with memory for it.

    Attributes:
        columns: the weights as [in, out], so that a product reads them in the order in which they lie.
        biases: of the network itself.
        rows: what each layer receives, [1, in], and what the last one gives, [1, out].
    """

    columns: tuple[Reals, ...]
    biases: tuple[Reals, ...]
    rows: tuple[Reals, ...]


def passes(network: Network, samples: int) -> Passes:
    """Fresh memory for a number of samples, in the precision of the network."""
    shapes = [w.shape for w in network.weights]
    kind = network.weights[0].dtype
    return Passes(
        tuple(np.zeros((inputs, samples), kind) for _, inputs in shapes),
        tuple(np.zeros((samples, inputs), kind) for _, inputs in shapes),
        tuple(np.zeros((outputs, samples), kind) for outputs, _ in shapes),
        np.zeros((shapes[-1][0], samples), kind),
    )


def single(network: Network) -> Single:
    """Fresh memory for one sample at a time; `turn` copies the weights into it."""
    kind = network.weights[0].dtype
    widths = [network.weights[0].shape[1], *(len(bias) for bias in network.biases)]
    columns = tuple(np.zeros(w.shape[::-1], kind) for w in network.weights)
    return Single(columns, network.biases, tuple(np.zeros((1, width), kind) for width in widths))


@jit
def _fraction(x: np.float32) -> np.float32:
    """tanh x of a float32 number."""
    v = min(max(x, -FLAT), FLAT)
    s = v * v
    p, q = P[0], Q[0]
    for i in range(1, len(P)):
        p, q = fma(p, s, P[i]), fma(q, s, Q[i])
    return v * p / q  # type: ignore[no-any-return]


@jit
def tanh(x: Reals) -> None:
    """Replace x [N] by its hyperbolic tangent."""
    for i in range(x.size):
        x[i] = np.tanh(x[i]) if x.itemsize == 8 else _fraction(np.float32(x[i]))


@inner
def _finish(sums: Reals, bias: Reals, hidden: bool) -> None:
    """Replace sums [units, B] by sums + bias, bias [units], and that by its tanh in a hidden layer."""
    for i in range(sums.shape[0]):
        for j in range(sums.shape[1]):
            x = sums[i, j] + bias[i]
            if hidden:
                sums[i, j] = np.tanh(x) if sums.itemsize == 8 else _fraction(np.float32(x))
            else:
                sums[i, j] = x


@jit
def forward(network: Network, memory: Passes) -> None:
    """From ``inputs[0]`` to ``output``; keeps what each layer received."""
    last = len(network.weights) - 1
    for layer in range(last + 1):
        into = memory.output if layer == last else memory.inputs[layer + 1]
        product(network.weights[layer], memory.inputs[layer], into)
        _finish(into, network.biases[layer], layer < last)


@jit
def turn(network: Network, memory: Single) -> None:
    """Copy the weights of a network into the memory of `forward_one`."""
    for layer in range(len(network.weights)):
        transpose(network.weights[layer], memory.columns[layer])


@jit
def forward_one(memory: Single) -> None:
    """`forward` for one sample, from the first of ``rows`` to the last, with the same bits."""
    last = len(memory.columns) - 1
    for layer in range(last + 1):
        into = memory.rows[layer + 1]
        product(memory.rows[layer], memory.columns[layer], into)
        units, bias = into[0], memory.biases[layer]
        for i in range(units.size):
            units[i] += bias[i]
        if layer < last:
            tanh(units)


@jit
def backward(network: Network, memory: Passes, gradient: Network) -> None:
    """From the last of ``deltas`` to the gradient of every weight and bias."""
    for layer in range(len(network.weights) - 1, -1, -1):
        delta, received = memory.deltas[layer], memory.inputs[layer]
        transpose(received, memory.across[layer])
        product(delta, memory.across[layer], gradient.weights[layer])
        bias = gradient.biases[layer]
        for i in range(bias.size):
            total = bias.dtype.type(0)
            for b in range(delta.shape[1]):
                total += delta[i, b]
            bias[i] = total
        if layer > 0:
            below = memory.deltas[layer - 1]
            product_transposed(network.weights[layer], delta, below)
            flat, unit, one = below.ravel(), received.ravel(), below.dtype.type(1)
            for i in range(flat.size):
                flat[i] *= fma(-unit[i], unit[i], one)  # tanh' = 1 − tanh²


@jit
def adam(
    values: Reals, gradient: Reals, mean: Reals, square: Reals, factor: float, optimizer: Optimizer, step: int
) -> None:
    """One step of Adam with bias correction (Kingma & Ba, 2015), as torch does it, on flat arrays.

    values: the parameters, updated; mean, square: running moments, updated; factor: multiplies the gradient;
    step: from 1, beyond those that the optimizer has done.
    """
    number = values.dtype.type
    (keep1, keep2), step = optimizer.betas, optimizer.steps + step
    fresh1, fresh2, old2 = number(1 - keep1), number(1 - keep2), number(keep2)
    size = number(optimizer.rate / (1 - keep1**step))
    scale = number(1 / np.sqrt(1 - keep2**step))
    small, clip = number(optimizer.eps), number(factor)
    for i in range(values.size):
        g = clip * gradient[i]
        m = fma(fresh1, g - mean[i], mean[i])
        v = fma(old2, square[i], fresh2 * g * g)
        mean[i], square[i] = m, v
        values[i] -= size * m / fma(np.sqrt(v), scale, small)
