r"""The gradient steps of PPO, compiled: as stable-baselines3's ``PPO.train`` takes them.

For a minibatch of B samples (o, a) with advantages A (normalised over the minibatch), returns R and
log π_old(a|o), the gradient step is one of Adam on

    − 1/B Σ min(ρ A, clip(ρ, 1 − ε, 1 + ε) A) − c_ent H(π) + c_vf/B Σ (R − V(o))²,

where ρ = π(a|o) / π_old(a|o) and π is Gaussian with mean μ(o) and std σ, a parameter of its own. The
gradient's norm is clipped. All sums over samples are in double precision; the networks keep their own.
"""

from typing import NamedTuple

import numpy as np

from srlrepro.compiled.jit import inner, jit
from srlrepro.compiled.products import square_sum
from srlrepro.dynamics.pendulum import Floats
from srlrepro.fast_ppo.network import Integers, Network, Optimizer, Passes, Reals, adam, backward, forward

HALF_LOG_2PI = 0.5 * np.log(2 * np.pi)
STATISTICS = ("policy_gradient_loss", "value_loss", "clip_fraction", "entropy_loss", "approx_kl", "loss")


class Learner(NamedTuple):
    """Actor, critic and σ; ``parameters`` holds all of them, and Adam's moments have its layout.

    Attributes:
        actor, critic: networks μ(o) and V(o); log_std: [actions].
        actor_gradient, critic_gradient, log_std_gradient: parts of ``gradient``.
        parameters, gradient, mean, square: [P].
        actor_passes, critic_passes: memory for one minibatch; both read the same observations.
    """

    actor: Network
    critic: Network
    log_std: Reals
    actor_gradient: Network
    critic_gradient: Network
    log_std_gradient: Reals
    parameters: Reals
    gradient: Reals
    mean: Reals
    square: Reals
    actor_passes: Passes
    critic_passes: Passes


class Samples(NamedTuple):
    """A rollout of N steps: [N, observations], [N, actions], and [N] each."""

    observations: Reals
    actions: Reals
    log_probs: Reals
    advantages: Reals
    returns: Reals


class Loss(NamedTuple):
    """ε, the coefficients of the loss, the largest norm of its gradient, and whether A is normalised."""

    clip_range: float
    vf_coef: float
    ent_coef: float
    max_grad_norm: float
    normalize_advantage: bool


@inner
def loss_gradient(
    learner: Learner, samples: Samples, index: Integers, loss: Loss, statistics: Floats
) -> None:
    """Gradient of the loss of the minibatch ``index`` [B]; writes `STATISTICS` [6]."""
    actor, critic = learner.actor_passes, learner.critic_passes
    batch, actions = index.size, learner.log_std.size
    for b in range(batch):
        for j in range(samples.observations.shape[1]):
            actor.inputs[0][j, b] = samples.observations[index[b], j]
    forward(learner.actor, actor)
    forward(learner.critic, critic)
    center, spread = 0.0, 1.0
    if loss.normalize_advantage:
        for b in range(batch):
            center += samples.advantages[index[b]] / batch
        total = 0.0
        for b in range(batch):
            total += (samples.advantages[index[b]] - center) ** 2
        spread = np.sqrt(total / (batch - 1)) + 1e-8
    means, values = actor.output, critic.output
    by_mean, by_value = actor.deltas[-1], critic.deltas[-1]
    by_log_std = learner.log_std_gradient
    inverse, entropy = np.empty(actions), 0.0
    for j in range(actions):
        inverse[j] = np.exp(-np.float64(learner.log_std[j]))
        entropy += learner.log_std[j] + 0.5 + HALF_LOG_2PI
        by_log_std[j] = -loss.ent_coef
    statistics[:] = 0.0
    for b in range(batch):
        i = index[b]
        log_prob = 0.0
        for j in range(actions):
            z = (np.float64(samples.actions[i, j]) - means[j, b]) * inverse[j]
            log_prob -= 0.5 * z * z + learner.log_std[j] + HALF_LOG_2PI
        difference = log_prob - samples.log_probs[i]
        ratio = np.exp(difference)
        advantage = (samples.advantages[i] - center) / spread
        clipped = min(max(ratio, 1 - loss.clip_range), 1 + loss.clip_range)
        surrogate = min(advantage * ratio, advantage * clipped)
        by_log_prob = -advantage * ratio / batch if advantage * ratio <= advantage * clipped else 0.0
        for j in range(actions):
            z = (np.float64(samples.actions[i, j]) - means[j, b]) * inverse[j]
            by_mean[j, b] = by_log_prob * z * inverse[j]
            by_log_std[j] += by_log_prob * (z * z - 1)
        error = np.float64(values[0, b]) - samples.returns[i]
        by_value[0, b] = loss.vf_coef * 2 * error / batch
        statistics[0] -= surrogate / batch
        statistics[1] += error * error / batch
        statistics[2] += (abs(ratio - 1) > loss.clip_range) / batch
        statistics[4] += (ratio - 1 - difference) / batch
    statistics[3] = -entropy
    statistics[5] = statistics[0] - loss.ent_coef * entropy + loss.vf_coef * statistics[1]
    backward(learner.actor, actor, learner.actor_gradient)
    backward(learner.critic, critic, learner.critic_gradient)


@jit
def update(learner: Learner, samples: Samples, orders: Integers, loss: Loss, optimizer: Optimizer) -> Floats:
    """Take gradient steps, one for each minibatch of orders [steps, B]; returns `STATISTICS` [steps, 6]."""
    statistics = np.empty((len(orders), len(STATISTICS)))
    for step in range(len(orders)):
        loss_gradient(learner, samples, orders[step], loss, statistics[step])
        norm = np.sqrt(square_sum(learner.gradient))
        factor = min(loss.max_grad_norm / (norm + 1e-6), 1.0)
        moments = learner.mean, learner.square
        adam(learner.parameters, learner.gradient, *moments, factor, optimizer, step + 1)
    return statistics
