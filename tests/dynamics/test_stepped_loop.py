"""A loop that is stepped: against compiled code, and on another environment."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from own_controller import UNIT, OwnLQG

from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.dynamics.closed_loop import NOT_RECOVERED, RECOVERED, ClosedLoop, is_upright
from srlrepro.dynamics.lqg import LQG
from srlrepro.dynamics.pendulum import Floats
from srlrepro.dynamics.stepped_loop import FAILED, StateRule, SteppedLoop
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError


def test_rollouts_of_the_pendulum_are_those_of_compiled_code(draw: Any) -> None:
    """The ground is a failure at the start too; a rate beyond the bound ends a rollout in both."""
    config = Config().with_values(action_unit=UNIT)
    compiled = ClosedLoop.from_config(config, 1.5)
    limits, states = compiled.rule.limits, draw(40) * 0.5
    states[0] = [np.pi / 2, 0, 0, 0, 0, 0]
    states[1] = 0.0
    rule = StateRule(
        lambda x: is_upright(limits, tuple(x)),
        lambda x: bool(abs(x[0]) >= limits[2]),
        compiled.rule.periods,
        compiled.rule.control_period,
    )
    stepped = SteppedLoop(ThreeLinkCircleEnv(1.5, config=config), OwnLQG(), rule)
    expected, found = compiled.rollout(states), stepped.rollout(states)
    assert set(expected.outcomes) >= {RECOVERED, FAILED}
    np.testing.assert_array_equal(found.outcomes, expected.outcomes)
    np.testing.assert_allclose(found.durations, expected.durations)
    np.testing.assert_array_equal(found.paths, expected.paths)
    np.testing.assert_array_equal(stepped.predict(states), compiled.predict(states))


class Brake:
    """Stop the pendulum of gymnasium: the torque against its rate, at most 2 N·m."""

    def reset(self, x: Floats) -> None:
        pass

    def action(self, x: Floats) -> Floats:
        return np.clip(-20.0 * x[1:], -2.0, 2.0)


def hanging(periods: int = 200) -> SteppedLoop:
    """Recovered: at rest, hanging down."""
    rule = StateRule(
        lambda x: bool(abs(np.cos(x[0]) + 1) < 0.01 and abs(x[1]) < 0.05), lambda x: x[1] > 7, periods, 0.05
    )
    return SteppedLoop(gym.make("Pendulum-v1"), Brake(), rule)


def test_another_environment_is_placed_and_run() -> None:
    loop = hanging()
    starts = np.array([[np.pi, 0.0], [np.pi, 1.0], [np.pi, 7.5]])
    found = loop.rollout(starts)
    assert found.outcomes.tolist() == [RECOVERED, RECOVERED, FAILED]
    assert found.labels.tolist() == [1, 1, 0]
    assert found.durations[0] == found.durations[2] == 0.0 < found.durations[1]
    assert found.paths.shape == (3, 201, 2)
    np.testing.assert_array_equal(found.paths[:, 0], starts)
    steps = round(found.durations[1] / 0.05)
    assert loop.rule.recovered(found.paths[1, steps]) and not loop.rule.recovered(found.paths[1, steps - 1])
    np.testing.assert_array_equal(found.paths[1, steps:], np.tile(found.paths[1, steps], (201 - steps, 1)))
    short = hanging(steps - 1).rollout(starts[1], record=False)
    assert short.outcomes.tolist() == [NOT_RECOVERED] and short.paths.shape == (1, 0, 2)
    assert short.durations[0] == pytest.approx(0.05 * (steps - 1))
    assert hanging(steps).predict(starts[1]).tolist() == [1]


def test_another_way_to_place_a_state() -> None:
    def place(env: Any, x: Floats) -> None:
        env.reset(seed=0)
        env.unwrapped.state = x + np.array([2 * np.pi, 0])

    loop = hanging()
    moved = SteppedLoop(loop.env, loop.controller, loop.rule, place=place)
    np.testing.assert_allclose(moved.rollout([[np.pi, 0.0]]).paths[0, 0], [3 * np.pi, 0.0])


@pytest.mark.parametrize(
    ("name", "value"), [("env", 1), ("controller", LQG()), ("rule", 1), ("state", 1), ("place", 1)]
)
def test_parts_of_another_kind_are_refused(name: str, value: Any) -> None:
    parts = {"env": hanging().env, "controller": Brake(), "rule": hanging().rule, name: value}
    with pytest.raises(ParameterError, match=f"^{name} = .*: must be "):
        SteppedLoop(**parts)


@pytest.mark.parametrize("found", ["words", ["a"], None, [], 1.0, [[1.0, 2.0]], [[1.0], [2.0, 3.0]]])
def test_what_is_no_state_is_refused_as_it_is_read(found: Any) -> None:
    loop = hanging()
    reading = SteppedLoop(loop.env, loop.controller, loop.rule, state=lambda env: found)
    with pytest.raises(ParameterError, match=r"^state = .*: must be a function of env that reads its state"):
        reading.read()


def test_without_a_period_times_are_numbers_of_steps() -> None:
    loop, start = hanging(), np.array([np.pi, 1.0])
    rule = StateRule(loop.rule.recovered, loop.rule.failed, loop.rule.periods)
    (steps,) = SteppedLoop(loop.env, loop.controller, rule).rollout(start, record=False).durations
    (seconds,) = loop.rollout(start, record=False).durations
    assert steps == round(seconds / loop.rule.control_period) > 1
