"""What made a figure: asked of the Snakefile and of what the stages wrote, also without any results."""

import json
import shlex
from pathlib import Path

import pandas as pd
import pytest

from srlrepro import tracing
from srlrepro.__main__ import main
from srlrepro.config import ParameterError
from srlrepro.files import ResultError
from srlrepro.jobs import Job
from srlrepro.plan import make_parser, plan
from srlrepro.provenance import code_hash

ROOT = Path(__file__).parent.parent
LINES = [
    "",
    "--quick",
    "--multiverse",
    "--hypotheses --quick",
    "--seeds 10",
    "--quick --seeds 2",
    "--alphas 0 none --deltas 2 --steps 64 --set k=500 known_origin=false --name other",
]


@pytest.mark.parametrize("line", LINES)
def test_the_command_of_a_configuration_plans_it(line: str) -> None:
    config = plan(make_parser().parse_args(line.split()))
    command = tracing.command_line(config)
    assert command is not None and plan(make_parser().parse_args(command)) == config
    assert len(command) <= len(line.split()) or "--alphas" in command


def test_a_configuration_of_another_version_has_no_command() -> None:
    config = plan(make_parser().parse_args([]))
    assert tracing.command_line(config | {"steps": 1}) is None  # full is never short
    assert tracing.command_line(config | {"cells": "else"}) is None


def test_parameters_are_read_without_running_anything(tmp_path: Path) -> None:
    def notebook(source: str, tag: str) -> Path:
        cell = {"cell_type": "code", "source": source, "metadata": {"tags": [tag]}}
        (tmp_path / "a.ipynb").write_text(json.dumps({"cells": [cell]}))
        return tmp_path / "a.ipynb"

    source = '# Parameters\nA = [1, "b"]\nB = {}\nC = -0.5\n'
    assert tracing.recorded_parameters(notebook(source, tracing.INJECTED)) == {
        "A": [1, "b"],
        "B": {},
        "C": -0.5,
    }
    with pytest.raises(ResultError, match="or its cell tagged 'injected-parameters' computes"):
        tracing.recorded_parameters(notebook("A = open('x', 'w')", tracing.INJECTED))
    with pytest.raises(ResultError, match="0 cells tagged"):
        tracing.recorded_parameters(notebook(source, "parameters"))


@pytest.mark.slow
def test_a_figure_is_traced_with_what_its_stages_noted(monkeypatch: pytest.MonkeyPatch) -> None:
    def noted(name: str, chain: list[Job]) -> pd.DataFrame:
        runs = [job.executed for job in chain if job.rule == "training_run"]
        made = {"run": "r", "code": code_hash(), "python": "3", "versions": "v", "machine": "cores 7"}
        return pd.DataFrame({"notebook": runs}).assign(**made, seconds=61.5, peak_memory_mb=8)

    monkeypatch.setattr(tracing, "records", noted)
    text = tracing.trace(ROOT / "figures" / "full" / "fig3_abc_learning.png")
    assert text.count("61.5") == 36 and f"{code_hash()[:8]} (this)" in text and "machine: cores 7\n" in text
    assert "no record here of code, machine, time and memory: 1 × training_data, 1 × embedding" in text
    command = next(line for line in text.splitlines() if line.startswith("remade")).partition("by: ")[2]
    assert plan(make_parser().parse_args(shlex.split(command)[1:]))["name"] == "full"


def test_defaults_that_have_changed_since_are_told() -> None:
    config = plan(make_parser().parse_args(["--set", "p_t=0.9"]))
    assert tracing.changed_values(config) == {}
    older = config | {"values": config["values"] | {"k": 7}}
    assert tracing.changed_values(older) == {"k": f"7, here {config['values']['k']}"}


@pytest.mark.parametrize(
    "path", ["README.md", "figures/full/none.png", "/etc/passwd", "figures/full", "a\nb"]
)
def test_what_is_no_result_is_refused_in_one_line(path: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ParameterError, match="FIGURE"):
        tracing.trace(ROOT / path)
    if "\n" not in path:
        with pytest.raises(SystemExit) as stop:
            main(["provenance", str(ROOT / path)])
        assert stop.value.code == 2 and capsys.readouterr().err.count("\n") == 1


def test_results_of_an_unknown_name_say_what_is_missing() -> None:
    with pytest.raises(ResultError, match=r"missing result results/nowhere/workflow.json"):
        tracing.configurations("nowhere")
