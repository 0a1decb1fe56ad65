"""Trials to look at: they are those that evaluation counts, and K's part is K's own rollout."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image
from runs import CONFIG, FREE, NARROW, SUPERVISED

from replication.plots.pendulum import animate_trials
from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.learner.training import make_env
from srlrepro.learner.trials import Trial, evaluate, run_trial

LEANING: Any = SimpleNamespace(predict=lambda observation, deterministic: (np.array([0.6, 0.0, 0.0]), None))
IDLE: Any = SimpleNamespace(predict=lambda observation, deterministic: (np.zeros(3), None))


@pytest.mark.parametrize(("policy", "outcome"), [(LEANING, "hit the ground"), (IDLE, "time limit")])
def test_a_free_trial_is_the_one_that_is_evaluated(policy: Any, outcome: str) -> None:
    env = make_env(FREE, CONFIG, None)
    trial = run_trial(policy, env, deterministic=True)
    expected = evaluate(policy, env)
    assert (trial.total, trial.steps, trial.outcome) == tuple(
        expected[n] for n in ("return", "length", "outcome")
    )
    assert trial.outcome == outcome
    assert len(trial.joints) == len(trial.targets) == len(trial.supervised) == trial.steps + 1
    assert not trial.supervised.any()
    np.testing.assert_allclose(np.linalg.norm(np.diff(trial.joints, axis=1), axis=-1), 1.0)
    np.testing.assert_allclose(np.linalg.norm(trial.targets - [0, 2.7], axis=1), 0.3)


def test_a_supervised_trial_goes_on_under_k() -> None:
    env = make_env(SUPERVISED, CONFIG, NARROW)
    trial = run_trial(LEANING, env, deterministic=True)
    assert isinstance(env.unwrapped, ThreeLinkCircleEnv)
    task = env.unwrapped
    rollout = ClosedLoop.from_config(CONFIG, SUPERVISED.delta).rollout(task.state)
    periods = round(float(rollout.durations[0]) / task.rule.control_period)
    assert trial.outcome == "K: recovered"
    assert trial.supervised.sum() == periods + 1
    assert trial.steps + periods + 1 == len(trial.joints)
    np.testing.assert_array_equal(
        trial.joints[trial.steps :], task.pendulum.joints(rollout.paths[0, : periods + 1])
    )


def test_the_animation_shows_both_trials(tmp_path: Path) -> None:
    env = ThreeLinkCircleEnv(1.5, config=CONFIG)
    first, second = (run_trial(policy, env, deterministic=True) for policy in (LEANING, IDLE))
    path = tmp_path / "folder" / "trials.gif"
    animate_trials(path, [("leaning", first), ("idle", second)], env)
    picture: Any = Image.open(path)
    longest = max(len(trial.joints) for trial in (first, second))
    assert isinstance(first, Trial)
    assert picture.n_frames == -(-(longest + 50) // 5)  # half a second more, at 20 pictures a second
    shown = []
    for n in (0, picture.n_frames - 1):
        picture.seek(n)
        shown.append(np.asarray(picture.convert("RGB"), dtype=int))
    assert (shown[0] != shown[1]).any()
