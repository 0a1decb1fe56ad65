# What the regions are learned from, how, and the choices behind them.


rule pendulum:
    input:
        notebook("01_pendulum"),
    output:
        notebook=f"{DRAWN}/01_pendulum.ipynb",
        measures=f"{MEASURES}/measures/01_pendulum.csv",
        figure=f"{PICTURES}/fig1_pendulum.pdf",
        animation=f"{PICTURES}/recovery.gif",
    params:
        values=config["values"],
        parameters=measuring(DELTAS=[1.0, *DELTAS]),
    shell:
        execute("01_pendulum")


rule data:
    input:
        command("srlrepro", "srlrepro/samplers.py"),
    output:
        f"{RESULTS}/data_{{data}}/alpha_{{alpha}}/training_data.npz",
    priority: FIRST
    params:
        values=config["values"],
    shell:
        f"{PYTHON} -m srlrepro data --alpha {{wildcards.alpha}} --seed {{wildcards.data}} --out {{output:q}} {SETTINGS}"


rule region:
    input:
        command("srlrepro", "srlrepro/region/safe_region.py"),
        data=rules.data.output,
    output:
        f"{RESULTS}/data_{{data}}/alpha_{{alpha}}/region.npz",
    priority: FIRST
    params:
        values=config["values"],
    shell:
        f"{PYTHON} -m srlrepro region --data {{input.data:q}} --seed {{wildcards.data}} --out {{output:q}} {SETTINGS}"


rule training_data:
    input:
        notebook("02_training_data"),
        expand(f"{RESULTS}/data_{{{{data}}}}/alpha_{{alpha}}/training_data.npz", alpha=REGIONS),
    output:
        notebook=f"{DRAWN}/data_{{data}}/02_training_data.ipynb",
        measures=f"{MEASURES}/measures/02_training_data__data_{{data}}.csv",
    params:
        values=config["values"],
        parameters=lambda w: measuring(FIGURES=f"../{figures_of(w.data)}", ALPHAS=NUMBERS, DATA_SEED=int(w.data)),
    shell:
        execute("02_training_data")


rule embedding:
    input:
        notebook("03_embedding"),
        expand(f"{RESULTS}/data_{{{{data}}}}/alpha_{{alpha}}/{{file}}.npz", alpha=REGIONS, file=["training_data", "region"]),
    output:
        notebook=f"{DRAWN}/data_{{data}}/03_embedding.ipynb",
        measures=f"{MEASURES}/measures/03_embedding__data_{{data}}.csv",
    params:
        values=config["values"],
        parameters=lambda w: measuring(FIGURES=f"../{figures_of(w.data)}", ALPHAS=NUMBERS, DATA_SEED=int(w.data)),
    shell:
        execute("03_embedding")


rule safe_region:
    input:
        notebook("04_safe_region"),
        expand(f"{RESULTS}/data_{{{{data}}}}/alpha_{{alpha}}/{{file}}.npz", alpha=REGIONS, file=["training_data", "region"]),
    output:
        notebook=f"{DRAWN}/data_{{data}}/04_safe_region.ipynb",
        measures=f"{MEASURES}/measures/04_safe_region__data_{{data}}.csv",
    params:
        values=config["values"],
        parameters=lambda w: measuring(FIGURES=f"../{figures_of(w.data)}", ALPHAS=NUMBERS, DATA_SEED=int(w.data)),
    shell:
        execute("04_safe_region")


rule choices:
    input:
        notebook("09_choices"),
    output:
        notebook=f"{DRAWN}/09_choices.ipynb",
        tables=expand(f"{PICTURES}/choices_{{table}}.csv", table=["integration", "stability", "recoveries", "random_policy", "calibration", "origin", "exploration"]),
    priority: LONG
    params:
        values=config["values"],
        parameters=drawing(ALPHAS=NUMBERS, DELTAS=[1.0, *DELTAS], DATASETS=2 if config["note"] else 10, STATES=2000),
    shell:
        execute("09_choices")


rule any_system:
    input:
        notebook("19_any_system"),
    output:
        notebook=f"{DRAWN}/19_any_system.ipynb",
        figures=expand(f"{PICTURES}/any_{{system}}.pdf", system=["cartpole", "pendulum"]),
    params:
        values=config["values"],
        parameters=drawing(TRIALS=30 if config["note"] else 200),
    shell:
        execute("19_any_system")
