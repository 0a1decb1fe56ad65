"""CompiledPPO on what `gymnasium.make` gives, with stable-baselines3's own callbacks, Monitor and files."""

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, RescaleAction, TimeLimit
from runs import CONFIG, SUPERVISED, UPDATE, Witness, agree, close, learn, narrow_region
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import CallbackList, CheckpointCallback, ConvertCallback, EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor, load_results

from srlrepro import ENVIRONMENT
from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.fast_ppo import ppo
from srlrepro.fast_ppo.ppo import CompiledPPO, is_uncompiled
from srlrepro.fast_ppo.rollout import Steps
from srlrepro.fast_ppo.sb3_bridge import RolloutCallback, told_at_once
from srlrepro.settings.fields import ParameterError
from srlrepro.supervisor import Supervisor

LIMIT = 20  # control periods, less than those of a trial
Environment = gym.Env[Any, Any]


def made(**values: Any) -> Environment:
    return gym.make(ENVIRONMENT, delta=SUPERVISED.delta, config=CONFIG, **values)


def supervised(env: Environment) -> Supervisor:
    return Supervisor(env, narrow_region(), ClosedLoop.from_config(CONFIG).controller)


STACKS: dict[str, Callable[[], Environment]] = {
    "made": made,
    "made with a time limit": lambda: made(max_episode_steps=LIMIT),
    "made with a longer time limit": lambda: made(max_episode_steps=1000),
    "supervised": lambda: supervised(made()),
    "supervised, limit inside": lambda: supervised(made(max_episode_steps=LIMIT)),
    "supervised, limit outside": lambda: TimeLimit(supervised(made()), LIMIT),
}
IN_STACKS = pytest.mark.parametrize("build", STACKS.values(), ids=STACKS)


def learner(kind: type[PPO], env: Environment, **values: Any) -> PPO:
    fixed = {"n_steps": 4 * UPDATE, "batch_size": 32, "n_epochs": 2, "seed": 3, "device": "cpu"}
    return kind("MlpPolicy", env, **fixed, **values)


@IN_STACKS
def test_callbacks_and_monitor_are_told_what_stock_tells(
    build: Callable[[], Environment], tmp_path: Path
) -> None:
    told, books = [], []
    for kind in (PPO, CompiledPPO):
        folder = tmp_path / kind.__name__
        env = Monitor(build(), str(folder / "run"), info_keywords=("outcome",))
        model, witness = learner(kind, env), Witness()
        model.train = lambda: None  # type: ignore[method-assign]
        learn(model, 2 * model.n_steps, witness)
        told.append(witness.rows)
        books.append(load_results(str(folder)).drop(columns="t"))
    agree(*told)
    assert len(books[0]) > 3
    for column in ("l", "outcome"):
        assert books[0][column].astype(str).tolist() == books[1][column].astype(str).tolist()
    close(books[0]["r"], books[1]["r"])


class Listener(RolloutCallback):
    """Notes what it is told, step by step or at once; steps by their number."""

    def __init__(self) -> None:
        super().__init__()
        self.steps: list[tuple[int, float]] = []
        self.ends: list[tuple[int, dict[str, Any]]] = []

    def _on_step(self) -> bool:
        info = self.locals["infos"][0]
        self.steps.append((self.num_timesteps, float(self.locals["rewards"][0])))
        if "episode" in info:
            self.ends.append((self.num_timesteps, info))
        return True

    def _on_steps(self, steps: Steps, trials: list[tuple[int, dict[str, Any]]]) -> None:
        first = self.num_timesteps - len(steps.rewards) + 1
        self.steps += [(first + n, float(np.float32(reward))) for n, reward in enumerate(steps.rewards)]
        self.ends += [(first + n, info) for n, info in trials]


@IN_STACKS
def test_told_at_once_everyone_knows_what_they_know_step_by_step(
    build: Callable[[], Environment], tmp_path: Path
) -> None:
    """Beside a callback of another kind, all are told step by step."""
    known = []
    for others in ([], [Witness()]):
        folder = tmp_path / str(len(others))
        env = Monitor(build(), str(folder / "run"), info_keywords=("outcome",))
        model, listener = learner(CompiledPPO, env), Listener()
        model.learn(2 * model.n_steps, [listener, *others])
        assert len(env.episode_times) == len(listener.ends) > 3
        episodes = [*(info["episode"] for _, info in listener.ends), *model.ep_info_buffer]
        for episode in episodes:
            episode.pop("t", None)  # the time of the clock
        books = load_results(str(folder)).drop(columns="t").to_csv()
        monitor = env.episode_returns, env.episode_lengths, env.rewards, env.total_steps
        ends = [(n, {k: np.asarray(v).tolist() for k, v in info.items()}) for n, info in listener.ends]
        counts = listener.n_calls, listener.num_timesteps, model.num_timesteps
        known.append((listener.steps, ends, episodes, books, monitor, counts))
    assert known[0] == known[1]
    assert known[0][-1] == (2 * model.n_steps,) * 3


def test_one_callback_that_must_be_told_step_by_step_is_enough() -> None:
    at_once, by_step = Listener(), Witness()
    for callback, expected in (
        (at_once, True),
        (by_step, False),
        (ConvertCallback(None), True),
        (ConvertCallback(lambda *_: True), False),
        (CallbackList([at_once, CallbackList([Listener()])]), True),
        (CallbackList([at_once, CallbackList([by_step])]), False),
    ):
        assert told_at_once(callback) is expected


@pytest.mark.parametrize("name", STACKS)
def test_after_a_training_one_steps_on_by_hand(name: str) -> None:
    """The task stands where the rollout ended, and no wrapper has lost count of the trial."""
    env = STACKS[name]()
    model = learner(CompiledPPO, env)
    model.learn(2 * UPDATE)
    task, twin = env.unwrapped, ThreeLinkCircleEnv(SUPERVISED.delta, config=CONFIG)
    assert isinstance(task, ThreeLinkCircleEnv) and isinstance(model._last_obs, np.ndarray)
    np.testing.assert_array_equal(task.observation(), model._last_obs[0])
    assert task.period > 0
    twin.state, twin.period = task.state.copy(), task.period
    action, ended = np.full(3, 0.01, np.float32), False
    while not ended:
        found, expected = env.step(action), twin.step(action)
        np.testing.assert_array_equal(found[0], expected[0])
        ended = found[2] or found[3]
    if "limit" in name and "longer" not in name:
        assert task.period <= LIMIT
    env.reset()
    env.step(action)
    assert task.period == 1


def test_checks_of_gymnasium_are_made_at_the_first_step_by_hand() -> None:
    env = made()
    learner(CompiledPPO, env).learn(UPDATE)
    assert isinstance(env, OrderEnforcing) and isinstance(env.env, PassiveEnvChecker)
    assert env.has_reset and env.env.checked_reset and not env.env.checked_step
    env.step(np.zeros(3, np.float32))
    assert env.env.checked_step


def test_evaluations_and_checkpoints_are_those_of_stock(tmp_path: Path) -> None:
    """While the policy is that of the first rollout."""
    scores = []
    for kind in (PPO, CompiledPPO):
        folder = tmp_path / kind.__name__
        evaluation = EvalCallback(
            Monitor(made()),
            n_eval_episodes=1,
            eval_freq=UPDATE,
            log_path=str(folder),
            best_model_save_path=str(folder),
            verbose=0,
        )
        model = learner(kind, made())
        learn(model, 4 * UPDATE, CallbackList([evaluation, CheckpointCallback(2 * UPDATE, str(folder))]))
        with np.load(folder / "evaluations.npz") as stored:
            assert list(stored["timesteps"]) == [UPDATE * n for n in range(1, 5)]
            scores.append(stored["results"])
        names = sorted(path.name for path in folder.iterdir())
        assert names == [
            "best_model.zip",
            "evaluations.npz",
            f"rl_model_{2 * UPDATE}_steps.zip",
            f"rl_model_{4 * UPDATE}_steps.zip",
        ]
        kept = kind.load(folder / f"rl_model_{2 * UPDATE}_steps.zip", device="cpu")
        assert kept.num_timesteps == 2 * UPDATE
    close(*scores)


def test_a_saved_model_goes_on_in_another_environment(tmp_path: Path) -> None:
    first = learner(CompiledPPO, made())
    first.learn(4 * UPDATE)
    first.save(tmp_path / "model.zip")
    second = CompiledPPO.load(tmp_path / "model.zip", env=made(), device="cpu")
    env = Monitor(made())
    assert evaluate_policy(first, env, 1) == evaluate_policy(second, env, 1)
    before = {name: value.clone() for name, value in second.policy.state_dict().items()}
    second.learn(4 * UPDATE, reset_num_timesteps=False)
    assert second.num_timesteps == 8 * UPDATE
    assert any((value != before[name]).any() for name, value in second.policy.state_dict().items())


@pytest.mark.parametrize(
    "env",
    [
        lambda: gym.make("Pendulum-v1"),
        lambda: RescaleAction(made(), -1.0, 1.0),
        lambda: Monitor(Monitor(made())),
        lambda: supervised(supervised(made())),
    ],
)
def test_other_environments_are_refused_at_once(env: Callable[[], Environment]) -> None:
    with pytest.raises(ParameterError, match=r"must be one ThreeLinkCircleEnv, .*--set learner=stock"):
        learner(CompiledPPO, env())


def test_other_hypotheses_are_refused_at_once() -> None:
    region: Any = SimpleNamespace(predict=lambda x: np.ones(len(x)))
    env = Supervisor(made(), region, ClosedLoop.from_config(CONFIG).controller)
    with pytest.raises(ParameterError, match=r"hypothesis that compiled code knows; .*--set learner=stock"):
        learner(CompiledPPO, env)


def test_a_log_for_tensorboard_needs_tensorboard(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(ppo, "find_spec", lambda name: None)
    with pytest.raises(ParameterError, match=r"tensorboard_log = .*: must be left out"):
        learner(CompiledPPO, made(), tensorboard_log=str(tmp_path))
    monkeypatch.setattr(ppo, "find_spec", lambda name: object())
    assert learner(CompiledPPO, made(), tensorboard_log=str(tmp_path)).tensorboard_log == str(tmp_path)


def test_compiling_is_announced(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Once, and only where nobody has compiled the update before."""
    learner(CompiledPPO, made()).learn(UPDATE)
    assert not is_uncompiled(ppo.update)
    kernel = SimpleNamespace(__qualname__="update", signatures=[], stats=SimpleNamespace(cache_path=tmp_path))
    assert is_uncompiled(kernel)
    (tmp_path / "update.update-134.py311.nbi").touch()
    assert not is_uncompiled(kernel)
    assert "compiling" not in capsys.readouterr().err
    monkeypatch.setattr(ppo, "is_uncompiled", lambda kernel: True)
    learner(CompiledPPO, made()).learn(UPDATE)  # silent, as there is no terminal
    assert "compiling" not in capsys.readouterr().err
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    learner(CompiledPPO, made()).learn(UPDATE)
    assert capsys.readouterr().err.count("compiling for about half a minute") == 1
