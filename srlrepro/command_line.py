"""What every command line of the project shares: a refusal is one line, with an exit status.

Wrong use gives 2; a missing, broken or unwritable result gives 1.
"""

import argparse
import io
import re
import shlex
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from srlrepro.settings.fields import LONGEST_MESSAGE, ParameterError, one_line


class Parser(argparse.ArgumentParser):
    """Refuses a wrong command line with one line and exit status 2; takes -1e-3 for a number."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._negative_number_matcher = re.compile(r"-\.?\d|-(inf|nan)$")  # argparse's knows no exponents

    def error(self, message: str) -> NoReturn:
        """Print the message and leave."""
        self.exit(2, f"{self.prog}: {one_line(message, LONGEST_MESSAGE)}\n")


def path(text: str) -> Path:
    """A path of a command line: some text in UTF-8, without the character NUL."""
    if not text or "\0" in text or text.encode(errors="replace").decode() != text:
        raise argparse.ArgumentTypeError(f"{one_line(repr(text))} is no path: some text in UTF-8")
    return Path(text)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Give a command line ``--set NAME=VALUE …``, collected in ``settings``."""
    text = "vary parameters; python -m srlrepro choices lists them"
    option = parser.add_argument("--set", dest="settings", action="extend", nargs="+", default=[], help=text)
    option.metavar = "NAME=VALUE"


def subcommands(parser: argparse.ArgumentParser) -> Callable[..., argparse.ArgumentParser]:
    """A function (name, function, text) that adds a subcommand to a parser and returns its own parser."""
    found = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=Parser)

    def add(name: str, function: Callable[[argparse.Namespace], None], text: str) -> argparse.ArgumentParser:
        sub: argparse.ArgumentParser = found.add_parser(name, help=text, description=text, allow_abbrev=False)
        sub.set_defaults(function=function)
        return sub

    return add


def escape_what_cannot_be_shown() -> None:
    """Let letters that the locale lacks, such as α in one of ASCII, be printed by their numbers."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # as it is for stderr


def run(parser: argparse.ArgumentParser, argv: Sequence[str] | None) -> int:
    """Parse a command line and run the ``function`` that it names; returns the exit status."""
    escape_what_cannot_be_shown()
    arguments = parser.parse_args(argv)
    with warnings.catch_warnings(record=True) as noted:  # of numbers that a refusal is about: it is one line
        status = _run(parser, arguments, shlex.join(sys.argv[1:] if argv is None else argv))
    for warning in noted if status == 0 else ():
        warnings.showwarning(warning.message, warning.category, warning.filename, warning.lineno)
    return status


def _run(parser: argparse.ArgumentParser, arguments: Any, given: str) -> int:
    try:
        arguments.function(arguments)
    except ParameterError as error:
        parser.error(str(error))
    except Exception as error:
        from numpy.linalg import LinAlgError

        from srlrepro.storage.files import ResultError

        if isinstance(error, (ArithmeticError, LinAlgError, MemoryError)):
            reason = f"{type(error).__name__}: {error}"
            parser.error(f"{one_line(given)}: must be values to compute with ({reason})")
        if not isinstance(error, (ResultError, OSError)):
            raise
        print(f"{parser.prog}: {one_line(error, LONGEST_MESSAGE)}", file=sys.stderr)
        return 1
    return 0
