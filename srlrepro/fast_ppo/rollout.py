"""The steps of a rollout, compiled: π acts, the pendulum moves, the supervisor watches (eq. 6).

The kernels called here are those that the environment and its supervisor call, one period at a time.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from srlrepro.compiled.jit import inner, jit
from srlrepro.compiled.stack import read, write
from srlrepro.dynamics.circle_env import TIME_OVER, Task, advance, observe
from srlrepro.dynamics.pendulum import Floats
from srlrepro.fast_ppo.network import Integers, Network, Passes, Reals, Single, forward, forward_one, turn
from srlrepro.fast_ppo.update import HALF_LOG_2PI
from srlrepro.supervisor import Singles, Supervision, supervise


class Policy(NamedTuple):
    """μ, log σ, and the memory for one observation."""

    actor: Network
    log_std: Reals
    single: Single


class Steps(NamedTuple):
    """The record of N steps of a pendulum of n links, written by `collect`.

    Attributes:
        observations: [N + 1, 2n + 2] before the step, and after the last (or at the start of a new trial).
        actions: [N, n], not limited; log_probs: [N].
        episode_starts: [N] 1 where a trial begins.
        rewards: [N] R of the step.
        reached, states: [N, 2n + 2] and [N, 2n], observation and state after the step, before a new trial.
        ended: [N] 0, or what ended the trial if K did not (`ENDS`).
        cut_off: [N] 1 where the trial was cut off (truncated): the return goes on with V of what was reached.
        recoveries, recovery_periods: [N] outcome and duration of K; 0 where it was not needed.
    """

    observations: Singles
    actions: Singles
    log_probs: Singles
    rewards: Floats
    episode_starts: Singles
    reached: Singles
    states: Floats
    ended: Integers
    cut_off: Integers
    recoveries: Integers
    recovery_periods: Integers

    @property
    def dones(self) -> NDArray[np.bool_]:
        """[N] whether the step ended a trial."""
        return np.asarray((self.ended != 0) | (self.recoveries != 0), np.bool_)


@inner
def _copy(a: Reals, out: Reals) -> None:
    """``out[:] = a`` of one size: numba compiles a loop in a fraction of the time."""
    for i in range(a.size):
        out[i] = a[i]


@inner
def _act(policy: Policy, observation: Singles, noise: Singles, action: Singles) -> np.float32:
    """Write a = μ(o) + σ ε, and return log π(a|o)."""
    _copy(observation, policy.single.rows[0][0])
    forward_one(policy.single)
    means, log_prob = policy.single.rows[-1][0], 0.0
    for j in range(action.size):
        std, mean = np.exp(policy.log_std[j]), means[j]
        action[j] = mean + std * noise[j]
        z = (np.float64(action[j]) - mean) / std
        log_prob -= 0.5 * z * z + policy.log_std[j] + HALF_LOG_2PI
    return np.float32(log_prob)


@jit
def collect(
    task: Task, supervision: Supervision, policy: Policy, noise: Singles, x: Floats, period: int, steps: Steps
) -> int:
    """Take N steps from the state x [2n] (updated), where ``period`` control periods of a trial are over.

    noise: [N, n] standard normal.

    Returns:
        The control periods of the last trial that are over.
    """
    turn(policy.actor, policy.single)
    observation = np.empty(x.size + 2, np.float32)
    upright, idle = task.coefficients.upright, task.coefficients.idle
    observe(task, read(x, upright), period, observation)
    for n in range(noise.shape[0]):
        _copy(observation, steps.observations[n])
        steps.episode_starts[n] = period == 0
        action = steps.actions[n]
        steps.log_probs[n] = _act(policy, observation, noise[n], action)
        state, reward, ended = advance(task, read(x, upright), read(action, idle), period)
        write(state, x)
        period += 1
        recovery, duration = supervise(supervision, task, x, ended)
        steps.recoveries[n], steps.recovery_periods[n] = recovery, duration
        steps.cut_off[n] = ended == TIME_OVER if recovery == 0 else not supervision.terminates
        observe(task, state, period, observation)
        _copy(observation, steps.reached[n])
        _copy(x, steps.states[n])
        steps.rewards[n], steps.ended[n] = reward, ended
        if ended != 0 or recovery != 0:
            x[:], period = 0.0, 0
            observe(task, upright, period, observation)
    _copy(observation, steps.observations[noise.shape[0]])
    return period


def blank(count: int, links: int) -> Steps:
    """A record of ``count`` steps of a pendulum of so many links, to be written."""
    observations, reached = (np.empty((rows, 2 * links + 2), np.float32) for rows in (count + 1, count))
    actions, states = np.empty((count, links), np.float32), np.empty((count, 2 * links))
    log_probs, starts = (np.empty(count, np.float32) for _ in range(2))
    codes = [np.empty(count, np.int64) for _ in range(4)]
    return Steps(observations, actions, log_probs, np.empty(count), starts, reached, states, *codes)


@jit
def values(critic: Network, memory: Passes, observations: Singles) -> Singles:
    """V [N] of observations [N, 2n + 2], as many at a time as the memory holds."""
    batch, out = memory.output.shape[1], np.empty(len(observations), np.float32)
    for start in range(0, out.size, batch):
        count = min(batch, out.size - start)
        for n in range(count):
            for j in range(observations.shape[1]):
                memory.inputs[0][j, n] = observations[start + n, j]
        forward(critic, memory)
        for n in range(count):
            out[start + n] = memory.output[0, n]
    return out


@jit
def advantages(
    rewards: Singles, values: Singles, dones: NDArray[np.bool_], discounts: tuple[float, float]
) -> Singles:
    """Generalised advantage estimates [N], as stable-baselines3's buffer computes them.

    values: [N + 1]; dones: [N]; discounts: (γ, λ).
    """
    gamma, decay = np.float32(discounts[0]), np.float32(discounts[0] * discounts[1])
    running, gae = np.float32(0), np.empty_like(rewards)
    for n in range(rewards.size - 1, -1, -1):
        goes_on = np.float32(not dones[n])
        delta = rewards[n] + gamma * values[n + 1] * goes_on - values[n]
        running = delta + decay * goes_on * running
        gae[n] = running
    return gae
