# The workflow: one rule per notebook. Configured by srlrepro/reproduce.py; start it with ./reproduce.sh
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


rule pendulum:
    input:
        modules(*provenance.PHYSICS),
        modules("figures", "drawing"),
        "notebooks/01_pendulum.ipynb",
    output:
        notebook=f"{DONE}/01_pendulum.ipynb",
        measures=f"{RESULTS}/measures/01_pendulum.csv",
        figure=f"{PICTURES}/fig1_pendulum.pdf",
        animation=f"{PICTURES}/recovery.gif",
    params:
        values=config["values"],
        parameters=parameters(FIGURES=f"../{PICTURES}", DELTAS=[1.0, *DELTAS]),
    shell:
        execute("01_pendulum")


rule training_data:
    input:
        modules(*provenance.DATA),
        modules("figures"),
        "notebooks/02_training_data.ipynb",
    output:
        notebook=f"{DONE}/data_{{data}}/02_training_data.ipynb",
        measures=f"{RESULTS}/measures/02_training_data__data_{{data}}.csv",
        data=expand(f"{RESULTS}/data_{{{{data}}}}/alpha_{{alpha}}/training_data.npz", alpha=REGIONS),
    params:
        values=config["values"],
        parameters=lambda w: parameters(
            FIGURES=f"../{figures_of(w.data)}", ALPHAS=[float(a) for a in REGIONS], DATA_SEED=int(w.data)
        ),
    shell:
        execute("02_training_data")


rule embedding:
    input:
        rules.training_data.output.data,
        modules(*provenance.REGION),
        modules("figures"),
        "notebooks/03_embedding.ipynb",
    output:
        notebook=f"{DONE}/data_{{data}}/03_embedding.ipynb",
        measures=f"{RESULTS}/measures/03_embedding__data_{{data}}.csv",
        regions=expand(f"{RESULTS}/data_{{{{data}}}}/alpha_{{alpha}}/region.npz", alpha=REGIONS),
    params:
        values=config["values"],
        parameters=lambda w: parameters(
            FIGURES=f"../{figures_of(w.data)}", ALPHAS=[float(a) for a in REGIONS], DATA_SEED=int(w.data)
        ),
    shell:
        execute("03_embedding")


rule safe_region:
    input:
        rules.training_data.output.data,
        rules.embedding.output.regions,
        modules("figures", "evaluation", "joined_measures"),
        "notebooks/04_safe_region.ipynb",
    output:
        notebook=f"{DONE}/data_{{data}}/04_safe_region.ipynb",
        measures=f"{RESULTS}/measures/04_safe_region__data_{{data}}.csv",
    params:
        values=config["values"],
        parameters=lambda w: parameters(
            FIGURES=f"../{figures_of(w.data)}", ALPHAS=[float(a) for a in REGIONS], DATA_SEED=int(w.data)
        ),
    shell:
        execute("04_safe_region")


rule training_run:
    input:
        LEARNING,
        "notebooks/05_training_run.ipynb",
        region=region_of,
    output:
        notebook=f"{DONE}/runs/05_training_run__{RUN}.ipynb",
        measures=f"{RESULTS}/measures/05_training_run__{RUN}.csv",
        run=f"{RESULTS}/runs/{RUN}/run.json",
        trials=f"{RESULTS}/runs/{RUN}/trials.csv",
        curve=f"{RESULTS}/runs/{RUN}/curve.csv",
        policy=f"{RESULTS}/runs/{RUN}/policy.zip",
        visited=f"{RESULTS}/runs/{RUN}/visited.npz",
    params:
        values=config["values"],
        parameters=lambda w, input: parameters(
            ALPHA=w.alpha,
            DELTA=float(w.delta),
            SEED=int(w.seed),
            STEPS=config["steps"],
            REGION="" if w.alpha == "none" else f"../{input.region}",
        ),
    shell:
        execute("05_training_run")


rule learning_performance:
    input:
        expand(f"{RESULTS}/runs/{{run}}/curve.csv", run=RUNS),
        modules("figures", "joined_measures"),
        "notebooks/06_learning_performance.ipynb",
    output:
        notebook=f"{EXECUTED}/06_learning_performance.ipynb",
        measures=f"{TABLES}/measures/06_learning_performance.csv",
        figure=f"{FIGURES}/fig3_abc_learning.pdf",
    params:
        values=config["values"],
        parameters=parameters(FIGURES=f"../{FIGURES}", TABLES=f"../{TABLES}", RUNS=RUNS, NOTE=config["note"]),
    shell:
        execute("06_learning_performance")


rule activations_and_failures:
    input:
        expand(f"{RESULTS}/runs/{{run}}/run.json", run=RUNS),
        modules("figures", "joined_measures"),
        "notebooks/07_activations_and_failures.ipynb",
    output:
        notebook=f"{EXECUTED}/07_activations_and_failures.ipynb",
        measures=f"{TABLES}/measures/07_activations_and_failures.csv",
        figure=f"{FIGURES}/fig3_def_counts.pdf",
    params:
        values=config["values"],
        parameters=parameters(FIGURES=f"../{FIGURES}", TABLES=f"../{TABLES}", RUNS=RUNS, NOTE=config["note"]),
    shell:
        execute("07_activations_and_failures")


rule claims:
    input:
        f"{RESULTS}/measures/01_pendulum.csv",
        expand(f"{RESULTS}/measures/{{stage}}__data_{{data}}.csv", stage=["02_training_data", "03_embedding", "04_safe_region"], data=DATA_SEEDS),
        expand(f"{RESULTS}/measures/05_training_run__{{run}}.csv", run=RUNS),
        f"{TABLES}/measures/06_learning_performance.csv",
        f"{TABLES}/measures/07_activations_and_failures.csv",
        f"{TABLES}/measures/10_calibration.csv",
        modules("claims", "statistics", "figures", "verdict_figures"),
        "srlrepro/claims.toml",
        "notebooks/08_claims.ipynb",
    output:
        notebook=f"{EXECUTED}/08_claims.ipynb",
        claims=f"{FIGURES}/claims.csv",
        contrasts=f"{FIGURES}/contrasts.csv",
        measures=f"{FIGURES}/measures.csv",
        performance=f"{FIGURES}/final_performance.csv",
        figure=f"{FIGURES}/verdict.pdf",
    params:
        values=config["values"],
        parameters=parameters(FIGURES=f"../{FIGURES}", TABLES=f"../{TABLES}", SEEDS=SEEDS, NOTE=config["note"]),
    shell:
        execute("08_claims")


rule choices:
    input:
        LEARNING,
        modules("choosing"),
        "notebooks/09_choices.ipynb",
    output:
        notebook=f"{DONE}/09_choices.ipynb",
        tables=expand(f"{PICTURES}/choices_{{table}}.csv", table=["integration", "stability", "recoveries", "random_policy", "calibration", "origin", "exploration"]),
    params:
        values=config["values"],
        parameters=parameters(
            FIGURES=f"../{PICTURES}", ALPHAS=[float(a) for a in REGIONS], DELTAS=[1.0, *DELTAS], DATASETS=1, STATES=2000
        ),
    shell:
        execute("09_choices")


rule calibration:
    input:
        expand(f"{RESULTS}/runs/{{run}}/visited.npz", run=[*CALIBRATED, *FREE]),
        expand(f"{RESULTS}/data_{DATA_SEEDS[0]}/alpha_{{alpha}}/region.npz", alpha=REGIONS),
        modules("figures", "evaluation", "joined_measures"),
        "notebooks/10_calibration.ipynb",
    output:
        notebook=f"{EXECUTED}/10_calibration.ipynb",
        measures=f"{TABLES}/measures/10_calibration.csv",
        figures=expand(f"{FIGURES}/reliability_{{labels}}.pdf", labels=["nominal", "real"]),
    params:
        values=config["values"],
        parameters=parameters(
            FIGURES=f"../{FIGURES}",
            TABLES=f"../{TABLES}",
            RUNS=CALIBRATED,
            COMMON_RUNS=FREE,
            DATA_SEED=DATA_SEEDS[0],
            NOTE=config["note"],
        ),
    shell:
        execute("10_calibration")


rule behaviour:
    input:
        expand(f"{RESULTS}/runs/{{run}}/policy.zip", run=SHOWN),
        modules("figures", "drawing", "behaviour"),
        "notebooks/11_behaviour.ipynb",
    output:
        notebook=f"{DONE}/11_behaviour.ipynb",
        animations=expand(f"{PICTURES}/behaviour/alpha_{{alpha}}__delta_{{delta}}.gif", alpha=ALPHAS, delta=[f"{d:g}" for d in DELTAS]),
    params:
        values=config["values"],
        parameters=parameters(FIGURES=f"../{PICTURES}", RUNS=SHOWN, DATA_SEED=DATA_SEEDS[0]),
    shell:
        execute("11_behaviour")


rule theorem:
    input:
        expand(f"{RESULTS}/runs/{{run}}/visited.npz", run=CALIBRATED + FREE),
        expand(f"{RESULTS}/data_{DATA_SEEDS[0]}/alpha_{{alpha}}/region.npz", alpha=REGIONS),
        modules("figures", "choosing", "divergence", "theorem"),
        "notebooks/12_theorem.ipynb",
    output:
        notebook=f"{EXECUTED}/12_theorem.ipynb",
        figure=f"{FIGURES}/theorem_terms.pdf",
        tables=expand(f"{FIGURES}/theorem_{{table}}.csv", table=["steps", "divergence", "orders"]),
    params:
        values=config["values"],
        parameters=parameters(
            FIGURES=f"../{FIGURES}", RUNS=CALIBRATED + FREE, DATA_SEED=DATA_SEEDS[0], DATASETS=5, STATES=5000, NOTE=config["note"]
        ),
    shell:
        execute("12_theorem")


# The studies beside the grid: in each universe, data, regions and short runs. A universe is one job, which goes
# on where it was killed; its runs and checkpoints are therefore no outputs of the rule.

UNIVERSES = jobs(STUDY, ALPHAS, SEEDS, config["few"]) if STUDY else {}


def all_universes(table):
    return expand(f"{RESULTS}/universes/{{universe}}/{table}.csv", universe=UNIVERSES)


rule universe:
    input:
        LEARNING,
        modules("universe"),
        "notebooks/13_universe.ipynb",
    output:
        notebook=f"{EXECUTED}/universes/{{universe}}.ipynb",
        measures=f"{RESULTS}/universes/{{universe}}/measures.csv",
        conditions=f"{RESULTS}/universes/{{universe}}/conditions.csv",
    params:
        values=config["values"],
        parameters=lambda w: parameters(**{"DELTAS": DELTAS, "STEPS": config["steps"]} | UNIVERSES[w.universe]),
    shell:
        execute("13_universe")


rule multiverse:
    input:
        all_universes("measures"),
        all_universes("conditions"),
        modules("claims", "multiverse", "specification", "figures"),
        "srlrepro/claims.toml",
        "srlrepro/multiverse.toml",
        "notebooks/14_multiverse.ipynb",
    output:
        notebook=f"{EXECUTED}/14_multiverse.ipynb",
        tables=expand(f"{FIGURES}/{{table}}.csv", table=["outcomes", "shares", "flips", "main_effects", "papers_rates"]),
    params:
        values=config["values"],
        parameters=parameters(FIGURES=f"../{FIGURES}", UNIVERSES=list(UNIVERSES), DELTAS=DELTAS, NOTE=config["note"]),
    shell:
        execute("14_multiverse")


rule hypotheses:
    input:
        all_universes("measures"),
        all_universes("conditions"),
        modules("hypotheses", "judging", "comparing", "evaluation", "figures"),
        "notebooks/15_hypotheses.ipynb",
    output:
        notebook=f"{EXECUTED}/15_hypotheses.ipynb",
        figures=expand(f"{FIGURES}/hypotheses_{{figure}}.pdf", figure=["classification", "learning"]),
        tables=expand(f"{FIGURES}/hypotheses_{{table}}.csv", table=["summary", "better"]),
    params:
        values=config["values"],
        parameters=parameters(
            FIGURES=f"../{FIGURES}", UNIVERSES={name: name for name in UNIVERSES}, ALPHAS=REGIONS, DELTAS=DELTAS, SEEDS=SEEDS, NOTE=config["note"]
        ),
    shell:
        execute("15_hypotheses")


rule discrepancy:
    input:
        expand(f"{RESULTS}/measures/05_training_run__{{run}}.csv", run=RUNS),
        expand(f"{RESULTS}/data_{DATA_SEEDS[0]}/alpha_{{alpha}}/region.npz", alpha=REGIONS),
        modules("discrepancy", "figures"),
        "notebooks/16_discrepancy.ipynb",
    output:
        notebook=f"{EXECUTED}/16_discrepancy.ipynb",
        figure=f"{FIGURES}/discrepancy.pdf",
        tables=expand(f"{FIGURES}/discrepancy_{{table}}.csv", table=["outcomes", "ranks"]),
    params:
        values=config["values"],
        parameters=parameters(
            FIGURES=f"../{FIGURES}", RUNS=RUNS, ALPHAS=REGIONS, DELTAS=sorted({1.0, *DELTAS, 1.25, 2.0, 2.8}), TRIALS=200, REPEATS=5, DATA_SEED=DATA_SEEDS[0], NOTE=config["note"]
        ),
    shell:
        execute("16_discrepancy")
