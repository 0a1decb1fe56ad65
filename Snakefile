# The workflow: one rule per notebook. Configured by srlrepro/workflow.py; start it with ./reproduce.sh
#
# A rule is run again when its notebook, a module that makes its *numbers*, a value of the configuration or
# one of its input results changed. srlrepro/figures.py is no input of the runs: a new colour trains nothing.

import hashlib
import json
import sys
from pathlib import Path

from srlrepro import provenance

NAME, CELLS, ALPHAS, DELTAS, SEEDS = (config[key] for key in ("name", "cells", "alphas", "deltas", "seeds"))
REGIONS = [a for a in ALPHAS if a != "none"]
# Grids that differ in the number of seeds alone share their regions and runs, which are those of CELLS.
RESULTS, PICTURES, DONE = f"results/{CELLS}", f"figures/{CELLS}", f"notebooks/executed/{CELLS}"
TABLES, FIGURES, EXECUTED = f"results/{NAME}/grid", f"figures/{NAME}", f"notebooks/executed/{NAME}"
DATA_SEEDS = SEEDS  # as many datasets as seeds are measured; unless data_per_seed, all runs use the first
RUN = "alpha_{alpha}__delta_{delta}__seed_{seed}"
RUNS = expand(RUN, alpha=ALPHAS, delta=[f"{d:g}" for d in DELTAS], seed=SEEDS)
SHOWN = expand(RUN, alpha=ALPHAS, delta=[f"{d:g}" for d in DELTAS], seed=SEEDS[:1])
JUDGED = {"delta": [f"{d:g}" for d in DELTAS], "seed": SEEDS[:1] if config["values"]["data_per_seed"] else SEEDS}
CALIBRATED = expand(RUN, alpha=REGIONS, **JUDGED)
FREE = expand(RUN, alpha=[a for a in ALPHAS if a == "none"], **JUDGED)

LONGEST = 2**16  # characters of parameters on a command line; Linux takes twice as many bytes

STUDY = config.get("study", "")
if STUDY:
    from srlrepro.studies import jobs


def modules(*names):
    return [f"srlrepro/{name}.py" for name in names]


LEARNING = modules(*provenance.LEARNING, "evaluation")


def region_of(wildcards):
    """The region that supervises a run; none for the free learner."""
    data = wildcards.seed if config["values"]["data_per_seed"] else 0
    return [] if wildcards.alpha == "none" else f"{RESULTS}/data_{data}/alpha_{wildcards.alpha}/region.npz"


def figures_of(data):
    """Figures of the first training data are the paper's; others stand in a folder of their own."""
    return PICTURES if int(data) == DATA_SEEDS[0] else f"{PICTURES}/data_{data}"


def parameters(**values):
    """The notebook's parameters as JSON, or @ and the file that holds them; paths are relative to the notebook."""
    common = {"RESULTS": f"../{RESULTS}", "SETTINGS": config["settings"]}
    text = json.dumps(common | values, ensure_ascii=False)
    if len(text) < LONGEST:
        return text
    from srlrepro.files import write_json

    digest = hashlib.sha256(text.encode()).hexdigest()
    write_json(file := Path(f"results/{NAME}/parameters/{digest}.json"), common | values)
    return f"@{file}"


def execute(notebook):
    """The shell command that executes a notebook with the rule's parameters."""
    command = f"{sys.executable} -m srlrepro execute notebooks/{notebook}.ipynb {{output.notebook}}"
    return command + " --parameters {params.parameters:q} --results {output:q}"


rule all:
    input:
        f"{DONE}/01_pendulum.ipynb",
        expand(f"{DONE}/data_{{data}}/04_safe_region.ipynb", data=DATA_SEEDS),
        f"{EXECUTED}/08_claims.ipynb",
        f"{DONE}/09_choices.ipynb",
        f"{EXECUTED}/10_calibration.ipynb",
        f"{DONE}/11_behaviour.ipynb",
        f"{EXECUTED}/12_theorem.ipynb",
        f"{EXECUTED}/16_discrepancy.ipynb",


include: "rules/regions.smk"
include: "rules/runs.smk"
include: "rules/judging.smk"
include: "rules/studies.smk"
