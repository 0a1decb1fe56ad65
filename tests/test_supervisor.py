"""The supervisor's state machine (eq. 6), driven by scripted hypotheses, and the ideal hypothesis (eq. 3)."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import RecordEpisodeStatistics
from sklearn.svm import SVC

from srlrepro import ENVIRONMENT
from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.dynamics.lqg import LQG
from srlrepro.dynamics.pendulum import Floats
from srlrepro.dynamics.rendering import PendulumView
from srlrepro.region.hypothesis import Hypothesis
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError
from srlrepro.supervisor import Supervisor

IDLE = np.zeros(3, np.float32)
QUIET = {"activated": False, "recovery": "", "recovery_time": 0.0}
LEANING = [0.3, 0, 0, 0, 0, 0]
DOOMED = [1.3, 0, 0, 3.0, 0, 0]  # it falls, but not within a period
FALLING = [1.5, 0, 0, 10.0, 0, 0]  # it falls within a period


def unsafe_at(query: int) -> Hypothesis:
    """A hypothesis that calls the states safe, but for the ``query``-th one it is asked about (from 0)."""
    asked: list[Floats] = []

    def predict(x: Any) -> Any:
        asked.append(np.array(x))
        return np.array([0 if len(asked) == query + 1 else 1])

    return SimpleNamespace(predict=predict, asked=asked)


def supervise(region: Hypothesis, delta: float = 1.0, **values: Any) -> Supervisor:
    return Supervisor(ThreeLinkCircleEnv(delta, config=Config().with_values(**values)), region, LQG())


def random_policy(seed: int) -> Callable[[], Floats]:
    rng = np.random.default_rng(seed)
    return lambda: rng.uniform(-1, 1, 3).astype(np.float32)


def trial(
    env: Supervisor, policy: Callable[[], Floats] = lambda: IDLE, start: Any = None
) -> list[tuple[Any, ...]]:
    """The steps of a trial."""
    env.reset(options=None if start is None else {"state": start})
    steps = [env.step(policy())]
    while not (steps[-1][2] or steps[-1][3]):
        steps.append(env.step(policy()))
    return steps


@pytest.mark.parametrize("query", [1, 2, 30])
def test_the_policy_acts_until_the_first_state_predicted_unsafe(query: int) -> None:
    env, plain = supervise(unsafe_at(query)), ThreeLinkCircleEnv()
    observation, info = env.reset()
    np.testing.assert_array_equal(observation, plain.reset()[0])
    assert info == {"outcome": "", **QUIET}
    policy, same_policy = random_policy(1), random_policy(1)
    for i in range(query):
        *found, info = env.step(policy())
        *expected, _ = plain.step(same_policy())
        np.testing.assert_array_equal(found[0], expected[0])
        assert found[1] == expected[1]  # the steps of K carry no reward
        last = i == query - 1
        assert found[2:] == [last, False]
        assert info["activated"] is last
        assert info["outcome"] == ("supervised" if last else "")
    np.testing.assert_array_equal(env.task.state, plain.state)


def test_the_hypothesis_reads_every_state_once() -> None:
    region = unsafe_at(1000)
    env = supervise(region, trial_length=0.1)
    states = []
    env.reset()
    states.append(env.task.state)
    policy = random_policy(2)
    while len(states) <= env.task.arrays.periods:
        env.step(policy())
        states.append(env.task.state)
    np.testing.assert_array_equal(np.vstack(region.asked), np.vstack(states))  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("start", "values", "outcome"),
    [
        (LEANING, {}, "recovered"),
        ([0.0] * 6, {}, "recovered"),
        (DOOMED, {}, "hit the ground"),
        (LEANING, {"recovery_horizon": Config().choices.control_period}, "not recovered in time"),
    ],
)
@pytest.mark.parametrize("early_stop", ["terminate", "truncate"])
def test_k_recovers_or_fails_and_the_trial_ends(
    start: Any, values: dict[str, Any], outcome: str, early_stop: str
) -> None:
    env = supervise(unsafe_at(1), early_stop=early_stop, **values)
    (step,) = trial(env, start=start)
    assert step[2:4] == ((True, False) if early_stop == "terminate" else (False, True))
    info = step[4]
    assert (info["activated"], info["outcome"], info["recovery"]) == (True, "supervised", outcome)
    expected = env.loop.rollout(env.task.state)
    assert info["recovery_time"] == expected.durations[0]
    assert (info["recovery_time"] == 0) == (start == [0.0] * 6)


@pytest.mark.parametrize("delta", [1.0, 1.5, 4.0])
def test_k_of_the_nominal_system_runs_on_the_real_one_from_the_unsafe_state(delta: float) -> None:
    env = supervise(unsafe_at(5), delta)
    trial(env, random_policy(3), LEANING)
    assert env.recovery is not None
    expected = ClosedLoop.from_config(Config(), delta).rollout(env.task.state)
    np.testing.assert_array_equal(env.recovery.paths, expected.paths)
    np.testing.assert_array_equal(env.recovery.paths[0, 0], env.task.state)
    assert env.loop.controller.nominal.delta == 1.0
    env.reset()
    assert env.recovery is None


def test_an_unforeseen_fall_comes_before_the_supervisor() -> None:
    region = unsafe_at(1)
    env = supervise(region)
    (step,) = trial(env, start=FALLING)
    assert step[2:] == (True, False, {"outcome": "hit the ground", **QUIET})
    assert env.recovery is None
    assert len(region.asked) == 1  # type: ignore[attr-defined]


def test_a_trial_that_diverges_is_not_supervised() -> None:
    (step,) = trial(supervise(unsafe_at(1)), start=[0, 0, 0, 0, 0, 1e4])
    assert step[2:] == (True, False, {"outcome": "diverged", **QUIET})


def test_a_safe_trial_lasts_until_the_time_limit() -> None:
    env = supervise(unsafe_at(1000), trial_length=0.2)
    steps = trial(env)
    assert len(steps) == env.task.arrays.periods
    assert steps[-1][2:] == (False, True, {"outcome": "time limit", **QUIET})
    assert all(step[2:] == (False, False, {"outcome": "", **QUIET}) for step in steps[:-1])


@pytest.mark.parametrize(("early_stop", "ends"), [("terminate", (True, False)), ("truncate", (False, True))])
def test_unsafe_at_the_time_limit_is_still_supervised(early_stop: str, ends: tuple[bool, bool]) -> None:
    env = supervise(unsafe_at(20), early_stop=early_stop, trial_length=20 * Config().choices.control_period)
    steps = trial(env)
    assert len(steps) == 20
    assert steps[-1][2:4] == ends
    assert steps[-1][4]["outcome"] == "supervised"


def test_a_start_predicted_unsafe_is_an_error() -> None:
    with pytest.raises(ValueError, match="region: predicts the start of the trial as unsafe"):
        supervise(unsafe_at(0)).reset()


@pytest.mark.parametrize("delta", [1.1, 4.0])
def test_behind_the_ideal_hypothesis_k_always_fails(delta: float) -> None:
    """With h = l the first state predicted unsafe is one from which K cannot recover, and none before was."""
    loop = ClosedLoop.from_config(Config(), delta)
    env, activations = supervise(loop, delta), 0
    for seed in range(10):
        info = trial(env, random_policy(seed))[-1][4]
        activations += info["activated"]
        if info["activated"]:
            assert info["recovery"] in ("hit the ground", "not recovered in time")
    assert activations > 0


def test_a_stop_one_period_before_the_ideal_one_always_recovers() -> None:
    """The state before the last one was still safe, so K from there succeeds."""
    loop = ClosedLoop.from_config(Config(), 1.5)
    for seed in range(5):
        first = len(trial(supervise(loop, 1.5), random_policy(seed)))
        assert first > 1
        info = trial(supervise(unsafe_at(first - 1), 1.5), random_policy(seed))[-1][4]
        assert info["recovery"] == "recovered"


def test_wrapped_tasks_are_welcome_and_other_environments_are_not() -> None:
    wrapped = Supervisor(RecordEpisodeStatistics(ThreeLinkCircleEnv()), unsafe_at(1), LQG())
    wrapped.reset()
    assert wrapped.step(IDLE)[4]["recovery"] == "recovered"
    with pytest.raises(ParameterError, match="must be a ThreeLinkCircleEnv"):
        Supervisor(gym.make("CartPole-v1"), unsafe_at(1), LQG())


def test_a_task_of_gymnasium_make_is_supervised_in_the_same_way() -> None:
    plain, made = (
        Supervisor(env, unsafe_at(5), LQG()) for env in (ThreeLinkCircleEnv(), gym.make(ENVIRONMENT))
    )
    for first, second in zip(trial(plain, random_policy(3)), trial(made, random_policy(3)), strict=True):
        np.testing.assert_array_equal(first[0], second[0])
        assert first[1:] == second[1:]


def test_a_classifier_of_scikit_learn_is_a_hypothesis() -> None:
    """It takes states [B, 6] only: a state alone would be refused."""
    x = np.random.default_rng(0).uniform(-1, 1, (200, 6))
    region = SVC().fit(x, np.abs(x[:, 0]) < 0.5)
    env = supervise(region)
    steps = trial(env, lambda: np.array([0.6, 0, 0], np.float32))
    assert steps[-1][4]["activated"]
    assert region.predict([env.task.state])[0] == 0


class Controller:
    """Someone's own K."""

    def control(self, x: Floats) -> Floats:
        return -x[:3]


@pytest.mark.parametrize(("name", "own"), [("controller", Controller()), ("region", Controller())])
def test_parts_of_another_kind_are_refused_at_once(name: str, own: Any) -> None:
    parts: dict[str, Any] = {"region": unsafe_at(1), "controller": LQG(), name: own}
    with pytest.raises(ParameterError, match=rf"{name} = .*Controller.*: must be ") as refused:
        Supervisor(ThreeLinkCircleEnv(), **parts)
    assert "\n" not in str(refused.value)


def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Floats]:
    """The joints of all that a view draws from now on."""
    found: list[Floats] = []
    monkeypatch.setattr(PendulumView, "draw", lambda self, joints, target, title: found.append(joints))
    return found


def test_the_recovery_can_be_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    env = Supervisor(ThreeLinkCircleEnv(render_mode="rgb_array"), unsafe_at(5), LQG())
    env.reset()
    assert env.recovery_frames() == [] and env.recovery_path.shape == (0, 6)
    info = trial(env, random_policy(3), LEANING)[-1][4]
    frames, path = env.recovery_frames(), env.recovery_path
    assert len(frames) == len(path) == round(info["recovery_time"] / env.task.rule.control_period) > 10
    assert env.recovery is not None
    np.testing.assert_array_equal(path[-1], env.recovery.paths[0, -1])
    last = env.render()
    assert all(frame.shape == last.shape and frame.dtype == np.uint8 for frame in frames)
    assert (frames[0] != frames[-1]).any()
    joints = drawn(monkeypatch)
    env.recovery_frames()
    np.testing.assert_array_equal(joints, env.task.pendulum.joints(path))


def test_the_window_shows_the_recovery(window: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PendulumView, "show", lambda self, now: None)
    joints = drawn(monkeypatch)
    env = Supervisor(ThreeLinkCircleEnv(render_mode="human"), unsafe_at(5), LQG())
    steps = trial(env, random_policy(3), LEANING)
    assert len(joints) == 1 + len(steps) + len(env.recovery_path)
    np.testing.assert_array_equal(joints[-1], env.task.pendulum.joints(env.recovery_path)[-1])
    env.close()
