# What follows from regions and runs: the claims, and what is measured beside them.


rule budgets:
    input:
        command("replication", "replication/evidence/measures.py"),
        expand(f"{RESULTS}/runs/{{run}}/{{file}}", run=RUNS, file=["run.json", "trials.csv", "curve.csv", "evaluations.csv"]),
    output:
        f"{FIGURES}/budgets.csv",
    params:
        values=config["values"],
        folders=expand(f"{RESULTS}/runs/{{run}}", run=RUNS),
    shell:
        f"{PYTHON} -m replication budgets {{params.folders:q}} --out {{output:q}}"


ARM = "figures/calibrated/measures.csv"  # of the study of this name: beside the grid as written, once it is there
BESIDE = [ARM] if Path(ARM).exists() and not config["note"] else []


rule claims:
    input:
        BESIDE,
        notebook("08_claims"),
        "replication/evidence/claims.toml",
        f"{MEASURES}/measures/01_pendulum.csv",
        expand(f"{MEASURES}/measures/{{stage}}__data_{{data}}.csv", stage=["02_training_data", "03_embedding", "04_safe_region"], data=DATA_SEEDS),
        expand(f"{RESULTS}/runs/{{run}}/measures.csv", run=RUNS),
        rules.budgets.output,
    output:
        notebook=f"{EXECUTED}/08_claims.ipynb",
        claims=f"{FIGURES}/claims.csv",
        contrasts=f"{FIGURES}/contrasts.csv",
        measures=f"{FIGURES}/measures.csv",
        performance=f"{FIGURES}/final_performance.csv",
        figures=expand(f"{FIGURES}/{{figure}}.pdf", figure=["verdict", "failure_rate", "verdict_by_step"]),
    params:
        values=config["values"],
        parameters=judging(MEASURES=f"../{MEASURES}/measures", RUNS=RUNS, SEEDS=SEEDS, CALIBRATED=f"../{ARM}" if BESIDE else ""),
    shell:
        execute("08_claims")


rule calibration:
    input:
        notebook("10_calibration"),
        expand(f"{RESULTS}/runs/{{run}}/{{file}}", run=CALIBRATED, file=["visited.npz", "measures.csv"]),
        LEARNED,
    output:
        notebook=f"{EXECUTED}/10_calibration.ipynb",
        figures=expand(f"{FIGURES}/reliability_{{labels}}.pdf", labels=["nominal", "real"]),
    params:
        values=config["values"],
        parameters=judging(RUNS=CALIBRATED, DATA_SEED=DATA_SEEDS[0]),
    shell:
        execute("10_calibration")


DATASETS = 5  # of each α in the theorem's class of regions; those that the grid does not need are learned there


rule theorem:
    input:
        notebook("12_theorem"),
        expand(f"{RESULTS}/runs/{{run}}/visited.npz", run=CALIBRATED + FREE),
        learned(DATA_SEEDS[:DATASETS]),
    output:
        notebook=f"{EXECUTED}/12_theorem.ipynb",
        figure=f"{FIGURES}/theorem_terms.pdf",
        tables=expand(f"{FIGURES}/theorem_{{table}}.csv", table=["steps", "divergence", "orders"]),
    priority: LONG
    params:
        values=config["values"],
        parameters=judging(
            RUNS=CALIBRATED + FREE,
            DATA_SEED=DATA_SEEDS[0],
            MADE=DATA_SEEDS[:DATASETS],
            DATASETS=DATASETS,
            STATES=1000 if config["note"] else 5000,  # a reduced run need not wait minutes for it
        ),
    shell:
        execute("12_theorem")


EXPLORED = DATA_SEEDS if config["values"]["data_per_seed"] else DATA_SEEDS[:1]  # the datasets behind the runs


rule discrepancy:
    input:
        notebook("16_discrepancy"),
        expand(f"{RESULTS}/runs/{{run}}/measures.csv", run=RUNS),
        learned(EXPLORED),
    output:
        notebook=f"{EXECUTED}/16_discrepancy.ipynb",
        figure=f"{FIGURES}/discrepancy.pdf",
        tables=expand(f"{FIGURES}/discrepancy_{{table}}.csv", table=["outcomes", "ranks"]),
    params:
        values=config["values"],
        parameters=judging(RUNS=RUNS, ALPHAS=REGIONS, DELTAS=sorted({1.0, *DELTAS, 1.25, 2.0, 2.8}), TRIALS=200, DATA_SEEDS=EXPLORED),
    shell:
        execute("16_discrepancy")
