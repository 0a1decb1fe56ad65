"""Training: the parameters of App. C, determinism, counts that add up, and runs that are refused."""

import io
import json
import shutil
import sys
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from learned import Learned
from runs import (
    CASES,
    CONDITIONS,
    CONFIG,
    FREE,
    NARROW,
    STOCK,
    SUPERVISED,
    UPDATE,
    UPDATES,
    Case,
    products,
    quiet,
)
from stable_baselines3 import PPO

from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.fast_ppo import ppo
from srlrepro.fast_ppo.ppo import CompiledPPO
from srlrepro.learner import VISITED_FORMAT
from srlrepro.learner.recording import TRIAL_COLUMNS, Recorder, count, learning_curve
from srlrepro.learner.training import Run, make_env, make_learner, train
from srlrepro.learner.trials import evaluate
from srlrepro.region.hypothesis import Hypothesis
from srlrepro.region.safe_region import learn_region
from srlrepro.samplers import generate
from srlrepro.settings.condition import Condition
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError
from srlrepro.storage import files
from srlrepro.storage.files import ResultError, read_arrays
from srlrepro.supervisor import Supervisor


@CONDITIONS
def test_trained_twice_gives_the_same_numbers(case: Case, whole: dict[str, Path], tmp_path: Path) -> None:
    case.train(tmp_path)
    assert products(tmp_path) == products(whole[case.name])
    replace(case, run=replace(case.run, seed=case.run.seed + 1)).train(tmp_path / "other")
    assert products(tmp_path / "other")["visited"] != products(whole[case.name])["visited"]


@pytest.mark.parametrize("values", [{}, {"visited_states": 50}, {"early_stop": "truncate"}], ids=str)
@pytest.mark.parametrize("case", CASES[:2], ids=lambda case: case.name)
def test_told_at_once_the_recorder_keeps_what_it_keeps_step_by_step(
    case: Case, values: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("_on_step", "_on_steps"):
        with monkeypatch.context() as patch:
            patch.setattr(ppo, "told_at_once", lambda _, name=name: name == "_on_steps")
            other = "_on_steps" if name == "_on_step" else "_on_step"
            patch.setattr(Recorder, other, lambda *_: pytest.fail("it is told otherwise"))
            case.train(tmp_path / name, **values)
    assert products(tmp_path / "_on_steps") == products(tmp_path / "_on_step")
    kept = [(tmp_path / name / "visited.npz").read_bytes() for name in ("_on_step", "_on_steps")]
    assert kept[0] == kept[1]


@pytest.mark.parametrize("where", ["folder", "checkpoint"])
def test_a_folder_that_cannot_be_written_is_found_out_before_training(
    where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    bad = tmp_path / "file" / "folder"

    def learn(*_: Any, **__: Any) -> None:
        raise AssertionError("it trains")

    monkeypatch.setattr(PPO, "learn", learn)
    with pytest.raises(ResultError, match=f"cannot write to {bad}"):
        train(FREE, CONFIG, None, *((bad, None) if where == "folder" else (tmp_path, bad / "c.zip")), quiet)


@CONDITIONS
def test_counts_and_curves_add_up(case: Case, whole: dict[str, Path]) -> None:
    folder, run, region = whole[case.name], case.run, case.region
    trials, curve = (pd.read_csv(folder / name) for name in ("trials.csv", "curve.csv"))
    result = json.loads((folder / "run.json").read_text())
    counts = result["counts"]
    assert tuple(trials.columns) == TRIAL_COLUMNS
    assert counts["trials"] == len(trials) == curve["trials"].sum() > 0
    assert counts["activations"] == trials["activated"].sum() == curve["activations"].sum()
    failures = counts["hit_the_ground"] + counts["not_recovered_in_time"]
    assert counts["activations"] == counts["recovered"] + failures
    assert counts["trials"] >= counts["activations"] + counts["falls"] + counts["diverged"]
    assert (curve["failures"].sum(), curve["falls"].sum()) == (failures, counts["falls"])
    assert (counts["activations"] > 0) == (region is not None)
    assert counts["falls"] > 0 or region is not None
    assert result["steps_done"] == run.steps == curve["step"].iloc[-1]
    assert list(curve["step"]) == [UPDATE * (i + 1) for i in range(UPDATES)]
    ends = np.cumsum(trials["length"])  # one trial after the other
    np.testing.assert_array_equal(trials["step"], ends)
    total = (curve["reward_per_step"] * curve["mean_length"] * curve["trials"]).sum()
    assert total == pytest.approx(trials["return"].sum())
    assert result["run"] == {"alpha": run.alpha, "delta": run.delta, "seed": run.seed, "steps": run.steps}
    assert result["config"] == case.config.as_dict()


@CONDITIONS
def test_visited_states_are_those_that_the_steps_reach(
    case: Case, whole: dict[str, Path], tmp_path: Path
) -> None:
    """A trial ends where the state is out of bounds, and nowhere else but at the time limit."""
    run, every = case.run, read_arrays(whole[case.name] / "visited.npz", VISITED_FORMAT, ("x",))["x"]
    trials = pd.read_csv(whole[case.name] / "trials.csv")
    assert every.shape == (run.steps, 6)
    ended = trials["step"][trials["outcome"] != "time limit"]
    out = np.abs(every[:, 0]) >= CONFIG.paper.theta1_max
    if case.region is not None:
        out |= case.region.predict(every) == 0
    np.testing.assert_array_equal(np.flatnonzero(out) + 1, ended)
    case.train(tmp_path, visited_states=run.steps // 5)
    fewer = read_arrays(tmp_path / "visited.npz", VISITED_FORMAT, ("x",))["x"]
    np.testing.assert_array_equal(fewer, every[4::5])


@CONDITIONS
def test_the_final_trials_are_those_of_the_saved_policy(case: Case, whole: dict[str, Path]) -> None:
    result = json.loads((whole[case.name] / "run.json").read_text())["final_policy"]
    policy = PPO.load(whole[case.name] / "policy.zip", device="cpu")
    assert result["own condition"] == evaluate(policy, make_env(case.run, CONFIG, case.region))
    assert result["no supervisor"] == evaluate(policy, ThreeLinkCircleEnv(1.5, config=CONFIG))


@CONDITIONS
def test_the_mean_policy_is_tried_while_it_is_learned(
    case: Case, whole: dict[str, Path], tmp_path: Path
) -> None:
    """After the first update that passes a multiple; the training is none the wiser."""
    case.train(tmp_path, evaluation_steps=100)
    tried = pd.read_csv(tmp_path / "evaluations.csv")
    assert UPDATE == 64 and tried["step"].tolist() == [128, 256, 320]
    found, others = products(tmp_path), products(whole[case.name])
    assert found["trials.csv"] == others["trials.csv"] and found["visited"] == others["visited"]
    final = json.loads((tmp_path / "run.json").read_text())["final_policy"]["no supervisor"]
    case.train(tmp_path / "last", evaluation_steps=UPDATE * UPDATES)
    last = pd.read_csv(tmp_path / "last" / "evaluations.csv").to_dict("records")
    assert last == [{"step": UPDATE * UPDATES} | final]


def test_evaluation_is_one_trial() -> None:
    """Of a policy that does nothing: the target is 2 r |sin(πt / 2)| away."""
    idle: Any = SimpleNamespace(predict=lambda observation, deterministic: (np.zeros(3), None))
    env = ThreeLinkCircleEnv(config=CONFIG)
    t = env.rule.control_period * np.arange(1, env.arrays.periods + 1)
    expected = {"length": env.arrays.periods, "outcome": "time limit"}
    found = evaluate(idle, env)
    assert found.pop("return") == pytest.approx((2 - 6 * np.sin(np.pi * t / 2)).sum())
    assert found == expected


def test_steps_are_rounded_up_to_whole_updates(tmp_path: Path) -> None:
    result = train(Run(None, 1.0, 0, UPDATE + 1), CONFIG, None, tmp_path, report=quiet)
    assert result["steps_done"] == 2 * UPDATE


def test_a_run_in_which_no_trial_ends_is_a_run(tmp_path: Path) -> None:
    config = CONFIG.with_values(trial_length=100.0, log_std_init=-5.0)
    result = train(Run(None, 1.0, 0, 2), config, None, tmp_path, report=quiet)
    assert set(result["counts"].values()) == {0}
    assert pd.read_csv(tmp_path / "curve.csv")["trials"].sum() == 0


def test_progress_is_reported_where_no_bar_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    lines: list[str] = []
    train(FREE, CONFIG, None, tmp_path, report=lines.append)
    assert len(lines) == UPDATES
    assert lines[-1].startswith(f"step {FREE.steps} of {FREE.steps}, about 0.0 min left")


def test_a_learned_region_supervises_a_training(small: Learned, tmp_path: Path) -> None:
    config = CONFIG.with_values(trial_length=4.0)
    counts = train(SUPERVISED, config, small[1], tmp_path, report=quiet)["counts"]
    assert counts["activations"] > 0
    env = make_env(SUPERVISED, config, small[1])
    assert isinstance(env, Supervisor)
    assert (env.region, env.task.pendulum.delta) == (small[1], 1.5)


def table(rows: list[tuple[Any, ...]]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=list(TRIAL_COLUMNS))


TRIALS = table(
    [
        (4, 4, 8.0, "supervised", True, "recovered", 0.5),
        (10, 6, 3.0, "hit the ground", False, "", 0.0),
        (11, 1, 1.0, "supervised", True, "hit the ground", 0.1),
        (31, 20, 9.0, "supervised", True, "not recovered in time", 5.0),
        (40, 9, 6.0, "time limit", False, "", 0.0),
        (41, 1, -9.0, "diverged", False, "", 0.0),
    ]
)


@pytest.mark.parametrize("links", [1, 2])
def test_a_pendulum_of_other_links_is_trained_under_its_region(links: int, tmp_path: Path) -> None:
    config = CONFIG.with_values(links=links, k=60, random_rollouts=30, p_t=0.3)
    data = generate(1.0, config, 0)
    region = learn_region(data, config)
    run = replace(SUPERVISED, alpha=1.0, steps=2 * UPDATE)
    for learner in ("compiled", "stock"):
        result = train(run, config.with_values(learner=learner), region, tmp_path / learner, report=quiet)
        assert result["steps_done"] == run.steps
        visited = read_arrays(tmp_path / learner / "visited.npz", VISITED_FORMAT, ("x",))["x"]
        assert visited.shape == (run.steps, 2 * links)
    with pytest.raises(ParameterError, match=rf"must be states of shape \[B, {2 * links}\]"):
        train(run, CONFIG, region, tmp_path / "other", report=quiet)


def test_the_learning_curve_of_a_small_table() -> None:
    curve = learning_curve(TRIALS, 10, 5)
    assert list(curve["step"]) == [10, 20, 30, 40, 50]
    assert list(curve["trials"]) == [2, 1, 0, 2, 1]
    np.testing.assert_array_equal(curve["mean_return"], [5.5, 1.0, np.nan, 7.5, -9.0])
    np.testing.assert_array_equal(curve["mean_length"], [5.0, 1.0, np.nan, 14.5, 1.0])
    np.testing.assert_allclose(curve["reward_per_step"], [1.1, 1.0, np.nan, 15 / 29, -9.0])
    assert list(curve["activations"]) == [1, 1, 0, 1, 0]
    assert list(curve["failures"]) == [0, 1, 0, 1, 0]
    assert list(curve["falls"]) == [1, 0, 0, 0, 0]


def test_the_counts_of_a_small_table() -> None:
    by_k = {"activations": 3, "recovered": 1, "hit_the_ground": 1, "not_recovered_in_time": 1}
    assert count(TRIALS) == {"trials": 6, **by_k, "falls": 1, "diverged": 1}
    assert set(count(TRIALS[:0]).values()) == {0}


def test_the_parameters_of_appendix_c_reach_the_learner() -> None:
    config = Config()
    model = make_learner(ThreeLinkCircleEnv(config=config), config, seed=5)
    assert (model.n_steps, model.batch_size, model.n_epochs) == (2048, 2048 // 128, 10)
    assert (model.learning_rate, model.gamma, model.gae_lambda) == (1e-4, 0.99, 0.95)
    assert (model.vf_coef, model.max_grad_norm, model.ent_coef) == (1.0, 10.0, 0.0)
    assert (model.seed, model.device.type) == (5, "cpu")
    assert model.clip_range(1.0) == model.clip_range(0.0) == config.choices.clip_range
    policy = model.policy
    for network in (policy.mlp_extractor.policy_net, policy.mlp_extractor.value_net):
        layers = [m for m in network if isinstance(m, torch.nn.Linear)]
        assert [(m.in_features, m.out_features) for m in layers] == [(8, 128), (128, 128)]
    assert (policy.action_net.out_features, policy.value_net.out_features) == (3, 1)
    assert (policy.log_std == config.choices.log_std_init).all()
    assert isinstance(policy.optimizer, torch.optim.Adam)
    assert (policy.optimizer.defaults["eps"], policy.optimizer.defaults["lr"]) == (1e-5, 1e-4)


def test_every_update_takes_its_epochs_of_minibatches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps, adam = [], torch.optim.Adam.step

    def counted(self: Any, *arguments: Any) -> Any:
        steps.append(self)
        return adam(self, *arguments)

    monkeypatch.setattr(torch.optim.Adam, "step", counted)
    train(Run(None, 1.0, 0, 2 * UPDATE), STOCK, None, tmp_path, report=quiet)
    assert len(steps) == 2 * CONFIG.paper.n_epochs * CONFIG.paper.n_minibatches


@pytest.mark.parametrize("other", [{"seed": 7}, {"steps": UPDATE}, {"alpha": 0.4}, {"delta": 1.1}])
def test_a_finished_run_is_not_replaced_by_another(
    other: dict[str, Any], whole: dict[str, Path], tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(whole["supervised"], folder)
    case = CASES[1]
    with pytest.raises(ResultError, match="holds a finished training of another run") as refused:
        replace(case, run=replace(case.run, **other)).train(folder, folder / "checkpoint.zip")
    assert "\n" not in str(refused.value)
    assert contents(folder) == contents(whole["supervised"])


def test_nor_by_another_configuration_or_region(whole: dict[str, Path], tmp_path: Path) -> None:
    folder, case = tmp_path / "run", CASES[1]
    shutil.copytree(whole["supervised"], folder)
    with pytest.raises(ResultError, match="finished training of another config:"):
        case.train(folder, learning_rate=2e-4)
    with pytest.raises(ResultError, match="finished training of another config and region:"):
        replace(case, region=NARROW).train(folder, learner="stock")
    (folder / "run.json").write_text("[]")
    with pytest.raises(ResultError, match="finished training of another run and config and region:"):
        case.train(folder)
    (folder / "run.json").write_text("{")
    with pytest.raises(ResultError, match=r"run\.json is truncated"):
        case.train(folder)


def test_the_same_run_is_trained_anew(whole: dict[str, Path], tmp_path: Path) -> None:
    """As the workflow does where its code has changed; a kill in between leaves no mixture."""
    folder, case = tmp_path / "run", CASES[0]
    shutil.copytree(whole[case.name], folder)
    (folder / "trials.csv").write_text("of older code")
    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(files, "write_table", interrupted)
        case.train(folder)
    assert not (folder / "run.json").exists()
    case.train(folder)
    assert products(folder) == products(whole[case.name])


def interrupted(*_: Any) -> None:
    raise KeyboardInterrupt


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def lose(model: PPO) -> None:
    """An update that ends in NaN."""
    with torch.no_grad():
        model.policy.log_std.fill_(np.nan)


@pytest.mark.parametrize("updates", [1, 3])
@pytest.mark.parametrize("learner", ["compiled", "stock", "compiled, really"])
def test_a_policy_that_diverges_is_no_result(
    learner: str, updates: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, config = Run(None, 1.0, 0, updates * UPDATE), CONFIG.with_values(learner=learner.split(",")[0])
    if learner == "compiled, really":
        config = config.with_values(learning_rate=1e38)
    else:
        monkeypatch.setattr(CompiledPPO if learner == "compiled" else PPO, "train", lose)
    with pytest.raises(ResultError, match=r"the policy has diverged within 64 steps: .* is not finite"):
        train(run, config, None, tmp_path / "run", tmp_path / "checkpoint.zip", report=quiet)
    assert list((tmp_path / "run").iterdir()) == []


def test_a_run_is_a_condition_with_steps() -> None:
    """run.json keeps its form, and its order."""
    assert isinstance(FREE, Condition) and FREE.name == "alpha_none__delta_1.5__seed_3"
    assert list(asdict(FREE)) == ["alpha", "delta", "seed", "steps"]


def test_a_region_comes_with_alpha_and_only_then(tmp_path: Path) -> None:
    for run, region in ((SUPERVISED, None), (FREE, NARROW)):
        with pytest.raises(ValueError, match="region = "):
            train(run, STOCK, region, tmp_path, report=quiet)


def test_a_region_that_denies_the_origin_stops_the_training(tmp_path: Path) -> None:
    nothing: Hypothesis = SimpleNamespace(predict=lambda x: np.zeros(1))
    with pytest.raises(ValueError, match="region: predicts the start of the trial as unsafe"):
        train(SUPERVISED, CONFIG, nothing, tmp_path, report=quiet)


BAD = [("alpha", v) for v in (-0.1, 1.1, np.nan)] + [("delta", v) for v in (0.0, -1.0, np.nan, np.inf)]
BAD += [("seed", -1), ("seed", 0.5), ("steps", 0), ("steps", 1e6)]


@pytest.mark.parametrize(("name", "value"), BAD)
def test_bad_runs_are_refused_by_name(name: str, value: Any) -> None:
    values: dict[str, Any] = {"alpha": None, "delta": 1.0, "seed": 0, "steps": 10, name: value}
    with pytest.raises(ValueError, match=f"{name} = {value}"):
        Run(**values)
