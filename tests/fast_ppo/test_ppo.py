"""The compiled learner is stable-baselines3's PPO: the same buffers, the same updates, the same refusals."""

import subprocess
import sys
from copy import deepcopy
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from runs import CONFIG, FREE, NARROW, SUPERVISED, UPDATE, Witness, agree, close, learn, narrow_region
from scipy.stats import ks_2samp
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback, EveryNTimesteps
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

from replication.studies.alternatives import learn_hypothesis
from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.fast_ppo.ppo import CompiledPPO
from srlrepro.learner.training import Run, make_env, make_learner
from srlrepro.region.hypothesis import Hypothesis
from srlrepro.samplers import generate
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError
from srlrepro.supervisor import Supervisor

LONG = CONFIG.with_values(n_steps=8 * UPDATE, n_minibatches=32)
REGION = narrow_region()
BUFFER = (
    "observations",
    "actions",
    "log_probs",
    "values",
    "rewards",
    "episode_starts",
    "advantages",
    "returns",
)


def pair(run: Run, region: Hypothesis | None, config: Config, **values: Any) -> tuple[PPO, PPO]:
    """Stock and compiled learner of the same run and seed."""
    models = []
    for kind in (PPO, CompiledPPO):
        learner = "stock" if kind is PPO else "compiled"
        model = make_learner(make_env(run, config, region), config.with_values(learner=learner), run.seed)
        assert type(model) is kind
        for name, value in values.items():
            setattr(model, name, value)
        models.append(model)
    return models[0], models[1]


DATA = generate(0.0, Config().with_values(k=200, random_rollouts=200), seed=0)


def hypothesis(kind: str) -> Hypothesis:
    """A hypothesis of another kind, learned from few states."""
    return learn_hypothesis(DATA, Config().with_values(hypothesis=kind))


CONDITIONS = pytest.mark.parametrize(
    ("run", "region", "values"),
    [
        (FREE, None, {}),
        (FREE, None, {"observation": "scaled", "log_std_init": 0.0}),
        (FREE, None, {"hidden_layers": 1, "trial_length": 0.03}),
        (SUPERVISED, REGION, {"hidden_layers": 3}),
        (SUPERVISED, REGION, {"early_stop": "truncate", "trial_length": 0.1}),
        (SUPERVISED, REGION, {"corrective": "none"}),
        *((SUPERVISED, hypothesis(kind), {}) for kind in ("pca", "mlp", "nominal")),
    ],
    ids=[
        "free",
        "free, scaled",
        "free, time limits",
        "supervised",
        "supervised, truncating",
        "early stop without K",
        "pca",
        "mlp",
        "nominal",
    ],
)


@CONDITIONS
def test_a_rollout_fills_the_buffer_as_stock_does(run: Run, region: Any, values: dict[str, Any]) -> None:
    stock, compiled = pair(run, region, LONG.with_values(**values))
    for model in (stock, compiled):
        model.train = lambda: None
        learn(model, model.n_steps)
    for name in BUFFER:
        a, b = (getattr(m.rollout_buffer, name) for m in (stock, compiled))
        assert a.dtype == b.dtype
        close(a, b)
    starts = stock.rollout_buffer.episode_starts
    assert 3 < starts.sum() < starts.size
    first = int(np.flatnonzero(starts[1:])[0]) + 1  # until the first trial ends, nothing is amplified
    for name in BUFFER[:4]:
        a, b = (getattr(m.rollout_buffer, name)[:first] for m in (stock, compiled))
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-5)
    close(stock._last_obs, compiled._last_obs)
    np.testing.assert_array_equal(stock._last_episode_starts, compiled._last_episode_starts)
    assert stock.num_timesteps == compiled.num_timesteps


@CONDITIONS
def test_callbacks_are_told_what_stock_tells(run: Run, region: Any, values: dict[str, Any]) -> None:
    told, books = [], []
    for model in pair(run, region, LONG.with_values(**values)):
        model.train = lambda: None
        witness = Witness()
        learn(model, 2 * model.n_steps, witness)
        told.append(witness.rows)
        assert model.env is not None
        monitor = model.env.envs[0]
        books.append((monitor.episode_lengths, monitor.total_steps, len(monitor.rewards)))
        assert len(model.ep_info_buffer) == min(100, len(monitor.episode_lengths))
        books[-1] += (monitor.unwrapped.period,)
    assert books[0] == books[1]
    agree(*told)


def double(model: PPO) -> None:
    """Let stable-baselines3 train in double precision, for which it is not made."""
    model.policy.double()
    model.policy.extract_features = lambda observations, *_: observations.double()
    buffer = model.rollout_buffer
    for name in BUFFER:
        setattr(buffer, name, getattr(buffer, name).astype(np.float64))


def filled(run: Run, region: Any, config: Config, **values: Any) -> tuple[PPO, PPO]:
    """A pair with the same weights and the same full buffer."""
    stock, compiled = pair(run, region, config, **values)
    for model in (stock, compiled):
        train = model.train
        model.train = lambda: None
        learn(model, model.n_steps)
        model.train = train
    for name in BUFFER:
        getattr(compiled.rollout_buffer, name)[:] = getattr(stock.rollout_buffer, name)
    # a rollout of an older policy, so that some ratios are clipped
    for model in (stock, compiled):
        model.rollout_buffer.log_probs += 0.3 * np.sin(np.arange(model.n_steps, dtype=np.float32))[:, None]
    return stock, compiled


def updated(model: PPO) -> dict[str, Any]:
    np.random.seed(11)  # noqa: NPY002  (the generator that stable-baselines3 permutes with)
    model.train()
    found = {name: p.detach().numpy().copy() for name, p in model.policy.named_parameters()}
    for name, p in model.policy.named_parameters():
        found |= {f"{name} {key}": v.numpy().copy() for key, v in model.policy.optimizer.state[p].items()}
    return found


def difference(stock: PPO, compiled: PPO) -> float:
    """The largest relative difference after the next update, over parameters and moments of Adam."""
    before = {name: p.detach().numpy().copy() for name, p in stock.policy.named_parameters()}
    a, b = updated(stock), updated(compiled)
    assert a.keys() == b.keys()
    assert all((a[name] != before[name]).any() for name in before)
    logs = [
        {k: v for k, v in m.logger.name_to_value.items() if k.startswith("train/")} for m in (stock, compiled)
    ]
    assert logs[0] == pytest.approx(logs[1], rel=1e-4, abs=1e-6)
    assert 0 < logs[0]["train/clip_fraction"] < 1
    return max(float(np.abs(a[name] - b[name]).max() / max(np.abs(a[name]).max(), 1e-30)) for name in a)


VARIED = [
    {},
    {"ent_coef": 0.01, "vf_coef": 0.5},
    {"max_grad_norm": 0.05},
    {"normalize_advantage": False},
    {"clip_range": lambda progress: 0.05},
]


@pytest.mark.parametrize("values", VARIED, ids=lambda v: next(iter(v), "default"))
def test_an_update_in_double_precision_is_stocks(values: dict[str, Any]) -> None:
    models = filled(SUPERVISED, REGION, LONG, **values)
    for model in models:
        double(model)
    assert difference(*models) <= 1e-9
    assert difference(*models) <= 1e-9  # a second update, with Adam's moments


@pytest.mark.slow
def test_an_update_of_full_size_in_double_precision_is_stocks() -> None:
    """1280 gradient steps with the networks of App. C."""
    models = filled(FREE, None, Config())
    for model in models:
        double(model)
    assert difference(*models) <= 1e-9


def test_a_gradient_step_in_single_precision_is_stocks() -> None:
    config = Config().with_values(n_steps=32, n_minibatches=2, n_epochs=1)
    models = filled(FREE, None, config, batch_size=32)
    assert difference(*models) <= 1e-5


def moved(model: PPO, before: dict[str, torch.Tensor]) -> list[float]:
    """How far a training has moved the weights of both networks (norms), and log σ (mean)."""
    after = dict(model.policy.named_parameters())
    by = {name: (after[name] - value).detach() for name, value in before.items()}
    networks = {"actor": ("policy_net", "action_net"), "critic": ("value_net",)}
    squares = {
        kind: sum(float((d**2).sum()) for name, d in by.items() if any(part in name for part in parts))
        for kind, parts in networks.items()
    }
    return [squares["actor"] ** 0.5, squares["critic"] ** 0.5, float(by["log_std"].mean())]


@pytest.mark.slow
def test_learning_is_the_same_in_law() -> None:
    """Over independent seeds of both learners: how far they have learned, and their last trials."""
    config = Config().with_values(n_steps=256, n_minibatches=8, hidden_width=32, learning_rate=1e-3)
    found: dict[type, list[list[float]]] = {PPO: [], CompiledPPO: []}
    for seed in range(10):
        for index, kind in enumerate(found):
            model = pair(Run(0.5, 1.5, 2 * seed + index, 1), REGION, config)[index]
            before = {name: p.detach().clone() for name, p in model.policy.named_parameters()}
            model.learn(4 * config.paper.n_steps)
            last = list(model.ep_info_buffer)
            means = [float(np.mean([e[key] for e in last])) for key in ("r", "l")]
            found[kind].append([*moved(model, before), *means])
    stock, compiled = (np.array(found[kind]) for kind in found)
    for column in range(stock.shape[1]):
        assert ks_2samp(stock[:, column], compiled[:, column]).pvalue > 0.01, column
    assert (stock != compiled).any()


def test_saved_models_are_those_of_stable_baselines3(tmp_path: Path) -> None:
    stock, compiled = pair(FREE, None, CONFIG)
    compiled.learn(2 * UPDATE)
    compiled.save(tmp_path / "model.zip")
    observations = np.random.default_rng(0).standard_normal((20, 8)).astype(np.float32)
    mine = compiled.predict(observations, deterministic=True)[0]
    for kind in (PPO, CompiledPPO):
        loaded = kind.load(tmp_path / "model.zip", env=ThreeLinkCircleEnv(1.5, config=CONFIG), device="cpu")
        np.testing.assert_array_equal(loaded.predict(observations, deterministic=True)[0], mine)
        loaded.learn(UPDATE)
        assert (loaded.predict(observations, deterministic=True)[0] != mine).any()
    stock.set_parameters(compiled.get_parameters())
    env = Monitor(ThreeLinkCircleEnv(1.5, config=CONFIG))
    assert evaluate_policy(stock, env, 1) == evaluate_policy(compiled, env, 1)


def test_loaded_weights_are_the_ones_that_learn() -> None:
    """Tensors that something has moved are shared anew, with the values that they have then."""
    first, second = (pair(FREE, None, CONFIG)[1] for _ in range(2))
    for model in (first, second):
        learn(model, UPDATE)
    kept = {name: p.clone() for name, p in first.policy.state_dict().items()}
    second.policy.double().float()
    second.policy.optimizer.load_state_dict(deepcopy(first.policy.optimizer.state_dict()))
    for model in (first, second):
        learn(model, UPDATE, reset_num_timesteps=False)
    for name, value in second.policy.state_dict().items():
        assert torch.equal(value, first.policy.state_dict()[name])
        assert not torch.equal(value, kept[name])


@pytest.mark.parametrize("stop", [1, UPDATE // 2, UPDATE + 7])
def test_a_callback_can_stop_the_training(stop: int) -> None:
    seen = []
    for model in pair(FREE, None, CONFIG):
        learn(model, 4 * UPDATE, Witness(stop))
        assert model.env is not None
        task = model.env.envs[0].unwrapped
        seen.append((model.num_timesteps, task.period, len(model.env.envs[0].rewards)))
        seen[-1] += (task.state.round(3).tolist(),)
    assert seen[0] == seen[1]


def test_callbacks_in_time_see_the_policy_of_the_rollout() -> None:
    """At fixed intervals, as stable-baselines3's own callbacks count them."""
    seen: list[list[tuple[int, float]]] = []
    for model in pair(FREE, None, CONFIG):

        class Look(BaseCallback):
            def _on_step(self) -> bool:
                seen[-1].append(
                    (self.num_timesteps, round(float(self.model.policy.log_std.detach().sum()), 4))
                )
                return True

        seen.append([])
        learn(model, 3 * UPDATE, EveryNTimesteps(40, Look()))
    assert seen[0] == seen[1]
    assert len({value for _, value in seen[0]}) > 1


class Other(RolloutBuffer):
    """A buffer of someone else's."""


REFUSED: list[dict[str, Any]] = [
    {"use_sde": True},
    {"target_kl": 0.01},
    {"clip_range_vf": 0.2},
    {"batch_size": 24},
    {"rollout_buffer_class": Other},
    {"policy_kwargs": {"activation_fn": torch.nn.ReLU}},
    {"policy_kwargs": {"optimizer_class": torch.optim.SGD}},
    {"policy_kwargs": {"optimizer_kwargs": {"weight_decay": 0.1}}},
    {"policy_kwargs": {"optimizer_kwargs": {"amsgrad": True}}},
]


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("values", REFUSED, ids=str)
def test_what_is_not_covered_is_refused(values: dict[str, Any]) -> None:
    with pytest.raises(ParameterError, match="CompiledPPO covers"):
        CompiledPPO("MlpPolicy", ThreeLinkCircleEnv(config=CONFIG), n_steps=64, **{"batch_size": 16} | values)


def test_what_is_changed_later_is_refused_or_heeded() -> None:
    model = pair(FREE, None, CONFIG)[1]
    model.learn(UPDATE)
    model.batch_size = 32
    model.learn(UPDATE)
    assert model.views().learner.actor_passes.output.shape[1] == 32
    model.target_kl = 0.1
    with pytest.raises(ParameterError, match=r"target_kl = 0\.1: must be one that CompiledPPO covers"):
        model.learn(UPDATE)


def test_other_environments_are_refused() -> None:
    for env in (gym.make("Pendulum-v1"), gym.wrappers.RescaleAction(ThreeLinkCircleEnv(), -1.0, 1.0)):
        with pytest.raises(ParameterError, match="must be one ThreeLinkCircleEnv"):
            CompiledPPO("MlpPolicy", env, n_steps=64, batch_size=16, device="cpu").learn(64)
    env = make_env(SUPERVISED, CONFIG, NARROW)
    assert isinstance(env, Supervisor)
    with pytest.raises(ParameterError, match="must be a hypothesis that compiled code knows"):
        make_learner(env, CONFIG, 0).learn(64)


SPARING = """
import io, sys
from stable_baselines3 import PPO
from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.fast_ppo.ppo import CompiledPPO
file, values = io.BytesIO(), {"n_steps": 64, "batch_size": 16, "device": "cpu"}
CompiledPPO("MlpPolicy", ThreeLinkCircleEnv(), **values).learn(64).save(file)
CompiledPPO.load(file, env=ThreeLinkCircleEnv(), device="cpu").learn(64)
print("torch._dynamo" in sys.modules)
PPO("MlpPolicy", ThreeLinkCircleEnv(), **values)
print("torch._dynamo" in sys.modules)
"""


@pytest.mark.slow
def test_a_training_does_without_torchs_compiler_and_leaves_it_to_others() -> None:
    found = subprocess.run([sys.executable, "-c", SPARING], check=True, capture_output=True, text=True)
    assert found.stdout.split() == ["False", "True"]
