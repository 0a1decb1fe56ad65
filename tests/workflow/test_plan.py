"""The command line of the driver, and the workflow's configuration that follows from it."""

import pytest
from plans import planned

from srlrepro.settings.choices import Choices
from srlrepro.settings.fields import ParameterError
from workflow.command_line import STUDIES


def test_the_default_is_the_papers_grid() -> None:
    grid = planned()
    assert grid["alphas"] == ["0", "0.5", "1", "none"] and grid["deltas"] == [1.1, 1.5, 4.0]
    assert grid["seeds"] == [0, 1, 2] and grid["steps"] == Choices.total_steps
    assert grid["name"] == "full" and grid["note"] == ""


def test_quick_differs_in_the_steps_alone_and_says_so() -> None:
    full, quick = planned(), planned("--quick")
    assert {key for key in full if full[key] != quick[key]} == {"name", "cells", "steps", "note"}
    assert quick["name"] == "quick" and str(Choices.quick_steps) in str(quick["note"])


def test_a_varied_grid_never_replaces_the_papers() -> None:
    assert planned("--deltas", "2")["name"] == planned("--deltas", "2")["cells"] == "custom"
    assert planned("--quick", "--set", "k=500", "--name", "k500")["name"] == "k500"
    with pytest.raises(ParameterError, match="another name"):
        planned("--seeds", "10", "--name", "full")


def test_the_verdicts_larger_set_is_the_papers_grid() -> None:
    assert planned("--seeds", "10", "--name", "seeds_10")["cells"] == "full"
    for other in (["--alphas", "0"], ["--steps", "4096"], ["--seeds", "5"], ["--quick", "--seeds", "10"]):
        with pytest.raises(ParameterError, match="another name"):
            planned(*other, "--name", "seeds_10")


def test_grids_with_other_seeds_alone_share_their_runs() -> None:
    more = planned("--seeds", "10")
    assert (more["name"], more["cells"]) == ("seeds_10", "full")
    assert planned("--quick", "--seeds", "2")["cells"] == "quick"
    for other in (["--steps", "4096"], ["--set", "k=500"], ["--alphas", "0"]):
        assert planned("--seeds", "10", *other)["cells"] == "custom"


def test_where_jobs_run_is_no_part_of_what_is_run() -> None:
    assert planned("--slurm") == planned()


def test_a_study_has_its_own_grid_and_name() -> None:
    study = planned("--multiverse")
    assert (study["name"], study["study"], study["deltas"]) == ("multiverse", "multiverse", [1.1, 4.0])
    assert study["steps"] == STUDIES["multiverse"].steps and "reduced" in str(study["note"])
    quick = planned("--hypotheses", "--quick")
    assert (quick["name"], quick["few"], quick["steps"]) == ("hypotheses_quick", True, Choices.quick_steps)
    assert planned("--multiverse", "--steps", "64")["name"] == "custom"
    assert planned()["study"] == "" and planned("--quick")["few"] is False


@pytest.mark.parametrize(
    "arguments",
    [["--multiverse", "--seeds", "5"], ["--hypotheses", "--set", "k=500"], ["--name", "multiverse"]],
)
def test_a_study_is_not_mixed_with_other_results(arguments: list[str]) -> None:
    with pytest.raises(ParameterError, match=r"must be|without one"):
        planned(*arguments, "--alphas", "0", "1")
