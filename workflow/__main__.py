"""The command line ``python -m workflow``: executing parameterised notebooks, as the rules do."""

import argparse
import sys
from pathlib import Path

from srlrepro import pins
from srlrepro.command_line import Parser, path, run, subcommands
from srlrepro.settings.fields import ParameterError, one_line
from workflow.command_line import add_limit


def execute(arguments: argparse.Namespace) -> None:
    """Execute a parameterised notebook."""
    from srlrepro.storage.files import parse_json, read_json
    from workflow import notebooks

    text = arguments.parameters
    try:
        parameters = read_json(Path(text[1:])) if text.startswith("@") else parse_json(text)
    except ValueError as error:
        raise ParameterError(
            f"--parameters = {one_line(text)}: must be JSON, or @ and a file with it ({error})"
        ) from None
    results = [path for path in arguments.results if path != arguments.output]
    notebooks.execute(arguments.notebook, arguments.output, parameters, results, arguments.limit * 3600)


def snapshot(arguments: argparse.Namespace) -> None:
    """Refresh the outputs that the tests of source notebooks compare."""
    from workflow import notebooks

    for notebook in arguments.notebooks:
        notebooks.snapshot(notebook)


def record(arguments: argparse.Namespace) -> None:
    """Keep the time that results took here."""
    from workflow import ROOT
    from workflow.engine import record

    for name in arguments.names:
        print(f"{record(name).relative_to(ROOT)}; python -m replication documents takes it over")


def make_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = Parser(prog="python -m workflow", description=__doc__, allow_abbrev=False)
    command = subcommands(parser)
    sub = command("execute", execute, "Execute a parameterised notebook.")
    sub.add_argument("notebook", type=path)
    sub.add_argument("output", type=path, help="executed notebook to write (.ipynb)")
    sub.add_argument("--parameters", default="{}", metavar="JSON", help="{NAME: value}, or @FILE with them")
    sub.add_argument("--results", type=path, nargs="*", default=[], help="files that the notebook must write")
    add_limit(sub)
    sub = command("snapshot", snapshot, "Refresh the outputs that the tests of the notebooks compare.")
    sub.add_argument(
        "notebooks", type=path, nargs="+", help="in their order: later ones read what earlier ones write"
    )
    sub = command(
        "record", record, "Keep the time that results took here in docs/records/, for the documents."
    )
    sub.add_argument("names", nargs="+", metavar="NAME", help="of results, such as full or quick; or tests")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    return run(make_parser(), argv)


if __name__ == "__main__":
    pins.pin("python -m workflow")
    sys.exit(main())
