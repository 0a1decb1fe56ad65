"""Records of results: read where the jobs wrote them, kept beside the figures for who has nothing else."""

from pathlib import Path

import pytest

from srlrepro import jobs, records
from srlrepro.files import write_json
from srlrepro.jobs import Job
from srlrepro.provenance import provenance
from srlrepro.site import KEPT

RUNS = {
    "grid": Job("training_run", [], ["results/a/runs/r/run.json"], "n", "executed/a/r.ipynb", {}),
    "study": Job("universe", [], ["results/a/universes/u/measures.csv"], "n", "executed/a/u.ipynb", {}),
    "figure": Job("claims", [], ["figures/a/c.csv"], "n", "executed/a/c.ipynb", {}),
}


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(records, "ROOT", tmp_path)
    for run, seconds in (("runs/r", 61.5), ("universes/u/runs/s", 5.0), ("universes/u/runs/t", 7.0)):
        write_json(tmp_path / "results" / "a" / run / "run.json", {"provenance": provenance(seconds)})
    return tmp_path


def test_trainings_have_records_without_one_of_their_notebook(checkout: Path) -> None:
    """Those of a grid, and those of a universe; a notebook that noted nothing has none."""
    table = records.records("a", list(RUNS.values()))
    assert table[["run", "seconds"]].to_numpy().tolist() == [["r", 61.5], ["s", 5.0], ["t", 7.0]]
    assert set(table["notebook"]) == {"executed/a/r.ipynb", "executed/a/u.ipynb"}
    write_json(checkout / "executed" / "a" / "c.json", {"parameters": {}} | provenance(3.0))
    assert records.noted(RUNS["figure"])[0]["seconds"] == 3.0


def test_what_is_kept_stands_for_what_is_gone(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a fresh clone, where no results are; what is there comes before what is kept."""
    every = list(RUNS.values())
    monkeypatch.setattr(records, "planned_jobs", lambda config: every)
    before = records.records("a", every)
    records.keep({"name": "a", "values": {"k": 1000}})
    written = records.file_of("a").read_bytes()
    (checkout / "results").rename(checkout / "gone")
    assert records.records("a", every).equals(before)
    records.keep({"name": "a", "values": {"k": 1000}})
    assert records.file_of("a").read_bytes() == written
    write_json(checkout / "results" / "a" / "runs" / "r" / "run.json", {"provenance": provenance(1.0)})
    assert records.records("a", every)["seconds"].tolist() == [1.0, 5.0, 7.0]


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in KEPT if (jobs.ROOT / "figures" / name).is_dir()])
def test_every_training_behind_kept_figures_has_its_record(name: str) -> None:
    from srlrepro.tracing import configurations

    planned = jobs.planned_jobs(configurations(name)[0])
    training = {job.executed for job in planned if job.rule in ("training_run", "universe")}
    assert training and training <= set(records.records(name, planned)["notebook"])
