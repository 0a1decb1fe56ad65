"""The page's simulation in JavaScript against the package's, under Node."""

import json
import shutil
import subprocess
from collections.abc import Callable
from copy import copy
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learned import Learned
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from sklearn.metrics import precision_score, recall_score

from replication.explorer.build import actor_data, arms, model_source, pack, physics, region_data
from replication.explorer.equations import motion
from srlrepro.dynamics.circle_env import ENDS, ThreeLinkCircleEnv
from srlrepro.dynamics.closed_loop import HIT_GROUND, NOT_RECOVERED, OUTCOMES, RECOVERED, ClosedLoop
from srlrepro.learner.policy import TrainedPolicy
from srlrepro.learner.trials import transitions
from srlrepro.settings.config import Config
from srlrepro.supervisor import Supervisor

NODE = shutil.which("node")
pytestmark = pytest.mark.skipif(
    NODE is None, reason="Node is not installed: the page's simulation cannot be run"
)

Floats = NDArray[np.float64]
Run = Callable[..., Any]
DELTAS = (1.0, 1.5, 4.0)
CONFIG = Config()
ARMS = ("as written", "calibrated")


@pytest.fixture(scope="module")
def node(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """node(code, **values): what the code returns, a body of a function of the model ``M`` and the values."""
    folder = tmp_path_factory.mktemp("node")
    (folder / "model.js").write_text(model_source(3), encoding="utf-8")

    def run(code: str, **values: Any) -> Any:
        (folder / "values.json").write_text(json.dumps(values))
        script = (
            "const M = require('./model.js'), values = M.unpack(JSON.parse(fs.readFileSync('values.json')));"
        )
        body = f"{script} const {{{', '.join(values)}}} = values; const answer = (() => {{ {code} }})();"
        text = f"const fs = require('fs'); {body} fs.writeFileSync('answer.json', JSON.stringify(answer));"
        (folder / "run.js").write_text(text, encoding="utf-8")
        subprocess.run([str(NODE), "run.js"], cwd=folder, check=True, capture_output=True, text=True)
        return json.loads((folder / "answer.json").read_text())

    return run


def clockwork(config: Config, strength: float = 1.0) -> TrainedPolicy:
    """A policy of two hidden layers that holds the pendulum up, and shakes it with the phase of the target.

    Where tanh is about linear, it is −L x and a part of sine and cosine, so that its 1000 steps neither die
    away nor end; a larger strength shakes too hard.
    """
    gain, small = ClosedLoop.from_config(config).controller.gain, 0.02
    shake = np.array([[0.03, 0.01], [0.0, 0.02], [0.01, 0.0]])
    last = strength * np.hstack([-gain / config.choices.action_unit, shake]) / small
    weights = tuple(w.astype(np.float32) for w in (small * np.eye(8), np.eye(8), last))
    biases = tuple(np.full(len(w), 1e-3, np.float32) for w in weights)
    return TrainedPolicy(weights, biases, np.zeros(3, np.float32), np.ones(3, np.float32))


def mean_action(policy: TrainedPolicy, observation: Any) -> Any:
    """The policy in double precision; `predict` rounds to single."""
    values = np.asarray(observation, np.float64)
    for w, b in zip(policy.weights[:-1], policy.biases[:-1], strict=True):
        values = np.tanh(w.astype(np.float64) @ values + b)
    return policy.weights[-1].astype(np.float64) @ values + policy.biases[-1]


def deviation(found: Any, expected: Any) -> float:
    """By how much columns differ at most, as a share of the largest value of each."""
    a, b = np.asarray(found, np.float64), np.asarray(expected, np.float64)
    assert a.shape == b.shape and np.abs(b).max() > 0
    return float((np.abs(a - b).max(axis=0) / np.maximum(np.abs(b).max(axis=0), 1e-3)).max())


@pytest.mark.parametrize("delta", DELTAS)
def test_a_step_is_the_packages(node: Run, draw: Callable[..., Floats], delta: float) -> None:
    x, u = draw(300, 3), np.random.default_rng(2).uniform(-100, 100, (300, 3))
    code = """const s = M.systemOf(data, delta), out = new Float64Array(6);
    return x.map((state, i) => { M.rk4Step(s, state, u[i], dt, out); return Array.from(out); });"""
    found = node(code, data=physics(CONFIG), delta=delta, x=x.tolist(), u=u.tolist(), dt=1e-3)
    assert deviation(found, ClosedLoop.from_config(CONFIG, delta).system.step(x, u, 1e-3)) < 1e-11


def test_one_link_is_a_pendulum(tmp_path: Path) -> None:
    """m (l/2)² φ̈ = u + m g (l/2) sin φ, whatever the rate."""
    code = "const a = [0], f = [0]; motion({masses: [3], lengths: [2], gravity: 10}, [0.5, 7], [4], a, f);"
    (tmp_path / "one.js").write_text(f"{motion(1)} {code} console.log(JSON.stringify([a[0], f[0]]));")
    done = subprocess.run([str(NODE), "one.js"], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert json.loads(done.stdout) == pytest.approx([3.0, 4 + 30 * np.sin(0.5)], rel=1e-15)


@pytest.mark.parametrize("delta", DELTAS)
def test_a_recovery_is_the_packages(node: Run, delta: float) -> None:
    loop, start = ClosedLoop.from_config(CONFIG, delta), [0.1, -0.2, 0.1, 0.4, -0.3, 0.2]
    rollout = loop.rollout([start])
    code = """const r = M.recover(M.systemOf(data, delta), data.k, data.rule, start, true);
    return [r.outcome, r.periods, r.path.map((x) => Array.from(x))];"""
    outcome, periods, path = node(code, data=physics(CONFIG), delta=delta, start=start)
    assert outcome == rollout.outcomes[0] == RECOVERED
    assert periods == round(rollout.durations[0] / CONFIG.choices.control_period) > 10
    assert deviation(path, rollout.paths[0, : periods + 1]) < 1e-9


def test_a_thousand_steps_of_a_policy_are_the_packages(node: Run) -> None:
    config = CONFIG.with_values(trial_length=10.0)
    env, policy = ThreeLinkCircleEnv(1.1, config=config), clockwork(config)

    def act(
        _: Any,
    ) -> Any:  # in double precision: rounded to single, the last digit of a state may come to count
        phase = config.paper.circle_speed * env.time
        return mean_action(policy, [*env.state, np.sin(phase), np.cos(phase)])

    steps = list(transitions(env, act))
    assert len(steps) == 1000
    following = np.array([step.following for step in steps])
    assert np.abs(following[-200:]).max() > 0.1, "it shall still move at the end"
    code = """const {k, rule, task} = data, system = M.systemOf(data, 1.1);
    const world = {system, k, rule, task, policy, Numbers: Float64Array};
    const t = M.runTrial(world, [0, 0, 0, 0, 0, 0]);
    return [t.states.map((x) => Array.from(x)), t.total, t.activated, t.outcome];"""
    states, total, activated, outcome = node(code, data=physics(config), policy=actor_data(policy))
    assert deviation(states[1:], following) < 1e-9
    assert total == pytest.approx(sum(step.reward for step in steps), rel=1e-9)
    assert activated == -1
    assert ENDS[outcome] == steps[-1].info["outcome"] == "time limit"


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("delta", [1.1, 4.0])
def test_a_supervised_trial_is_the_packages(
    node: Run, small: Learned, small_config: Config, name: str, delta: float
) -> None:
    """K is activated at the same step, and fares the same, where a policy shakes too hard.

    The threshold lies above the least Γ of the first 40 steps: later, last digits come to count.
    """
    policy, data = clockwork(small_config, 12.0), physics(small_config)
    env, region = ThreeLinkCircleEnv(delta, config=small_config), copy(arms(small[1])[name])
    free = islice(transitions(env, lambda seen: mean_action(policy, seen)), 40)
    levels = np.unique(region.safety([np.zeros(6), *(step.following for step in free)]))
    region.p_t = float(levels[:2].mean())
    env = Supervisor(env, region, ClosedLoop.from_config(small_config).controller)
    steps = list(transitions(env, lambda seen: mean_action(policy, seen)))
    last = steps[-1].info
    assert last["activated"] and 0 < len(steps) <= 40
    code = """const {k, rule, task} = data, system = M.systemOf(data, delta);
    const arm = M.armOf(region, name), world = {system, k, rule, task, policy, arm, p_t: arm.p_t};
    const t = M.runTrial(world, [0, 0, 0, 0, 0, 0]);
    return [t.states.length, t.activated, t.outcome, Array.from(t.states.at(-1)), t.total];"""
    told = region_data(small[1]) | {"p_t": region.p_t}
    length, activated, outcome, end, total = node(
        code, data=data, delta=delta, policy=actor_data(policy), region=told, name=name
    )
    assert total == pytest.approx(sum(step.reward for step in steps), rel=1e-9)
    assert activated == len(steps)
    assert length == 1 + len(steps) + len(env.recovery_path)
    assert OUTCOMES[outcome] == last["recovery"]
    assert deviation([end], [env.recovery_path[-1]]) < 1e-6


@pytest.mark.parametrize("delta", DELTAS)
def test_labels_are_the_packages(node: Run, draw: Callable[..., Floats], delta: float) -> None:
    """2000 states: of the whole state space, and of a tenth of it."""
    x = np.concatenate([draw(1000, 5), 0.1 * draw(1000, 6), [[np.pi / 2, 0, 0, 0, 0, 0]]])
    code = "return x.map((state) => M.recover(M.systemOf(data, delta), data.k, data.rule, state).outcome);"
    found = node(code, data=physics(CONFIG), delta=delta, x=x.tolist())
    expected = ClosedLoop.from_config(CONFIG, delta).rollout(x, record=False).outcomes
    assert set(expected) >= {RECOVERED, HIT_GROUND}
    np.testing.assert_array_equal(np.array(found) == RECOVERED, expected == RECOVERED)
    assert np.mean(np.array(found) == expected) > 0.99  # the way in which K fails may turn on the last digit


@pytest.mark.parametrize("name", ARMS)
def test_h_is_the_packages(node: Run, small: Learned, draw: Callable[..., Floats], name: str) -> None:
    """Ψ, Γ and h of an arm at 2000 states, at training states, and far away."""
    data, fitted = small
    region, near = arms(fitted)[name], np.concatenate([draw(1000, 7), 0.1 * draw(1000, 8), data.x[:50]])
    assert region.psi == {"as written": "network", "calibrated": "neighbours"}[name]
    code = """const arm = M.armOf(region, name);
    return x.map((state) => [...M.place(arm, state), M.safety(arm, state)]);"""
    for x in (near, 1e9 * draw(5, 9)):
        found = np.array(node(code, region=region_data(fitted), name=name, x=x.tolist()))
        assert deviation(found[:, :2], region.transform(x)) < 1e-12
        np.testing.assert_array_equal(found[:, 2] > region.p_t, region.predict(x) == 1)
        np.testing.assert_allclose(found[:, 2], region.safety(x), rtol=1e-9)
    assert 0 < region.predict(near).mean() < 1


def test_arms_differ_in_psi_and_gamma(small: Learned, draw: Callable[..., Floats]) -> None:
    written, calibrated = arms(small[1]).values()
    x = draw(1000, 7)
    assert np.abs(written.transform(x) - calibrated.transform(x)).max() > 0.1 * written.embedding_.std()
    assert 0 < np.mean(written.predict(x) != calibrated.predict(x)) < 1


@pytest.mark.parametrize("name", ARMS)
def test_the_marked_states_are_the_nearest(
    node: Run, small: Learned, draw: Callable[..., Floats], name: str
) -> None:
    """In half ranges, the nearest first; by neighbours their weights add up to 1 and give Ψ(x)."""
    region, x = small[1], draw(100, 11)
    code = """const arm = M.armOf(region, name);
    return x.map((state) => Array.from(M.nearest(arm, state).near));"""
    found = node(code, region=region_data(region), name=name, x=x.tolist())
    scale = region.arrays_.scale
    distances = cdist(x / scale, region.arrays_.x_train.T)
    np.testing.assert_array_equal(found, distances.argsort(axis=1)[:, : region.psi_neighbours])
    code = """const arm = M.armOf(region, "calibrated");
    return x.map((state) => {
      const {near, weights, y} = M.mapState(arm, state);
      return [Array.from(near), Array.from(weights), y];
    });"""
    for order, weights, y in node(code, region=region_data(region), x=x[:5].tolist()):
        assert sum(weights) == pytest.approx(1.0, rel=1e-12)
        np.testing.assert_allclose(np.array(weights) @ region.embedding_[order], y, rtol=1e-9)


def test_precision_and_recall(node: Run) -> None:
    rng = np.random.default_rng(1)
    p, labels = rng.uniform(size=500), rng.integers(0, 2, 500)
    code = "return [M.judge(p, labels, 0.7), M.judge(p, labels, 1)];"
    found, none = node(code, p=p.tolist(), labels=labels.tolist())
    assert found["precision"] == pytest.approx(precision_score(labels, p > 0.7))
    assert found["recall"] == pytest.approx(recall_score(labels, p > 0.7))
    assert none == {"found": 0, "safe": labels.sum(), "precision": None, "recall": 0}


@pytest.mark.parametrize("kind", ["float64", "float32", "uint8"])
def test_arrays_arrive_as_they_are(node: Run, kind: str) -> None:
    values = np.random.default_rng(3).uniform(0, 200, 33).astype(kind)
    assert node("return Array.from(packed);", packed=pack(values, kind)) == values.tolist()


def test_a_rollout_is_given_up_beyond_the_rate_bound(node: Run) -> None:
    start = [0.0, 0.0, 0.0, 0.0, 900.0, -900.0]
    code = "return M.recover(M.systemOf(data, 1), data.k, data.rule, start).outcome;"
    assert node(code, data=physics(CONFIG), start=start) == NOT_RECOVERED
    assert ClosedLoop.from_config(CONFIG).rollout([start]).outcomes[0] == NOT_RECOVERED
