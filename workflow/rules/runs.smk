# The trainings, and what Fig. 3 shows of them.


rule training_run:
    input:
        sources("05_training_run"),
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
        sources("06_learning_performance"),
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
        sources("07_activations_and_failures"),
    output:
        notebook=f"{EXECUTED}/07_activations_and_failures.ipynb",
        measures=f"{TABLES}/measures/07_activations_and_failures.csv",
        figure=f"{FIGURES}/fig3_def_counts.pdf",
    params:
        values=config["values"],
        parameters=parameters(FIGURES=f"../{FIGURES}", TABLES=f"../{TABLES}", RUNS=RUNS, NOTE=config["note"]),
    shell:
        execute("07_activations_and_failures")


rule behaviour:
    input:
        expand(f"{RESULTS}/runs/{{run}}/policy.zip", run=SHOWN),
        sources("11_behaviour"),
    output:
        notebook=f"{DONE}/11_behaviour.ipynb",
        animations=expand(f"{PICTURES}/behaviour/alpha_{{alpha}}__delta_{{delta}}.gif", alpha=ALPHAS, delta=[f"{d:g}" for d in DELTAS]),
    params:
        values=config["values"],
        parameters=parameters(FIGURES=f"../{PICTURES}", RUNS=SHOWN, DATA_SEED=DATA_SEEDS[0]),
    shell:
        execute("11_behaviour")
