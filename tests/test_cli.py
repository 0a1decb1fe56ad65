"""The command lines: each stage by itself, and wrong use in one line that writes nothing."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from workflow.main_tmp import main

from srlrepro.region.safe_region import SafeRegion

ROOT = Path(__file__).parent.parent
SMALL = [
    "--set",
    "k=120",
    "random_rollouts=300",
    "n_steps=64",
    "n_minibatches=4",
    "n_epochs=1",
    "hidden_width=16",
]


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line that a wrong command line gives, on its way out with status 2."""
    with pytest.raises(SystemExit) as stop:
        main(list(arguments))
    error = capsys.readouterr().err
    assert stop.value.code == 2 and error.count("\n") == 1
    return error


@pytest.mark.slow
def test_stages_one_after_the_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data, region, run = tmp_path / "data.npz", tmp_path / "region.npz", tmp_path / "run"
    assert main(["data", "--alpha", "0", "--out", str(data), *SMALL]) == 0
    assert "120 states, 0 of them from UD" in capsys.readouterr().out
    assert main(["region", "--data", str(data), "--out", str(region), *SMALL]) == 0
    assert SafeRegion.load(region).labels_.shape == (121,)
    train = [
        "train",
        "--alpha",
        "0",
        "--delta",
        "1.1",
        "--steps",
        "128",
        "--region",
        str(region),
        "--out",
        str(run),
    ]
    assert main([*train, *SMALL]) == 0
    result = json.loads((run / "run.json").read_text())
    assert result["steps_done"] == 128 and result["config"]["hidden_width"] == 16
    assert sorted(p.name for p in run.iterdir()) == [
        "curve.csv",
        "policy.zip",
        "run.json",
        "trials.csv",
        "visited.npz",
    ]


@pytest.mark.parametrize("kind", ["nominal", "knn"])
def test_another_hypothesis_is_learned_when_it_is_needed(kind: str, tmp_path: Path) -> None:
    data, run = tmp_path / "data.npz", tmp_path / "run"
    assert main(["data", "--alpha", "0", "--out", str(data), *SMALL]) == 0
    learned = [] if kind == "nominal" else ["--data", str(data)]
    train = ["train", "--alpha", "0", "--delta", "1.1", "--steps", "128", *learned, "--out", str(run)]
    assert main([*train, *SMALL, f"hypothesis={kind}"]) == 0
    result = json.loads((run / "run.json").read_text())
    assert result["config"]["hypothesis"] == kind and len(result["region"]) == 64


def test_label_of_a_state(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["label", "--state", *["0"] * 6, "--delta", "4"]) == 0
    assert capsys.readouterr().out == "l(x) = 1: recovered, 0.00 s\n"


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["data", "--alpha", "1.5", "--out", "x"], ("alpha = 1.5", "[0, 1]")),
        (["data", "--alpha", "nan", "--out", "x"], ("alpha = nan", "[0, 1]")),
        (["data", "--alpha", "half", "--out", "x"], ("--alpha", "half")),
        (["data", "--alpha", "0", "--out", "x", "--set", "k=1"], ("k = 1", "whole number in [4, inf)")),
        (["data", "--alpha", "0", "--out", "x", "--set", "k=2.5"], ("k = 2.5", "whole number")),
        (["data", "--alpha", "0", "--out", "x", "--set", "p_t=1"], ("p_t = 1", "(0, 1)")),
        (["data", "--alpha", "0", "--out", "x", "--set", "q=1"], ("q = 1", "no such parameter")),
        (["data", "--alpha", "0", "--out", "x", "--set", "k"], ("k", "NAME=VALUE")),
        (["train", "--alpha", "none", "--delta", "0", "--out", "x"], ("delta = 0.0", "> 0")),
        (["train", "--alpha", "none", "--delta", "1", "--steps", "0", "--out", "x"], ("steps = 0",)),
        (["train", "--alpha", "0", "--delta", "1", "--out", "x"], ("region", "exactly if alpha")),
        (
            ["train", "--alpha", "0", "--delta", "1", "--out", "x", "--set", "hypothesis=mlp"],
            ("region", "exactly if alpha"),
        ),
        (
            [
                "train",
                "--alpha",
                "0",
                "--delta",
                "1",
                "--region",
                "r",
                "--out",
                "x",
                "--set",
                "hypothesis=mlp",
            ],
            ("--region = r", "hypothesis = mlp", "train --data"),
        ),
        (
            ["train", "--alpha", "0", "--delta", "1", "--region", "r", "--data", "d", "--out", "x"],
            ("--data = d", "left out"),
        ),
        (
            ["region", "--data", "d", "--out", "x", "--set", "hypothesis=nominal"],
            ("--out = x", "hypothesis = nominal"),
        ),
        (["label", "--state", "nan", *["0"] * 5], ("--state = nan", "finite")),
        (["execute", "a.ipynb", "b.ipynb", "--parameters", "{"], ("--parameters", "JSON")),
        (["import", "nowhere", "--name", "../x"], ("--name = ../x", "letters")),
        (["import", "nowhere", "--name", "full"], ("FOLDER = nowhere", "a folder")),
        (["dance"], ("dance",)),
        ([], ("COMMAND",)),
    ],
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


def test_help_and_choices_in_a_process() -> None:
    for arguments in (["--help"], ["train", "--help"], ["choices"]):
        done = subprocess.run(
            [sys.executable, "-m", "srlrepro", *arguments], capture_output=True, text=True, cwd=ROOT
        )
        assert done.returncode == 0 and len(done.stdout) > 300
