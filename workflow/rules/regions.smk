# What the regions are learned from, how, and the choices behind them.


rule pendulum:
    input:
        sources("01_pendulum"),
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
        sources("02_training_data"),
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
        sources("03_embedding"),
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
        sources("04_safe_region"),
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


rule choices:
    input:
        sources("09_choices"),
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
