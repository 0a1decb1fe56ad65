"""A policy of stable-baselines3 and the state of its optimiser as arrays that compiled code changes."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn

from srlrepro.fast_ppo.network import Network, passes, single
from srlrepro.fast_ppo.rollout import Policy
from srlrepro.fast_ppo.update import Learner

MOMENTS = ("exp_avg", "exp_avg_sq")
ALIGNMENT = 16  # numbers: every tensor starts at a cache line
PAGE = 4096  # bytes: Adam's loop over several arrays is slower where these lie equally far into their pages
GAP = 1024  # bytes from one array's place in its page to that of the next, in four arrays
BOOKKEEPING = ("add_param_group", "state_dict", "load_state_dict")  # of optimisers: not worth compiling
UNCOMPILED = "__dynamo_disable"  # torch keeps there what it calls in place of such a function


@contextmanager
def without_compiler() -> Iterator[None]:
    """Leave torch's compiler unloaded where an optimiser is made, read or filled.

    Its `BOOKKEEPING` imports the compiler, a second of every process, only to be left alone by it.
    """
    methods = [getattr(torch.optim.Optimizer, name) for name in BOOKKEEPING]
    functions = [getattr(method, "__wrapped__", method) for method in methods]
    functions = [function for function in functions if not hasattr(function, UNCOMPILED)]
    for function in functions:
        setattr(function, UNCOMPILED, function)
    try:
        yield
    finally:
        for function in functions:
            delattr(function, UNCOMPILED)


class Views(NamedTuple):
    """The arrays, for minibatches of one size, and where the tensors lay when they were made."""

    learner: Learner
    policy: Policy
    addresses: tuple[int, ...]


def addresses(policy: ActorCriticPolicy, batch: int) -> tuple[int, ...]:
    """The batch, and where the parameters and their moments lie; 0 for a moment that is not there yet."""
    found = [batch]
    for parameter in policy.parameters():
        state = policy.optimizer.state[parameter]
        found += [parameter.data_ptr(), *(state[m].data_ptr() if m in state else 0 for m in MOMENTS)]
    return tuple(found)


def _network(views: dict[torch.Tensor, torch.Tensor], *modules: nn.Module) -> Network:
    """One of the policy's two networks, as arrays; its modules, first to last."""
    layers = [layer for module in modules for layer in module.modules() if isinstance(layer, nn.Linear)]
    weights = tuple(views[layer.weight].numpy() for layer in layers)
    return Network(weights, tuple(views[layer.bias].numpy() for layer in layers))


def _flats(size: int, kind: torch.dtype) -> list[torch.Tensor]:
    """Four arrays of zeros that start at cache lines, each a quarter of a page further into its page."""
    width = torch.empty(0, dtype=kind).element_size()
    spacing = -(-size * width // PAGE) * PAGE + GAP
    memory = np.zeros(4 * spacing + PAGE, np.uint8)
    first = -memory.ctypes.data % PAGE
    starts = [first + n * spacing for n in range(4)]
    return [torch.from_numpy(memory[start : start + size * width]).view(kind) for start in starts]


def make_views(policy: ActorCriticPolicy, batch: int) -> Views:
    """Move the parameters and moments into flat memory that torch and numpy both see; values are kept.

    batch: samples of a minibatch.
    """
    parameters: list[torch.Tensor] = list(policy.parameters())
    sizes = [-(-p.numel() // ALIGNMENT) * ALIGNMENT for p in parameters]
    flats = _flats(sum(sizes), parameters[0].dtype)
    split = (torch.split(flat, sizes) for flat in flats)
    values, gradients, *moments = (
        {p: part[: p.numel()].view(p.shape) for p, part in zip(parameters, parts, strict=True)}
        for parts in split
    )
    for p in parameters:
        state = policy.optimizer.state[p]
        state.setdefault("step", torch.tensor(0.0))
        for name, views in zip(MOMENTS, moments, strict=True):
            if name in state:
                views[p].copy_(state[name])
            state[name] = views[p]
        values[p].copy_(p.data)
        p.data = values[p]
    actor = policy.mlp_extractor.policy_net, policy.action_net
    critic = policy.mlp_extractor.value_net, policy.value_net
    networks = _network(values, *actor), _network(values, *critic)
    actor_passes, critic_passes = (passes(network, batch) for network in networks)
    critic_passes = critic_passes._replace(inputs=(actor_passes.inputs[0], *critic_passes.inputs[1:]))
    log_std, by_log_std = values[policy.log_std].numpy(), gradients[policy.log_std].numpy()
    by_parameters = _network(gradients, *actor), _network(gradients, *critic)
    parts = (*networks, log_std, *by_parameters, by_log_std)
    everything, gradient, mean, square = (flat.numpy() for flat in flats)
    learner = Learner(*parts, everything, gradient, mean, square, actor_passes, critic_passes)
    return Views(learner, Policy(networks[0], log_std, single(networks[0])), addresses(policy, batch))
