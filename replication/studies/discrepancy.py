r"""How far is the real system from the nominal one? Measured from data that a learner has.

The paper leaves such a measure to future work. A learner knows the nominal model, the transitions
(x_t, u_t, x_{t+1}) that it made on the real system, and how K fared from the states where it was activated.
Three measures, each 0 if the systems are equal:

- ``unexplained``: the motion of a control period that the nominal model misses, relative to the motion,
  (Σ_t ‖x_{t+1} − x̂_{t+1}‖² / Σ_t ‖x_{t+1} − x_t‖²)^½, in half ranges of App. C;
- ``surprises``: share of the activations whose outcome is another than on the nominal model, E[I(l ≠ l_n)] on
  the states in which K is activated: an estimate of E_2 of Theorem 1 where it matters;
- ``slower``: mean of log(time of the recovery / its time on the nominal model), where both recover.

States in which K is activated depend on the region, so that the last two do as well.
"""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from srlrepro.dynamics.circle_env import ThreeLinkCircleEnv
from srlrepro.dynamics.closed_loop import ClosedLoop, Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.learner.trials import Transition, transitions, untrained
from srlrepro.region.hypothesis import Hypothesis
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check
from srlrepro.supervisor import Supervisor


@dataclass(frozen=True, eq=False)
class Experience:
    """What a learner has seen of the real system; states are in rad and rad/s."""

    x: Floats  # [N, 2n] at the start of a control period
    actions: Floats  # [N, n] of π, in units of ``action_unit``
    following: Floats  # [N, 2n] at the end of the control period
    activated: Floats  # [M, 2n] states in which K was activated
    safe: Labels  # [M] whether it recovered the system
    times: Floats  # [M] s, until the outcome


def explore(delta: float, region: Hypothesis, config: Config, trials: int, rng: Generator) -> Experience:
    """Trials of an untrained policy (mean 0, the initial std) on the real system of Δ under a supervisor."""
    check(trials >= 1, "trials", trials, "a whole number in [1, inf)")
    loop = ClosedLoop.from_config(config)
    env = Supervisor(ThreeLinkCircleEnv(delta, config=config), region, loop.controller)
    task, policy = env.task, untrained(rng, config.choices.log_std_init, config.paper.links)
    steps: list[Transition] = []
    activated, outcomes, times = [], [], []
    for _ in range(trials):
        steps += transitions(env, policy)
        if env.recovery is not None:
            activated.append(task.state.copy())
            outcomes.append(env.recovery.labels[0])
            times.append(env.recovery.durations[0])
    x, actions, _, following, _ = zip(*steps, strict=True)
    of_k = np.array(activated).reshape(-1, task.state.size), np.array(outcomes, int), np.array(times)
    return Experience(np.array(x), np.array(actions), np.array(following), *of_k)


def predict(experience: Experience, config: Config) -> Floats:
    """x̂_{t+1} [N, 2n]: each transition on the nominal model."""
    nominal, predicted = ThreeLinkCircleEnv(1.0, config=config), []
    for x, action in zip(experience.x, experience.actions, strict=True):
        nominal.reset(options={"state": x})
        nominal.step(action)
        predicted.append(nominal.state)
    return np.array(predicted)


def discrepancy(experience: Experience, config: Config) -> dict[str, float]:
    """The measures of the module; ``surprises`` and ``slower`` are NaN where K gives nothing to compare."""
    scale = np.array(config.paper.state_max)
    missed = (experience.following - predict(experience, config)) / scale
    moved = (experience.following - experience.x) / scale
    measures = {"unexplained": float(np.sqrt((missed**2).sum() / (moved**2).sum()))}
    if len(experience.activated) == 0:
        return measures | {"surprises": float("nan"), "slower": float("nan")}
    nominal = ClosedLoop.from_config(config).rollout(experience.activated, record=False)
    both = (experience.safe == 1) & (nominal.labels == 1) & (nominal.durations > 0) & (experience.times > 0)
    ratio = np.log(experience.times[both] / nominal.durations[both])
    measures["surprises"] = float((experience.safe != nominal.labels).mean())  # l(x) != l_n(x)
    return measures | {"slower": float(ratio.mean()) if both.any() else float("nan")}
