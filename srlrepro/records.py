"""What made each result: code, versions, machine, time and memory, as each job noted them.

A job notes them beside its executed notebook, and each training in run.json. Git ignores both, so a
file beside the figures keeps them: whoever reads a figure has the record of every stage before it.
"""

from pathlib import Path
from typing import Any

import pandas as pd

from srlrepro.files import read_json, write_json
from srlrepro.jobs import ROOT, Job, planned_jobs

COLUMNS = ("notebook", "run", "code", "python", "versions", "machine", "seconds", "peak_memory_mb")


def file_of(name: str) -> Path:
    """The file in which the records of the results ``name`` are kept."""
    return ROOT / "figures" / name / "records.json"


def _row(job: Job, run: str, made: dict[str, Any]) -> dict[str, Any]:
    texts = {key: ", ".join(f"{k} {v}" for k, v in made[key].items()) for key in ("versions", "machine")}
    return {"notebook": job.executed, "run": run} | {name: made[name] for name in COLUMNS[2:]} | texts


def noted(job: Job) -> list[dict[str, Any]]:
    """What a job has noted here, a row for its notebook and one for each training; results made before
    notebooks were timed have the latter alone."""
    beside_it = ROOT / Path(job.executed).with_suffix(".json")
    rows = [_row(job, "", read_json(beside_it))] if beside_it.is_file() else []
    for folder in sorted({(ROOT / output).parent for output in job.outputs}):
        for file in (folder / "run.json", *sorted(folder.glob("runs/*/run.json"))):
            if file.is_file():
                rows.append(_row(job, file.parent.name, read_json(file)["provenance"]))
    return rows


def records(name: str, jobs: list[Job]) -> pd.DataFrame:
    """Rows of `COLUMNS` for jobs of the results ``name``: what each noted here, else what is kept of it."""
    kept = read_json(file_of(name)) if file_of(name).is_file() else []
    rows: list[dict[str, Any]] = []
    for job in jobs:
        rows += noted(job) or [row for row in kept if row["notebook"] == job.executed]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def keep(config: dict[str, Any]) -> None:
    """Write, beside the figures of a workflow's configuration, what made them: the configuration, which has
    the value of every parameter (workflow.json), and the records of all jobs.

    Raises:
        ResultError: its jobs cannot be listed, or a file cannot be written.
    """
    write_json(file_of(config["name"]).with_name("workflow.json"), config)
    rows = records(config["name"], planned_jobs(config)).to_dict("records")
    write_json(file_of(config["name"]), rows)
