"""Time the parts that every control period needs, and see that each keeps its bound.

``python -m benchmarks.parts`` prints a table, and ends with status 1 if a part is slower than it may be. The
best of many short turns counts: on a busy machine a long one is always interrupted.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from srlrepro.command_line import Parser
from srlrepro.compiled.jit import jit
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.dynamics.pendulum import Coefficients, Floats, Pendulum, State, Torque, rk4_step
from srlrepro.region.safe_region import SafeRegion
from srlrepro.region.safety_map import RegionArrays, query
from srlrepro.settings.paper import Paper

STATES = 1000  # of a batch, and training states of the region, as in the paper
STEPS = 500  # of the integrator in one turn


@dataclass(frozen=True)
class Part:
    """What is timed: its name, one turn of it, how often it does it in a turn, the bound in µs, turns."""

    name: str
    turn: Callable[[], object]
    times: int
    bound: float
    turns: int


@jit
def _steps(c: Coefficients, x: State, u: Torque, dt: float, n: int) -> State:
    for _ in range(n):
        x = rk4_step(c, x, u, dt)
    return x


@jit
def _ask(region: RegionArrays, x: Floats) -> float:
    total = 0.0
    for i in range(x.shape[0]):
        total += query(region, x[i])[2]
    return total


def parts() -> list[Part]:
    """The parts, with what is compiled already compiled."""
    rng, high = np.random.default_rng(0), np.array(Paper().state_max)
    train, x = rng.uniform(-high, high, (STATES, 6)), rng.uniform(-high, high, (STATES, 6))
    region = SafeRegion().fit_embedding(train, rng.integers(0, 2, STATES), rng.normal(size=(STATES, 2)))
    loop, coefficients = ClosedLoop(), Pendulum().coefficients
    start, idle = (0.1, 0.2, 0.3, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    found = [
        Part("Runge-Kutta step", lambda: _steps(coefficients, start, idle, 1e-3, STEPS), STEPS, 1.0, 1000),
        Part("label of a state", lambda: loop.predict(x), STATES, 1000.0, 3),
        Part("prediction in compiled code", lambda: _ask(region.arrays_, x), STATES, 15.0, 7),
        Part("prediction in a batch", lambda: region.predict(x), STATES, 20.0, 7),
    ]
    for part in found:
        part.turn()
    return found


def best(part: Part) -> float:
    """µs of a part, in the fastest of its turns."""
    seconds = []
    for _ in range(part.turns):
        before = time.perf_counter()
        part.turn()
        seconds.append(time.perf_counter() - before)
    return 1e6 * min(seconds) / part.times


def main() -> int:
    """The command line; returns the exit status."""
    Parser(prog="python -m benchmarks.parts", description=__doc__, allow_abbrev=False).parse_args()
    rows = [(part.name, best(part), part.bound) for part in parts()]
    table = pd.DataFrame(rows, columns=["part", "µs", "at most"])
    print(table.to_string(index=False, float_format="{:.3g}".format))
    return int((table["µs"] > table["at most"]).any())


if __name__ == "__main__":
    sys.exit(main())
