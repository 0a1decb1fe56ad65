"""Chains of n links: the values with which K keeps them upright, and the data that they are learned from."""

from functools import cache
from itertools import product

import numpy as np

from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.samplers import (
    MultivariateNormal,
    TrainingData,
    generate,
    sample_mnd,
    sample_uniform,
    split,
    visited_states,
)
from srlrepro.settings.choices import Choices
from srlrepro.settings.config import Config
from srlrepro.settings.fields import ParameterError
from srlrepro.settings.paper import Paper

EVERY_DELTA = (1.0, 1.1, 1.5, 4.0)  # the nominal system, and the paper's mismatches
STEADY = 0.99  # of `decay`: the paper's chain has 0.988 at Δ = 4, and recovers in time
FINE = 0.01 / 32  # s of an integration step: of n = 5, 1 in 400 labels of UD differs from those of half of it


@cache
def controlled(links: int) -> Config:
    """The values with which K keeps n links upright, by the ledger's rule: it is stable for every Δ.

    Up to three links they are those of the paper's chain. More links are lighter and faster. Of the weights
    of the angles, each ten times the one before, K gets the smallest that will do, and with it the longest
    of the control periods, each half of the one before; `STEADY` is the margin. Integration steps are `FINE`.

    Raises:
        ParameterError: none will do.
    """
    config = Config().with_values(links=links)
    if links <= Paper.links:
        return config
    weights = [Choices.lqr_angle_weight * 10.0**i for i in range(3)]
    periods = [Choices.control_period / 2**i for i in range(6)]
    for weight, period in product(weights, periods):
        values = {
            "lqr_angle_weight": weight,
            "control_period": period,
            "substeps": max(1, round(period / FINE)),
        }
        found = config.with_values(**values)
        if max(decay(found, delta) for delta in EVERY_DELTA) <= STEADY:
            return found
    raise ParameterError(f"links = {links}: no K is stable for every mismatch")


def decay(config: Config, delta: float) -> float:
    """By what a small deviation from upright is multiplied in 0.01 s under K; below 1 it is stable."""
    loop = ClosedLoop.from_config(config, delta)
    periods = Choices.control_period / config.choices.control_period
    return float(loop.controller.spectral_radius(loop.system) ** periods)


def slower(links: int) -> float:
    """By what torques of a policy are smaller than the paper's: the moment of inertia of a link, n⁻³, from
    three links on. So they turn every chain as fast as the paper's.

    With the torques of the paper, a light link leaves the ranges of App. C in its first control period.
    """
    return min(1.0, (Paper.links / links) ** 3)


def learning(links: int) -> Config:
    """The values of a learner: those of `controlled`; an action of 1 is a torque that is `slower`.

    So are the torques with which it explores. The limits of the torques stay, K's and the learner's.
    """
    config = controlled(links)
    return config.with_values(action_unit=slower(links) * config.choices.action_unit)


def exploring(config: Config) -> Config:
    """The values with which the random policy visits states: its torques are `slower`.

    Otherwise little but the origin would be visited. K keeps its limits. States are recorded as often as of
    the paper's chain.
    """
    step = config.choices.control_period / config.choices.substeps
    period = {"control_period": Choices.control_period, "substeps": round(Choices.control_period / step)}
    limit = slower(config.paper.links) * config.paper.torque_limit
    return config.with_values(torque_limit=limit, **period)


def normal(config: Config, seed: int) -> MultivariateNormal:
    """The MND of a dataset, fitted to what the random policy visits."""
    rng, _ = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))  # as `generate`
    return MultivariateNormal.fit(visited_states(exploring(config), rng))


def training_data(alpha: float, config: Config, seed: int, mnd: MultivariateNormal) -> TrainingData:
    """D_tr, as `generate` makes it; the MND is that of the dataset, see `normal`."""
    n_ud, n_mnd = split(alpha, config.paper.k)
    _, rng = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    ud = sample_uniform(n_ud, config.paper.state_max, rng)
    x = np.concatenate([ud, sample_mnd(n_mnd, mnd, config, rng)])
    return TrainingData(x, ClosedLoop.from_config(config).predict(x), n_ud, mnd)


def data_of(alpha: float, config: Config, seed: int) -> TrainingData:
    """D_tr of a chain: as `generate` makes it up to three links, of `training_data` for more.

    Up to three links both give the same states; only what `generate` makes says what it was made of.
    """
    if config.paper.links <= Paper.links:
        return generate(alpha, config, seed)
    return training_data(alpha, config, seed, normal(config, seed))
