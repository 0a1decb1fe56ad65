"""The steps of a rollout, compiled: π acts, the pendulum moves, the supervisor watches (eq. 6).

The kernels called here are those of the environment, the region and the controller; this loop takes the
place of the Python that calls them one period at a time.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from srlrepro.env import TIME_OVER, Task, advance, observe
from srlrepro.network import Network, Passes, Reals, forward_one
from srlrepro.pendulum import Floats, as_state, jit
from srlrepro.supervisor import Guard, watch
from srlrepro.updating import HALF_LOG_2PI

Singles = NDArray[np.float32]
Codes = NDArray[np.int64]


class Policy(NamedTuple):
    """μ, V and log σ, with the memory for one observation."""

    actor: Network
    critic: Network
    log_std: Reals
    actor_passes: Passes
    critic_passes: Passes


class Steps(NamedTuple):
    """The record of N steps, written by `collect`.

    Attributes:
        observations: [N, 8] before the step; actions: [N, 3], not limited; log_probs, values: [N].
        rewards: [N] R of the step, plus γ V of the last state where a trial was cut off.
        episode_starts: [N] 1 where a trial begins.
        raw_rewards: [N] R of the step.
        reached, states: [N, 8] and [N, 6], observation and state after the step, before a new trial.
        ended: [N] 0, or what ended the trial if K did not (`ENDS`).
        recoveries, recovery_periods: [N] outcome and duration of K; 0 where it was not needed.
    """

    observations: Singles
    actions: Singles
    log_probs: Singles
    values: Singles
    rewards: Singles
    episode_starts: Singles
    raw_rewards: Floats
    reached: Singles
    states: Floats
    ended: Codes
    recoveries: Codes
    recovery_periods: Codes


@jit
def _value(policy: Policy, observation: Singles) -> np.float32:
    policy.critic_passes.inputs[0][:, 0] = observation
    forward_one(policy.critic, policy.critic_passes)
    return policy.critic_passes.output[0, 0]  # type: ignore[no-any-return]


@jit
def _act(policy: Policy, observation: Singles, noise: Singles, action: Singles) -> np.float32:
    """Write a = μ(o) + σ ε; returns log π(a|o)."""
    policy.actor_passes.inputs[0][:, 0] = observation
    forward_one(policy.actor, policy.actor_passes)
    log_prob = 0.0
    for j in range(action.size):
        std = np.exp(policy.log_std[j])
        mean = policy.actor_passes.output[j, 0]
        action[j] = mean + std * noise[j]
        z = (np.float64(action[j]) - mean) / std
        log_prob -= 0.5 * z * z + policy.log_std[j] + HALF_LOG_2PI
    return np.float32(log_prob)


@jit
def collect(
    task: Task,
    guard: Guard,
    policy: Policy,
    noise: Singles,
    discount: float,
    x: Floats,
    period: int,
    start: float,
    steps: Steps,
) -> tuple[int, float]:
    """Take N steps from the state x [6] (updated) in so many periods of a trial.

    Returns (period that the trial is in afterwards, V there).
    noise: [N, 3] standard normal; start: 1.0 if a trial begins at x.
    """
    observation = np.empty(8, np.float32)
    observe(task, as_state(x), period, observation)
    for n in range(noise.shape[0]):
        steps.observations[n] = observation
        steps.episode_starts[n] = start
        steps.values[n] = _value(policy, observation)
        action = steps.actions[n]
        steps.log_probs[n] = _act(policy, observation, noise[n], action)
        torque = (np.float64(action[0]), np.float64(action[1]), np.float64(action[2]))
        state, reward, ended = advance(task, as_state(x), torque, period)
        x[0], x[1], x[2], x[3], x[4], x[5] = state
        period += 1
        recovery, duration = watch(guard, task, x, ended)
        steps.recoveries[n], steps.recovery_periods[n] = recovery, duration
        cut_off = ended == TIME_OVER if recovery == 0 else not guard.terminates
        observe(task, state, period, observation)
        steps.reached[n], steps.states[n], steps.ended[n] = observation, x, ended
        steps.raw_rewards[n] = reward
        steps.rewards[n] = reward
        if cut_off:
            steps.rewards[n] += np.float32(discount) * _value(policy, observation)
        start = 0.0
        if ended != 0 or recovery != 0:
            x[:], period, start = 0.0, 0, 1.0
            observe(task, as_state(x), period, observation)
    return period, _value(policy, observation)


def blank(count: int) -> Steps:
    """A record of so many steps, to be written."""
    singles = [np.empty((count, *rest), np.float32) for rest in ((8,), (3,), (), (), (), ())]
    reached, states = np.empty((count, 8), np.float32), np.empty((count, 6))
    codes = [np.empty(count, np.int64) for _ in range(3)]
    return Steps(*singles, np.empty(count), reached, states, *codes)


@jit
def advantages(
    steps: Steps, last_value: float, discount: float, gae_lambda: float, gae: Singles, returns: Singles
) -> None:
    """Generalised advantage estimates [N] and returns [N], as stable-baselines3's buffer computes them."""
    count = steps.rewards.size
    gamma, decay = np.float32(discount), np.float32(discount * gae_lambda)
    running, following = np.float32(0), np.float32(last_value)
    for n in range(count - 1, -1, -1):
        ended = steps.ended[n] != 0 or steps.recoveries[n] != 0
        goes_on = np.float32(0.0 if ended else 1.0)
        delta = steps.rewards[n] + gamma * following * goes_on - steps.values[n]
        running = delta + decay * goes_on * running
        gae[n], following = running, steps.values[n]
        returns[n] = running + steps.values[n]
