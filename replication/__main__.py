"""The command line ``python -m replication``: judging results, and the documents that tell of them."""

import argparse
import sys

from srlrepro.command_line import Parser, path, run, subcommands
from srlrepro.settings.fields import check


def measure(arguments: argparse.Namespace) -> None:
    """Measure one trained run, and write the table."""
    from replication.evidence.measures import measure_run, write_measures
    from replication.evidence.runs import read_run
    from replication.studies.alternatives import read

    run = read_run(arguments.run)
    region = arguments.region and read(arguments.region, run.config, run.condition.delta)
    rows = measure_run(run, region, arguments.common and read_run(arguments.common))
    write_measures(arguments.out, rows)
    print(f"{len(rows)} measures of {run.condition.name}")


def claims(arguments: argparse.Namespace) -> None:
    """Print contrasts and verdicts for tables of measures."""
    from replication.evidence.claims import judge, load
    from replication.evidence.measures import read_measures

    measures = read_measures(*arguments.measures)
    check(len(measures) > 0, "MEASURES", arguments.measures[0], "tables of measures, or folders of them")
    summary, contrasts = judge(load(), measures)
    print(
        contrasts.to_string(index=False), summary[["id", "n", "verdict"]].to_string(index=False), sep="\n\n"
    )


def render(arguments: argparse.Namespace) -> None:
    """Render README.md or REPORT.md from its template and the results."""
    from replication import readme, report

    document = {d.command: d for d in (readme.DOCUMENT, report.DOCUMENT)}[arguments.document]
    if arguments.check:
        document.check()
        return
    if document is readme.DOCUMENT:
        readme.keep_times()
    document.write()


def make_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = Parser(prog="python -m replication", description=__doc__, allow_abbrev=False)
    command = subcommands(parser)
    sub = command("measure", measure, "Measure one trained run, from what it has written.")
    sub.add_argument("run", type=path, help="its folder, or the run.json in it")
    sub.add_argument("--out", type=path, required=True, help="table of measures to write (.csv)")
    sub.add_argument("--region", type=path, help="region that supervised it")
    sub.add_argument("--common", type=path, help="the run without a supervisor of the same Δ and seed")
    sub = command("claims", claims, "Evaluate the tests of the paper's claims on tables of measures.")
    sub.add_argument("measures", type=path, nargs="+", metavar="MEASURES", help="tables, or folders of them")
    for document in ("readme", "report"):
        name = f"{document.upper()}.md"
        sub = command(document, render, f"Render {name} from its template and the results.")
        sub.set_defaults(document=document)
        sub.add_argument(
            "--check", action="store_true", help=f"write nothing; exit with 1 if {name} is stale"
        )
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    return run(make_parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
