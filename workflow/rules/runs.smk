# The trainings, and what Fig. 3 shows of them. A training writes raw products; another job measures them.


rule training_run:
    input:
        notebook("05_training_run"),
        region=region_of,
    output:
        notebook=f"{TRAINED}/05_training_run__{RUN}.ipynb",
        run=f"{RESULTS}/runs/{RUN}/run.json",
        trials=f"{RESULTS}/runs/{RUN}/trials.csv",
        curve=f"{RESULTS}/runs/{RUN}/curve.csv",
        evaluations=f"{RESULTS}/runs/{RUN}/evaluations.csv",
        policy=f"{RESULTS}/runs/{RUN}/policy.npz",
        learner=f"{RESULTS}/runs/{RUN}/policy.zip",
        visited=f"{RESULTS}/runs/{RUN}/visited.npz",
    priority: SECOND
    params:
        values=config["values"],
        steps=config["steps"],
        data=data_of,
        parameters=lambda w, input: parameters(
            ALPHA=w.alpha,
            DELTA=float(w.delta),
            SEED=int(w.seed),
            STEPS=config["steps"],
            REGION="" if w.alpha == "none" else f"../{input.region}",
            NOTE=config["note"],
        ),
    shell:
        execute("05_training_run")


rule run_measures:
    input:
        command("replication", "replication/evidence/measures.py", "replication/studies/alternatives.py"),
        run=rules.training_run.output.run,
        visited=rules.training_run.output.visited,
        region=region_of,
        common=free_run_of,
    output:
        f"{RESULTS}/runs/{RUN}/measures.csv",
    params:
        values=config["values"],
        region=lambda w, input: f"--region {shlex.quote(input.region)}" if input.region else "",
        common=lambda w, input: f"--common {shlex.quote(str(Path(input.common).parent))}" if input.common else "",
    shell:
        f"{PYTHON} -m replication measure {{input.run:q}} --out {{output:q}} {{params.region}} {{params.common}}"


rule learning_performance:
    input:
        notebook("06_learning_performance"),
        expand(f"{RESULTS}/runs/{{run}}/{{table}}.csv", run=RUNS, table=["curve", "evaluations", "measures"]),
    output:
        notebook=f"{EXECUTED}/06_learning_performance.ipynb",
        figure=f"{FIGURES}/fig3_abc_learning.pdf",
    params:
        values=config["values"],
        steps=config["steps"],
        parameters=judging(RUNS=RUNS),
    shell:
        execute("06_learning_performance")


rule activations_and_failures:
    input:
        notebook("07_activations_and_failures"),
        expand(f"{RESULTS}/runs/{{run}}/measures.csv", run=RUNS),
    output:
        notebook=f"{EXECUTED}/07_activations_and_failures.ipynb",
        figure=f"{FIGURES}/fig3_def_counts.pdf",
    params:
        values=config["values"],
        steps=config["steps"],
        parameters=judging(RUNS=RUNS),
    shell:
        execute("07_activations_and_failures")


rule policies:
    input:
        command("replication", "replication/policies.py"),
        policies=expand(f"{RESULTS}/runs/{{run}}/policy.npz", run=TAKEN_RUNS),
        regions=expand(f"{RESULTS}/data_{{data}}/alpha_{{alpha}}/region.npz", data=TAKEN_DATA, alpha=REGIONS),
    output:
        expand(f"{TAKEN}/{{run}}.npz", run=TAKEN_RUNS),
        expand(f"{TAKEN}/region__alpha_{{alpha}}__data_{{data}}.npz", data=TAKEN_DATA, alpha=REGIONS),
    params:
        values=config["values"],
    shell:
        f"{PYTHON} -m replication policies {{input.policies:q}} {{input.regions:q}} --out {shlex.quote(TAKEN)}"


rule behaviour:
    input:
        notebook("11_behaviour"),
        expand(f"{RESULTS}/runs/{{run}}/policy.npz", run=SHOWN),
    output:
        notebook=f"{DRAWN}/11_behaviour.ipynb",
        animations=expand(f"{PICTURES}/behaviour/alpha_{{alpha}}__delta_{{delta}}.gif", alpha=ALPHAS, delta=[f"{d:g}" for d in DELTAS]),
    params:
        values=config["values"],
        parameters=drawing(RUNS=SHOWN, STEPS=config["steps"], DATA_SEED=DATA_SEEDS[0], NOTE=config["note"]),
    shell:
        execute("11_behaviour")
