"""The command line ``python -m srlrepro``: each stage by itself, and the tools around the results."""

import argparse
import json
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

from srlrepro.config import Choices, Config, Paper, ParameterError, check, parse_settings
from srlrepro.plan import Parser, check_name


def _alpha(text: str) -> float | None:
    return None if text == "none" else float(text)


_alpha.__name__ = "number in [0, 1], or none"  # what argparse says of a wrong value


def make_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = Parser(prog="python -m srlrepro", description=__doc__, allow_abbrev=False)
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=Parser)

    def command(name: str, function: Any, text: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text, allow_abbrev=False)
        sub.set_defaults(function=function)
        return sub

    def settings(sub: argparse.ArgumentParser) -> None:
        sub.add_argument(
            "--set",
            dest="settings",
            nargs="+",
            default=[],
            metavar="NAME=VALUE",
            help="vary parameters (see choices)",
        )

    sub = command("data", _data, "Sample and label the training data D_tr of one α.")
    sub.add_argument("--alpha", type=float, required=True, help="share of UD, in [0, 1]")
    sub.add_argument("--seed", type=int, default=0, help="seed of the samples (default: 0)")
    sub.add_argument("--out", type=Path, required=True, help="file to write (.npz)")
    settings(sub)

    sub = command("region", _region, "Learn Ψ, Γ and S_y from training data.")
    sub.add_argument("--data", type=Path, required=True, help="file that the command data wrote")
    sub.add_argument("--seed", type=int, default=0, help="seed of t-SNE (default: 0)")
    sub.add_argument("--out", type=Path, required=True, help="file to write (.npz)")
    settings(sub)

    sub = command("label", _label, "Print l(x) of one state and how K fares from it.")
    sub.add_argument(
        "--state", type=float, nargs=6, required=True, metavar="X", help="θ1 θ2 θ3 (rad) θ̇1 θ̇2 θ̇3 (rad/s)"
    )
    sub.add_argument(
        "--delta", type=float, default=1.0, help="mass mismatch Δ (default: 1, the nominal system: l_n)"
    )
    settings(sub)

    sub = command("train", _train, "Train one run; started again after a kill, it goes on.")
    sub.add_argument(
        "--alpha", type=_alpha, required=True, help="share of UD of the region, or none: no supervisor"
    )
    sub.add_argument("--delta", type=float, required=True, help="mass mismatch Δ > 0 of the real system")
    sub.add_argument("--seed", type=int, default=0, help="seed of the learner (default: 0)")
    sub.add_argument("--steps", type=int, help="training steps (default: total_steps)")
    sub.add_argument("--region", type=Path, help="file that the command region wrote; not with --alpha none")
    sub.add_argument(
        "--data", type=Path, help="instead: file that the command data wrote, to learn the hypothesis from"
    )
    sub.add_argument("--out", type=Path, required=True, help="folder to write")
    settings(sub)

    sub = command("execute", _execute, "Execute a parameterised notebook.")
    sub.add_argument("notebook", type=Path)
    sub.add_argument("output", type=Path)
    sub.add_argument("--parameters", default="{}", metavar="JSON", help="{NAME: value}, or @FILE with them")
    sub.add_argument("--results", type=Path, nargs="*", default=[], help="files that the notebook must write")

    sub = command(
        "snapshot", _snapshot, "Refresh the outputs that the tests of the source notebooks compare."
    )
    sub.add_argument(
        "notebooks", type=Path, nargs="+", help="in their order: later ones read what earlier ones write"
    )

    sub = command("import", _import, "Bring in finished runs that another checkout has trained.")
    sub.add_argument("folder", type=Path, help="the other checkout, or a copy of what it made")
    sub.add_argument("--name", required=True, help="results that lack them, such as full")

    sub = command("claims", _claims, "Evaluate the tests of the paper's claims on a folder of measures.")
    sub.add_argument("measures", type=Path, help="such as results/quick/measures")

    sub = command("provenance", _provenance, "Print what made a figure, back to the command that remakes it.")
    sub.add_argument("figure", type=Path, help="a figure, table or executed notebook of the results")

    command("crate", _crate, "Describe the results as a RO-Crate (ro-crate-metadata.json).")
    command("choices", _choices, "List every parameter with its value, allowed values and reason.")
    for document in ("readme", "report"):
        name = f"{document.upper()}.md"
        sub = command(document, _document, f"Render {name} from its template and the results.")
        sub.set_defaults(document=document)
        sub.add_argument(
            "--check", action="store_true", help=f"write nothing; exit with 1 if {name} is stale"
        )
    return parser


def _config(arguments: argparse.Namespace) -> Config:
    return Config().with_values(**parse_settings(arguments.settings))


def _data(arguments: argparse.Namespace) -> None:
    from srlrepro.sampling import generate

    data = generate(arguments.alpha, _config(arguments), arguments.seed)
    data.save(arguments.out)
    print(f"{len(data.x)} states, {data.n_ud} of them from UD, {data.z.mean():.3f} safe: {arguments.out}")


def _region(arguments: argparse.Namespace) -> None:
    from srlrepro.safe_region import learn
    from srlrepro.sampling import TrainingData

    config = _config(arguments)
    _require_tsne(config, "--out", arguments.out)
    region = learn(TrainingData.load(arguments.data), config, arguments.seed)
    region.save(arguments.out)
    print(f"Γ at the origin is {region.safety([[0.0] * 6])[0]:.3f}, p_t is {region.p_t}: {arguments.out}")


def _label(arguments: argparse.Namespace) -> None:
    from srlrepro.labels import OUTCOMES, ClosedLoop

    rollout = ClosedLoop.from_config(_config(arguments), arguments.delta).rollout(
        [arguments.state], record=False
    )
    print(f"l(x) = {rollout.labels[0]}: {OUTCOMES[int(rollout.outcomes[0])]}, {rollout.durations[0]:.2f} s")


def _require_tsne(config: Config, name: str, value: object) -> None:
    """Refuse files of regions where another hypothesis is asked for."""
    kind = config.choices.hypothesis
    check(kind == "tsne", name, value, f"left out: hypothesis = {kind} is learned afresh, by train --data")


def _hypothesis(arguments: argparse.Namespace, config: Config) -> Any:
    """The hypothesis of a run, if its command line gives what it takes."""
    from srlrepro.hypotheses import ORACLES, learn
    from srlrepro.safe_region import SafeRegion
    from srlrepro.sampling import TrainingData

    data, region = arguments.data, arguments.region
    if region is not None:
        check(data is None, "--data", data, "left out with --region")
        _require_tsne(config, "--region", region)
        return SafeRegion.load(region)
    oracle = arguments.alpha is not None and config.choices.hypothesis in ORACLES
    if data is None and not oracle:
        return None
    return learn(None if data is None else TrainingData.load(data), config, delta=arguments.delta)


def _train(arguments: argparse.Namespace) -> None:
    from srlrepro.training import Run, train

    config = _config(arguments)
    steps = config.choices.total_steps if arguments.steps is None else arguments.steps
    run = Run(arguments.alpha, arguments.delta, arguments.seed, steps)
    region = _hypothesis(arguments, config)
    result = train(run, config, region, arguments.out, arguments.out / "checkpoint.zip")
    print(json.dumps({"counts": result["counts"], "final_policy": result["final_policy"]}, indent=1))


def _execute(arguments: argparse.Namespace) -> None:
    from srlrepro.files import read_json
    from srlrepro.notebooks import execute

    text = arguments.parameters
    try:
        parameters = read_json(Path(text[1:])) if text.startswith("@") else json.loads(text)
    except json.JSONDecodeError as error:
        raise ParameterError(f"--parameters: not JSON: {error}") from None
    results = [path for path in arguments.results if path != arguments.output]
    execute(arguments.notebook, arguments.output, parameters, results)


def _snapshot(arguments: argparse.Namespace) -> None:
    from srlrepro.notebooks import snapshot

    for notebook in arguments.notebooks:
        snapshot(notebook)


def _claims(arguments: argparse.Namespace) -> None:
    from srlrepro.claims import judge, load
    from srlrepro.evaluation import read_measures

    measures = read_measures(arguments.measures)
    summary, contrasts = judge(load(), measures)
    print(
        contrasts.to_string(index=False), summary[["id", "n", "verdict"]].to_string(index=False), sep="\n\n"
    )


def _provenance(arguments: argparse.Namespace) -> None:
    from srlrepro.tracing import trace

    print(trace(arguments.figure))


def _crate(arguments: argparse.Namespace) -> None:
    from srlrepro.crate import write

    print(f"written: {write()}")


def _import(arguments: argparse.Namespace) -> None:
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


def _choices(arguments: argparse.Namespace) -> None:
    for part, source in ((Paper, "place"), (Choices, "reason")):
        for f in fields(part):
            m = f.metadata
            unit = f" {m['unit']}" if m["unit"] else ""
            print(f"{f.name} = {f.default}{unit}, in {m['allowed']}: {m['meaning']} ({m[source]})")


def _document(arguments: argparse.Namespace) -> None:
    from srlrepro import readme, report

    document = {d.command: d for d in (readme.DOCUMENT, report.DOCUMENT)}[arguments.document]
    if arguments.check:
        document.check()
        return
    if document is readme.DOCUMENT:
        readme.keep_times()
    document.write()


def main(argv: list[str] | None = None) -> int:
    """Run a command; wrong use gives one line and 2, a missing or broken result one line and 1."""
    parser = make_parser()
    arguments = parser.parse_args(argv)
    try:
        arguments.function(arguments)
    except ParameterError as error:
        parser.error(str(error))
    except Exception as error:
        from srlrepro.files import ResultError

        if not isinstance(error, ResultError):
            raise
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
