"""The option that ends what hangs; the driver hands its value to its jobs in a variable."""

import argparse
import os

from srlrepro.config import check

LIMIT, LONGEST = 12.0, 8766  # h for one cell: what the longest job on Slurm has; a year
VARIABLE = "SRLREPRO_LIMIT"


def _hours(text: str) -> float:
    check(0 < float(text) <= LONGEST, "--limit", text, f"in (0, {LONGEST}]")
    return float(text)


_hours.__name__ = f"number of hours in (0, {LONGEST}]"  # what argparse says of a wrong value


def add_limit(parser: argparse.ArgumentParser) -> None:
    """Give a command line the option."""
    parser.add_argument(
        "--limit",
        type=_hours,
        default=os.environ.get(VARIABLE, str(LIMIT)),
        metavar="H",
        help=f"hours for one cell of a notebook, after which its kernel is ended (default: {LIMIT:g})",
    )
