"""The results as a RO-Crate: which notebook made which file, from what, with which parameters."""

import json
import mimetypes
from pathlib import Path

import yaml

from srlrepro.files import ResultError, write_json
from srlrepro.jobs import ROOT, maker, makers, planned_jobs
from srlrepro.records import records
from srlrepro.site import KEPT
from srlrepro.tracing import configurations, recorded_parameters

try:
    from rocrate.model.contextentity import ContextEntity
    from rocrate.rocrate import ROCrate
except ModuleNotFoundError as error:
    raise ResultError("rocrate is not installed: .venv/bin/pip install -r requirements-test.txt") from error

METADATA = ROOT / "ro-crate-metadata.json"
PROCESS_RUN = "https://w3id.org/ro/wfrun/process/0.5"  # the profile of the actions
LICENCES = "https://spdx.org/licenses/"
VERSION = "1.1"  # of RO-Crate, on which the profile rests


def describe(names: tuple[str, ...] = KEPT) -> ROCrate:
    """Figures, tables and executed notebooks of some results, each with the action that made it.

    Raises:
        ResultError: the workflow that made them is not known.
    """
    about = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    crate = ROCrate(version=VERSION)
    crate.name, crate.description = about["title"], about["abstract"]
    crate.datePublished = about["date-released"].isoformat()
    crate.keywords = ", ".join(about["keywords"])
    profile = {"@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"}
    crate.root_dataset["conformsTo"] = crate.add(ContextEntity(crate, PROCESS_RUN, properties=profile))
    licence = {"@type": "CreativeWork", "name": about["license"], "url": LICENCES + about["license"]}
    crate.license = crate.add(ContextEntity(crate, LICENCES + about["license"], properties=licence))
    author = {"@type": "Organization", "name": about["authors"][0]["name"]}
    agent = crate.add(ContextEntity(crate, "#authors", properties=author))
    crate.root_dataset["author"] = agent
    for number, paper in enumerate(about["references"]):
        writers = "; ".join(f"{a['family-names']}, {a['given-names']}" for a in paper["authors"])
        article = {"@type": "ScholarlyArticle", "name": paper["title"], "author": writers}
        crate.root_dataset.append_to(
            "citation", crate.add(ContextEntity(crate, f"#paper-{number}", properties=article))
        )

    def add(path: str, **properties: object) -> object:
        kind = mimetypes.guess_type(path)[0] or "application/octet-stream"
        named = {"name": Path(path).name, "encodingFormat": kind} | properties
        return crate.get(path) or crate.add_file(ROOT / path, path, properties=named, record_size=True)

    code = {"@type": ["File", "SoftwareSourceCode"]}
    for source in ("Snakefile", *sorted(f"rules/{file.name}" for file in (ROOT / "rules").glob("*.smk"))):
        add(source, **code)
    for name in names:
        folders = [ROOT / "figures" / name, ROOT / "notebooks" / "executed" / name]
        found = [path for folder in folders for path in sorted(folder.rglob("[!.]*.*")) if path.is_file()]
        jobs = planned_jobs(configurations(name)[0]) if found else []
        sources, made_by = makers(jobs), records(name, jobs).groupby("notebook")
        notes = {notebook: rows.drop(columns="notebook").to_dict("records") for notebook, rows in made_by}
        made = {job.executed: list[str]() for job in jobs}
        for path in (file.relative_to(ROOT).as_posix() for file in found):
            add(path)
            job = maker(path, jobs)
            if job is not None:
                made[job.executed].append(path)
        for job in (job for job in jobs if job.executed in made[job.executed]):
            # Intermediate results are not part of the crate: the notebooks that made them stand for them.
            used = dict.fromkeys(sources[path].executed if path in sources else path for path in job.inputs)
            parameters = recorded_parameters(ROOT / job.executed)
            note = {"parameters": parameters, "records": notes.get(job.executed, [])}
            crate.add_action(
                add(job.notebook, **code),
                f"#{job.executed}",
                object=[add(path) for path in used if path != job.notebook and (ROOT / path).is_file()],
                result=[add(path) for path in made[job.executed]],
                properties={
                    "name": f"{job.rule}: {job.executed}",
                    "description": json.dumps(note, ensure_ascii=False),
                    "agent": agent,
                },
            )
    return crate


def write() -> Path:
    """Write the description of the kept results; returns its place."""
    write_json(METADATA, describe().metadata.generate())
    return METADATA
