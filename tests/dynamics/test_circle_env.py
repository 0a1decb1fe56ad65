"""The task: gymnasium's and stable-baselines3's checkers, the reward by hand, how trials end, pictures."""

import warnings
from math import inf, nan, pi
from typing import Any

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled
from gymnasium.utils.env_checker import check_env
from matplotlib.backends.backend_agg import FigureCanvasAgg
from stable_baselines3.common.env_checker import check_env as check_env_for_learning

import srlrepro  # noqa: F401  (registers the task)
from srlrepro.dynamics import rendering
from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv, advance, observe, perfect_return, target
from srlrepro.dynamics.pendulum import Floats, Pendulum, rk4_step
from srlrepro.dynamics.rendering import PendulumView
from srlrepro.settings.config import Config

IDLE = np.zeros(3, np.float32)
CIRCLE = (2.7, 0.3, pi)  # App. C: height of the centre m, radius m, rad/s


def run(env: ThreeLinkCircleEnv, actions: Floats, start: Any = None) -> list[tuple[Any, ...]]:
    """The steps of a trial, until it ends or the actions do."""
    env.reset(options=None if start is None else {"state": start})
    steps = []
    for action in actions:
        steps.append(env.step(action))
        if steps[-1][2] or steps[-1][3]:
            break
    return steps


def random_actions(n: int, seed: int = 0) -> Floats:
    return np.random.default_rng(seed).uniform(-1, 1, (n, 3)).astype(np.float32)


def test_the_checkers_find_nothing(window: None) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*infinity.*")  # the observations have no bounds
        check_env(gym.make("srlrepro/ThreeLinkCircle-v0", render_mode="rgb_array").unwrapped)
        check_env_for_learning(ThreeLinkCircleEnv(1.5, trial_length=0.5))


def test_the_task_is_registered_with_its_parameters() -> None:
    env = gym.make("srlrepro/ThreeLinkCircle-v0", delta=1.5, trial_length=1.0)
    task = env.unwrapped
    assert isinstance(task, ThreeLinkCircleEnv)
    assert task.pendulum == Pendulum(1.5)
    env.reset(seed=0)
    ends = [env.step(IDLE)[3] for _ in range(round(1.0 / task.rule.control_period))]
    assert ends == [False] * (len(ends) - 1) + [True]


def test_the_target_turns_on_the_circle_in_two_seconds() -> None:
    assert target(CIRCLE, 0.0) == pytest.approx((0.0, 3.0))
    assert target(CIRCLE, 0.5) == pytest.approx((0.3, 2.7))
    for t in np.linspace(0, 4, 23):
        x, y = target(CIRCLE, t)
        assert np.hypot(x, y - 2.7) == pytest.approx(0.3)
        assert target(CIRCLE, t + 2.0) == pytest.approx((x, y))
        assert target.py_func(CIRCLE, t) == pytest.approx((x, y))


def test_the_reward_of_standing_still_follows_from_the_chord() -> None:
    """The tip stays at (0, 3) while the target runs along: after t the chord is 2 r |sin(πt / 2)|."""
    env = ThreeLinkCircleEnv(4.0)
    rewards = [step[1] for step in run(env, np.zeros((150, 3)))]
    t = env.rule.control_period * np.arange(1, 151)
    np.testing.assert_allclose(rewards, 2.0 - 10.0 * 0.6 * np.abs(np.sin(pi * t / 2)), atol=1e-9)


def test_the_reward_is_two_minus_ten_times_the_distance() -> None:
    env = ThreeLinkCircleEnv(1.5)
    for i, action in enumerate(random_actions(30)):
        if i == 0:
            env.reset()
        _, reward, *_ = env.step(action)
        distance = np.linalg.norm(env.pendulum.joints(env.state)[0, 3] - target(CIRCLE, env.time))
        assert env.time == pytest.approx((i + 1) * env.rule.control_period)
        assert reward == pytest.approx(2.0 - 10.0 * distance)


def test_a_step_holds_the_scaled_torque_for_one_period() -> None:
    env, dt = ThreeLinkCircleEnv(1.1), ThreeLinkCircleEnv().rule.limits[0]
    x = np.zeros(6)
    for action in random_actions(20, 1):
        if not x.any():
            env.reset()
        env.step(action)
        for _ in range(env.rule.substeps):
            x = np.array(
                rk4_step(env.pendulum.coefficients, tuple(x), tuple(100.0 * action.astype(float)), dt)
            )
        np.testing.assert_allclose(env.state, x, rtol=1e-9, atol=1e-12)


def test_torques_are_limited() -> None:
    for sign in (1, -1):
        ends = []
        for action in ([1, -1, 1], [7, -1.5, 1e9], [inf, -inf, inf]):
            env = ThreeLinkCircleEnv()
            run(env, sign * np.array([action] * 3, dtype=np.float64))
            ends.append(env.state)
        np.testing.assert_array_equal(ends[0], ends[1])
        np.testing.assert_array_equal(ends[0], ends[2])


@pytest.mark.parametrize("unit", [1.0, 50.0, 250.0])
def test_the_unit_of_the_action_changes_numbers_not_torques(unit: float) -> None:
    env, usual = ThreeLinkCircleEnv(config=Config().with_values(action_unit=unit)), ThreeLinkCircleEnv()
    np.testing.assert_allclose(env.action_space.high * unit, 100.0)
    actions = 1.5 * random_actions(10)
    for found, expected in zip(run(env, actions * 100.0 / unit), run(usual, actions), strict=True):
        np.testing.assert_allclose(found[0], expected[0], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("observation", ["state", "scaled"])
def test_the_policy_sees_the_state_and_the_phase_of_the_target(observation: str) -> None:
    env = ThreeLinkCircleEnv(config=Config().with_values(observation=observation))
    seen, info = env.reset()
    np.testing.assert_array_equal(seen, np.array([0] * 7 + [1], np.float32))
    assert info == {"outcome": ""}
    for action in random_actions(10):
        seen = env.step(action)[0]
    state = env.state / env.config.paper.state_max if observation == "scaled" else env.state
    np.testing.assert_allclose(seen[:6], state, rtol=1e-5)
    np.testing.assert_allclose(seen[6:], [np.sin(pi * env.time), np.cos(pi * env.time)], rtol=1e-5)
    assert env.observation_space.contains(seen)


def test_a_trial_ends_at_the_time_limit() -> None:
    env = ThreeLinkCircleEnv(trial_length=0.25)
    steps = run(env, np.zeros((1000, 3)))
    assert len(steps) == round(0.25 / env.rule.control_period)
    assert steps[-1][2:] == (False, True, {"outcome": "time limit"})
    assert all(step[2:] == (False, False, {"outcome": ""}) for step in steps[:-1])
    np.testing.assert_array_equal(env.state, np.zeros(6))


def test_a_trial_ends_on_the_ground() -> None:
    env = ThreeLinkCircleEnv()
    steps = run(env, np.zeros((1000, 3)), [1.4, 0, 0, 3.0, 0, 0])
    assert steps[-1][2:] == (True, False, {"outcome": "hit the ground"})
    assert abs(env.state[0]) >= pi / 2
    assert 1 < len(steps) < 20


def test_hitting_the_ground_at_the_time_limit_is_a_fall() -> None:
    falls = len(run(ThreeLinkCircleEnv(), np.zeros((1000, 3)), [1.4, 0, 0, 3.0, 0, 0]))
    period = Config().choices.control_period
    steps = run(ThreeLinkCircleEnv(trial_length=falls * period), np.zeros((1000, 3)), [1.4, 0, 0, 3.0, 0, 0])
    assert len(steps) == falls
    assert steps[-1][2:] == (True, False, {"outcome": "hit the ground"})


def test_a_trial_that_cannot_be_integrated_ends_with_finite_numbers() -> None:
    env = ThreeLinkCircleEnv()
    for action, start in ((IDLE, [0, 0, 0, 0, 0, 1e4]), (np.full(3, nan), np.zeros(6))):
        observation, reward, *end = run(env, np.array([action]), start)[-1]
        assert end == [True, False, {"outcome": "diverged"}]
        assert np.isfinite(observation).all()
        assert np.isfinite(reward)
        assert np.isfinite(env.state).all()


def test_a_trial_starts_at_the_origin_or_at_the_given_state() -> None:
    env, start = ThreeLinkCircleEnv(), np.array([0.1, -0.2, 0.3, -0.4, 0.5, -0.6])
    run(env, random_actions(5))
    env.reset(options={"state": start})
    np.testing.assert_array_equal(env.state, start)
    env.step(IDLE)
    np.testing.assert_array_equal(start, [0.1, -0.2, 0.3, -0.4, 0.5, -0.6])  # a copy was taken
    for options in (None, {}):
        env.reset(options=options)
        np.testing.assert_array_equal(env.state, np.zeros(6))
        assert env.time == 0.0
    for bad in ([0] * 5, [nan] * 6, [[0] * 6]):
        with pytest.raises(ValueError, match="state = "):
            env.reset(options={"state": bad})


@pytest.mark.parametrize("links", [1, 2, 8])
def test_a_pendulum_of_other_links_has_the_same_task(links: int) -> None:
    env = ThreeLinkCircleEnv(1.1, config=Config().with_values(links=links))
    assert env.action_space.shape == (links,) and env.observation_space.shape == (2 * links + 2,)
    seen, _ = env.reset()
    np.testing.assert_array_equal(seen, [0.0] * (2 * links + 1) + [1.0])
    for _ in range(3):
        seen, reward, *_ = env.step(np.full(links, 0.01, np.float32))
    distance = np.linalg.norm(env.pendulum.joints(env.state)[0, -1] - target(CIRCLE, env.time))
    assert reward == pytest.approx(2.0 - 10.0 * distance)
    np.testing.assert_allclose(seen[:-2], env.state, rtol=1e-6)
    with pytest.raises(ValueError, match=f"must be {2 * links} finite numbers"):
        env.reset(options={"state": [0.0] * 7})


def test_the_same_actions_give_the_same_trial() -> None:
    first, second = (run(ThreeLinkCircleEnv(1.5), random_actions(60, 3)) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a[0], b[0])
        assert a[1:] == b[1:]


def test_compiled_code_does_what_the_source_says() -> None:
    env = ThreeLinkCircleEnv(1.5)
    task, state = env.arrays, (0.1, -0.2, 0.3, 1.0, -2.0, 3.0)
    now = state, (0.3, -3.0, 1.0), 70
    fast, slow = advance(task, *now), advance.py_func(task, *now)
    np.testing.assert_allclose(fast[0], slow[0], rtol=1e-9)
    assert fast[1:] == pytest.approx(slow[1:])
    out = np.empty((2, 8))
    observe(task, state, 70, out[0])
    observe.py_func(task, state, 70, out[1])
    np.testing.assert_allclose(*out)


@pytest.mark.parametrize(
    ("name", "value"),
    [("delta", v) for v in (0.0, -1.0, nan, inf)]
    + [("trial_length", v) for v in (0.0, -1.0, nan)]
    + [("render_mode", "ascii")],
)
def test_bad_parameters_are_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=f"{name} = {value}"):
        ThreeLinkCircleEnv(**{name: value})


def test_the_picture_shows_the_state() -> None:
    env = ThreeLinkCircleEnv(render_mode="rgb_array")
    env.reset()
    upright = env.render()
    assert upright is not None
    assert upright.dtype == np.uint8
    assert upright.ndim == 3
    assert upright.shape[2] == 3
    np.testing.assert_array_equal(env.render(), upright)
    env.reset(options={"state": [1.0, 0, 0, 0, 0, 0]})
    leaning = env.render()
    assert (leaning != upright).any()
    mirrored = env.reset(options={"state": [-1.0, 0, 0, 0, 0, 0]}) and env.render()
    assert (mirrored != leaning).any()
    env.close()
    env.close()


def test_without_a_mode_there_is_no_picture() -> None:
    with pytest.warns(UserWarning, match="render_mode"):
        assert ThreeLinkCircleEnv().render() is None


def test_the_return_of_a_perfect_trial_is_r_c_in_every_period() -> None:
    assert perfect_return(Config()) == 2.0 * 400
    config = Config().with_values(reward_constant=3.0, trial_length=0.7, control_period=0.02)
    assert perfect_return(config) == 3.0 * ThreeLinkCircleEnv(config=config).arrays.periods == 3.0 * 35


@pytest.mark.parametrize("period", [0.01, 0.02])
def test_videos_run_in_real_time(period: float) -> None:
    """One picture per step."""
    config = Config().with_values(control_period=period)
    env = ThreeLinkCircleEnv(render_mode="rgb_array", config=config)
    assert env.metadata["render_fps"] == round(1 / period)
    assert ThreeLinkCircleEnv.metadata["render_fps"] == round(1 / Config().choices.control_period)


def test_a_window_needs_a_gui_toolkit(monkeypatch: pytest.MonkeyPatch) -> None:
    plt.close("all")
    env = gym.make("srlrepro/ThreeLinkCircle-v0", render_mode="human")
    with pytest.raises(DependencyNotInstalled, match='render_mode="human" needs a display') as refused:
        env.reset()
    assert "\n" not in str(refused.value)
    assert plt.get_fignums() == []

    def without_display(**values: Any) -> None:
        raise ImportError("Cannot load backend 'QtAgg'")

    monkeypatch.setattr(plt, "figure", without_display)
    with pytest.raises(DependencyNotInstalled, match='render_mode="human" needs a display'):
        ThreeLinkCircleEnv(render_mode="human").reset()


@pytest.mark.parametrize("cost", [0.0, 0.04], ids=["quick", "as slow as a window"])
def test_a_window_runs_in_real_time(cost: float, window: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a clock by which a picture takes 40 ms: pictures are left out. Where they cost nothing, all wait."""
    now, pictures = 100.0, []

    def wait(canvas: Any, seconds: float) -> None:
        nonlocal now
        now += max(seconds, cost)
        pictures.append(now)

    monkeypatch.setattr(FigureCanvasAgg, "start_event_loop", wait)
    monkeypatch.setattr(rendering.time, "perf_counter", lambda: now)
    env = ThreeLinkCircleEnv(render_mode="human")
    for _ in range(2):  # the second trial starts late, and is in real time too
        pictures.clear()
        now += 5.0
        env.reset()
        began = pictures[0] - cost
        for _ in range(100):
            env.step(IDLE)
        assert now - began == pytest.approx(1.0, abs=0.1)
        assert len(pictures) == pytest.approx(101 if cost == 0 else 1.0 / cost, rel=0.3)
    env.close()
    assert plt.get_fignums() == []


def test_a_slow_policy_is_seen_now_and_then(window: None, monkeypatch: pytest.MonkeyPatch) -> None:
    now, pictures = 100.0, []
    monkeypatch.setattr(FigureCanvasAgg, "start_event_loop", lambda canvas, seconds: pictures.append(now))
    monkeypatch.setattr(rendering.time, "perf_counter", lambda: now)
    env = ThreeLinkCircleEnv(render_mode="human")
    env.reset()
    for _ in range(100):
        now += 0.05
        env.step(IDLE)
    assert len(pictures) == pytest.approx(100 * 0.05 / rendering.LONGEST_GAP, abs=5)
    env.close()


def test_the_window_follows_every_step(window: None, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[str] = []
    monkeypatch.setattr(PendulumView, "draw", lambda self, joints, target, title: drawn.append(title))
    env = ThreeLinkCircleEnv(render_mode="human")
    env.reset()
    env.step(IDLE)
    assert env.render() is None
    env.close()
    after = f"t = {env.rule.control_period:.2f} s"
    assert drawn == ["t = 0.00 s", after, after]
