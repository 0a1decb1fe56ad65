"""What the workflow itself costs, by its number of cells: a dry run, and a start that finds nothing to do.

Nothing is trained: in a temporary copy of the checkout every result is an empty file, which Snakemake is told
to take for finished.
"""

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd

from srlrepro.storage.files import write_table
from workflow.command_line import ALPHAS, DELTAS, Parser, make_parser
from workflow.plan import plan

ROOT = Path(__file__).parent.parent
OUT = ROOT / "docs" / "records" / "overhead.csv"
CELLS, OF_A_SEED = (36, 360, 3600), len(ALPHAS) * len(DELTAS)
CONFIGURATION = "workflow.json"


def snakemake(folder: Path, *options: str) -> tuple[str, float, float]:
    """What Snakemake prints on the workflow in a folder; seconds by the clock and of the processor.

    Other work on the machine counts less in those of the processor.

    Raises:
        CalledProcessError: it failed.
    """
    command = [sys.executable, "-m", "snakemake", "all", "--cores", "2", "--nolock", "--scheduler", "greedy"]
    command += ["--keep-going", "--rerun-incomplete", "--configfile", CONFIGURATION, *options]
    wall, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = os.environ | {"PYTHONPATH": str(folder)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return done.stdout + done.stderr, time.perf_counter() - wall, cpu


def measure(cells: int) -> dict[str, float]:
    """Costs of a grid of so many cells, a multiple of `OF_A_SEED`.

    Raises:
        RuntimeError: a job was left when all results were there.
    """
    seeds = cells // OF_A_SEED
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        made = shutil.ignore_patterns("executed", "__pycache__")
        for name in ("srlrepro", "replication", "workflow", "notebooks"):
            shutil.copytree(ROOT / name, folder / name, ignore=made)
        grid = plan(make_parser().parse_args(["--seeds", str(seeds), "--name", "overhead", "--steps", "1"]))
        (folder / CONFIGURATION).write_text(json.dumps(grid))
        _, dry, dry_cpu = snakemake(folder, "--dry-run", "--quiet", "rules", "reason")
        listed, *_ = snakemake(folder, "--summary")
        table = [line.split("\t") for line in listed.splitlines() if "\t" in line]
        column = table[0].index("output_file")
        for line in table[1:]:
            path = folder / line[column]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
        snakemake(folder, "--touch", "--forceall", "--cores", str(cells))  # all at once
        said, idle, idle_cpu = snakemake(folder)
    if "Nothing to be done" not in said:
        raise RuntimeError(f"{cells} cells: something was left to do")
    costs = {"dry_run_s": dry, "dry_run_cpu_s": dry_cpu}
    return {"cells": cells} | costs | {"nothing_to_do_s": idle, "nothing_to_do_cpu_s": idle_cpu}


def main() -> None:
    """The command line."""
    parser = Parser(prog="python -m benchmarks.workflow", description=__doc__, allow_abbrev=False)
    parser.add_argument("--cells", type=int, nargs="+", default=CELLS, help="default: %(default)s")
    parser.add_argument(
        "--out", type=Path, default=OUT, help="table to write (default: docs/records/overhead.csv)"
    )
    arguments = parser.parse_args()
    for cells in arguments.cells:
        if cells < 1 or cells % OF_A_SEED:
            parser.error(f"--cells = {cells}: must be a multiple of {OF_A_SEED}")
    table = pd.DataFrame([measure(cells) for cells in arguments.cells])
    write_table(arguments.out, table, digits=3)
    print(table.to_string(index=False, float_format="{:.3g}".format))


if __name__ == "__main__":
    main()
