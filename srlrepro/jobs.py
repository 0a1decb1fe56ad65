"""The jobs of the workflow as its Snakefile plans them, and which of them makes a file.

How files hang together is said once, in the Snakefile: a forced dry run lists every job.
"""

import json
import re
import shlex
import subprocess
import sys
import tempfile
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from srlrepro.files import ResultError, read_json, write_json

ROOT = Path(__file__).resolve().parent.parent
JOB = re.compile(
    r"rule (?P<rule>\w+):\n    input: (?P<inputs>.*)\n    output: (?P<outputs>.*)\n"
    r"(?:    .*\n)*Shell command: (?P<command>.*)"
)
NAME = re.compile(r'"(\w[^"\n]*)"')  # in code: a text that could name a file


class Job(NamedTuple):
    """One executed notebook of the workflow; paths are relative to the checkout."""

    rule: str
    inputs: list[str]
    outputs: list[str]
    notebook: str
    executed: str
    parameters: dict[str, Any]


def planned_jobs(config: dict[str, Any]) -> list[Job]:
    """Every job of the workflow's configuration, by the name of its notebook, whether it has results or not.

    Raises:
        ResultError: the Snakefile refuses the configuration, or Snakemake does not list its jobs as expected.
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
        notebook, executed, _, text = words[words.index("execute") + 1 :][:4]
        parameters = read_json(ROOT / text[1:]) if text.startswith("@") else json.loads(text)
        files = (found["inputs"].split(", "), found["outputs"].split(", "))
        jobs.append(Job(found["rule"], *files, notebook, executed, parameters))
    if not jobs:
        raise ResultError(f"Snakemake lists no jobs of {config['name']} that can be read")
    return sorted(jobs, key=lambda job: job.executed)


def makers(jobs: list[Job]) -> dict[str, Job]:
    """{output: the job that makes it}."""
    return {output: job for job in jobs for output in job.outputs}


@cache
def _names(notebook: str) -> set[str]:
    """Texts in a notebook's code that could name a figure; * stands for what an f-string fills in."""
    cells = read_json(ROOT / notebook)["cells"]
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    return {re.sub(r"\{.*?\}", "*", text) for text in NAME.findall(code)}


def maker(path: str, jobs: list[Job]) -> Job | None:
    """The job that makes a file: the one with an output of that name, whatever its suffix; else the only one
    that draws into the file's folder and names it in its code. None if there is no such job, or several.

    A figure is an output where a later stage or the README needs it. The others are not, so that a lost
    picture trains nothing; the executed notebook, where there is one, says what was drawn.
    """
    target = Path(path)
    for job in jobs:
        if any(Path(output).with_suffix("") == target.with_suffix("") for output in job.outputs):
            return job
    drawing = [
        j for j in jobs if j.parameters.get("FIGURES", "").removeprefix("../") == target.parent.as_posix()
    ]
    code = {j.executed: j.executed if (ROOT / j.executed).is_file() else j.notebook for j in drawing}
    found = [j for j in drawing if any(fnmatchcase(target.stem, name) for name in _names(code[j.executed]))]
    return found[0] if len(found) == 1 else None


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
