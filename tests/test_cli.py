"""``python -m srlrepro``: each stage by itself, and wrong use in one line that writes nothing."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from srlrepro.__main__ import main
from srlrepro.region.safe_region import SafeRegion
from srlrepro.settings.config import PARAMETERS

ROOT = Path(__file__).parent.parent
SMALL = ["k=120", "random_rollouts=300", "n_steps=64", "n_minibatches=4", "n_epochs=1", "hidden_width=16"]


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line that a wrong command line gives, on its way out with status 2."""
    with pytest.raises(SystemExit) as stop:
        main(list(arguments))
    error = capsys.readouterr().err
    assert stop.value.code == 2 and error.count("\n") == 1
    return error


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with data.npz and region.npz, made by the commands with α = 0.5 and `SMALL`."""
    folder = tmp_path_factory.mktemp("made")
    data, region = str(folder / "data.npz"), str(folder / "region.npz")
    assert main(["data", "--alpha", "0.5", "--out", data, "--set", *SMALL]) == 0
    assert main(["region", "--data", data, "--out", region, "--set", *SMALL]) == 0
    return folder


def train(made: Path, out: Path, *more: str, alpha: str = "0.5") -> list[str]:
    """A command line that trains under the region of `made`."""
    line = ["train", "--alpha", alpha, "--delta", "1.1", "--steps", "128", "--out", str(out)]
    return [*line, "--region", str(made / "region.npz"), "--set", *SMALL, *more]


@pytest.mark.slow
def test_stages_one_after_the_other(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = tmp_path / "data.npz"
    assert main(["data", "--alpha", "0", "--out", str(data), "--set", *SMALL]) == 0
    assert "120 states, 0 of them from UD" in capsys.readouterr().out
    assert SafeRegion.load(made / "region.npz").labels_.shape == (121,)
    run = tmp_path / "run"
    assert main(train(made, run)) == 0
    result = json.loads((run / "run.json").read_text())
    assert result["steps_done"] == 128 and result["config"]["hidden_width"] == 16
    products = {
        "curve.csv",
        "evaluations.csv",
        "policy.npz",
        "policy.zip",
        "run.json",
        "trials.csv",
        "visited.npz",
    }
    assert {path.name for path in run.iterdir()} == products


def test_a_region_is_learned_with_the_values_of_its_data_alone(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["region", "--data", str(made / "data.npz"), "--out", str(tmp_path / "region.npz"), "--set"]
    for setting, words in (("gravity=9", "gravity = 9.0: must be 9.81"), ("k=100", "k = 100: must be 120")):
        error = refused(
            capsys, *line, *[s for s in SMALL if not setting.startswith("k=") or s != "k=120"], setting
        )
        assert f"{words}, with which {made / 'data.npz'} was made" in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("p_t=0.5", "p_t = 0.5: must be 0.8"),
        ("gamma_evidence=held out", "gamma_evidence = held out: must be embedded"),
        ("psi_neighbours=4", "psi_neighbours = 4: must be 16"),
        ("known_origin=false", "known_origin = False: must be True"),
        ("gravity=9", "gravity = 9.0: must be 9.81"),
        ("random_hold=0.1", "random_hold = 0.1: must be 0.5"),
    ],
)
def test_a_run_is_trained_under_a_region_of_its_values_alone(
    setting: str, words: str, made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    error = refused(capsys, *train(made, tmp_path / "run", setting))
    assert f"{words}, with which {made / 'region.npz'} was made" in error
    assert list(tmp_path.iterdir()) == []


def test_a_run_is_trained_under_a_region_of_its_alpha_alone(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    error = refused(capsys, *train(made, tmp_path / "run", alpha="1"))
    assert f"alpha = 1.0: must be 0.5, with which {made / 'region.npz'} was made" in error
    assert list(tmp_path.iterdir()) == []


def test_label_of_a_state(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["label", "--state", *["0"] * 6, "--delta", "4"]) == 0
    assert capsys.readouterr().out == "l(x) = 1: recovered, 0.00 s\n"


@pytest.mark.parametrize("number", ["-1e-3", "-.1e-2", "-0.001", "-1E-3"])
def test_a_state_may_be_negative(number: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["label", "--state", number, *["0"] * 5]) == 0
    assert capsys.readouterr().out == "l(x) = 1: recovered, 0.00 s\n"


OUT = ["--out", "x"]
WRONG: list[tuple[list[str], tuple[str, ...]]] = [  # a command line, and what the refusal names
    (["data", "--alpha", "1.5", *OUT], ("--alpha = 1.5", "[0, 1]")),
    (["data", "--alpha", "nan", *OUT], ("--alpha = nan", "[0, 1]")),
    (["data", "--alpha", "half", *OUT], ("--alpha", "half")),
    (["data", "--alpha", "none", *OUT], ("--alpha = none", "[0, 1]")),
    (["data", "--alpha", "0", "--seed", "-1", *OUT], ("--seed = -1", "[0, 4294967295]")),
    (["data", "--alpha", "0", "--seed", str(2**32), *OUT], ("--seed = 4294967296", "[0, 4294967295]")),
    (["data", "--alpha", "0", *OUT, "--set", "k=1"], ("k = 1", "whole number in [4, inf)")),
    (["data", "--alpha", "0", *OUT, "--set", "k=2.5"], ("k = 2.5", "whole number")),
    (["data", "--alpha", "0", *OUT, "--set", "p_t=1"], ("p_t = 1", "(0, 1)")),
    (["data", "--alpha", "0", *OUT, "--set", "q=1"], ("q = 1", "no such parameter")),
    (["data", "--alpha", "0", *OUT, "--set", "k"], ("k", "NAME=VALUE")),
    (["train", "--alpha", "none", "--delta", "0", *OUT], ("delta = 0.0", "> 0")),
    (["train", "--alpha", "none", "--delta", "1", "--steps", "0", *OUT], ("steps = 0",)),
    (["train", "--alpha", "none", "--delta", "1", "--seed", str(2**32), *OUT], ("--seed = 4294967296",)),
    (["train", "--alpha", "none", "--delta", "1", "--region", "r", *OUT], ("--region = r", "left out")),
    (["train", "--alpha", "0", "--delta", "1", *OUT], ("--region = None", "given")),
    (
        ["train", "--alpha", "0", "--delta", "1", *OUT, "--set", "hypothesis=mlp"],
        ("hypothesis = mlp", "tsne"),
    ),
    (["label", "--state", "nan", *["0"] * 5], ("--state = nan", "finite")),
    (["label", "--state", *["0"] * 6, "--delta", "-1"], ("delta = -1.0", "> 0")),
    (["label", "--state", *["0"] * 6, "--set", "links=2"], ("--state = ", "must be 4 numbers, as links = 2")),
    (["dance"], ("dance",)),
    ([], ("COMMAND",)),
]


@pytest.mark.parametrize(
    ("arguments", "names"), WRONG, ids=lambda v: " ".join(v) if isinstance(v, list) else ""
)
def test_wrong_use_is_one_line_and_writes_nothing(
    arguments: list[str],
    names: tuple[str, ...],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    error = refused(capsys, *arguments)
    assert all(name in error for name in names)
    assert list(tmp_path.iterdir()) == []


def test_missing_and_broken_results_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = tmp_path / "broken.npz"
    broken.write_bytes(b"PK")
    for data, message in ((tmp_path / "none.npz", "missing result"), (broken, "truncated or not")):
        assert main(["region", "--data", str(data), "--out", str(tmp_path / "r.npz")]) == 1
        error = capsys.readouterr().err
        assert message in error and str(data) in error and error.count("\n") == 1
    assert not (tmp_path / "r.npz").exists()


def test_choices_are_listed_by_stage(capsys: pytest.CaptureFixture[str]) -> None:
    """Each once, in groups that say what they change."""
    assert main(["choices"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name, field in PARAMETERS.items():
        (at,) = (i for i, line in enumerate(lines) if line.startswith(f"  {name} = "))
        heading = next(line for line in reversed(lines[:at]) if line and not line.startswith(" "))
        assert heading.startswith(f"{field.metadata['stage']}: ")
        assert field.metadata["meaning"] in lines[at + 1]


def test_help_and_choices_in_a_process() -> None:
    for arguments in (["--help"], ["train", "--help"], ["choices"]):
        command = [sys.executable, "-m", "srlrepro", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
        assert done.returncode == 0 and len(done.stdout) > 300
