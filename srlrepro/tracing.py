"""What made a figure: its notebook, the stages before it, and the command that remakes it.

How files hang together is read off the Snakefile (a forced dry run lists every job); what happened, off
what the jobs wrote: parameters in executed notebooks, beside them code, versions, machine, time and memory.
"""

import json
import re
import shlex
import subprocess
import sys
import tempfile
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from srlrepro.config import check
from srlrepro.files import ResultError, read_json, write_json
from srlrepro.notebooks import parameters_of
from srlrepro.plan import STUDIES, check_workflow, make_parser, plan
from srlrepro.provenance import EVERYTHING, LEARNING, code_hash

ROOT = Path(__file__).resolve().parent.parent
PLACES = ("figures", "notebooks/executed", "results")
INJECTED = "injected-parameters"  # papermill's tag
HASH_SHOWN = 8  # digits of a hash that a table shows
JOB = re.compile(
    r"rule (?P<rule>\w+):\n    input: (?P<inputs>.*)\n    output: (?P<outputs>.*)\n"
    r"(?:    .*\n)*Shell command: (?P<command>.*)"
)


class Job(NamedTuple):
    """One executed notebook of the workflow; paths are relative to the checkout."""

    rule: str
    inputs: list[str]
    outputs: list[str]
    notebook: str
    executed: str
    parameters: dict[str, Any]


def planned_jobs(config: dict[str, Any]) -> list[Job]:
    """Every job of the workflow's configuration, whether its results are there or not.

    Raises:
        ResultError: the Snakefile refuses the configuration.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "workflow.json")
        write_json(file, config)
        command = [sys.executable, "-m", "snakemake", config.get("study") or "all", "--configfile", str(file)]
        command += ["--dry-run", "--forceall", "--printshellcmds", "--nolock", "--nocolor", "--cores", "1"]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        reason = (done.stderr + done.stdout).strip().splitlines()[-1]
        raise ResultError(f"this Snakefile refuses the configuration of {config['name']}: {reason}")
    jobs = []
    for found in JOB.finditer(done.stdout + done.stderr):
        words = shlex.split(found["command"])
        notebook, executed, _, parameters = words[words.index("execute") + 1 :][:4]
        files = (found["inputs"].split(", "), found["outputs"].split(", "))
        jobs.append(Job(found["rule"], *files, notebook, executed, json.loads(parameters)))
    return jobs


def command_line(config: dict[str, Any]) -> list[str] | None:
    """Arguments of ``reproduce.sh`` that plan the configuration; None if there are none in this version.

    Values of parameters that are not set are not compared: their defaults may have changed since.
    """
    usual = [[], *([f"--{study}"] for study in STUDIES)]
    seeds = ["--seeds", str(len(config["seeds"]))]
    settings = [f"{n}={str(v).lower() if isinstance(v, bool) else v}" for n, v in config["settings"].items()]
    grid = ["--alphas", *config["alphas"], "--deltas", *(f"{d:g}" for d in config["deltas"]), *seeds]
    grid += ["--steps", str(config["steps"]), *(["--set", *settings] if settings else [])]
    ways = [[*way, *size, *more] for more in ([], seeds) for way in usual for size in ([], ["--quick"])]
    for arguments in (*ways, [*grid, "--name", config["name"]]):
        try:
            planned = plan(make_parser().parse_args(arguments))
        except ValueError:  # a study with seeds, a reserved name
            continue
        if all(planned.get(name) == value for name, value in config.items() if name != "values"):
            return arguments
    return None


def configurations(name: str) -> list[dict[str, Any]]:
    """Configurations whose files lie in the folder ``name``: its own first; without results, the planned one.

    Raises:
        ResultError: none is known.
    """
    kept = [check_workflow(read_json(path)) for path in sorted(ROOT.glob("results/*/workflow.json"))]
    found = [config for config in kept if name in (config["name"], config.get("cells"))]
    if not any(config["name"] == name for config in found):
        seeds = re.fullmatch(r"seeds_(\d+)", name)
        ways = [
            [],
            ["--quick"],
            *([f"--{study}"] for study in STUDIES),
            *([["--seeds", seeds[1]]] if seeds else []),
        ]
        found += [config for way in ways if (config := plan(make_parser().parse_args(way)))["name"] == name]
    if not found:
        raise ResultError(f"missing result results/{name}/workflow.json: it says what {name} is")
    return sorted(found, key=lambda config: config["name"] != name)


@cache
def _names(notebook: str) -> list[str]:
    """Patterns of the file names in a notebook's code; parts in braces are filled in as it runs."""
    cells = read_json(ROOT / notebook)["cells"]
    code = "".join("".join(cell["source"]) + "\n" for cell in cells if cell["cell_type"] == "code")
    texts = [text.rpartition("/")[2] for text in re.findall(r'"([^"\n]*)"', code)]
    return [re.sub(r"\\\{.*?\\\}", ".+", re.escape(t)) for t in texts if re.match(r"\w", t)]


def maker(path: str, jobs: list[Job]) -> Job | None:
    """The job that makes a file: as one of its outputs, beside one of them, or by a name in its notebook."""
    target = Path(path)
    sources = makers(jobs)
    if path in sources:
        return sources[path]
    for job in jobs:
        if any(Path(output).with_suffix("") == target.with_suffix("") for output in job.outputs):
            return job
    for job in jobs:
        folder = job.parameters.get("FIGURES", "").removeprefix("../")
        if folder == target.parent.as_posix() and any(
            re.fullmatch(name, text) for name in _names(job.notebook) for text in (target.stem, target.name)
        ):
            return job
    return None


def makers(jobs: list[Job]) -> dict[str, Job]:
    """{output: the job that makes it}."""
    return {output: job for job in jobs for output in job.outputs}


def stages(job: Job, jobs: list[Job]) -> list[Job]:
    """The job, and before it every job that its inputs come from."""
    sources = makers(jobs)
    found: dict[str, Job] = {}

    def visit(current: Job) -> None:
        for name in current.inputs:
            if name in sources and sources[name].executed not in found:
                visit(sources[name])
        found[current.executed] = current

    visit(job)
    return list(found.values())


def recorded_parameters(executed: Path) -> dict[str, Any]:
    """{name: value} that a notebook was executed with.

    Raises:
        ResultError: the notebook is missing, or was not executed by the workflow.
    """
    return parameters_of(executed, INJECTED)


def record(job: Job) -> dict[str, Any]:
    """What a job noted about itself: beside its notebook, or in run.json; empty if neither is there."""
    beside_it = ROOT / Path(job.executed).with_suffix(".json")
    if beside_it.is_file():
        found: dict[str, Any] = read_json(beside_it)
        return found
    runs = [ROOT / output for output in job.outputs if output.endswith("/run.json")]
    return read_json(runs[0])["provenance"] if runs and runs[0].is_file() else {}


def _code(made: dict[str, Any]) -> str:
    digest = made["code"]
    same = digest in (code_hash(LEARNING), code_hash(EVERYTHING))
    return f"{digest[:HASH_SHOWN]} {'(this)' if same else '(other)'}"


def trace(file: Path) -> str:
    """What made a figure, table or executed notebook, back to the command that remakes it.

    Raises:
        ParameterError: it is no file of the results, or nothing makes it.
        ResultError: what is needed to say so is missing.
    """
    path, allowed = Path(file).resolve(), f"a file below {', '.join(PLACES)}"
    check(path.is_file() and path.is_relative_to(ROOT), "FIGURE", file, allowed)
    name = path.relative_to(ROOT).as_posix()
    place = re.match(rf"(?:{'|'.join(PLACES)})/([^/]+)/", name)
    check(place is not None, "FIGURE", file, allowed)
    assert place is not None
    for config in configurations(place[1]):
        jobs = planned_jobs(config)
        job = maker(name, jobs)
        if job is not None:
            break
    check(job is not None, "FIGURE", file, "made by one of the notebooks")
    assert job is not None
    chain = stages(job, jobs)
    records = {stage.executed: record(stage) for stage in chain}
    made = {executed: found for executed, found in records.items() if found}
    rows = [(name, _code(r), r["seconds"], r.get("peak_memory_mb", "")) for name, r in made.items()]
    silent = Counter(stage.rule for stage in chain if stage.executed not in made)
    arguments = command_line(config)
    grid = f"./reproduce.sh {shlex.join(arguments)}".strip() if arguments is not None else ""
    try:
        parameters, origin = recorded_parameters(ROOT / job.executed), "with the parameters"
    except ResultError as error:
        parameters, origin = job.parameters, f"not there ({error}); planned are the parameters"
    lines = [
        name,
        f"made by {job.notebook}, rule {job.rule}; executed: {job.executed}, {origin}",
        *(f"    {key} = {json.dumps(value, ensure_ascii=False)}" for key, value in parameters.items()),
        "stages: " + ", ".join(f"{n} × {rule}" for rule, n in Counter(stage.rule for stage in chain).items()),
    ]
    if rows:
        lines.append(
            pd.DataFrame(rows, columns=["executed notebook", "code", "seconds", "MB"]).to_string(index=False)
        )
    for key in ("python", "versions", "machine"):
        lines += sorted({f"{key}: {json.dumps(r[key], ensure_ascii=False)}" for r in made.values()})
    if silent:
        missing = ", ".join(f"{n} × {rule}" for rule, n in silent.items())
        lines.append(f"no record here of code, machine, time and memory: {missing}")
    summary = ROOT / "figures" / config["name"] / "run_time.json"
    if summary.is_file():
        lines.append(f"all of {config['name']}: {json.dumps(read_json(summary), ensure_ascii=False)}")
    if not grid:
        return "\n".join([*lines, "remade by: no command of this version plans this configuration"])
    alone = f".venv/bin/python -m snakemake {job.executed} --cores 1"
    alone += f" --configfile results/{config['name']}/workflow.json"
    lines += [f"remade, with all of {config['name']}, by: {grid}", f"alone by: {grid} --dry-run && {alone}"]
    return "\n".join(lines)
