"""The command line ``python -m replication``: judging results, and the documents that tell of them."""

import argparse
import sys

from srlrepro.settings.command_line import Parser, path, run, subcommands
from srlrepro.settings.fields import check


def claims(arguments: argparse.Namespace) -> None:
    """Print contrasts and verdicts for a folder of measures."""
    from replication.evidence.claims import MEASURE_COLUMNS, judge, load
    from replication.evidence.measures import read_measures
    from srlrepro.storage.files import read_table

    files = sorted(arguments.measures.glob("*.csv"))
    check(bool(files), "MEASURES", arguments.measures, "a folder with tables of measures (.csv)")
    for file in files:
        read_table(file, MEASURE_COLUMNS, numbers=("delta", "seed", "value"))
    measures = read_measures(arguments.measures)
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
    sub = command("claims", claims, "Evaluate the tests of the paper's claims on a folder of measures.")
    sub.add_argument("measures", type=path, help="such as results/quick/measures")
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
