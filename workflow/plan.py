"""From a command line of ``reproduce.sh`` to the configuration of the workflow.

Results lie in folders that are named after what they depend on, so that none can be taken for another:

- ``cells``: the values of all parameters and the training steps. Data, regions and runs lie there.
- ``look``: these, α and Δ of the grid. The figures of the regions lie there.
- ``name``: these and the number of seeds. The figures and tables of the whole grid lie there.

"full", "quick" and the studies are the names where nothing is varied; else a name says what is.
"""

import argparse
import hashlib
import math
import re
import shlex
import tomllib
from functools import partial
from typing import Any

from replication.digests import read_set
from srlrepro.pins import ARITHMETIC
from srlrepro.settings.condition import alpha_text
from srlrepro.settings.config import Config, parse_settings
from srlrepro.settings.fields import ParameterError, check, check_whole
from srlrepro.storage.files import ResultError
from workflow import ROOT
from workflow.command_line import ALPHAS, DELTAS, LONGEST, SEEDS, STUDIES, TESTS

MOST_SEEDS = 10_000  # Snakemake plans the 1000 seeds of the largest set that was thought of, not a million
LONGEST_NAME = 64  # characters; a file system takes 255 bytes, and some go to what stands around the name
DIFFERENT = (
    "alphas",
    "deltas",
    "seeds",
    "steps",
    "settings",
    "study",
    "few",
    "arithmetic",
)  # what one name is of
DIGEST = 8  # hexadecimal digits that tell cut names apart


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


def check_limit(hours: float) -> None:
    """See that the hours of ``--limit`` can be waited for."""
    check(0 < hours <= LONGEST, "--limit", hours, f"a number of hours in (0, {LONGEST:g}]")


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
    return alpha_text(abs(value))  # -0 is 0


def folder_name(parts: list[str]) -> str:
    """A name that says its parts; a digest tells apart what is too long, or no name of a file."""
    text = "__".join(parts)
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", text)
    if name == text and len(name) <= LONGEST_NAME:
        return name
    digest = hashlib.sha256(text.encode()).hexdigest()[:DIGEST]
    return f"{name[: LONGEST_NAME - DIGEST - 1]}-{digest}"


def setting_texts(settings: dict[str, Any]) -> list[str]:
    """NAME=VALUE of every setting, as ``--set`` takes them, in the order of the names."""
    values = {n: str(v).lower() if isinstance(v, bool) else str(v) for n, v in sorted(settings.items())}
    return [f"{name}={value}" for name, value in values.items()]


def figures() -> dict[str, dict[str, str]]:
    """{figure: its notebook, text and, where it has one, study} of ``docs/figures.toml``."""
    found: dict[str, dict[str, str]] = tomllib.loads((ROOT / "docs" / "figures.toml").read_text("utf-8"))
    return found


def _command(
    arguments: argparse.Namespace,
    alphas: list[str],
    deltas: list[float],
    texts: list[str],
    steps: int | None,
    seeds: int,
    name: str,
) -> str:
    """The command line that gives a plan again, wherever its jobs run.

    Args:
        texts: of the settings; steps: None if they are the usual; name: "" if it follows from the rest.
    """
    words = ["./reproduce.sh", *(["--quick"] if arguments.quick else [])]
    words += [f"--{arguments.study}"] if arguments.study else []
    words += ["--alphas", *alphas] if alphas != ALPHAS else []
    words += ["--deltas", *(f"{delta:g}" for delta in deltas)] if arguments.deltas != DELTAS else []
    words += ["--seeds", str(seeds)] if seeds != SEEDS else []
    words += ["--steps", str(steps)] if steps is not None else []
    words += ["--set", *texts] if texts else []
    words += ["--name", name] if name else []
    return shlex.join(words)


def _names(
    arguments: argparse.Namespace,
    alphas: list[str],
    deltas: list[float],
    texts: list[str],
    steps: int,
    usual: int,
) -> dict[str, str]:
    """``cells``, ``look`` and ``name`` of the module; texts: of the settings; usual: steps if not varied."""
    settings = [text.replace("=", "-", 1) for text in texts]
    if arguments.study:
        base = f"{arguments.study}_quick" if arguments.quick else arguments.study
    else:
        base = "quick" if arguments.quick else "full"
    varied = [*([f"steps_{steps}"] if steps != usual or settings else []), *settings]
    cells = [base] if not varied else varied if not arguments.study else [base, *varied]
    grid = ["alphas_" + "_".join(alphas)] if alphas != ALPHAS else []
    if not arguments.study:
        grid += ["deltas_" + "_".join(f"{d:g}" for d in deltas)] if deltas != DELTAS else []
    seeds = [f"seeds_{arguments.seeds}"] if arguments.seeds != SEEDS else []
    parts = {"name": cells + grid + seeds, "look": cells + grid, "cells": cells}
    return {
        key: folder_name(words[1:] if len(words) > 1 and words[0] == "full" else words)
        for key, words in parts.items()
    }


def plan(arguments: argparse.Namespace) -> dict[str, Any]:
    """The workflow's configuration for a command line.

    Returns:
        A table. name, look, cells: see the module. alphas, deltas, seeds, steps: of the grid. settings: what
        is varied; values: of every parameter. note: what a figure must say of itself, "" of the full
        one; varied: the same of one that no training enters.
        study: its name, or ""; few: whether it has few universes. command: the command line that gives this
        plan again; look_command: one that gives what lies under ``look``, whatever the number of seeds.
        arithmetic: on which the results rest (`srlrepro.pins`). only: the notebook asked for, or "".

    Raises:
        ParameterError: a value that is not allowed.
    """
    alphas = [parse_alpha(text) for text in arguments.alphas]
    for delta in arguments.deltas:
        check(0 < delta < math.inf, "--deltas", delta, "finite numbers > 0")
    deltas = [float(f"{delta:g}") for delta in arguments.deltas]
    for option, values in (("--alphas", alphas), ("--deltas", deltas)):
        check(
            len(set(values)) == len(values), option, " ".join(map(str, values)), "different from each other"
        )
    regions = "joined by at least one number, for the figures of the regions"
    check(alphas != ["none"], "--alphas", "none", regions)
    check_whole("--seeds", arguments.seeds, 1, MOST_SEEDS)
    check_limit(arguments.limit)
    if arguments.cores is not None:
        check_whole("--cores", arguments.cores, 1)
    config = Config().with_values(**(settings := parse_settings(arguments.settings)))
    seeds, longest = arguments.seeds, config.choices.total_steps
    if arguments.study:
        alone = (alphas, deltas, settings, seeds) == (ALPHAS, DELTAS, {}, SEEDS)
        check(alone, f"--{arguments.study}", "another grid", "without one: it has its own")
        _, deltas, seeds, own = STUDIES[arguments.study]
        longest = longest if own is None else own
    usual = config.choices.quick_steps if arguments.quick else longest
    steps = usual if arguments.steps is None else arguments.steps
    check_whole("--steps", steps, 1)
    texts = setting_texts(settings)
    names = _names(arguments, alphas, deltas, texts, steps, usual)
    full = config.choices.total_steps
    notes = [f"reduced: {steps} of {full} training steps"] if steps < full else []
    notes += [f"longer: {steps} instead of {full} training steps"] if steps > full else []
    varied = f"varied: {', '.join(texts)}" if settings else ""
    only = ""
    if arguments.only is not None:
        known = figures()
        check(arguments.only in known, "--only", arguments.only, f"one of {', '.join(known)}")
        study = known[arguments.only].get("study", "")
        check(
            study == arguments.study,
            "--only",
            arguments.only,
            f"with --{study}" if study else "without a study",
        )
        only = known[arguments.only]["notebook"]
    own_name = "" if arguments.name in (None, names["name"]) else arguments.name
    command = partial(_command, arguments, alphas, deltas, texts, None if steps == usual else steps)
    planned = names | {
        "alphas": alphas,
        "deltas": deltas,
        "seeds": list(range(seeds)),
        "steps": steps,
        "settings": settings,
        "values": config.as_dict(),
        "varied": varied,
        "note": "; ".join([*notes, *([varied] if varied else [])]),
        "study": arguments.study,
        "few": arguments.quick and bool(arguments.study),
        "arithmetic": ARITHMETIC,
        "command": command(arguments.seeds, own_name),
        "look_command": command(arguments.seeds if own_name else SEEDS, own_name),
    }
    if own_name:
        check_name(own_name)
        check_is_free(planned | {"name": own_name})
        planned |= {"name": own_name, "look": own_name, "cells": own_name}
    return planned | {"only": only}


def check_is_free(planned: dict[str, Any]) -> None:
    """See that the folder of a plan with a name of its own holds no results of another plan.

    Raises:
        ParameterError: it does; they would be mixed, or taken for each other.
    """
    name = planned["name"]
    reserved = name in ("full", "quick", TESTS, *STUDIES) or name.startswith("seeds_")
    check(not reserved, "--name", name, "another name: results that are not varied have this one")
    for file in (ROOT / place / name / "workflow.json" for place in ("results", "figures")):
        try:
            found = read_set(file) if file.exists() else planned
        except ResultError as error:
            raise ParameterError(error) from error
        other = [key for key in DIFFERENT if found.get(key) != planned[key]]
        free = f"another name: {file.relative_to(ROOT)} is of another grid ({', '.join(other)} differ)"
        check(not other, "--name", name, free)
