"""The command line of ``reproduce.sh``, as far as it can be read before anything is installed.

Only the standard library is used here: a command line of the wrong form is refused before ``.venv`` exists.
What the values mean is checked in `plan`, which needs the package.
"""

import argparse
import os
from typing import NamedTuple, NoReturn

ALPHAS, DELTAS, SEEDS = ["0", "0.5", "1", "none"], [1.1, 1.5, 4.0], 3  # Sec. IV
CORES = os.cpu_count() or 1
LIMIT, LONGEST = 12.0, 8766.0  # h for one cell of a notebook: what the longest job on Slurm has; a year
LONGEST_MESSAGE = 2000  # characters
VERIFIED = 3  # cells of `verify`: some minutes each
LIMIT_VARIABLE = "SRLREPRO_LIMIT"  # in which the driver hands the limit to its jobs
COMMAND_VARIABLE = "SRLREPRO_COMMAND"  # in which a rule hands over the command line that makes its results
TESTS = "tests"  # name of the results of ./reproduce.sh test, which are its time


class Study(NamedTuple):
    """A study beside the paper's grid: its mismatches Δ, datasets, and steps of a run (None: total_steps)."""

    text: str
    deltas: list[float]
    seeds: int
    steps: int | None = None


ENDS = [DELTAS[0], DELTAS[-1]]  # of Δ, where what lies between would add runs and no contrast
# A step takes about 0.1 ms of a core. 95 universes of 8 runs of 150 000 steps, and a minute for the kernel,
# the regions and the labels of each, take four and a half hours of a core; by then most activations of K have
# occurred. The others have 90, 48, 186 and 50 runs of total_steps, of some two minutes each. More joints have
# 120 of a million steps, an hour of two cores, and cells that take as long.
STUDIES = {
    "multiverse": Study("vary what the paper leaves open, in many short runs", ENDS, 1, 150_000),
    "calibrated": Study("the grid with the evidence of Γ where held-out calibration puts it", DELTAS, 10),
    "crossed": Study("cross datasets and learners: which share of the variance is the data's", DELTAS[:1], 4),
    "caution": Study("vary p_t and α, behind the paper's region and an SVM of the whole state", ENDS, 3),
    "shift": Study("move the training data to where learners go, as Theorem 1 advises", ENDS, 5),
    "joints": Study("1 to 8 joints: where does a low-dimensional region pay?", ENDS, 3, 1_000_000),
}


class Parser(argparse.ArgumentParser):
    """Refuses a wrong command line with one line and exit status 2."""

    def error(self, message: str) -> NoReturn:
        """Print the message as one line, what cannot be printed escaped and a long one cut, and leave."""
        line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in message)
        self.exit(2, f"{self.prog}: {line[:LONGEST_MESSAGE]}\n")


def add_limit(parser: argparse.ArgumentParser) -> None:
    """Give a command line the option that ends what hangs."""
    parser.add_argument(
        "--limit",
        type=float,
        default=os.environ.get(LIMIT_VARIABLE, str(LIMIT)),
        metavar="H",
        help=f"hours for one cell of a notebook, after which its kernel is ended (default: {LIMIT:g})",
    )


def make_parser() -> argparse.ArgumentParser:
    """The command line of ``reproduce.sh``."""
    parser = Parser(
        prog="reproduce.sh",
        allow_abbrev=False,
        description="Regenerate every figure of the paper. What is up to date is not run again.",
        epilog="./reproduce.sh test [PYTEST OPTIONS] runs the tests instead; "
        "./reproduce.sh verify [OPTIONS] makes some of the committed results anew and compares them; "
        "./reproduce.sh site writes README, REPORT and executed notebooks as pages to site/.",
    )
    add = parser.add_argument
    add("--quick", action="store_true", help="the same grid with few training steps (minutes, not hours)")
    studies = parser.add_mutually_exclusive_group()
    for name, study in STUDIES.items():
        text = f"instead of the grid: {study.text}"
        studies.add_argument(
            f"--{name}", dest="study", action="store_const", const=name, default="", help=text
        )
    text = "shares of UD in [0, 1], or none for no supervisor (default: %(default)s)"
    add("--alphas", nargs="+", default=ALPHAS, metavar="A", help=text)
    text = "mass mismatches Δ > 0 (default: %(default)s)"
    add("--deltas", nargs="+", type=float, default=DELTAS, metavar="D", help=text)
    text = "number of seeds (default: %(default)s)"
    add("--seeds", type=int, default=SEEDS, metavar="N", help=text)
    text = "training steps of a run (default: total_steps, or quick_steps with --quick)"
    add("--steps", type=int, metavar="N", help=text)
    text = "vary any parameter; python -m srlrepro choices lists them"
    add("--set", dest="settings", action="extend", nargs="+", default=[], metavar="NAME=VALUE", help=text)
    text = "only the notebook that draws this figure, and what it needs (docs/figures.toml lists the figures)"
    add("--only", metavar="FIGURE", help=text)
    text = "folder name of the results (default: full, quick or the study, with what differs from these)"
    add("--name", help=text)
    text = f"jobs at a time (default: all cores, {CORES}; with --slurm, as many as its profile says)"
    add("--cores", type=int, metavar="N", help=text)
    add("--slurm", action="store_true", help="run the jobs on Slurm, as workflow/profiles/slurm says")
    add_limit(parser)
    add("--dry-run", action="store_true", help="say what would be run; nothing is run or written")
    return parser


def make_verify_parser() -> argparse.ArgumentParser:
    """The command line of ``reproduce.sh verify``."""
    parser = Parser(
        prog="reproduce.sh verify",
        allow_abbrev=False,
        description="Make cells of the committed results anew, in a folder of their own, and compare them "
        "byte for byte; or hold all committed tables and documents against each other.",
    )
    what = parser.add_mutually_exclusive_group()
    text = f"how many cells to draw at random (default: {VERIFIED})"
    what.add_argument("number", type=int, nargs="?", metavar="N", help=text)
    text = "these cells instead, such as full/alpha_0__delta_1.1__seed_0"
    what.add_argument("--cells", nargs="+", metavar="SET/CELL", help=text)
    what.add_argument(
        "--tables", action="store_true", help="no training: all tables, README, REPORT and pages"
    )
    add = parser.add_argument
    add("--seed", type=int, metavar="S", help="of the draw (default: a random one, which is printed)")
    add("--cores", type=int, metavar="N", help=f"jobs at a time (default: all cores, {CORES})")
    add_limit(parser)
    return parser
