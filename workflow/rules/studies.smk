# The studies beside the grid: in each universe, data, regions and runs. A universe is one job, which goes on where
# it was killed; its data, runs and checkpoints are therefore no outputs of the rule. So are the cells of joints.

UNIVERSES = {}
if STUDY:
    from replication.studies.designs import universes

    UNIVERSES = universes(STUDY, ALPHAS, DELTAS, SEEDS, config["few"])

    ruleorder: gathered > claims

else:

    ruleorder: claims > gathered

FOLDERS = {name: name for name in UNIVERSES}  # as the notebooks take them
MORE_SHARES = REGIONS if config["few"] else ["0", "0.25", "0.5", "0.75", "1"]  # α on stored states, in caution


def all_universes(table):
    return expand(f"{RESULTS}/universes/{{universe}}/{table}.csv", universe=UNIVERSES)


rule universe:
    input:
        notebook("13_universe"),
    output:
        notebook=f"{EXECUTED}/universes/{{universe}}.ipynb",
        measures=f"{RESULTS}/universes/{{universe}}/measures.csv",
        conditions=f"{RESULTS}/universes/{{universe}}/conditions.csv",
    priority: SECOND
    params:
        values=config["values"],
        steps=config["steps"],
        cells=lambda w: UNIVERSES[w.universe],
        parameters=lambda w: parameters(**{"DELTAS": DELTAS, "STEPS": config["steps"]} | UNIVERSES[w.universe] | config.get("narrowed", {})),
    shell:
        execute("13_universe")


rule gathered:
    input:
        command("replication", "replication/studies/designs.py"),
        all_universes("measures"),
        all_universes("conditions"),
    output:
        measures=f"{FIGURES}/measures.csv",
        conditions=f"{FIGURES}/conditions.csv",
    params:
        values=config["values"],
        universes=[f"{RESULTS}/universes/{universe}" for universe in UNIVERSES],
    shell:
        f"{PYTHON} -m replication gather {{params.universes:q}} --out {shlex.quote(FIGURES)}"


rule multiverse:
    input:
        notebook("14_multiverse"),
        all_universes("measures"),
        all_universes("conditions"),
        "replication/evidence/claims.toml",
        "replication/studies/multiverse.toml",
    output:
        notebook=f"{EXECUTED}/14_multiverse.ipynb",
        tables=expand(f"{FIGURES}/{{table}}.csv", table=["outcomes", "shares", "flips", "main_effects", "papers_rates"]),
    params:
        values=config["values"],
        parameters=parameters(
            FIGURES=f"../{FIGURES}", UNIVERSES=list(UNIVERSES), DELTAS=DELTAS, EVERY_CURVE=True, NOTE=config["note"]
        ),
    shell:
        execute("14_multiverse")


rule calibrated:  # its measures are judged beside those of the grid
    input:
        rules.gathered.output,
    params:
        values=config["values"],


rule caution:
    input:
        notebook("15_caution"),
        rules.gathered.output,
    output:
        notebook=f"{EXECUTED}/15_caution.ipynb",
        figures=expand(f"{FIGURES}/caution_{{figure}}.pdf", figure=["roc", "frontier", "outcomes", "effects"]),
        recall=f"{FIGURES}/caution_recall.csv",
    priority: LONG
    params:
        values=config["values"],
        parameters=parameters(FIGURES=f"../{FIGURES}", UNIVERSES=FOLDERS, SHARES=MORE_SHARES, NOTE=config["note"]),
    shell:
        execute("15_caution")


rule crossed:
    input:
        notebook("17_crossed"),
        rules.gathered.output,
    output:
        notebook=f"{EXECUTED}/17_crossed.ipynb",
        figure=f"{FIGURES}/crossed_components.pdf",
    params:
        values=config["values"],
        parameters=parameters(FIGURES=f"../{FIGURES}", UNIVERSES=FOLDERS, NOTE=config["note"]),
    shell:
        execute("17_crossed")


rule shift:
    input:
        notebook("18_shift"),
        rules.gathered.output,
    output:
        notebook=f"{EXECUTED}/18_shift.ipynb",
        figure=f"{FIGURES}/shift.pdf",
        contrasts=f"{FIGURES}/shift_contrasts.csv",
    params:
        values=config["values"],
        parameters=parameters(FIGURES=f"../{FIGURES}", UNIVERSES=FOLDERS, NOTE=config["note"]),
    shell:
        execute("18_shift")


JOBS, LEARNERS = [], {}  # of joints, and where the free learners are whose states are asked about in a job
if STUDY == "joints":
    from replication.studies.designs import learners_of
    from replication.studies.joints.cells import design

    JOBS = list(design(config["few"]).jobs)
    LEARNERS = {job: f"{RESULTS}/universes/{learners_of(job)}" for job in JOBS if learners_of(job) in UNIVERSES}


def cells_command(wildcards):
    """The options of a job: of which design, with whose learners, and which cells if not all."""
    words = ["--few"] if config["few"] else []
    words += ["--learners", LEARNERS[wildcards.job]] if wildcards.job in LEARNERS else []
    return shlex.join(words + [word for cell in config.get("cells_only", []) for word in ("--cell", cell)])


rule joints_cells:
    input:
        command("replication", "replication/studies/joints/cells.py"),
        learners=lambda w: f"{LEARNERS[w.job]}/measures.csv" if w.job in LEARNERS else [],
    output:
        f"{RESULTS}/cells/{{job}}__scores.csv",
        f"{RESULTS}/cells/{{job}}__times.csv",
    priority: SECOND
    params:
        values=config["values"],
        options=cells_command,
    shell:
        f"{PYTHON} -m replication joints {{wildcards.job}} --out {shlex.quote(RESULTS)}/cells {{params.options}}"


rule joints_curve:
    input:
        notebook("20_joints"),
        "replication/studies/joints/predictions.toml",
        expand(f"{RESULTS}/cells/{{job}}__scores.csv", job=JOBS),
    output:
        notebook=f"{EXECUTED}/20_joints.ipynb",
        figures=expand(f"{FIGURES}/{{figure}}.pdf", figure=["joints", "joints_ladder", "joints_coverage"]),
        tables=expand(f"{FIGURES}/joints_{{table}}.csv", table=["scores", "recall", "predictions"]),
    priority: LONG
    params:
        values=config["values"],
        parameters=parameters(
            FIGURES=f"../{FIGURES}",
            JOBS=JOBS,
            LEARNERS={job: f"../{folder}" for job, folder in LEARNERS.items()},
            FEW=config["few"],
            NOTE="reduced: a small design" if config["few"] else "",
        ),
    shell:
        execute("20_joints")


rule joints:
    input:
        notebook("21_more_joints"),
        "replication/studies/joints/predictions_training.toml",
        rules.gathered.output,
        rules.joints_curve.output.tables,
    output:
        notebook=f"{EXECUTED}/21_more_joints.ipynb",
        figures=expand(f"{FIGURES}/joints_{{figure}}.pdf", figure=["training", "frontier", "contrasts"]),
        tables=f"{FIGURES}/joints_trained_predictions.csv",
    params:
        values=config["values"],
        parameters=parameters(FIGURES=f"../{FIGURES}", UNIVERSES=FOLDERS, NOTE=config["note"]),
    shell:
        execute("21_more_joints")
