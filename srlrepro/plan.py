"""The command line of ``reproduce.sh``, and the workflow's configuration that follows from it."""

import argparse
import math
import os
import re
from typing import Any, NamedTuple, NoReturn

from srlrepro.config import Config, check, condition, parse_settings
from srlrepro.limit import add_limit
from srlrepro.parameters import LARGEST_WHOLE, LONGEST_MESSAGE, one_line

ALPHAS, DELTAS, SEEDS = ["0", "0.5", "1", "none"], [1.1, 1.5, 4.0], 3  # Sec. IV
CORES = os.cpu_count() or 1
MOST_SEEDS = 10_000  # Snakemake plans the 1000 seeds of the largest set that was thought of, not a million
LONGEST_NAME = 64  # characters; a file system takes 255 bytes, and some go to what stands around the name


class Study(NamedTuple):
    """A study beside the paper's grid: its mismatches Δ, seeds per condition, and steps of a run."""

    text: str
    deltas: list[float]
    seeds: int
    steps: int


# Both take the two ends of Δ. A step takes about 0.1 ms of a core. 95 universes of 8 runs of 150 000 steps,
# and a minute for the kernel, the regions and the labels of each, take four and a half hours of a core, so
# little more than two on two cores. By then most activations of K have occurred. 114 runs of 500 000 steps,
# and 12 under the two hypotheses that simulate K in every step, which take five times as long, are two and a
# half hours of a core.
STUDIES = {
    "multiverse": Study("vary what the paper leaves open, in many short runs", [1.1, 4.0], 1, 150_000),
    "hypotheses": Study("compare hypotheses behind the supervisor", [1.1, 4.0], 3, 500_000),
}


class Parser(argparse.ArgumentParser):
    """Refuses a wrong command line with one line and exit status 2."""

    def error(self, message: str) -> NoReturn:
        """Print the message and leave."""
        self.exit(2, f"{self.prog}: {one_line(message, LONGEST_MESSAGE)}\n")


# Names of results that only the grid or study of this name may have; so has seeds_N, as verdicts rest on it.
RESERVED = ("full", "quick", *STUDIES, *(f"{name}_quick" for name in STUDIES))


def make_parser() -> argparse.ArgumentParser:
    """The command line of ``reproduce.sh``."""
    parser = Parser(
        prog="reproduce.sh",
        allow_abbrev=False,
        description="Regenerate every figure of the paper. What is up to date is not run again.",
        epilog="./reproduce.sh test [PYTEST OPTIONS] runs the tests instead; "
        "./reproduce.sh site writes README and executed notebooks as pages to site/.",
    )
    parser.add_argument(
        "--quick", action="store_true", help="the same grid with few training steps (minutes, not hours)"
    )
    studies = parser.add_mutually_exclusive_group()
    for name, study in STUDIES.items():
        studies.add_argument(
            f"--{name}",
            dest="study",
            action="store_const",
            const=name,
            default="",
            help=f"instead of the grid: {study.text}",
        )
    parser.add_argument(
        "--alphas",
        nargs="+",
        default=ALPHAS,
        metavar="A",
        help="shares of UD in [0, 1], or none for no supervisor (default: %(default)s)",
    )
    parser.add_argument(
        "--deltas",
        nargs="+",
        type=float,
        default=DELTAS,
        metavar="D",
        help="mass mismatches Δ > 0 (default: %(default)s)",
    )
    parser.add_argument(
        "--seeds", type=int, default=SEEDS, metavar="N", help="number of seeds (default: %(default)s)"
    )
    parser.add_argument(
        "--steps",
        type=int,
        metavar="N",
        help="training steps of a run (default: total_steps, or quick_steps with --quick)",
    )
    parser.add_argument(
        "--set",
        dest="settings",
        action="extend",
        nargs="+",
        default=[],
        metavar="NAME=VALUE",
        help="vary any parameter; python -m srlrepro choices lists them",
    )
    parser.add_argument(
        "--name",
        help="folder name of the results (default: full, quick, the study, or seeds_N for N; else custom)",
    )
    parser.add_argument(
        "--cores",
        type=int,
        metavar="N",
        help=f"jobs at a time (default: all cores, {CORES}; with --slurm, as many as profiles/slurm says)",
    )
    parser.add_argument(
        "--slurm", action="store_true", help="run the jobs on a Slurm cluster, as profiles/slurm says"
    )
    add_limit(parser)
    parser.add_argument("--dry-run", action="store_true", help="say what would be run, and run nothing")
    return parser


def check_name(name: Any, parameter: str = "--name") -> None:
    """See that a name of results can be that of a folder, and leads nowhere else.

    Raises:
        ParameterError: it cannot.
    """
    fits = isinstance(name, str) and len(name) <= LONGEST_NAME
    check(
        fits and re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", name) is not None,
        parameter,
        name,
        f"at most {LONGEST_NAME} letters, digits, '_', '-' and '.', a letter or digit first",
    )


def check_whole(name: str, value: Any, least: int, most: int = LARGEST_WHOLE) -> None:
    """Raise `ParameterError` unless a value is a whole number between two others."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    check(whole and least <= value <= most, name, value, f"a whole number in [{least}, {most}]")


def check_workflow(found: Any) -> dict[str, Any]:
    """The workflow's configuration that was read from a file, if `plan` can have made it.

    Raises:
        ParameterError: it cannot: a name would lead out of its folder, or a value is not allowed.
    """
    check(isinstance(found, dict), "workflow.json", found, "a table of values")
    check_name(found.get("name"), "workflow.json: name")
    check_name(found.get("cells", found["name"]), "workflow.json: cells")
    for name, kinds in (("alphas", str), ("deltas", (int, float)), ("seeds", int)):
        values = found.get(name)
        plain = isinstance(values, list) and not any(isinstance(value, bool) for value in values)
        fits = plain and all(isinstance(value, kinds) for value in values)
        check(fits, f"workflow.json: {name}", values, "a list, as reproduce.sh writes it")
    for alpha in found["alphas"]:
        check(parse_alpha(alpha) == alpha, "workflow.json: alphas", alpha, "written in the shortest way")
    for delta in found["deltas"]:
        check(0 < delta < math.inf, "workflow.json: deltas", delta, "finite numbers > 0")
    for seed in found["seeds"]:
        check_whole("workflow.json: seeds", seed, 0)
    check_whole("workflow.json: steps", found.get("steps"), 1)
    for name in ("settings", "values"):
        check(isinstance(found.get(name), dict), f"workflow.json: {name}", found.get(name), "a table")
    per_seed = found["values"].get("data_per_seed")
    check(isinstance(per_seed, bool), "workflow.json: data_per_seed", per_seed, "true or false")
    Config().with_values(**found["settings"])
    study = found.get("study", "")
    check(study in ("", *STUDIES), "workflow.json: study", study, f"empty, or one of {', '.join(STUDIES)}")
    return dict(found)


def parse_alpha(text: str) -> str:
    """The text of α in names, tables and legends, of one on a command line.

    Raises:
        ParameterError: it is neither a number in [0, 1] nor "none".
    """
    if text == "none":
        return text
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    check(0 <= value <= 1, "--alphas", text, "numbers in [0, 1], or none")
    return condition(abs(value))  # -0 is 0


def plan(arguments: argparse.Namespace) -> dict[str, Any]:
    """The workflow's configuration for a command line.

    Raises:
        ParameterError: a value that is not allowed.
    """
    alphas = [parse_alpha(text) for text in arguments.alphas]
    for delta in arguments.deltas:
        check(0 < delta < math.inf, "--deltas", delta, "finite numbers > 0")
    deltas = [float(f"{delta:g}") for delta in arguments.deltas]
    for name, values in (("--alphas", alphas), ("--deltas", deltas)):
        check(len(set(values)) == len(values), name, " ".join(map(str, values)), "different from each other")
    check(
        alphas != ["none"],
        "--alphas",
        "none",
        "joined by at least one number, for the figures of the regions",
    )
    check_whole("--seeds", arguments.seeds, 1, MOST_SEEDS)
    if arguments.cores is not None:
        check_whole("--cores", arguments.cores, 1)
    config = Config().with_values(**(settings := parse_settings(arguments.settings)))
    grid = (alphas, deltas, settings) == (ALPHAS, DELTAS, {})
    seeds, longest = arguments.seeds, config.choices.total_steps
    if arguments.study:
        alone = grid and seeds == SEEDS
        check(alone, f"--{arguments.study}", "another grid", "without one: it has its own")
        _, deltas, seeds, longest = STUDIES[arguments.study]
    usual = config.choices.quick_steps if arguments.quick else longest
    steps = usual if arguments.steps is None else arguments.steps
    check_whole("--steps", steps, 1)
    papers, size = grid and steps == usual, "quick" if arguments.quick else "full"
    if arguments.study:
        size = f"{arguments.study}_quick" if arguments.quick else arguments.study
    default = papers and arguments.seeds == SEEDS
    more = f"seeds_{arguments.seeds}" if size == "full" else f"{size}_seeds_{arguments.seeds}"
    usual_name = size if default else more if papers else "custom"
    name = usual_name if arguments.name is None else arguments.name
    check_name(name)
    check(
        name == usual_name or not (name in RESERVED or re.fullmatch(r"(.+_)?seeds_\d+", name)),
        "--name",
        name,
        "another name if the grid or a parameter is varied",
    )
    full = config.choices.total_steps
    note = f"reduced: {steps} of {full} training steps" if steps < full else ""
    return {
        "name": name,
        "cells": size if papers else name,
        "alphas": alphas,
        "deltas": deltas,
        "seeds": list(range(seeds)),
        "steps": steps,
        "settings": settings,
        "values": config.as_dict(),
        "note": note,
        "study": arguments.study,
        "few": arguments.quick and bool(arguments.study),
    }
