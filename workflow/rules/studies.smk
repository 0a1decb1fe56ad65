# The studies beside the grid: in each universe, data, regions and short runs. A universe is one job, which goes
# on where it was killed; its runs and checkpoints are therefore no outputs of the rule.

UNIVERSES = {}
if STUDY:
    from replication.studies.multiverse import jobs

    UNIVERSES = jobs(STUDY, ALPHAS, SEEDS, config["few"])


def all_universes(table):
    return expand(f"{RESULTS}/universes/{{universe}}/{table}.csv", universe=UNIVERSES)


rule universe:
    input:
        notebook("13_universe"),
    output:
        notebook=f"{EXECUTED}/universes/{{universe}}.ipynb",
        measures=f"{RESULTS}/universes/{{universe}}/measures.csv",
        conditions=f"{RESULTS}/universes/{{universe}}/conditions.csv",
    params:
        values=config["values"],
        steps=config["steps"],
        cells=lambda w: UNIVERSES[w.universe],
        parameters=lambda w: parameters(**{"DELTAS": DELTAS, "STEPS": config["steps"]} | UNIVERSES[w.universe]),
    shell:
        execute("13_universe")


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


rule hypotheses:
    input:
        notebook("15_hypotheses"),
        all_universes("measures"),
        all_universes("conditions"),
    output:
        notebook=f"{EXECUTED}/15_hypotheses.ipynb",
        figures=expand(f"{FIGURES}/hypotheses_{{figure}}.pdf", figure=["classification", "learning"]),
        tables=expand(f"{FIGURES}/hypotheses_{{table}}.csv", table=["summary", "better", "ranks"]),
    params:
        values=config["values"],
        parameters=parameters(
            FIGURES=f"../{FIGURES}",
            UNIVERSES={name: name for name in UNIVERSES},
            ALPHAS=REGIONS,
            DELTAS=DELTAS,
            SEEDS=SEEDS,
            NOTE=config["note"],
        ),
    shell:
        execute("15_hypotheses")
