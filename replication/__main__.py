"""The command line ``python -m replication``: judging results, and the documents that tell of them."""

import argparse
import sys
from pathlib import Path

from srlrepro import pins
from srlrepro.command_line import Parser, path, run, subcommands
from srlrepro.settings.fields import check


def measure(arguments: argparse.Namespace) -> None:
    """Measure one trained run, and write the table."""
    from replication.evidence.measures import measure_run, write_measures
    from replication.evidence.results import read_run
    from replication.studies.alternatives import read_hypothesis

    run = read_run(arguments.run)
    region = arguments.region and read_hypothesis(arguments.region, run.config, run.condition)
    rows = measure_run(run, region, arguments.common and read_run(arguments.common))
    write_measures(arguments.out, rows)
    print(f"{len(rows)} measures of {run.condition.name}")


def budgets(arguments: argparse.Namespace) -> None:
    """Judge trained runs at several of their steps, and write one table."""
    import pandas as pd

    from replication.evidence.claims import MEASURE_COLUMNS
    from replication.evidence.measures import measure_budgets
    from replication.evidence.results import read_run
    from srlrepro.storage.files import write_table

    rows = [row for folder in arguments.runs for row in measure_budgets(read_run(folder))]
    *of, value = MEASURE_COLUMNS
    write_table(arguments.out, pd.DataFrame(rows, columns=[*of, "step", value]), digits=6)
    print(f"{len(rows)} measures of {len(arguments.runs)} runs")


def claims(arguments: argparse.Namespace) -> None:
    """Print contrasts and verdicts for tables of measures."""
    from replication.evidence.claims import judge_claims, load_claims
    from replication.evidence.measures import read_measures

    measures = read_measures(*arguments.measures)
    check(len(measures) > 0, "MEASURES", arguments.measures[0], "tables of measures, or folders of them")
    summary, contrasts = judge_claims(load_claims(), measures)
    tables = contrasts, summary[["id", "n", "verdict"]]
    print("\n\n".join(table.to_string(index=False) for table in tables))


def gather(arguments: argparse.Namespace) -> None:
    """Write the measures and the conditions of universes as one table each."""
    from replication.studies.designs import write_gathered

    rows = write_gathered(arguments.universes, arguments.out)
    print(f"{rows} measures of {len(arguments.universes)} universes")


def joints(arguments: argparse.Namespace) -> None:
    """Learn and score every hypothesis in the cells of one number of joints and one dataset."""
    from replication.studies.joints.cells import write_job

    rows = write_job(arguments.job, arguments.out, arguments.few, arguments.learners, arguments.cell or ())
    print(f"{rows} scores of {arguments.job}")


def times(arguments: argparse.Namespace) -> None:
    """Keep the medians of the times of a study of joints, for the documents."""
    from replication.studies.joints.cells import write_times

    print(f"{write_times(arguments.cells, arguments.out)} medians in {arguments.out}")


def provenance(arguments: argparse.Namespace) -> None:
    """Print what made a figure."""
    from replication.plots.provenance import lines, read_made_by

    print("\n".join(lines(read_made_by(arguments.figure))))


def beside(arguments: argparse.Namespace) -> None:
    """Join a figure of two variations into one picture, and print their measures side by side."""
    from replication.documents import FIGURES
    from replication.plots.comparison import compare_measures, join_pictures

    known = {folder.name: folder for folder in FIGURES.iterdir() if folder.is_dir()}
    for name in (arguments.first, arguments.second):
        check(name in known, "NAME", name, f"one of {', '.join(sorted(known))}")
    check(arguments.first != arguments.second, "NAME", arguments.second, "another than the first")
    first, second = known[arguments.first], known[arguments.second]
    drawn_alone = [folder.name for folder in (first, second) if not (folder / "measures.csv").exists()]
    table = None if drawn_alone else compare_measures(first, second)
    join_pictures(first, second, arguments.figure, arguments.out)
    if table is None:
        print(f"{', '.join(drawn_alone)}: not measured, so that only the pictures stand side by side")
    else:
        print(table.to_string(index=False, float_format="{:.4g}".format, na_rep=""))


def policies(arguments: argparse.Namespace) -> None:
    """Copy final policies and regions into a folder, each under the name of what it holds."""
    from replication.policies import take

    names = take(arguments.files, arguments.out)
    print(f"{len(names)} policies and regions: {arguments.out}")


def explorer(arguments: argparse.Namespace) -> None:
    """Make the page in which a reader moves a state, and sees what the supervisor thinks of it."""
    from replication.explorer import build

    build.write(arguments.out, build.collect(arguments.policies, arguments.figures))
    print(f"{arguments.out.stat().st_size / 1e6:.2f} MB: {arguments.out}")


def documents(arguments: argparse.Namespace) -> None:
    """Render README, REPORT and the pages of docs/ that hold results."""
    from replication import documents

    if arguments.check:
        documents.check()
    else:
        documents.write()


def make_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = Parser(prog="python -m replication", description=__doc__, allow_abbrev=False)
    command = subcommands(parser)
    sub = command("measure", measure, "Measure one trained run, from what it has written.")
    sub.add_argument("run", type=path, help="its folder, or the run.json in it")
    sub.add_argument("--out", type=path, required=True, help="table of measures to write (.csv)")
    sub.add_argument("--region", type=path, help="region that supervised it")
    sub.add_argument("--common", type=path, help="the run without a supervisor of the same Δ and seed")
    sub = command("budgets", budgets, "Judge trained runs as if they had ended at several of their steps.")
    sub.add_argument("runs", type=path, nargs="+", metavar="RUN", help="their folders")
    sub.add_argument("--out", type=path, required=True, help="table to write (.csv)")
    sub = command("claims", claims, "Evaluate the tests of the paper's claims on tables of measures.")
    sub.add_argument("measures", type=path, nargs="+", metavar="MEASURES", help="tables, or folders of them")
    sub = command("gather", gather, "Write the tables of universes as one: measures, and conditions.")
    sub.add_argument("universes", type=path, nargs="+", metavar="UNIVERSE", help="folder of a universe")
    sub.add_argument("--out", type=path, required=True, help="folder to write")
    text = "Learn and score every hypothesis in the cells of one number of joints and one dataset."
    sub = command("joints", joints, text)
    sub.add_argument("job", metavar="JOB", help="such as links_3__dataset_0")
    sub.add_argument("--few", action="store_true", help="of the small design")
    sub.add_argument(
        "--learners", type=path, metavar="UNIVERSE", help="whose free learners' states are asked"
    )
    sub.add_argument("--cell", action="append", help="only this cell, such as k_250__alpha_0")
    sub.add_argument("--out", type=path, required=True, help="folder to write; finished cells are kept there")
    sub = command("times", times, "Keep the medians of the times of a study of joints, for the documents.")
    sub.add_argument("cells", type=path, metavar="FOLDER", help="of the cells, such as results/joints/cells")
    sub.add_argument("--out", type=path, default=Path("docs/records/joints_times.csv"), help="table to write")
    sub = command("provenance", provenance, "Print what made a figure.")
    sub.add_argument("figure", type=path, metavar="FIGURE", help=".png, .pdf or .gif")
    sub = command("beside", beside, "Lay two variations side by side: a figure, and the final measures.")
    sub.add_argument("first", metavar="NAME", help="a folder of figures/")
    sub.add_argument("second", metavar="NAME")
    sub.add_argument("--figure", default="fig3_abc_learning", help="without suffix")
    sub.add_argument("--out", type=path, required=True, help="picture to write (.png)")
    text = "Copy final policies and regions into a folder, each under the name of what it holds."
    sub = command("policies", policies, text)
    sub.add_argument("files", type=path, nargs="+", metavar="FILE", help="policy.npz of a run, or region.npz")
    sub.add_argument("--out", type=path, required=True, help="folder to write")
    text = "Make the page in which a reader moves a state, and sees what the supervisor thinks of it."
    sub = command("explorer", explorer, text)
    sub.add_argument("--policies", type=path, default="policies", help="folder of policies and regions")
    figures = "folder with the tables of Fig. 3 (default: %(default)s)"
    sub.add_argument("--figures", type=path, default="figures/full", help=figures)
    sub.add_argument("--out", type=path, default="docs/explorer.html", help="page to write (%(default)s)")
    sub = command("documents", documents, "Render README, REPORT and the pages of docs/ that hold results.")
    sub.add_argument("--check", action="store_true", help="write nothing; exit with 1 if one is stale")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    return run(make_parser(), argv)


if __name__ == "__main__":
    pins.pin("python -m replication")
    sys.exit(main())
