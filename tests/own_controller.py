"""A controller that tests bring, for what compiled code does not know."""

import numpy as np

from srlrepro.dynamics.lqg import LQG, lqg_update
from srlrepro.dynamics.pendulum import Floats

UNIT = 64.0  # N·m of an action of 1: a power of two, by which K's torques are divided without rounding


class OwnLQG:
    """K once more as a controller that somebody brings: an action at a time, with a memory of its own."""

    gains = LQG().arrays

    def __init__(self) -> None:
        self.xbar = np.zeros(6)

    def reset(self, x: Floats) -> None:
        self.xbar = x.copy()

    def action(self, x: Floats) -> Floats:
        u = np.zeros(3)
        lqg_update(self.gains, self.xbar, x, u)
        return u / UNIT
