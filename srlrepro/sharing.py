"""A policy of stable-baselines3 and the state of its optimiser as arrays that compiled code changes in place."""

from collections.abc import Iterable
from typing import NamedTuple

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn

from srlrepro.network import Network, passes
from srlrepro.rollout import Policy
from srlrepro.updating import Learner

MOMENTS = ("exp_avg", "exp_avg_sq")
ALIGNMENT = 16  # numbers: every tensor starts at a cache line


class Shared(NamedTuple):
    """The arrays, and where the tensors lay when they were made."""

    learner: Learner
    policy: Policy
    addresses: tuple[int, ...]


def addresses(policy: ActorCriticPolicy) -> tuple[int, ...]:
    """Where the policy's parameters and their moments lie in memory; 0 for a moment that is not there yet."""
    found = []
    for parameter in policy.parameters():
        state = policy.optimizer.state[parameter]
        found += [parameter.data_ptr(), *(state[m].data_ptr() if m in state else 0 for m in MOMENTS)]
    return tuple(found)


def _network(layers: Iterable[nn.Linear], views: dict[nn.Parameter, torch.Tensor]) -> Network:
    layers = list(layers)
    weights = tuple(views[layer.weight].numpy() for layer in layers)
    return Network(weights, tuple(views[layer.bias].numpy() for layer in layers))


def share(policy: ActorCriticPolicy, batch: int) -> Shared:
    """Move the parameters and moments into flat memory that torch and numpy both see; values are kept.

    batch: samples of a minibatch.
    """
    parameters = list(policy.parameters())
    sizes = [-(-p.numel() // ALIGNMENT) * ALIGNMENT for p in parameters]
    flats = [torch.zeros(sum(sizes), dtype=parameters[0].dtype) for _ in range(4)]
    values, gradients, *moments = (
        {p: part[: p.numel()].view(p.shape) for p, part in zip(parameters, flat.split(sizes), strict=True)}
        for flat in flats
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
    bodies = policy.mlp_extractor.policy_net, policy.mlp_extractor.value_net
    actor, critic = (
        [*(layer for layer in body if isinstance(layer, nn.Linear)), head]
        for body, head in zip(bodies, (policy.action_net, policy.value_net), strict=True)
    )
    networks = _network(actor, values), _network(critic, values)
    actor_passes, critic_passes = (passes(network, batch) for network in networks)
    both = critic_passes._replace(inputs=(actor_passes.inputs[0], *critic_passes.inputs[1:]))
    log_std = values[policy.log_std].numpy()
    learner = Learner(
        *networks,
        log_std,
        _network(actor, gradients),
        _network(critic, gradients),
        gradients[policy.log_std].numpy(),
        *(flat.numpy() for flat in flats),
        actor_passes,
        both,
    )
    acting = Policy(*networks, log_std, *(passes(network, 1) for network in networks))
    return Shared(learner, acting, addresses(policy))
