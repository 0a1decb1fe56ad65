"""The command line of the driver, and the workflow's configuration that follows from it."""

import shlex
from pathlib import Path

import pytest
from plans import planned

from srlrepro.pins import ARITHMETIC
from srlrepro.settings.choices import Choices
from srlrepro.settings.fields import ParameterError
from srlrepro.storage.files import write_json
from workflow import ROOT, plan
from workflow.command_line import STUDIES
from workflow.plan import LONGEST_NAME


def test_the_default_is_the_papers_grid() -> None:
    grid = planned()
    assert grid["alphas"] == ["0", "0.5", "1", "none"] and grid["deltas"] == [1.1, 1.5, 4.0]
    assert grid["seeds"] == [0, 1, 2] and grid["steps"] == Choices.total_steps
    assert grid["name"] == "full" and grid["note"] == ""


def test_quick_differs_in_the_steps_alone_and_says_so() -> None:
    full, quick = planned(), planned("--quick")
    different = {"name", "look", "cells", "steps", "note", "command", "look_command"}
    assert {key for key in full if full[key] != quick[key]} == different
    assert quick["name"] == "quick" and str(Choices.quick_steps) in str(quick["note"])


VARIED = [
    ["--steps", "100000"],
    ["--steps", "200000"],
    ["--quick", "--steps", "100001"],
    ["--set", "p_t=0.5"],
    ["--set", "p_t=0.6"],
    ["--set", "gamma_evidence=embedded"],
    ["--quick", "--set", "p_t=0.5"],
    ["--steps", "100000", "--set", "p_t=0.5"],
    [
        "--set",
        *(f"{name}=0.7" for name in ("p_t", "gamma_bandwidth", "gamma_prior", "gamma_empty", "clip_range")),
    ],
    [
        "--set",
        *(f"{name}=0.7" for name in ("p_t", "gamma_bandwidth", "gamma_prior", "gamma_empty", "discount")),
    ],
]


def test_results_of_other_values_or_steps_never_share_a_folder() -> None:
    """Else a run with other steps would be taken for finished, and its figures labelled as this one's."""
    plans = [planned(), planned("--quick"), *(planned(*arguments) for arguments in VARIED)]
    assert len({plan["cells"] for plan in plans}) == len({plan["name"] for plan in plans}) == len(plans)
    assert all(len(str(plan["name"])) <= LONGEST_NAME for plan in plans)


def test_a_note_says_what_is_varied() -> None:
    grid = planned("--set", "gamma_evidence=embedded")
    assert grid["note"] == grid["varied"] == "varied: gamma_evidence=embedded"
    assert planned("--quick")["varied"] == "" != planned("--quick")["note"]
    note = str(planned("--steps", "5", "--set", "k=500")["note"])
    assert "reduced: 5 of" in note and "varied: k=500" in note
    assert "longer" in str(planned("--steps", "2000000")["note"])


def test_a_further_alpha_or_another_order_shares_the_runs_and_not_the_figures() -> None:
    full = planned()
    for alphas in (["0", "0.5", "1", "0.25", "none"], ["none", "1", "0.5", "0"]):
        grid = planned("--alphas", *alphas)
        assert grid["cells"] == full["cells"] and grid["look"] != full["look"] != grid["name"]
    assert planned("--deltas", "2")["cells"] == "full" and planned("--deltas", "2")["name"] == "deltas_2"


def test_grids_with_other_seeds_alone_share_their_runs_and_regions() -> None:
    more = planned("--seeds", "10")
    assert (more["name"], more["look"], more["cells"]) == ("seeds_10", "full", "full")
    named = planned("--seeds", "10", "--name", "seeds_10")
    assert named == more
    fewer = planned("--quick", "--seeds", "2")
    assert (fewer["name"], fewer["look"], fewer["cells"]) == ("quick__seeds_2", "quick", "quick")


@pytest.mark.parametrize("name", ["full", "quick", "multiverse", "seeds_10", "seeds_4"])
def test_a_varied_grid_takes_no_name_that_is_not_varied(name: str) -> None:
    with pytest.raises(ParameterError, match="another name"):
        planned("--deltas", "2", "--name", name)


@pytest.mark.parametrize("place", ["results", "figures"])
def test_a_name_is_of_one_grid(place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "ROOT", tmp_path)
    grid = planned("--steps", "5", "--name", "mine")
    write_json(tmp_path / place / "mine" / "workflow.json", grid)
    assert planned("--steps", "5", "--name", "mine") == grid
    for other in (["--steps", "6"], ["--steps", "5", "--set", "p_t=0.5"], ["--steps", "5", "--deltas", "2"]):
        with pytest.raises(ParameterError, match="is of another grid") as refusal:
            planned(*other, "--name", "mine")
        assert "\n" not in str(refusal.value)


def test_the_command_of_a_plan_gives_it_again() -> None:
    for arguments in ([], ["--quick"], ["--multiverse"], ["--seeds", "10"], ["--deltas", "2", "3"], *VARIED):
        found = planned(*arguments)
        assert planned(*shlex.split(str(found["command"]))[1:]) == found


@pytest.mark.parametrize("figure", ["fig1_pendulum", "fig2_ghi_safe_region", "fig3_abc_learning"])
def test_one_figure_is_asked_for_by_its_name(figure: str) -> None:
    only = planned("--only", figure)
    assert (ROOT / "notebooks" / f"{only['only']}.ipynb").exists()
    assert only | {"only": ""} == planned()


def test_where_jobs_run_is_no_part_of_what_is_run() -> None:
    assert planned("--slurm") == planned()


def test_a_study_has_its_own_grid_and_name() -> None:
    study = planned("--multiverse")
    assert (study["name"], study["study"], study["deltas"]) == ("multiverse", "multiverse", [1.1, 4.0])
    assert study["steps"] == STUDIES["multiverse"].steps and "reduced" in str(study["note"])
    quick = planned("--caution", "--quick")
    assert (quick["name"], quick["few"], quick["steps"]) == ("caution_quick", True, Choices.quick_steps)
    full = planned("--crossed")
    assert (full["seeds"], full["steps"], full["note"]) == ([0, 1, 2, 3], Choices.total_steps, "")
    assert planned("--multiverse", "--steps", "64")["name"] == "multiverse__steps_64"
    assert planned()["study"] == "" and planned("--quick")["few"] is False


@pytest.mark.parametrize(
    "arguments",
    [["--multiverse", "--seeds", "5"], ["--shift", "--set", "k=500"], ["--name", "multiverse"]],
)
def test_a_study_is_not_mixed_with_other_results(arguments: list[str]) -> None:
    with pytest.raises(ParameterError, match=r"must be|without one"):
        planned(*arguments, "--alphas", "0", "1")


def test_a_figure_records_a_command_that_says_nothing_of_the_machine() -> None:
    """Figures that sets of more seeds share must have the same bytes whichever of them drew them."""
    full = planned()
    for arguments in (["--cores", "1"], ["--slurm"], ["--limit", "3"], ["--name", "full"]):
        assert planned(*arguments) == full, arguments
    more = planned("--seeds", "10")
    assert more["command"] == "./reproduce.sh --seeds 10"
    assert more["look_command"] == full["look_command"] == full["command"] == "./reproduce.sh"
    own = planned("--seeds", "10", "--name", "mine")
    assert own["look_command"] == own["command"] == "./reproduce.sh --seeds 10 --name mine"


def test_results_rest_on_the_arithmetic(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert planned()["arithmetic"] == ARITHMETIC
    monkeypatch.setattr(plan, "ROOT", tmp_path)
    grid = planned("--steps", "5", "--name", "mine")
    earlier = {key: value for key, value in grid.items() if key != "arithmetic"}
    write_json(tmp_path / "figures" / "mine" / "workflow.json", earlier)
    with pytest.raises(ParameterError, match=r"of another grid \(arithmetic differ"):
        planned("--steps", "5", "--name", "mine")
