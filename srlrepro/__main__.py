"""The command line ``python -m srlrepro``: each stage by itself, and the tools around the results."""

import argparse
import shlex
import sys
from pathlib import Path
from typing import Any

from srlrepro import commands
from srlrepro.config import ParameterError
from srlrepro.parameters import LONGEST_MESSAGE, one_line
from srlrepro.plan import Parser, add_limit, check_whole

MOST_SEED = 2**32 - 1  # that numpy's global generator and scikit-learn take


def _alpha(text: str) -> float | None:
    return None if text == "none" else float(text)


def _seed(text: str) -> int:
    check_whole("--seed", seed := int(text), 0, MOST_SEED)
    return seed


def _path(text: str) -> Path:
    if not text or "\0" in text or text.encode(errors="replace").decode() != text:
        raise ValueError
    return Path(text)


# what argparse says of a wrong value
_alpha.__name__ = "number in [0, 1], or none"
_seed.__name__ = f"whole number in [0, {MOST_SEED}]"
_path.__name__ = "path (some text in UTF-8)"


def make_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = Parser(prog="python -m srlrepro", description=__doc__, allow_abbrev=False)
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=Parser)

    def command(name: str, function: Any, text: str) -> argparse.ArgumentParser:
        sub = subparsers.add_parser(name, help=text, description=text, allow_abbrev=False)
        sub.set_defaults(function=function)
        return sub

    def settings(sub: argparse.ArgumentParser) -> None:
        sub.add_argument(
            "--set",
            dest="settings",
            action="extend",
            nargs="+",
            default=[],
            metavar="NAME=VALUE",
            help="vary parameters (see choices)",
        )

    sub = command("data", commands.data, "Sample and label the training data D_tr of one α.")
    sub.add_argument("--alpha", type=float, required=True, help="share of UD, in [0, 1]")
    sub.add_argument("--seed", type=_seed, default=0, help="seed of the samples (default: 0)")
    sub.add_argument("--out", type=_path, required=True, help="file to write (.npz)")
    settings(sub)

    sub = command("region", commands.region, "Learn Ψ, Γ and S_y from training data.")
    sub.add_argument("--data", type=_path, required=True, help="file that the command data wrote")
    sub.add_argument("--seed", type=_seed, default=0, help="seed of t-SNE (default: 0)")
    sub.add_argument("--out", type=_path, required=True, help="file to write (.npz)")
    settings(sub)

    sub = command("label", commands.label, "Print l(x) of one state and how K fares from it.")
    sub.add_argument(
        "--state", type=float, nargs=6, required=True, metavar="X", help="θ1 θ2 θ3 (rad) θ̇1 θ̇2 θ̇3 (rad/s)"
    )
    sub.add_argument(
        "--delta", type=float, default=1.0, help="mass mismatch Δ (default: 1, the nominal system: l_n)"
    )
    settings(sub)

    sub = command(
        "train",
        commands.train,
        "Train one run; started again with --trust-checkpoint after a kill, it goes on.",
    )
    sub.add_argument(
        "--alpha", type=_alpha, required=True, help="share of UD of the region, or none: no supervisor"
    )
    sub.add_argument("--delta", type=float, required=True, help="mass mismatch Δ > 0 of the real system")
    sub.add_argument("--seed", type=_seed, default=0, help="seed of the learner (default: 0)")
    sub.add_argument("--steps", type=int, help="training steps (default: total_steps)")
    sub.add_argument("--region", type=_path, help="file that the command region wrote; not with --alpha none")
    sub.add_argument(
        "--data", type=_path, help="instead: file that the command data wrote, to learn the hypothesis from"
    )
    sub.add_argument("--out", type=_path, required=True, help="folder to write")
    sub.add_argument(
        "--trust-checkpoint",
        action="store_true",
        help="go on from checkpoint.zip in the folder: it holds pickles of stable-baselines3, which can run "
        "any code as they are read, so only if you or this program wrote it",
    )
    settings(sub)

    sub = command("execute", commands.execute, "Execute a parameterised notebook.")
    sub.add_argument("notebook", type=_path)
    sub.add_argument("output", type=_path, help="executed notebook to write (.ipynb)")
    sub.add_argument("--parameters", default="{}", metavar="JSON", help="{NAME: value}, or @FILE with them")
    sub.add_argument(
        "--results", type=_path, nargs="*", default=[], help="files that the notebook must write"
    )
    add_limit(sub)

    sub = command(
        "snapshot", commands.snapshot, "Refresh the outputs that the tests of the source notebooks compare."
    )
    sub.add_argument(
        "notebooks", type=_path, nargs="+", help="in their order: later ones read what earlier ones write"
    )

    sub = command("import", commands.import_runs, "Bring in finished runs that another checkout has trained.")
    sub.add_argument("folder", type=_path, help="the other checkout, or a copy of what it made")
    sub.add_argument("--name", required=True, help="results that lack them, such as full")

    sub = command(
        "claims", commands.claims, "Evaluate the tests of the paper's claims on a folder of measures."
    )
    sub.add_argument("measures", type=_path, help="such as results/quick/measures")

    sub = command(
        "provenance", commands.provenance, "Print what made a figure, back to the command that remakes it."
    )
    sub.add_argument("figure", type=_path, help="a figure, table or executed notebook of the results")

    command("crate", commands.crate, "Describe the results as a RO-Crate (ro-crate-metadata.json).")
    command(
        "choices", commands.list_choices, "List every parameter with its value, allowed values and reason."
    )
    for document in ("readme", "report"):
        name = f"{document.upper()}.md"
        sub = command(document, commands.render, f"Render {name} from its template and the results.")
        sub.set_defaults(document=document)
        sub.add_argument(
            "--check", action="store_true", help=f"write nothing; exit with 1 if {name} is stale"
        )
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a command; wrong use gives one line and 2, a missing or broken result one line and 1."""
    parser = make_parser()
    arguments = parser.parse_args(argv)
    try:
        arguments.function(arguments)
    except ParameterError as error:
        parser.error(str(error))
    except Exception as error:
        from numpy.linalg import LinAlgError

        from srlrepro.files import ResultError

        if isinstance(error, (ArithmeticError, LinAlgError, MemoryError)):
            given = one_line(shlex.join(sys.argv[1:] if argv is None else argv))
            parser.error(f"{given}: must be values to compute with ({type(error).__name__}: {error})")
        if not isinstance(error, (ResultError, OSError)):
            raise
        print(f"{parser.prog}: {one_line(error, LONGEST_MESSAGE)}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
