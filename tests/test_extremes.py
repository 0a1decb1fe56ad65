"""Every parameter at the ends of what is allowed: a result of finite numbers, or a refusal in one line."""

import io
import json
import math
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from srlrepro.__main__ import main
from srlrepro.settings.choices import Choices
from srlrepro.settings.fields import LARGEST_WHOLE, STAGES
from srlrepro.settings.paper import Paper

SMALL = {"k": 12, "random_rollouts": 50, "n_steps": 32, "n_minibatches": 4, "n_epochs": 1, "hidden_width": 8}
SMALL |= {"trial_length": 0.5, "random_length": 0.5, "gamma_cells": 16}
SLOW = {
    ("hidden_width", 4096),
    ("hidden_layers", 8),
    ("n_epochs", LARGEST_WHOLE),
}  # allowed, and as slow as asked for
TINY, LEAST, MOST = 1e-300, 5e-324, math.nextafter(math.inf, 0)


def ends(f: Any) -> Iterator[Any]:
    """Allowed values of a field at and near the ends of its interval."""
    low, high = (float(bound) for bound in f.metadata["allowed"][1:-1].split(","))
    closed = f.metadata["allowed"][0] == "[", f.metadata["allowed"][-1] == "]"
    if f.type is int:
        yield from (int(low) if closed[0] else int(low) + 1, LARGEST_WHOLE if high == math.inf else int(high))
        return
    if low == -math.inf:
        yield from (-MOST, -LEAST)
    else:
        yield from (low if closed[0] else math.nextafter(low, math.inf), low + TINY)
    if high == math.inf:
        yield from (1e300, MOST)
    else:
        yield high if closed[1] else math.nextafter(high, -math.inf)


NUMBERS = [f for part in (Paper, Choices) for f in fields(part) if f.type in (int, float)]
CASES = [(f, v) for f in NUMBERS for v in dict.fromkeys(ends(f)) if (f.name, v) not in SLOW]


def run(*words: str) -> int:
    """The exit status of a command; one that is not zero comes with one line."""
    out, error = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(error):
        try:
            status = main(list(words))
        except SystemExit as stop:
            status = int(stop.code or 0)
    lines = [line for line in error.getvalue().splitlines() if line.startswith("python -m srlrepro")]
    assert status == 0 or (status in (1, 2) and len(lines) == 1 and lines[0].isprintable()), error.getvalue()
    assert "Traceback" not in error.getvalue()
    assert status == 0 or error.getvalue().count("\n") == 1, error.getvalue()
    return status


def not_finite(folder: Path) -> list[str]:
    """What commands have written that is no finite number: files and arrays."""
    found: list[str] = []
    for path in folder.rglob("*.npz"):
        with np.load(path) as arrays:
            kept = {name: array for name, array in arrays.items() if array.dtype.kind == "f"}
            found += [f"{path.name} {name}" for name, array in kept.items() if not np.isfinite(array).all()]
    for path in folder.rglob("run.json"):
        json.loads(path.read_text(encoding="utf-8"), parse_constant=found.append)
    for path in folder.rglob("trials.csv"):
        cells = path.read_text(encoding="utf-8").replace("\n", ",").split(",")
        found += sorted({"nan", "inf", "-inf"} & {*cells})
    return found


def test_what_is_not_finite_is_found(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", x=np.array([1.0, np.inf]), z=np.array([1]), y=np.zeros(2))
    (tmp_path / "run.json").write_text('{"return": NaN}')
    (tmp_path / "trials.csv").write_text("step,return\n1,nan\n2,0.5\n")
    assert not_finite(tmp_path) == ["a.npz x", "NaN", "nan"]


@pytest.mark.filterwarnings("default::RuntimeWarning")  # as outside of tests, where they are held back
@pytest.mark.parametrize(("f", "value"), CASES, ids=[f"{f.name}={v}" for f, v in CASES])
def test_at_the_ends_of_what_is_allowed(f: Any, value: Any, tmp_path: Path) -> None:
    values = [f"{name}={v!r}" for name, v in (SMALL | {f.name: value}).items()]
    data, region, stage = (
        tmp_path / "data.npz",
        tmp_path / "region.npz",
        list(STAGES).index(f.metadata["stage"]),
    )
    made = stage <= 2 and run("data", "--alpha", "0.5", "--out", str(data), "--set", *values) == 0
    if made and stage > 0:
        run("region", "--data", str(data), "--out", str(region), "--set", *values)
    if stage != 1 and stage != 2:
        line = ["train", "--alpha", "none", "--delta", "1.5", "--steps", "64", "--out", str(tmp_path / "run")]
        run(*line, "--set", *values)
    assert not_finite(tmp_path) == []
