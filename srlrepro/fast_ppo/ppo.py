"""stable-baselines3's PPO with compiled rollouts and updates: the same algorithm, only faster.

`CompiledPPO` overrides ``collect_rollouts`` and ``train``. It works on the policy's own tensors and on the
optimiser's own moments, through shared memory, and takes noise and permutations from the generators that
stock PPO takes them from, in the same order: the same seed gives the run of stock PPO, up to rounding.
"""

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.distributions import DiagGaussianDistribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.utils import explained_variance
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from srlrepro.fast_ppo.network import Optimizer
from srlrepro.fast_ppo.rollout import Steps, advantages, blank, collect, values
from srlrepro.fast_ppo.sb3_bridge import Stack, tell, told_at_once
from srlrepro.fast_ppo.torch_views import Views, addresses, make_views, without_compiler
from srlrepro.fast_ppo.update import STATISTICS, Loss, Samples, update
from srlrepro.settings.fields import check
from srlrepro.supervisor import STOCK


def is_uncompiled(kernel: Any) -> bool:
    """Whether numba has never compiled a kernel, in this process or in one that kept it on disk."""
    if kernel.signatures:
        return False
    return not any(Path(kernel.stats.cache_path).glob(f"*.{kernel.__qualname__}-*.nbi"))


class CompiledPPO(PPO):
    """PPO for `ThreeLinkCircleEnv`, bare or under a `Supervisor` with a `CompiledHypothesis`.

    The environment may come from ``gymnasium.make``. ``save``, ``load``, ``predict``, ``evaluate_policy``,
    the logger and the callbacks work as with stock PPO. But callbacks are told of the steps of a rollout
    after it is complete; one by one, unless all of them are a `RolloutCallback`:

    - ``locals`` hold what stock PPO tells of each step, without the tensors ``obs_tensor``, ``values`` and
      ``log_probs``;
    - the environment and torch's generator stand where they stand at the end of the rollout;
    - one that changes the policy or the environment in the middle of a rollout acts from the next one on;
    - where one stops the training, the task is put back to where it stood at that step.

    The first training of a shape of networks compiles for half a minute; what it compiles is kept on disk.

    Args:
        policy, env, values: those of stock PPO.

    Raises:
        ParameterError: a setting of stock PPO, or an environment, that the compiled code does not cover.
    """

    _views: Views | None = None

    def __init__(self, policy: Any, env: Any, **values: Any) -> None:
        log = values.get("tensorboard_log")
        there = log is None or find_spec("tensorboard") is not None
        check(there, "tensorboard_log", log, "left out, as the package tensorboard is not installed")
        super().__init__(policy, env, **values)

    def _setup_model(self) -> None:
        with without_compiler():
            super()._setup_model()
        self._refuse_what_is_not_covered()
        if self.env is not None:
            _ = Stack.of(self.env).supervision

    def _refuse_what_is_not_covered(self) -> None:
        policy, optimizer = self.policy, self.policy.optimizer
        other_adam = ("weight_decay", "amsgrad", "maximize", "differentiable", "capturable")
        covered = {
            "policy": type(policy) is ActorCriticPolicy,
            "activation_fn": policy.activation_fn is nn.Tanh,
            "features_extractor_class": type(policy.features_extractor) is FlattenExtractor,
            "action_space": type(policy.action_dist) is DiagGaussianDistribution,
            "optimizer_class": type(optimizer) is torch.optim.Adam,
            "optimizer_kwargs": not any(optimizer.defaults.get(name) for name in other_adam),
            "rollout_buffer_class": self.rollout_buffer_class is RolloutBuffer,
            "device": self.device.type == "cpu",
            "n_envs": self.n_envs == 1,
            "use_sde": not self.use_sde,
            "batch_size": self.batch_size > 1 and self.n_steps % self.batch_size == 0,
            "clip_range_vf": self.clip_range_vf is None,
            "target_kl": self.target_kl is None,
        }
        for name, ok in covered.items():
            allowed = f"one that CompiledPPO covers; {STOCK} has them all"
            check(ok, name, getattr(self, name, "of this kind"), allowed)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "_views"]

    def get_parameters(self) -> dict[str, Any]:
        """Those of stock PPO, by name: of the policy and of its optimiser."""
        with without_compiler():
            return super().get_parameters()

    def set_parameters(self, *values: Any, **named: Any) -> None:
        """What stock PPO does with the same arguments."""
        with without_compiler():
            super().set_parameters(*values, **named)

    def views(self) -> Views:
        """The policy's numbers as arrays; made anew if something has moved them, as `load` does."""
        now = addresses(self.policy, self.batch_size)
        if self._views is None or self._views.addresses != now:
            self._views = make_views(self.policy, self.batch_size)
        return self._views

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Fill the buffer with the current policy's steps; False if a callback has stopped the training."""
        self._refuse_what_is_not_covered()  # settings may have been changed since
        stack = Stack.of(env)
        if (self.verbose or sys.stderr.isatty()) and is_uncompiled(update):
            print("compiling for about half a minute, this once", file=sys.stderr)
        self.policy.set_training_mode(False)
        rollout_buffer.reset()
        callback.on_rollout_start()
        task, (learner, policy, _) = stack.task, self.views()
        steps = blank(n_rollout_steps, task.pendulum.links)
        # with a stride, torch draws one number after the other, as it does for one action at a time
        noise = torch.empty(*steps.actions.shape, 2)[..., 0].normal_().contiguous().numpy()
        x = task.state.copy()
        period = collect(stack.arrays, stack.supervision, policy, noise, x, task.period, steps)
        stack.place(x, period)
        expected = values(learner.critic, learner.critic_passes, steps.observations)
        dones = steps.dones
        if told_at_once(callback):
            self._tell_at_once(stack, steps, callback)
        elif not self._tell_step_by_step(stack, steps, dones, callback):
            return False
        self._last_obs, self._last_episode_starts = steps.observations[-1:].copy(), dones[-1:].copy()
        rewards = steps.rewards.astype(np.float32)
        cut_off = np.flatnonzero(steps.cut_off)
        left = values(learner.critic, learner.critic_passes, steps.reached[cut_off])
        rewards[cut_off] += np.float32(self.gamma) * left
        gae = advantages(rewards, expected, dones, (self.gamma, self.gae_lambda))
        columns = {"observations": steps.observations[:-1], "values": expected[:-1], "rewards": rewards}
        columns |= {name: getattr(steps, name) for name in ("actions", "episode_starts", "log_probs")}
        columns |= {"advantages": gae, "returns": gae + expected[:-1]}
        for name, column in columns.items():
            getattr(rollout_buffer, name)[:, 0] = column
        rollout_buffer.pos, rollout_buffer.full = n_rollout_steps, True
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    def _tell_at_once(self, stack: Stack, steps: Steps, callback: BaseCallback) -> None:
        """Enter a rollout into the books, and show it to callbacks that take all of it."""
        trials = stack.trials(steps)
        self.num_timesteps += len(steps.rewards)
        self._update_info_buffer([info for _, info in trials])
        tell(callback, steps, trials)

    def _tell_step_by_step(
        self, stack: Stack, steps: Steps, dones: NDArray[np.bool_], callback: BaseCallback
    ) -> bool:
        """Show every step to the callbacks; if one says stop, all stands where it stood after that step."""
        assert isinstance(self.action_space, Box)
        clipped = np.clip(steps.actions, self.action_space.low, self.action_space.high)
        columns = (steps.actions, clipped, steps.observations[1:], steps.rewards.astype(np.float32), dones)
        rows = zip(*(list(column[:, None]) for column in columns), stack.infos(steps), strict=True)
        names = ("actions", "clipped_actions", "new_obs", "rewards", "dones", "infos", "n_steps")
        n_rollout_steps = len(dones)
        callback.update_locals(locals())
        for n, (*told, done, info) in enumerate(rows):
            self.num_timesteps += 1
            callback.update_locals(dict(zip(names, (*told, done, [info], n), strict=True)))
            if not callback.on_step():
                stack.rewind(steps, n)
                return False
            if done[0]:
                self._update_info_buffer([info], done)
        return True

    def train(self) -> None:
        """Update policy and value function from the rollout buffer, as stock PPO does."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        clip_range = self.clip_range(self._current_progress_remaining)  # type: ignore[operator]
        learner, buffer, optimizer = self.views().learner, self.rollout_buffer, self.policy.optimizer
        group, states = optimizer.param_groups[0], list(optimizer.state.values())
        # the generator and the order of calls are those of the buffer's own sampling
        orders = np.stack([np.random.permutation(self.n_steps) for _ in range(self.n_epochs)])  # noqa: NPY002
        samples = Samples(*(getattr(buffer, name)[:, 0] for name in Samples._fields))
        loss = Loss(clip_range, self.vf_coef, self.ent_coef, self.max_grad_norm, self.normalize_advantage)
        done = int(states[0]["step"])
        adam = Optimizer(group["lr"], tuple(group["betas"]), group["eps"], done)
        statistics = update(learner, samples, orders.reshape(-1, self.batch_size), loss, adam)
        for state in states:
            state["step"].fill_(done + len(statistics))
        self._n_updates += self.n_epochs
        means = dict(zip(STATISTICS, statistics.mean(axis=0), strict=True))
        last_epoch = statistics[-(len(statistics) // self.n_epochs) :]
        means["approx_kl"] = last_epoch[:, STATISTICS.index("approx_kl")].mean()  # as stock PPO has it
        means["loss"] = statistics[-1, STATISTICS.index("loss")]
        for name, value in means.items():
            self.logger.record(f"train/{name}", value)
        explained = explained_variance(buffer.values.flatten(), buffer.returns.flatten())
        self.logger.record("train/explained_variance", explained)
        self.logger.record("train/std", torch.exp(self.policy.log_std).mean().item())
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/clip_range", clip_range)
