"""The jobs of the workflow: asked of the Snakefile, also without any results."""

import json
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from srlrepro import jobs
from srlrepro.files import ResultError
from srlrepro.jobs import Job
from srlrepro.plan import make_parser, plan

ROOT = Path(__file__).parent.parent
OF_THE_WORKFLOW = ["records.json", "run_time.json", "workflow.json"]  # written by reproduce.sh itself


@pytest.fixture(scope="module")
def planned() -> list[Job]:
    """Every job of the paper's grid."""
    return jobs.planned_jobs(plan(make_parser().parse_args([])))


@pytest.mark.slow
def test_every_kept_figure_has_its_notebook(planned: list[Job]) -> None:
    """Also those that no rule declares, by the name in the notebook's code."""
    kept = [p.relative_to(ROOT).as_posix() for p in sorted((ROOT / "figures" / "full").rglob("*.*"))]
    makers = {path: jobs.maker(path, planned) for path in kept if "/data_" not in path}
    without = [Path(path).name for path, job in makers.items() if job is None]
    assert set(without) <= set(OF_THE_WORKFLOW)
    for path, notebook in {
        "fig3_abc_learning.png": "06_learning_performance",
        "reward_per_step.csv": "06_learning_performance",
        "fig2_def_embedding.pdf": "03_embedding",
        "behaviour/alpha_none__delta_4.gif": "11_behaviour",
        "theorem_terms_free.png": "12_theorem",
    }.items():
        job = makers[f"figures/full/{path}"]
        assert job is not None and job.notebook == f"notebooks/{notebook}.ipynb"


@pytest.mark.slow
def test_stages_lead_back_to_the_training_data(planned: list[Job]) -> None:
    job = jobs.maker("figures/full/fig3_abc_learning.pdf", planned)
    assert job is not None
    rules = [stage.rule for stage in jobs.stages(job, planned)]
    assert rules[-1] == "learning_performance" and rules.count("training_run") == 36
    assert rules.index("training_data") < rules.index("embedding") < len(rules) - 1


def test_parameters_too_long_for_a_command_line_are_found_in_their_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the Snakefile does for grids of some thousand runs."""
    (tmp_path / "p.json").write_text('{"RUNS": ["a", "b"]}')
    listed = (
        "rule few:\n    input: i, j\n    output: o\n    jobid: 1\nShell command: python -m srlrepro execute "
    )
    listed += "n.ipynb e.ipynb --parameters @p.json --results o\n"
    monkeypatch.setattr(jobs, "ROOT", tmp_path)
    monkeypatch.setattr(jobs.subprocess, "run", lambda c, **_: CompletedProcess(c, 0, listed, ""))
    job = Job("few", ["i", "j"], ["o"], "n.ipynb", "e.ipynb", {"RUNS": ["a", "b"]})
    assert jobs.planned_jobs({"name": "full"}) == [job]
    monkeypatch.setattr(jobs.subprocess, "run", lambda c, **_: CompletedProcess(c, 0, "nothing", ""))
    with pytest.raises(ResultError, match="no jobs of full that can be read"):
        jobs.planned_jobs({"name": "full"})


@pytest.mark.slow
def test_a_configuration_that_the_snakefile_refuses() -> None:
    with pytest.raises(ResultError, match="refuses the configuration of full"):
        jobs.planned_jobs({"name": "full"})


def test_a_figure_is_found_by_its_name_in_the_code_that_drew_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the executed notebook, where there is one; not if two notebooks name it."""
    monkeypatch.setattr(jobs, "ROOT", tmp_path)

    def notebook(name: str, source: str) -> None:
        cell = {"cell_type": "code", "source": source, "metadata": {}}
        (tmp_path / name).write_text(json.dumps({"cells": [cell]}))

    def job(letter: str) -> Job:
        parameters = {"FIGURES": "../figures/all"}
        return Job(
            letter, [], [f"figures/all/{letter}.csv"], f"{letter}.ipynb", f"{letter}_run.ipynb", parameters
        )

    notebook("a.ipynb", 'save_figure(f, F, "both", t); save_figure(f, F, "renamed", t)')
    notebook("a_run.ipynb", 'save_figure(f, F, "both", t); save_figure(f, F, f"curve_{claim.id}", t)')
    notebook("b.ipynb", 'save_figure(f, F, "both", t); print(f"{a}_{b}")')
    every = [job("a"), job("b")]
    found = {
        n: jobs.maker(f"figures/all/{n}", every) for n in ("a.png", "curve_x.pdf", "both.png", "renamed.png")
    }
    assert {name: j and j.rule for name, j in found.items()} == {
        "a.png": "a",
        "curve_x.pdf": "a",
        "both.png": None,
        "renamed.png": None,
    }
    assert jobs.maker("figures/other/curve_x.pdf", every) is None
