"""The command line ``python -m srlrepro``: each stage of the method by itself.

Slow imports wait in the functions, so that a wrong command line is refused at once.
"""

import argparse
import json
import math
import sys
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

from srlrepro.settings.choices import Choices
from srlrepro.command_line import Parser, add_settings, path, run, subcommands
from srlrepro.settings.config import Config, parse_settings
from srlrepro.settings.fields import check, check_whole
from srlrepro.settings.paper import Paper

MOST_SEED = 2**32 - 1  # that numpy's global generator and scikit-learn take


def _config(arguments: argparse.Namespace) -> Config:
    return Config().with_values(**parse_settings(arguments.settings))


def data(arguments: argparse.Namespace) -> None:
    """Sample and label the training data of one α."""
    from srlrepro.samplers import generate

    data = generate(arguments.alpha, _config(arguments), arguments.seed)
    data.save(arguments.out)
    print(f"{len(data.x)} states, {data.n_ud} of them from UD, {data.z.mean():.3f} safe: {arguments.out}")


def region(arguments: argparse.Namespace) -> None:
    """Learn Ψ, Γ and S_y from a file of training data."""
    from srlrepro.region.safe_region import learn_region

    config = _config(arguments)
    region = learn_region(load_training_data(arguments.data), config, arguments.seed)
    region.save(arguments.out)
    print(f"Γ at the origin is {region.safety([[0.0] * 6])[0]:.3f}, p_t is {region.p_t}: {arguments.out}")


def label(arguments: argparse.Namespace) -> None:
    """Print l(x) of one state and how K fares from it."""
    from srlrepro.dynamics.closed_loop import OUTCOMES, ClosedLoop

    for value in arguments.state:
        check(math.isfinite(value), "--state", value, "finite numbers (rad, rad/s)")
    rollout = ClosedLoop.from_config(_config(arguments), arguments.delta).rollout(
        [arguments.state], record=False
    )
    print(f"l(x) = {rollout.labels[0]}: {OUTCOMES[int(rollout.outcomes[0])]}, {rollout.durations[0]:.2f} s")


def load_training_data(path: Path) -> Any:
    """The training data of a file that may come from elsewhere: labelled states, at least two."""
    import numpy as np

    from srlrepro.dynamics.pendulum import as_states
    from srlrepro.samplers import TrainingData
    from srlrepro.storage.files import ResultError

    try:
        data = TrainingData.load(path)
        labelled = data.z.shape == (len(as_states(data.x)),) and bool(np.isin(data.z, (0, 1)).all())
    except (ValueError, TypeError) as error:
        raise ResultError(f"{path} holds no labelled states: {error}") from error
    if not labelled or len(data.z) < 2:
        raise ResultError(f"{path} holds no labelled states")
    return data


def _region(arguments: argparse.Namespace, config: Config) -> Any:
    """The region of a run, from its file; None without a supervisor."""
    from srlrepro.region.safe_region import SafeRegion

    kind, file = config.choices.hypothesis, arguments.region
    check(
        kind == "tsne", "hypothesis", kind, "tsne here; ./reproduce.sh --hypotheses trains under the others"
    )
    if arguments.alpha is None:
        check(file is None, "--region", file, "left out with --alpha none")
        return None
    check(file is not None, "--region", file, "given, unless --alpha is none")
    return SafeRegion.load(file)


def train(arguments: argparse.Namespace) -> None:
    """Train one run, or go on with one from its checkpoint, if that is trusted."""
    from srlrepro.learner import training

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
    region = _region(arguments, config)
    result = training.train(run, config, region, arguments.out, checkpoint)
    print(json.dumps({"counts": result["counts"], "final_policy": result["final_policy"]}, indent=1))


def list_choices(arguments: argparse.Namespace) -> None:
    """Print every parameter."""
    for part, source in ((Paper, "place"), (Choices, "reason")):
        for f in fields(part):
            m = f.metadata
            unit = f" {m['unit']}" if m["unit"] else ""
            print(f"{f.name} = {f.default}{unit}, in {m['allowed']}: {m['meaning']} ({m[source]})")


def make_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = Parser(prog="python -m srlrepro", description=__doc__, allow_abbrev=False)
    parser.add_argument("--version", action="version", version=f"srlrepro {version('srlrepro')}")
    command = subcommands(parser)
    sub = command("data", data, "Sample and label the training data D_tr of one α.")
    sub.add_argument("--alpha", type=float, required=True, help="share of UD, in [0, 1]")
    sub.add_argument("--seed", type=int, default=0, help="seed of the samples (default: 0)")
    sub.add_argument("--out", type=path, required=True, help="file to write (.npz)")
    add_settings(sub)

    sub = command("region", region, "Learn Ψ, Γ and S_y from training data.")
    sub.add_argument("--data", type=path, required=True, help="file that the command data wrote")
    sub.add_argument("--seed", type=int, default=0, help="seed of t-SNE (default: 0)")
    sub.add_argument("--out", type=path, required=True, help="file to write (.npz)")
    add_settings(sub)

    sub = command("label", label, "Print l(x) of one state and how K fares from it.")
    sub.add_argument(
        "--state", type=float, nargs=6, required=True, metavar="X", help="θ1 θ2 θ3 (rad) θ̇1 θ̇2 θ̇3 (rad/s)"
    )
    sub.add_argument(
        "--delta", type=float, default=1.0, help="mass mismatch Δ (default: 1, the nominal system: l_n)"
    )
    add_settings(sub)

    sub = command(
        "train",
        train,
        "Train one run; started again with --trust-checkpoint after a kill, it goes on.",
    )
    sub.add_argument(
        "--alpha", type=str, required=True, help="share of UD of the region, or none: no supervisor"
    )
    sub.add_argument("--delta", type=float, required=True, help="mass mismatch Δ > 0 of the real system")
    sub.add_argument("--seed", type=int, default=0, help="seed of the learner (default: 0)")
    sub.add_argument("--steps", type=int, help="training steps (default: total_steps)")
    sub.add_argument("--region", type=path, help="file that the command region wrote; not with --alpha none")
    sub.add_argument(
        "--data", type=path, help="instead: file that the command data wrote, to learn the hypothesis from"
    )
    sub.add_argument("--out", type=path, required=True, help="folder to write")
    sub.add_argument(
        "--trust-checkpoint",
        action="store_true",
        help="go on from checkpoint.zip in the folder: it holds pickles of stable-baselines3, which can run "
        "any code as they are read, so only if you or this program wrote it",
    )
    add_settings(sub)

    command("choices", list_choices, "List every parameter with its value, allowed values and reason.")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    return run(make_parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
