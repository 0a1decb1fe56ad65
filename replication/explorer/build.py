"""The page: data of regions, policies and test states, put into the templates beside this module."""

import json
from base64 import b64encode
from dataclasses import asdict
from pathlib import Path
from typing import Any

import jinja2
import matplotlib as mpl
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from replication.evidence.results import require_same
from replication.explorer.equations import motion
from replication.plots import style
from replication.policies import Policy, Region, cards, read
from replication.studies.designs import CALIBRATED
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.learner.policy import TrainedPolicy
from srlrepro.region.mapping import FAR, Network
from srlrepro.region.safe_region import SafeRegion
from srlrepro.samplers import sample_uniform, visited_states
from srlrepro.settings.condition import alpha_text
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check
from srlrepro.storage.files import ResultError, beside, read_table
from srlrepro.storage.made_of import require_made_of

ROOM = Path(__file__).parent
DELTAS = np.round(
    np.arange(1.0, 4.05, 0.1), 1
)  # of the slider: from the nominal system to the paper's largest Δ
TEST_STATES = 1000  # of each kind: precision and recall to within three per cent
TEST_SEED = 1  # regions are learned with 0
CURVE_POINTS = 100  # of a learning curve: a point is some two pixels wide
SHADES = 33  # of the colours of Γ

Floats = NDArray[np.float64]


def pack(values: ArrayLike, kind: str = "float64") -> dict[str, str]:
    """An array in base64, little end first, for `unpack` of the page."""
    array = np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<"))
    return {"kind": kind, "base64": b64encode(array.tobytes()).decode()}


def physics(config: Config) -> dict[str, Any]:
    """System, K, rule and task: every number that the simulation needs."""
    loop, paper, choices = ClosedLoop.from_config(config), config.paper, config.choices
    masses = np.array([ClosedLoop.from_config(config, delta).system.masses for delta in (1.0, 2.0)])
    system = {"masses": masses[0].tolist(), "masses_per_delta": (masses[1] - masses[0]).tolist()}
    system |= {"lengths": list(loop.system.lengths), "gravity": loop.system.gravity}
    (a, b), k = loop.controller.model, loop.controller
    gains = {"a": a, "b": b, "gain": k.gain, "filter_gain": k.filter_gain}
    controller = {name: m.tolist() for name, m in gains.items()} | {"torque_limit": k.torque_limit}
    names = (
        "circle_height",
        "circle_radius",
        "circle_speed",
        "reward_constant",
        "reward_slope",
        "torque_limit",
    )
    task = {name: getattr(paper, name) for name in names}
    unit = paper.state_max if choices.observation == "scaled" else np.ones(len(paper.state_max))
    task |= {
        "action_unit": choices.action_unit,
        "control_period": choices.control_period,
        "scale": list(unit),
    }
    task |= {"periods": round(choices.trial_length / choices.control_period)}
    rule = asdict(loop.rule) | {"periods": loop.rule.periods}
    return {"system": system, "k": controller, "task": task, "rule": rule}


def arms(region: SafeRegion) -> dict[str, SafeRegion]:
    """The region as it was learned, and with the Ψ and Γ of the calibrated study on the same y_i."""
    calibrated = SafeRegion(**region.get_params() | CALIBRATED)
    states = region.arrays_.x_train.T * region.arrays_.scale
    return {
        "as written": region,
        "calibrated": calibrated.fit_embedding(states, region.labels_, region.embedding_),
    }


def arm_data(region: SafeRegion) -> dict[str, Any]:
    """Ψ and Γ of an arm, without what the arms of a region share; ``network``: None by neighbours."""
    a = region.arrays_
    named = zip(Network._fields, a.network, strict=True)
    network = {name: pack(part) for name, part in named} if a.network.first.size else None
    gamma = {"grid": pack(a.gamma), "origin": a.origin.tolist(), "cell": a.cell}
    gamma |= {"empty": a.empty, "cells": len(a.gamma)}
    told = {"neighbours": a.neighbours, "evidence": region.gamma_evidence}
    return told | {"network": network, "gamma": gamma}


def region_data(region: SafeRegion) -> dict[str, Any]:
    """A region for the page: its training states, and Ψ and Γ of each of its `arms`."""
    a = region.arrays_
    states = {"x_train": pack(a.x_train), "y_train": pack(a.y_train), "labels": pack(region.labels_, "uint8")}
    shared = {"scale": a.scale.tolist(), "far": FAR, "p_t": region.p_t}
    return states | shared | {"arms": {name: arm_data(arm) for name, arm in arms(region).items()}}


def test_states(config: Config) -> dict[str, Any]:
    """States that no region has seen, of two kinds, with their labels at each of `DELTAS`."""
    rng, high = np.random.default_rng(TEST_SEED), config.paper.state_max
    visited = visited_states(config, rng)
    chosen = visited[rng.choice(len(visited), TEST_STATES, replace=len(visited) < TEST_STATES)]
    kinds = {"uniform": sample_uniform(TEST_STATES, high, rng), "random policy": chosen}
    found = {}
    for name, drawn in kinds.items():
        x = drawn.astype(np.float32).astype(np.float64)  # the page holds them in single precision
        labels = [ClosedLoop.from_config(config, float(delta)).predict(x) for delta in DELTAS]
        found[name] = {"x": pack(x, "float32"), "labels": pack(labels, "uint8")}
    return found


def figure_3(folder: Path) -> dict[str, Any]:
    """The curves and counts of Fig. 3, from the tables of its figures."""
    curves = read_table(folder / "fig3_abc_learning.csv", ("alpha", "delta", "seed", "step"), text=("alpha",))
    counts = read_table(folder / "fig3_def_counts.csv", ("alpha", "delta", "seed"), text=("alpha",))
    curves = curves.assign(bin=(CURVE_POINTS * (curves["step"] - 1)) // curves["step"].max())
    panels = []
    for delta in sorted(counts["delta"].unique()):
        panel: dict[str, Any] = {"delta": delta, "curves": {}, "counts": {}}
        for alpha, group in curves[curves["delta"] == delta].groupby("alpha"):
            seeds = group.pivot_table(index="bin", columns="seed", values="mean_return")
            step = group.groupby("bin")["step"].max()
            rows = {
                "step": step,
                "mean": seeds.mean(axis=1),
                "low": seeds.min(axis=1),
                "high": seeds.max(axis=1),
            }
            panel["curves"][alpha] = {name: _short(row) for name, row in rows.items()}
        for alpha, group in counts[counts["delta"] == delta].groupby("alpha"):
            named = {n: group[n] for n in ("activations", "failures", "falls")}
            panel["counts"][alpha] = {
                n: {"mean": float(c.mean()), "seeds": c.tolist()} for n, c in named.items()
            }
        panels.append(panel)
    return {"panels": panels, "seeds": int(counts["seed"].nunique())}


def _short(row: pd.Series) -> list[float]:
    """Values to six digits, which is finer than a pixel."""
    return [float(f"{value:.6g}") for value in row]


def actor_data(actor: TrainedPolicy) -> dict[str, Any]:
    """A policy for the page."""
    pairs = zip(actor.weights, actor.biases, strict=True)
    layers = [{"weights": pack(w, "float32"), "biases": pack(b, "float32")} for w, b in pairs]
    c = actor.condition
    named = {} if c is None else {"alpha": c.alpha_text, "delta": c.delta, "seed": c.seed}
    return named | {"layers": layers, "log_std": actor.log_std.tolist()}


def colours() -> dict[str, Any]:
    """The colours of the house, by their meaning."""
    names = (
        "SAFE",
        "UNSAFE",
        "BORDER",
        "CORRECTIVE",
        "TRACE",
        "LINK",
        "TARGET",
        "GROUND",
        "INK",
        "BACKGROUND",
    )
    shades = mpl.colormaps[style.GAMMA_MAP](np.linspace(0, 1, SHADES))
    gamma = [[round(float(255 * part)) for part in shade[:3]] for shade in shades]
    return {n.lower(): getattr(style, n) for n in names} | {"conditions": style.CONDITIONS, "gamma": gamma}


def collect(folder: Path, figures: Path) -> dict[str, Any]:
    """All data of the page.

    Args:
        folder: with regions and policies; of each condition the first seed is taken, of each α its dataset.
        figures: with the tables of Fig. 3.

    Raises:
        ParameterError: a region was made with other values than the policies, or with weights, which it
            does not keep, so that it cannot be calibrated.
        ResultError: there are no regions or no policies, a policy was trained with other values than the
            first one, or a file is missing or damaged.
    """
    items = [read(path) for paths in cards(folder).values() for path in paths]
    regions = [item for item in items if isinstance(item, Region)]
    policies = [item for item in items if isinstance(item, Policy)]
    for name, found in (("regions", regions), ("policies", policies)):
        if not found:
            raise ResultError(f"{folder} holds no {name}: run python -m replication policies first")
    config = policies[0].run.config
    for policy in policies:
        require_same(policy.run, config)
    for region in regions:
        require_made_of(region.made_of, config, "region", where=region.path)
    weights = config.choices.gamma_weights
    check(weights == "none", "gamma_weights", weights, "none, since a region keeps no weights")
    own = {alpha_text(r.made_of.alpha): r for r in sorted(regions, key=lambda r: -r.made_of.seed)}
    first = {policy.card: policy for policy in sorted(policies, key=lambda p: -p.run.condition.seed)}
    return physics(config) | {
        "regions": {alpha: region_data(own[alpha].region) for alpha in sorted(own)},
        "actors": [actor_data(first[card].arrays) for card in sorted(first)],
        "test": test_states(config),
        "deltas": DELTAS.tolist(),
        "state_max": list(config.paper.state_max),
        "figure_3": figure_3(figures),
        "colours": colours(),
    }


def model_source(links: int) -> str:
    """The simulation in JavaScript, which Node can load too."""
    return f'"use strict";\n\n{motion(links)}\n\n{(ROOM / "model.js").read_text(encoding="utf-8")}'


def render(data: dict[str, Any]) -> str:
    """The page."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(ROOM), undefined=jinja2.StrictUndefined, keep_trailing_newline=True
    )
    text = json.dumps(data, ensure_ascii=False, allow_nan=False).replace("</", "<\\/")  # ends no script
    parts = {name: (ROOM / name).read_text(encoding="utf-8") for name in ("page.css", "page.js")}
    model = model_source(len(data["system"]["lengths"]))
    return environment.get_template("page.html").render(
        css=parts["page.css"], model=model, page=parts["page.js"], data=text, colours=data["colours"]
    )


def write(path: Path, data: dict[str, Any]) -> None:
    """Write the page to a file."""
    text = render(data)
    with beside(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
