"""The compiled perceptron against torch: passes, gradients, Adam, and tanh against the library's."""

import itertools
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from srlrepro.fast_ppo.network import Network, Optimizer, _lambert, adam, backward, forward, passes, tanh

PRECISIONS = pytest.mark.parametrize("kind", [np.float32, np.float64])


def build(widths: list[int], kind: Any) -> tuple[nn.Sequential, Network, Network]:
    """A torch network, the same one as arrays that share its memory, and room for its gradient."""
    torch.manual_seed(3)
    dtype = torch.from_numpy(np.zeros(1, kind)).dtype
    layers = [nn.Linear(a, b, dtype=dtype) for a, b in itertools.pairwise(widths)]
    body = [module for layer in layers for module in (layer, nn.Tanh())][:-1]
    arrays = [tuple(getattr(layer, name).detach().numpy() for layer in layers) for name in ("weight", "bias")]
    gradient = Network(*(tuple(np.full_like(a, np.nan) for a in part) for part in arrays))
    return nn.Sequential(*body), Network(*arrays), gradient


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_tanh_is_tanh(kind: Any) -> None:
    x = np.concatenate([np.linspace(-30, 30, 100_001), [0.0, 1e-30, -1e-30, 1e30, -np.inf, np.inf]]).astype(
        kind
    )
    found = x.copy()
    tanh(found)
    units = 4 if kind is np.float32 else 1
    np.testing.assert_allclose(found, np.tanh(x.astype(np.float64)), rtol=0, atol=units * np.finfo(kind).eps)
    small = np.abs(x) < 1
    np.testing.assert_allclose(
        found[small], np.tanh(x[small].astype(np.float64)), rtol=4 * np.finfo(kind).eps
    )
    plain = x[:3000].copy()
    tanh.py_func(plain)
    np.testing.assert_allclose(plain, found[:3000], rtol=2 * np.finfo(kind).eps)


def test_lamberts_fraction_has_its_odd_numbers() -> None:
    """Tanh x = x / (1 + x² / (3 + x² / (5 + …))), cut off after one to three levels; highest powers first."""
    assert _lambert(1) == ((1,), (1,))
    assert _lambert(2) == ((1,), (np.float32(1 / 3), 1))
    assert _lambert(3) == ((np.float32(1 / 15), 1), (np.float32(6 / 15), 1))


@PRECISIONS
@pytest.mark.parametrize("batch", [1, 5, 16])
@pytest.mark.parametrize("widths", [[8, 3], [8, 128, 128, 3], [4, 7, 6, 5, 1]])
def test_values_and_gradients_are_torchs(
    kind: Any, batch: int, widths: list[int], rng: np.random.Generator
) -> None:
    module, network, gradient = build(widths, kind)
    memory = passes(network, batch)
    x, slope = (rng.standard_normal((batch, width)).astype(kind) for width in (widths[0], widths[-1]))
    memory.inputs[0][:], memory.deltas[-1][:] = x.T, slope.T
    forward(network, memory)
    backward(network, memory, gradient)
    np.testing.assert_array_equal(memory.deltas[-1], slope.T)  # it is the caller's
    np.testing.assert_array_equal(memory.inputs[0], x.T)
    expected = module(torch.from_numpy(x))
    expected.backward(torch.from_numpy(slope))
    tolerance = {"rtol": 1e-4, "atol": 1e-5} if kind is np.float32 else {"rtol": 1e-11, "atol": 1e-13}
    np.testing.assert_allclose(memory.output.T, expected.detach().numpy(), **tolerance)
    layers = [m for m in module if isinstance(m, nn.Linear)]
    for layer, weight, bias in zip(layers, *gradient, strict=True):
        np.testing.assert_allclose(weight, layer.weight.grad.numpy(), **tolerance)
        np.testing.assert_allclose(bias, layer.bias.grad.numpy(), **tolerance)
    single = passes(network, 1)
    for b in range(batch):
        single.inputs[0][:, 0] = x[b]
        forward(network, single)
        np.testing.assert_allclose(single.output[:, 0], memory.output[:, b], **tolerance)


@PRECISIONS
def test_adam_is_torchs(kind: Any, rng: np.random.Generator) -> None:
    """With zero gradients too, where only ε keeps the step finite."""
    start = rng.standard_normal(1000).astype(kind)
    parameter = nn.Parameter(torch.from_numpy(start.copy()))
    optimizer = torch.optim.Adam([parameter], lr=1e-2, betas=(0.8, 0.95), eps=1e-5)
    mine, mean, square = start.copy(), np.zeros_like(start), np.zeros_like(start)
    for step in range(1, 30):
        gradient = rng.standard_normal(1000).astype(kind) * (rng.random(1000) < 0.5)
        parameter.grad = torch.from_numpy(0.5 * gradient)
        optimizer.step()
        adam(mine, gradient, mean, square, 0.5, Optimizer(1e-2, (0.8, 0.95), 1e-5, step - 1), 1)
    tolerance = {"rtol": 1e-4, "atol": 1e-6} if kind is np.float32 else {"rtol": 1e-12, "atol": 1e-14}
    np.testing.assert_allclose(mine, parameter.detach().numpy(), **tolerance)
    state = optimizer.state[parameter]
    np.testing.assert_allclose(mean, state["exp_avg"].numpy(), **tolerance)
    np.testing.assert_allclose(square, state["exp_avg_sq"].numpy(), **tolerance)
