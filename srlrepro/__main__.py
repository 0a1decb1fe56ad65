"""The command line ``python -m srlrepro``: each stage of the method by itself.

Slow imports wait in the functions, so that a wrong command line is refused at once.
"""

import argparse
import json
import math
import sys
from importlib.metadata import version
from typing import Any

from srlrepro import pins
from srlrepro.command_line import Parser, add_settings, path, run, subcommands
from srlrepro.settings.condition import MOST_SEED, parse_alpha
from srlrepro.settings.config import PARAMETERS, Config, parse_settings
from srlrepro.settings.fields import STAGES, check, check_whole


def _config(arguments: argparse.Namespace) -> Config:
    return Config().with_values(**parse_settings(arguments.settings))


def _seed(arguments: argparse.Namespace) -> int:
    check_whole("--seed", arguments.seed, 0, MOST_SEED)
    return int(arguments.seed)


def data(arguments: argparse.Namespace) -> None:
    """Sample and label the training data of one α."""
    from srlrepro.samplers import generate

    alpha = parse_alpha(arguments.alpha, "--alpha")
    check(alpha is not None, "--alpha", arguments.alpha, "a number in [0, 1]")
    assert alpha is not None
    data = generate(alpha, _config(arguments), _seed(arguments))
    data.save(arguments.out)
    print(f"{len(data.x)} states, {data.n_ud} of them from UD, {data.z.mean():.3f} safe: {arguments.out}")


def region(arguments: argparse.Namespace) -> None:
    """Learn Ψ, Γ and S_y from a file of training data."""
    from srlrepro.region.safe_region import learn_region
    from srlrepro.samplers import TrainingData
    from srlrepro.storage.made_of import require_made_of

    config, seed = _config(arguments), _seed(arguments)
    data = TrainingData.load(arguments.data)
    require_made_of(data.made_of, config, "data", where=arguments.data)
    region = learn_region(data, config, seed)
    region.save(arguments.out)
    safety = region.safety([0.0] * region.n_features_in_)[0]
    print(f"Γ at the origin is {safety:.3f}, p_t is {region.p_t}: {arguments.out}")


def label(arguments: argparse.Namespace) -> None:
    """Print l(x) of one state and how K fares from it."""
    from srlrepro.dynamics.closed_loop import OUTCOMES, ClosedLoop

    config, state = _config(arguments), arguments.state
    for value in state:
        check(math.isfinite(value), "--state", value, "finite numbers (rad, rad/s)")
    links = config.paper.links
    check(len(state) == 2 * links, "--state", state, f"{2 * links} numbers, as links = {links}")
    loop = ClosedLoop.from_config(config, arguments.delta)
    rollout = loop.rollout([state], record=False)
    print(f"l(x) = {rollout.labels[0]}: {OUTCOMES[int(rollout.outcomes[0])]}, {rollout.durations[0]:.2f} s")


def _region(arguments: argparse.Namespace, alpha: float | None, config: Config) -> Any:
    """The region of a run, from its file; None without a supervisor."""
    kind, file = config.choices.hypothesis, arguments.region
    others = f"tsne here; ./reproduce.sh --set hypothesis={kind} trains under it"
    check(kind == "tsne", "hypothesis", kind, others)
    if alpha is None:
        check(file is None, "--region", file, "left out with --alpha none")
        return None
    check(file is not None, "--region", file, "given, unless --alpha is none")
    from srlrepro.region.safe_region import SafeRegion
    from srlrepro.storage.made_of import require_made_of

    region = SafeRegion.load(file)
    require_made_of(region.made_of_, config, "region", where=file, alpha=alpha)
    return region


def train(arguments: argparse.Namespace) -> None:
    """Train one run, or go on with one from its checkpoint."""
    from srlrepro.learner import training

    config, alpha = _config(arguments), parse_alpha(arguments.alpha, "--alpha")
    steps = config.choices.total_steps if arguments.steps is None else arguments.steps
    run = training.Run(alpha, arguments.delta, _seed(arguments), steps)
    checkpoint = arguments.out / "checkpoint.zip"
    result = training.train(run, config, _region(arguments, alpha, config), arguments.out, checkpoint)
    print(json.dumps({"counts": result["counts"], "final_policy": result["final_policy"]}, indent=1))


def list_choices(arguments: argparse.Namespace) -> None:
    """Print every parameter, in groups: who states it, and what depends on it."""
    for source, title in (("place", "Stated by the paper"), ("reason", "Chosen where the paper is open")):
        print(f"{title}\n{'=' * len(title)}")
        for stage, results in STAGES.items():
            found = [f for f in PARAMETERS.values() if source in f.metadata and f.metadata["stage"] == stage]
            if found:
                print(f"\n{stage}: changes {results}")
            for f in found:
                m, value = f.metadata, f"{f.default} {f.metadata['unit']}".rstrip()
                print(f"  {f.name} = {value}, in {m['allowed']}\n      {m['meaning']} ({m[source]})")
        print()


def make_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = Parser(prog="python -m srlrepro", description=__doc__, allow_abbrev=False)
    parser.add_argument("--version", action="version", version=f"srlrepro {version('srlrepro')}")
    command = subcommands(parser)
    sub = command("data", data, "Sample and label the training data D_tr of one α.")
    sub.add_argument("--alpha", required=True, help="share of UD, in [0, 1]")
    sub.add_argument("--seed", type=int, default=0, help="seed of the samples (default: 0)")
    sub.add_argument("--out", type=path, required=True, help="file to write (.npz)")
    add_settings(sub)

    sub = command("region", region, "Learn Ψ, Γ and S_y from training data.")
    sub.add_argument("--data", type=path, required=True, help="file that the command data wrote")
    sub.add_argument("--seed", type=int, default=0, help="seed of t-SNE (default: 0)")
    sub.add_argument("--out", type=path, required=True, help="file to write (.npz)")
    add_settings(sub)

    sub = command("label", label, "Print l(x) of one state and how K fares from it.")
    state = "angles θ1 θ2 θ3 (rad), then rates θ̇1 θ̇2 θ̇3 (rad/s); 2n numbers with --set links=n"
    sub.add_argument("--state", type=float, nargs="+", required=True, metavar="X", help=state)
    text = "mass mismatch Δ (default: 1, the nominal system: l_n)"
    sub.add_argument("--delta", type=float, default=1.0, help=text)
    add_settings(sub)

    sub = command("train", train, "Train one run; started again after a kill, it goes on.")
    sub.add_argument("--alpha", required=True, help="share of UD of the region, or none: no supervisor")
    sub.add_argument("--delta", type=float, required=True, help="mass mismatch Δ > 0 of the real system")
    sub.add_argument("--seed", type=int, default=0, help="seed of the learner (default: 0)")
    sub.add_argument("--steps", type=int, help="training steps (default: total_steps)")
    sub.add_argument("--region", type=path, help="file that the command region wrote; not with --alpha none")
    sub.add_argument("--out", type=path, required=True, help="folder to write, or to go on in")
    add_settings(sub)

    command("choices", list_choices, "List every parameter with its value, allowed values and reason.")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    return run(make_parser(), argv)


if __name__ == "__main__":
    pins.pin("python -m srlrepro")
    sys.exit(main())
