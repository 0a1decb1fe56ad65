"""What made a figure: its notebook, the stages before it, and the command that remakes it.

How files hang together is asked of the Snakefile (`jobs`); what happened, of what the jobs wrote: parameters
in executed notebooks; code, versions, machine, time and memory in their records (`records`).
"""

import json
import re
import shlex
from collections import Counter
from pathlib import Path
from typing import Any

from srlrepro.config import Config, ParameterError, check
from srlrepro.files import ResultError, read_json
from srlrepro.jobs import ROOT, Job, maker, planned_jobs, stages
from srlrepro.notebooks import INJECTED, parameters_of
from srlrepro.plan import STUDIES, check_workflow, make_parser, plan
from srlrepro.provenance import EVERYTHING, LEARNING, code_hash
from srlrepro.records import records

PLACES = ("figures", "notebooks/executed", "results")
HASH_SHOWN = 8  # digits of a hash that a table shows


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
    """Configurations whose files lie in the folder ``name``: its own first; if that was not kept, as planned.

    Raises:
        ResultError: none is known.
    """
    found_in = {
        path.parent.name: path
        for place in ("figures", "results")
        for path in sorted(ROOT.glob(f"{place}/*/workflow.json"))
    }
    kept = [check_workflow(read_json(path)) for path in found_in.values()]
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


def recorded_parameters(executed: Path) -> dict[str, Any]:
    """{name: value} that a notebook was executed with.

    Raises:
        ResultError: the notebook is missing, or was not executed by the workflow.
    """
    return parameters_of(executed, INJECTED)


def changed_values(config: dict[str, Any]) -> dict[str, str]:
    """{parameter: its value in a configuration, and here} where a default is another one in this version."""
    here = json.loads(json.dumps(Config().with_values(**config["settings"]).as_dict()))
    there = config["values"]
    return {
        name: f"{there.get(name)}, here {here.get(name)}"
        for name in sorted(here.keys() | there.keys())
        if here.get(name) != there.get(name)
    }


def find(file: Path) -> tuple[dict[str, Any], Job, list[Job]]:
    """The configuration and the job that make a file of the results, and that job's `stages`.

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
            return config, job, stages(job, jobs)
    raise ParameterError(f"FIGURE = {file}: must be made by one of the notebooks")


def _count(chain: list[Job]) -> str:
    return ", ".join(f"{n} × {rule}" for rule, n in Counter(stage.rule for stage in chain).items())


def _code(digest: str) -> str:
    same = digest in (code_hash(LEARNING), code_hash(EVERYTHING))
    return f"{digest[:HASH_SHOWN]} {'(this)' if same else '(other)'}"


def trace(file: Path) -> str:
    """What made a figure, table or executed notebook, back to the command that remakes it, as text.

    Raises:
        ParameterError: it is no file of the results, or nothing makes it.
        ResultError: what is needed to say so is missing.
    """
    config, job, chain = find(file)
    try:
        parameters, origin = recorded_parameters(ROOT / job.executed), "with the parameters"
    except ResultError as error:
        parameters, origin = job.parameters, f"not there ({error}); planned are the parameters"
    lines = [
        str(file),
        f"made by {job.notebook}, rule {job.rule}; executed: {job.executed}, {origin}",
        *(f"    {key} = {json.dumps(value, ensure_ascii=False)}" for key, value in parameters.items()),
        f"stages: {_count(chain)}",
    ]
    made = records(config["name"], chain)
    if len(made):
        shown = made.assign(code=made["code"].map(_code))
        lines.append(shown[["notebook", "run", "code", "seconds", "peak_memory_mb"]].to_string(index=False))
    lines += [f"{key}: {text}" for key in ("python", "versions", "machine") for text in made[key].unique()]
    silent = [stage for stage in chain if stage.executed not in set(made["notebook"])]
    if silent:
        lines.append(f"no record here of code, machine, time and memory: {_count(silent)}")
    summary = ROOT / "figures" / config["name"] / "run_time.json"
    if summary.is_file():
        lines.append(f"all of {config['name']}: {json.dumps(read_json(summary), ensure_ascii=False)}")
    lines += [f"made with another default: {name} = {text}" for name, text in changed_values(config).items()]
    arguments = command_line(config)
    if arguments is None:
        return "\n".join([*lines, "remade by: no command of this version plans this configuration"])
    grid = shlex.join(["./reproduce.sh", *arguments])
    alone = f".venv/bin/python -m snakemake {job.executed} --force --cores 1"
    alone += f" --configfile results/{config['name']}/workflow.json"
    lines += [f"remade, with all of {config['name']}, by: {grid}", f"alone by: {grid} --dry-run && {alone}"]
    return "\n".join(lines)
