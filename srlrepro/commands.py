"""What ``python -m srlrepro COMMAND`` does; each function takes the parsed command line.

Slow imports wait in the functions, so that a wrong command line is refused at once.
"""

import argparse
import json
import math
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

from srlrepro.config import Choices, Config, Paper, ParameterError, check, parse_settings
from srlrepro.parameters import one_line
from srlrepro.plan import check_limit, check_name, check_whole


def _config(arguments: argparse.Namespace) -> Config:
    return Config().with_values(**parse_settings(arguments.settings))


def data(arguments: argparse.Namespace) -> None:
    """Sample and label the training data of one α."""
    from srlrepro.sampling import generate

    data = generate(arguments.alpha, _config(arguments), arguments.seed)
    data.save(arguments.out)
    print(f"{len(data.x)} states, {data.n_ud} of them from UD, {data.z.mean():.3f} safe: {arguments.out}")


def region(arguments: argparse.Namespace) -> None:
    """Learn Ψ, Γ and S_y from a file of training data."""
    from srlrepro.safe_region import learn

    config = _config(arguments)
    _require_tsne(config, "--out", arguments.out)
    region = learn(load_training_data(arguments.data), config, arguments.seed)
    region.save(arguments.out)
    print(f"Γ at the origin is {region.safety([[0.0] * 6])[0]:.3f}, p_t is {region.p_t}: {arguments.out}")


def label(arguments: argparse.Namespace) -> None:
    """Print l(x) of one state and how K fares from it."""
    from srlrepro.labels import OUTCOMES, ClosedLoop

    for value in arguments.state:
        check(math.isfinite(value), "--state", value, "finite numbers (rad, rad/s)")
    rollout = ClosedLoop.from_config(_config(arguments), arguments.delta).rollout(
        [arguments.state], record=False
    )
    print(f"l(x) = {rollout.labels[0]}: {OUTCOMES[int(rollout.outcomes[0])]}, {rollout.durations[0]:.2f} s")


def load_training_data(path: Path) -> Any:
    """The training data of a file that may come from elsewhere: labelled states, at least two."""
    import numpy as np

    from srlrepro.files import ResultError
    from srlrepro.pendulum import as_states
    from srlrepro.sampling import TrainingData

    try:
        data = TrainingData.load(path)
        labelled = data.z.shape == (len(as_states(data.x)),) and bool(np.isin(data.z, (0, 1)).all())
    except (ValueError, TypeError) as error:
        raise ResultError(f"{path} holds no labelled states: {error}") from error
    if not labelled or len(data.z) < 2:
        raise ResultError(f"{path} holds no labelled states")
    return data


def _require_tsne(config: Config, name: str, value: object) -> None:
    """Refuse files of regions where another hypothesis is asked for."""
    kind = config.choices.hypothesis
    check(kind == "tsne", name, value, f"left out: hypothesis = {kind} is learned afresh, by train --data")


def _hypothesis(arguments: argparse.Namespace, config: Config) -> Any:
    """The hypothesis of a run, if its command line gives what it takes."""
    from srlrepro.hypotheses import ORACLES, learn
    from srlrepro.safe_region import SafeRegion

    data, region = arguments.data, arguments.region
    if arguments.alpha is None:
        check(data is None and region is None, "--alpha", "none", "a number with --region or --data")
        return None
    if region is not None:
        check(data is None, "--data", data, "left out with --region")
        _require_tsne(config, "--region", region)
        return SafeRegion.load(region)
    if data is None and config.choices.hypothesis not in ORACLES:
        return None
    return learn(None if data is None else load_training_data(data), config, delta=arguments.delta)


def train(arguments: argparse.Namespace) -> None:
    """Train one run, or go on with one from its checkpoint, if that is trusted."""
    from srlrepro import training

    config = _config(arguments)
    steps = config.choices.total_steps if arguments.steps is None else arguments.steps
    check_whole("steps", steps, 1)
    run = training.Run(arguments.alpha, arguments.delta, arguments.seed, steps)
    checkpoint = arguments.out / "checkpoint.zip"
    if checkpoint.is_file() and not arguments.trust_checkpoint:
        ways = (
            "without a checkpoint, or with --trust-checkpoint (its pickles can run any code as they are read)"
        )
        check(False, "--out", arguments.out, ways)
    region = _hypothesis(arguments, config)
    result = training.train(run, config, region, arguments.out, checkpoint)
    print(json.dumps({"counts": result["counts"], "final_policy": result["final_policy"]}, indent=1))


def execute(arguments: argparse.Namespace) -> None:
    """Execute a parameterised notebook."""
    from srlrepro import notebooks
    from srlrepro.files import parse_json, read_json

    text = arguments.parameters
    try:
        parameters = read_json(Path(text[1:])) if text.startswith("@") else parse_json(text)
    except ValueError as error:
        raise ParameterError(
            f"--parameters = {one_line(text)}: must be JSON, or @ and a file with it ({error})"
        ) from None
    results = [path for path in arguments.results if path != arguments.output]
    check_limit(arguments.limit)
    notebooks.execute(arguments.notebook, arguments.output, parameters, results, arguments.limit * 3600)


def snapshot(arguments: argparse.Namespace) -> None:
    """Refresh the outputs that the tests of source notebooks compare."""
    from srlrepro import notebooks

    for notebook in arguments.notebooks:
        notebooks.snapshot(notebook)


def claims(arguments: argparse.Namespace) -> None:
    """Print contrasts and verdicts for a folder of measures."""
    from srlrepro.claims import MEASURE_COLUMNS, judge, load
    from srlrepro.evaluation import read_measures
    from srlrepro.files import read_table

    files = sorted(arguments.measures.glob("*.csv"))
    check(bool(files), "MEASURES", arguments.measures, "a folder with tables of measures (.csv)")
    for path in files:
        read_table(path, MEASURE_COLUMNS, numbers=("delta", "seed", "value"))
    measures = read_measures(arguments.measures)
    summary, contrasts = judge(load(), measures)
    print(
        contrasts.to_string(index=False), summary[["id", "n", "verdict"]].to_string(index=False), sep="\n\n"
    )


def provenance(arguments: argparse.Namespace) -> None:
    """Print what made a figure."""
    from srlrepro.tracing import trace

    print(trace(arguments.figure))


def crate(arguments: argparse.Namespace) -> None:
    """Describe the results as a RO-Crate."""
    from srlrepro.crate import write

    print(f"written: {write()}")


def import_runs(arguments: argparse.Namespace) -> None:
    """Bring in finished runs of another checkout; leaves with 1 if any was refused."""
    from srlrepro.importing import bring_in, mark_finished
    from srlrepro.reproduce import ROOT, only_one

    check_name(arguments.name)
    check(arguments.folder.is_dir(), "FOLDER", arguments.folder, "a folder")
    with only_one():
        notebooks, refused = bring_in(arguments.folder, arguments.name, ROOT)
        mark_finished(notebooks, arguments.name, ROOT)
    print(*(f"refused {run}: {reason}\n" for run, reason in refused.items()), sep="", end="")
    print(f"{len(notebooks)} runs brought in, {len(refused)} refused")
    if refused:
        sys.exit(1)


def list_choices(arguments: argparse.Namespace) -> None:
    """Print every parameter."""
    for part, source in ((Paper, "place"), (Choices, "reason")):
        for f in fields(part):
            m = f.metadata
            unit = f" {m['unit']}" if m["unit"] else ""
            print(f"{f.name} = {f.default}{unit}, in {m['allowed']}: {m['meaning']} ({m[source]})")


def render(arguments: argparse.Namespace) -> None:
    """Render README.md or REPORT.md from its template and the results."""
    from srlrepro import readme, report

    document = {d.command: d for d in (readme.DOCUMENT, report.DOCUMENT)}[arguments.document]
    if arguments.check:
        document.check()
        return
    if document is readme.DOCUMENT:
        readme.keep_times()
    document.write()
