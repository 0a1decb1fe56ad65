"""The supervisor's state machine (eq. 6), driven by scripted hypotheses, and the ideal hypothesis (eq. 3).

On the task with K compiled, with the same K stepped as anybody's own, and on another environment.
"""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import RecordEpisodeStatistics
from learned import Learned
from own_controller import UNIT, OwnLQG
from sklearn.svm import SVC

from srlrepro import ENVIRONMENT
from srlrepro.dynamics.circle_env import TIME_OVER, ThreeLinkCircleEnv
from srlrepro.dynamics.closed_loop import HIT_GROUND, NOT_RECOVERED, ClosedLoop
from srlrepro.dynamics.lqg import LQG
from srlrepro.dynamics.pendulum import Floats
from srlrepro.dynamics.rendering import PendulumView
from srlrepro.dynamics.stepped_loop import StateRule
from srlrepro.learner.trials import transitions
from srlrepro.region.hypothesis import Hypothesis
from srlrepro.settings.choices import Choices
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError
from srlrepro.supervisor import NOT_TRIED, Supervisor
from srlrepro.supervisor import supervise as decide

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


Supervise = Callable[..., Supervisor]


def compiled(region: Hypothesis, delta: float = 1.0, **values: Any) -> Supervisor:
    return Supervisor(ThreeLinkCircleEnv(delta, config=Config().with_values(**values)), region, LQG())


def stepped(region: Hypothesis, delta: float = 1.0, **values: Any) -> Supervisor:
    config = Config().with_values(**{"action_unit": UNIT} | values)
    return Supervisor(ThreeLinkCircleEnv(delta, config=config), region, OwnLQG())


@pytest.fixture(params=[compiled, stepped])
def supervise(request: pytest.FixtureRequest) -> Supervise:
    """A supervisor of the task, whose K is run by compiled code or step by step."""
    made: Supervise = request.param
    return made


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
def test_the_policy_acts_until_the_first_state_predicted_unsafe(supervise: Supervise, query: int) -> None:
    env = supervise(unsafe_at(query))
    plain = ThreeLinkCircleEnv(config=env.task.config)
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
    assert env.recovery is not None
    np.testing.assert_array_equal(env.recovery.paths[0, 0], plain.state)


def test_the_hypothesis_reads_every_state_once(supervise: Supervise) -> None:
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
    supervise: Supervise, start: Any, values: dict[str, Any], outcome: str, early_stop: str
) -> None:
    env = supervise(unsafe_at(1), early_stop=early_stop, **values)
    (step,) = trial(env, start=start)
    assert step[2:4] == ((True, False) if early_stop == "terminate" else (False, True))
    info = step[4]
    assert (info["activated"], info["outcome"], info["recovery"]) == (True, "supervised", outcome)
    assert env.recovery is not None
    loop = ClosedLoop.from_config(env.task.config)
    expected = loop.rollout(env.recovery.paths[0, 0])
    assert info["recovery_time"] == expected.durations[0]
    assert (info["recovery_time"] == 0) == (start == [0.0] * 6)


@pytest.mark.parametrize("delta", [1.0, 1.5, 4.0])
def test_k_of_the_nominal_system_runs_on_the_real_one_from_the_unsafe_state(
    supervise: Supervise, delta: float
) -> None:
    env = supervise(unsafe_at(5), delta)
    trial(env, random_policy(3), LEANING)
    assert env.recovery is not None
    start, path = env.recovery.paths[0, 0], env.recovery_path
    expected = ClosedLoop.from_config(Config(), delta).rollout(start)
    np.testing.assert_array_equal(env.recovery.paths, expected.paths)
    stands = start if supervise is compiled else path[-1]  # compiled code leaves the environment alone
    np.testing.assert_array_equal(env.task.state, stands)
    env.reset()
    assert env.recovery is None


def test_transitions_end_where_the_policy_has_left_the_task(supervise: Supervise) -> None:
    env, act = supervise(unsafe_at(5)), random_policy(3)
    *_, last = transitions(env, lambda _: act())
    assert env.recovery is not None
    np.testing.assert_array_equal(last.following, env.recovery.paths[0, 0])


def test_an_unforeseen_fall_comes_before_the_supervisor(supervise: Supervise) -> None:
    region = unsafe_at(1)
    env = supervise(region)
    (step,) = trial(env, start=FALLING)
    assert step[2:] == (True, False, {"outcome": "hit the ground", **QUIET})
    assert env.recovery is None
    assert len(region.asked) == 1  # type: ignore[attr-defined]


def test_a_trial_that_diverges_is_not_supervised(supervise: Supervise) -> None:
    (step,) = trial(supervise(unsafe_at(1)), start=[0, 0, 0, 0, 0, 1e4])
    assert step[2:] == (True, False, {"outcome": "diverged", **QUIET})


def test_a_safe_trial_lasts_until_the_time_limit(supervise: Supervise) -> None:
    env = supervise(unsafe_at(1000), trial_length=0.2)
    steps = trial(env)
    assert len(steps) == env.task.arrays.periods
    assert steps[-1][2:] == (False, True, {"outcome": "time limit", **QUIET})
    assert all(step[2:] == (False, False, {"outcome": "", **QUIET}) for step in steps[:-1])


@pytest.mark.parametrize(("early_stop", "ends"), [("terminate", (True, False)), ("truncate", (False, True))])
def test_unsafe_at_the_time_limit_is_still_supervised(
    supervise: Supervise, early_stop: str, ends: tuple[bool, bool]
) -> None:
    env = supervise(unsafe_at(20), early_stop=early_stop, trial_length=20 * Config().choices.control_period)
    steps = trial(env)
    assert len(steps) == 20
    assert steps[-1][2:4] == ends
    assert steps[-1][4]["outcome"] == "supervised"


def test_a_start_predicted_unsafe_is_an_error(supervise: Supervise) -> None:
    with pytest.raises(ValueError, match="region: predicts the start of the trial as unsafe"):
        supervise(unsafe_at(0)).reset()


@pytest.mark.parametrize("label", [0, 2, -1, 0.5])
def test_only_the_label_1_is_safe(supervise: Supervise, label: float) -> None:
    region = SimpleNamespace(predict=lambda x: np.array([label]))
    with pytest.raises(ValueError, match="region: predicts the start of the trial as unsafe"):
        supervise(region).reset()


@pytest.mark.parametrize("delta", [1.1, 4.0])
def test_behind_the_ideal_hypothesis_k_always_fails(supervise: Supervise, delta: float) -> None:
    """With h = l the first state predicted unsafe is one from which K cannot recover, and none before was."""
    loop = ClosedLoop.from_config(Config(), delta)
    env, activations = supervise(loop, delta), 0
    for seed in range(10):
        info = trial(env, random_policy(seed))[-1][4]
        activations += info["activated"]
        if info["activated"]:
            assert info["recovery"] in ("hit the ground", "not recovered in time")
    assert activations > 0


def test_a_stop_one_period_before_the_ideal_one_always_recovers(supervise: Supervise) -> None:
    """The state before the last one was still safe, so K from there succeeds."""
    loop = ClosedLoop.from_config(Config(), 1.5)
    for seed in range(5):
        first = len(trial(supervise(loop, 1.5), random_policy(seed)))
        assert first > 1
        info = trial(supervise(unsafe_at(first - 1), 1.5), random_policy(seed))[-1][4]
        assert info["recovery"] == "recovered"


def test_wrapped_tasks_are_welcome() -> None:
    wrapped = Supervisor(RecordEpisodeStatistics(ThreeLinkCircleEnv()), unsafe_at(1), LQG())
    wrapped.reset()
    assert wrapped.step(IDLE)[4]["recovery"] == "recovered"


@pytest.mark.parametrize("delta", [1.0, 4.0])
@pytest.mark.parametrize("values", [{}, {"corrective": "none"}, {"early_stop": "truncate"}])
def test_k_step_by_step_gives_the_trials_of_compiled_code(delta: float, values: dict[str, str]) -> None:
    """The same observations, rewards, ends and recoveries, to the last bit."""
    seen = set()
    for seed in range(6):
        loop = ClosedLoop.from_config(Config(), 1.1)  # knows Δ = 1.1: too cautious, and not cautious enough
        fast, slow = compiled(loop, delta, action_unit=UNIT, **values), stepped(loop, delta, **values)
        first, second = (trial(env, random_policy(seed)) for env in (fast, slow))
        for one, other in zip(first, second, strict=True):
            np.testing.assert_array_equal(one[0], other[0])
            assert one[1:] == other[1:]
        np.testing.assert_array_equal(fast.recovery_path, slow.recovery_path)
        seen.add(first[-1][4]["recovery"])
    tried = {"recovered", "hit the ground", "not recovered in time"}
    assert (seen - {""} == {"not tried"}) if "corrective" in values else (seen & tried)


class CartLQR:
    """Push the cart as an LQR would, to the left (0) or to the right (1)."""

    gain = np.array([-7.9, -13.8, -90.3, -23.9])  # N per m, m/s, rad, rad/s

    def __init__(self) -> None:
        self.started: list[Floats] = []

    def reset(self, x: Floats) -> None:
        self.started.append(x.copy())

    def action(self, x: Floats) -> int:
        return int(-self.gain @ x > 0)


BALANCED = StateRule(lambda x: bool((np.abs(x) < [1.0, 1.0, 0.1, 1.0]).all()), periods=300)


def cart_trial(env: Supervisor, action: int = 1) -> list[tuple[Any, ...]]:
    """The steps of a trial of the cart that is always pushed to one side."""
    env.reset(seed=0)
    steps = [env.step(action)]
    while not (steps[-1][2] or steps[-1][3]):
        steps.append(env.step(action))
    return steps


@pytest.mark.parametrize("early_stop", ["terminate", "truncate"])
def test_another_environment_is_supervised_in_the_same_way(early_stop: str) -> None:
    k, choices = CartLQR(), Choices(early_stop=early_stop)
    region, rule = unsafe_at(4), StateRule(BALANCED.recovered, periods=300, control_period=0.02)
    env = Supervisor(gym.make("CartPole-v1"), region, k, rule, choices=choices)
    plain = gym.make("CartPole-v1")
    plain.reset(seed=0)
    steps = cart_trial(env)
    assert len(steps) == 4
    for i, (observation, reward, *ends, info) in enumerate(steps):
        expected = plain.step(1)
        np.testing.assert_array_equal(observation, expected[0])
        assert reward == expected[1] == 1.0
        stopped = i == 3
        assert ends == [stopped and early_stop == "terminate", stopped and early_stop == "truncate"]
        assert info["activated"] is stopped
    assert info["recovery"] == "recovered" and info["outcome"] == "supervised"
    path = env.recovery_path
    assert 0 < info["recovery_time"] == pytest.approx(0.02 * len(path))
    (started,) = k.started
    np.testing.assert_array_equal(started, plain.unwrapped.state)  # type: ignore[attr-defined]
    np.testing.assert_array_equal(started, region.asked[-1][0])  # type: ignore[attr-defined]
    for x, following in zip([started, *path], path, strict=False):  # K acts on the system itself
        plain.unwrapped.step(k.action(x))
        np.testing.assert_array_equal(plain.unwrapped.state, following)  # type: ignore[attr-defined]
    assert rule.recovered(path[-1]) and not any(map(rule.recovered, [started, *path[:-1]]))
    env.reset(seed=1)
    assert env.recovery is None and env.recovery_path.shape == (0, 4)


class Rightwards(CartLQR):
    """A K that makes it worse."""

    def action(self, x: Floats) -> int:
        return 1


def test_another_environment_can_fail_by_its_own_end_by_a_rule_or_by_time() -> None:
    late = StateRule(lambda x: False, periods=3)
    tilted = StateRule(lambda x: abs(x[2]) > 0.15, lambda x: abs(x[2]) > 0.15)  # a failure comes first
    cases: list[tuple[StateRule, CartLQR, str]] = [
        (BALANCED, Rightwards(), "failed"),
        (late, CartLQR(), "not recovered in time"),
        (tilted, Rightwards(), "failed"),
    ]
    tilts = []
    for rule, k, outcome in cases:
        env = cart_with(unsafe_at(5), k, rule)
        info = cart_trial(env)[-1][4]
        assert info["recovery"] == outcome
        assert info["recovery_time"] == len(env.recovery_path)
        assert env.recovery is not None
        tilts.append(abs(env.recovery.paths[0, -1, 2]))
        np.testing.assert_array_equal(env.state, env.recovery.paths[0, 0])
    assert tilts[0] > 12 * np.pi / 180 > tilts[2] > 0.15
    assert info["recovery_time"] > 0


@pytest.mark.parametrize("largest", [0.1, np.inf])
def test_an_unforeseen_failure_comes_before_the_supervisor(largest: float) -> None:
    """By the rule, where the environment itself goes on; or by the environment."""
    region = unsafe_at(1000)
    env = cart_with(region, rule=StateRule(BALANCED.recovered, lambda x: abs(x[2]) > largest))
    steps = cart_trial(env)
    assert steps[-1][2:] == (True, False, QUIET) and len(steps) < 20
    assert min(largest, 12 * np.pi / 180) < abs(env.state[2])
    assert len(region.asked) == len(steps)  # type: ignore[attr-defined]
    assert env.recovery is None


def test_wrappers_neither_limit_k_nor_count_its_steps() -> None:
    inside = RecordEpisodeStatistics(gym.make("CartPole-v1", max_episode_steps=8))
    env = Supervisor(inside, unsafe_at(4), CartLQR(), StateRule(BALANCED.recovered, periods=300))
    info = cart_trial(env)[-1][4]
    assert info["recovery"] == "recovered" and info["recovery_time"] > 1
    assert inside.episode_lengths == 4


def test_the_state_is_read_by_a_function_of_ones_own() -> None:
    """In the order and the units that the hypothesis takes."""
    region = unsafe_at(2)
    env = Supervisor(
        gym.make("Pendulum-v1"),
        region,
        CartLQR(),
        BALANCED,
        state=lambda env: np.rad2deg(env.unwrapped.state),
    )
    env.reset(seed=0, options={"x_init": 0.1, "y_init": 0.1})
    np.testing.assert_array_equal(region.asked[0][0], np.rad2deg(env.task.state))  # type: ignore[attr-defined]
    np.testing.assert_array_equal(env.state, region.asked[0][0])  # type: ignore[attr-defined]


def test_a_task_of_gymnasium_make_is_supervised_in_the_same_way() -> None:
    plain, made = (
        Supervisor(env, unsafe_at(5), LQG()) for env in (ThreeLinkCircleEnv(), gym.make(ENVIRONMENT))
    )
    for first, second in zip(trial(plain, random_policy(3)), trial(made, random_policy(3)), strict=True):
        np.testing.assert_array_equal(first[0], second[0])
        assert first[1:] == second[1:]


def test_a_classifier_of_scikit_learn_is_a_hypothesis(supervise: Supervise) -> None:
    """It takes states [B, 6] only: a state alone would be refused."""
    x = np.random.default_rng(0).uniform(-1, 1, (200, 6))
    region = SVC().fit(x, np.abs(x[:, 0]) < 0.5)
    env = supervise(region)
    steps = trial(env, lambda: np.array([0.6, 0, 0], np.float32))
    assert steps[-1][4]["activated"]
    assert env.recovery is not None
    assert region.predict(env.recovery.paths[0, :1])[0] == 0


class Stranger:
    """None of the parts."""

    def control(self, x: Floats) -> Floats:
        return -x[:3]


def cart() -> gym.Env[Any, Any]:
    return gym.make("CartPole-v1")


def cart_with(region: Any = None, controller: Any = None, rule: Any = BALANCED, **values: Any) -> Supervisor:
    return Supervisor(cart(), region or unsafe_at(1), controller or CartLQR(), rule, **values)


def task_with(controller: Any, **values: Any) -> Supervisor:
    return Supervisor(ThreeLinkCircleEnv(), unsafe_at(1), controller, **values)


REFUSED: dict[str, tuple[str, Callable[[], Any]]] = {
    "controller": (r"controller = .*Stranger", lambda: cart_with(controller=Stranger())),
    "K of the task": (r"controller = LQG", lambda: cart_with(controller=LQG())),
    "env": (r"env = .*Stranger", lambda: Supervisor(cast(Any, Stranger()), unsafe_at(1), LQG())),
    "region": (r"region = .*Stranger", lambda: cart_with(region=Stranger())),
    "no rule": (r"rule = None", lambda: cart_with(rule=None)),
    "no function": (r"state = 1", lambda: cart_with(state=1)),
    "choices": (r"choices = Config", lambda: cart_with(choices=Config())),
    "own K of the task": (r"controller = .*Stranger", lambda: task_with(Stranger())),
    "rule of the task": (r"rule = StateRule", lambda: task_with(LQG(), rule=BALANCED)),
    "state of the task": (r"state = ", lambda: task_with(LQG(), state=lambda env: np.zeros(6))),
    "recovered": (r"recovered = 1", lambda: StateRule(cast(Any, 1))),
    "failed": (r"failed = 1", lambda: StateRule(BALANCED.recovered, cast(Any, 1))),
    "periods": (r"periods = 0", lambda: StateRule(BALANCED.recovered, periods=0)),
    "control_period": (r"control_period = 0", lambda: StateRule(BALANCED.recovered, control_period=0)),
}


@pytest.mark.parametrize("case", REFUSED)
def test_parts_of_another_kind_are_refused_at_once(case: str) -> None:
    message, make = REFUSED[case]
    with pytest.raises(ParameterError, match=rf"^{message}.*: must be ") as refused:
        make()
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "read", [lambda env: None, lambda env: "up", lambda env: 1.0, lambda env: [[0.0] * 4]]
)
def test_a_state_that_cannot_be_read_is_refused_as_a_trial_starts(read: Callable[[Any], Any]) -> None:
    env = Supervisor(cart(), unsafe_at(1), CartLQR(), BALANCED, read)
    with pytest.raises(ParameterError, match=r"^state = .*: must be a function of env that reads its state"):
        env.reset()


def test_compiled_code_decides_after_each_period_as_eq_6_does(
    small: Learned, draw: Callable[..., Floats]
) -> None:
    """K runs on the real system where h(x) = 0 and π has not fallen: ends and times of rollouts."""
    region, task = small[1], ThreeLinkCircleEnv(1.5, config=Config())
    supervision = Supervisor(task, region, LQG()).arrays
    x = draw(40)
    rolled, unsafe = ClosedLoop.from_config(Config(), 1.5).rollout(x), region.predict(x) == 0
    expected = [
        (end, round(time / Config().choices.control_period)) if out else (0, 0)
        for end, time, out in zip(rolled.outcomes, rolled.durations, unsafe, strict=True)
    ]
    assert 5 < unsafe.sum() < 35
    for ended in (0, TIME_OVER):
        assert [decide(supervision, task.arrays, state, ended) for state in x] == expected
    for other, ended in (
        (supervision, HIT_GROUND),
        (supervision, NOT_RECOVERED),
        (supervision._replace(active=False), 0),
    ):
        assert {decide(other, task.arrays, state, ended) for state in x} == {(0, 0)}
    without_k = supervision._replace(corrects=False)
    found = [decide(without_k, task.arrays, state, 0) for state in x]
    assert found == [(NOT_TRIED, 0) if out else (0, 0) for out in unsafe]


def test_only_compiled_parts_go_into_compiled_code(small: Learned) -> None:
    region = small[1]
    with pytest.raises(ParameterError, match=r"controller = a OwnLQG: must be an LQG"):
        _ = stepped(region).arrays
    with pytest.raises(ParameterError, match=r"env = .*: must be a ThreeLinkCircleEnv under an LQG"):
        stepped(unsafe_at(1)).recovery_frames()


@pytest.mark.slow
def test_stock_ppo_learns_another_system_under_a_supervisor() -> None:
    """Behind a bound on the angle of the pole: it leaves every trial before the pole falls."""
    from stable_baselines3 import PPO

    region = SimpleNamespace(predict=lambda x: (np.abs(x[:, 2]) < 0.1).astype(int))
    infos: list[dict[str, Any]] = []

    def note(found: dict[str, Any], _: dict[str, Any]) -> bool:
        infos.append(found["infos"][0])
        return True

    PPO("MlpPolicy", cart_with(region), n_steps=128, batch_size=32, device="cpu", seed=0).learn(256, note)
    ended = [info for info in infos if "episode" in info]
    assert len(infos) == 256 and len(ended) > 5
    assert all(info["activated"] and info["outcome"] == "supervised" for info in ended)


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
