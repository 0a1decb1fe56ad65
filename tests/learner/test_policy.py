"""A policy to take home acts as the learner's does, is read with numpy alone, and tells of its training."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from runs import CASES, FREE, STOCK
from scipy.stats import kstest
from stable_baselines3 import PPO

import srlrepro
from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.learner.policy import FORMAT, TrainedPolicy, load_policy
from srlrepro.learner.training import make_env, make_learner
from srlrepro.learner.trials import evaluate
from srlrepro.settings.fields import ParameterError
from srlrepro.storage.files import ResultError, write_arrays

ROUNDING = 2e-6  # of actions up to 1 in single precision, over three layers
ARRAYS = ("weight_0", "bias_0", "weight_1", "bias_1", "weight_2", "bias_2", "log_std", "largest")


@pytest.fixture(scope="module")
def learner() -> Any:
    """An untrained learner, with outer weights so large that some actions reach their bound."""
    model = make_learner(make_env(FREE, STOCK, None), STOCK, seed=5)
    model.policy.action_net.weight.data *= 300
    return model


@pytest.fixture
def stored(learner: Any, tmp_path: Path) -> Path:
    path = tmp_path / "policy.npz"
    record = {"run": {"alpha": None, "delta": 1.5, "seed": 3}, "config": STOCK.as_dict()}
    TrainedPolicy.of(learner, record).save(path)
    return path


def test_it_acts_as_stable_baselines3_does(learner: Any, stored: Path, rng: np.random.Generator) -> None:
    policy, seen = srlrepro.load_policy(stored), rng.normal(size=(400, 8)).astype(np.float32)
    expected, _ = learner.predict(seen, deterministic=True)
    actions, state = policy.predict(seen, state="kept")
    assert actions.dtype == expected.dtype and actions.shape == (400, 3) and state == "kept"
    np.testing.assert_allclose(actions, expected, rtol=0, atol=ROUNDING)
    bound = learner.action_space.high
    assert (actions == bound).any() and (np.abs(actions) < bound).any()
    one, _ = policy.predict(seen[7])
    assert one.shape == (3,)
    np.testing.assert_allclose(one, learner.predict(seen[7], deterministic=True)[0], rtol=0, atol=ROUNDING)


def test_drawn_actions_are_normal_about_the_mean(stored: Path, rng: np.random.Generator) -> None:
    policy = load_policy(stored)
    wide = TrainedPolicy(policy.weights, policy.biases, policy.log_std, 1e6 * policy.largest)
    seen = np.tile(rng.normal(size=8), (4000, 1))
    mean = wide.predict(seen[0])[0]
    drawn = (wide.predict(seen, deterministic=False, rng=rng)[0] - mean) / np.exp(policy.log_std)
    assert kstest(drawn.ravel(), "norm").pvalue > 0.01
    again = [policy.predict(seen, deterministic=False, rng=np.random.default_rng(1))[0] for _ in range(2)]
    np.testing.assert_array_equal(*again)
    assert (np.abs(again[0]) <= policy.largest).all()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            {"observation": np.zeros(7)},
            r"observation = float64 of shape \[7\]: must be numbers of shape \[8\]",
        ),
        ({"observation": np.zeros((1, 2, 8))}, r"observation = .*\[1, 2, 8\]"),
        ({"observation": ["a"] * 8}, "observation = <U1"),
        ({"observation": [1e39] * 8}, "observation = other values: must be finite"),
        ({"observation": [np.nan] * 8}, "observation = other values: must be finite"),
        ({"observation": np.zeros(8), "deterministic": False}, "rng = None: must be numpy's Generator"),
        (
            {"observation": np.zeros(8), "deterministic": False, "rng": 3},
            "rng = 3: must be numpy's Generator",
        ),
    ],
)
def test_what_it_cannot_act_on_is_refused(stored: Path, given: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        load_policy(stored).predict(**given)


def test_the_largest_numbers_give_actions(stored: Path) -> None:
    policy, largest = load_policy(stored), np.finfo(np.float32).max
    weights = tuple(np.where(w > 0, largest, -largest).astype(np.float32) for w in policy.weights)
    extreme = TrainedPolicy(weights, policy.biases, policy.log_std, policy.largest)
    assert (np.abs(extreme.predict(np.full(8, largest))[0]) <= policy.largest).all()


def test_a_file_gives_the_policy_and_the_policy_the_file(stored: Path, tmp_path: Path) -> None:
    policy = load_policy(stored)
    policy.save(tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == stored.read_bytes()
    condition = policy.condition
    assert condition is not None and condition.name == "alpha_none__delta_1.5__seed_3"
    assert policy.config == STOCK
    TrainedPolicy(policy.weights, policy.biases, policy.log_std, policy.largest).save(tmp_path / "own.npz")
    own = load_policy(tmp_path / "own.npz")
    assert own.condition is None and own.record == {}


def test_it_needs_neither_torch_nor_stable_baselines3(stored: Path) -> None:
    code = (
        "import sys, srlrepro\n"
        f"print(srlrepro.load_policy({str(stored)!r}).predict([0.0] * 8)[0].shape)\n"
        "print(sorted({'torch', 'stable_baselines3', 'numba', 'scipy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["(3,)", "[]"]


def changed(path: Path, **changes: Any) -> None:
    """Write a file of a policy with some parts replaced; None: left out."""
    with np.load(path) as archive:
        parts = {name: archive[name] for name in archive if name != "format"} | changes
    write_arrays(path, FORMAT, **{name: part for name, part in parts.items() if part is not None})


FORGED: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    **{f"no {name}": lambda p, n=name: {n: None} for name in (*ARRAYS, "layers", "record")},  # type: ignore[misc]
    **{f"{name} of float64": lambda p, n=name: {n: p[n].astype(np.float64)} for name in ARRAYS},  # type: ignore[misc]
    "float16": lambda p: {"weight_1": p["weight_1"].astype(np.float16)},
    "objects": lambda p: {"weight_1": p["weight_1"].astype(object)},
    "whole numbers": lambda p: {"bias_1": p["bias_1"].astype(np.int32)},
    "text": lambda p: {"bias_1": p["bias_1"].astype(str)},
    "another byte order": lambda p: {"bias_1": p["bias_1"].astype(">f4")},
    "not a number": lambda p: {"weight_0": p["weight_0"] * np.float32(np.nan)},
    "infinite": lambda p: {"bias_2": p["bias_2"] + np.float32(np.inf)},
    "an infinite deviation": lambda p: {"log_std": p["log_std"] + np.float32(1000)},
    "a bound of zero": lambda p: {"largest": 0 * p["largest"]},
    "turned": lambda p: {"weight_0": p["weight_0"].T},
    "flat": lambda p: {"weight_0": p["weight_0"].ravel()},
    "empty": lambda p: {"weight_0": p["weight_0"][:, :0]},
    "too short": lambda p: {"bias_0": p["bias_0"][:-1]},
    "another number of actions": lambda p: {"log_std": p["log_std"][:2]},
    "no layers": lambda p: {"layers": np.array(0)},
    "fewer layers": lambda p: {"layers": np.array(2)},
    "more layers": lambda p: {"layers": np.array(10**9)},
    "half a layer": lambda p: {"layers": np.array(2.5)},
    "layers in a row": lambda p: {"layers": np.array([3])},
    "a record that is no JSON": lambda p: {"record": np.array("{")},
    "a record that is no table": lambda p: {"record": np.array("[]")},
    "a number as record": lambda p: {"record": np.array(1.0)},
    **{
        f"a record with {key} = {value!r}": lambda p, k=key, v=value: {  # type: ignore[misc]
            "record": np.array(json.dumps(json.loads(str(p["record"])) | {k: v}))
        }
        for key, value in [
            ("run", None),
            ("run", {"alpha": 2, "delta": 1.5, "seed": 0}),
            ("run", {"alpha": 1, "delta": -1, "seed": 0}),
            ("config", []),
            ("config", {}),
            ("config", {"k": 20, "no_such": 1}),
        ]
    },
}


@pytest.mark.parametrize("kind", FORGED)
def test_a_forged_file_is_refused_in_one_line(stored: Path, kind: str) -> None:
    with np.load(stored) as archive:
        parts = dict(archive)
    changed(stored, **FORGED[kind](parts))
    with pytest.raises(ResultError, match=r"policy\.npz") as refused:
        load_policy(stored)
    assert "\n" not in str(refused.value) and len(str(refused.value)) < 500


def test_a_file_written_again_unchanged_is_read(stored: Path) -> None:
    """So that it is what was forged that the test above sees refused."""
    before = load_policy(stored)
    with np.load(stored) as archive:
        changed(stored, weight_0=archive["weight_0"])
    after = load_policy(stored)
    assert after.record == before.record and np.array_equal(after.log_std, before.log_std)
    for old, new in zip((*before.weights, *before.biases), (*after.weights, *after.biases), strict=True):
        assert np.array_equal(old, new)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_training_writes_it(case: Any, whole: dict[str, Path], rng: np.random.Generator) -> None:
    folder = whole[case.name]
    policy, result = load_policy(folder / "policy.npz"), json.loads((folder / "run.json").read_text())
    result.pop("provenance")
    assert policy.record == result
    task = ThreeLinkCircleEnv(case.run.delta, config=case.config)
    told = policy.record["final_policy"]["no supervisor"]["return"]
    assert evaluate(policy, task)["return"] == pytest.approx(told, rel=1e-3)
    seen = rng.normal(size=(50, 8)).astype(np.float32)
    expected = PPO.load(folder / "policy.zip", device="cpu").predict(seen, deterministic=True)[0]
    np.testing.assert_allclose(policy.predict(seen)[0], expected, rtol=0, atol=ROUNDING)
