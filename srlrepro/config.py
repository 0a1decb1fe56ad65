"""Every number of the replication: what the paper states (`Paper`) and what we chose (`Choices`).

This module needs only the standard library, so that a command line can be checked before anything is
installed. Each field carries its unit, its allowed values and its source or reason; the ledger in the
README is printed from here, and `Config.with_values` varies any field without editing code.
"""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any


class ParameterError(ValueError):
    """A parameter has a value that is not allowed; the message is one line."""


def check(ok: bool, name: str, value: object, allowed: str) -> None:
    """Raise `ParameterError` naming the parameter, its value and what is allowed, unless ``ok``."""
    if not ok:
        raise ParameterError(f"{name} = {value}: must be {allowed}")


def _stated(default: Any, allowed: str, unit: str, meaning: str, place: str) -> Any:
    """A field of `Paper`; ``allowed`` is an interval such as ``(0, 1]``, or names separated by ``|``."""
    return field(
        default=default, metadata={"allowed": allowed, "unit": unit, "meaning": meaning, "place": place}
    )


def _chosen(default: Any, allowed: str, unit: str, meaning: str, reason: str) -> Any:
    """A field of `Choices`; as `_stated`, with the reason of the choice instead of a place."""
    return field(
        default=default, metadata={"allowed": allowed, "unit": unit, "meaning": meaning, "reason": reason}
    )


def _check_fields(values: Any) -> None:
    for f in fields(values):
        value, allowed = getattr(values, f.name), f.metadata["allowed"]
        if f.type is str:
            check(value in allowed.split("|"), f.name, value, f"one of {allowed.replace('|', ', ')}")
            continue
        if f.type is bool:
            check(isinstance(value, bool), f.name, value, "true or false")
            continue
        whole = f.type is int
        kind = "a whole number in" if whole else "a number in"
        numeric = isinstance(value, int if whole else (int, float)) and not isinstance(value, bool)
        low, high = (float(bound) for bound in allowed[1:-1].split(","))
        ok = (
            numeric
            and math.isfinite(value)
            and (value >= low if allowed[0] == "[" else value > low)
            and (value <= high if allowed[-1] == "]" else value < high)
        )
        check(ok, f.name, value, f"{kind} {allowed}")


@dataclass(frozen=True)
class Paper:
    """Values stated by the paper; the metadata of each field names the place."""

    link_length: float = _stated(1.0, "(0, inf)", "m", "length of each link", "Sec. IV-A")
    link_mass: float = _stated(1.0, "(0, inf)", "kg", "nominal mass of each link", "Sec. IV-A")
    torque_limit: float = _stated(100.0, "(0, inf)", "N·m", "largest torque of each joint", "Sec. IV-A")
    circle_height: float = _stated(
        2.7, "(-inf, inf)", "m", "height of the circle's centre (0, 2.7)", "Fig. 1"
    )
    circle_radius: float = _stated(0.3, "(0, inf)", "m", "radius r of the target circle", "Fig. 1")
    circle_speed: float = _stated(math.pi, "(0, inf)", "rad/s", "angular velocity of the target", "Sec. IV-A")
    theta1_max: float = _stated(math.pi / 2, "(0, inf)", "rad", "UD range of θ1; the ground", "App. C")
    theta23_max: float = _stated(math.pi, "(0, inf)", "rad", "UD range of θ2 and θ3", "App. C")
    rate1_max: float = _stated(10.0, "(0, inf)", "rad/s", "UD range of θ̇1", "App. C")
    rate23_max: float = _stated(20.0, "(0, inf)", "rad/s", "UD range of θ̇2 and θ̇3", "App. C")
    k: int = _stated(1000, "[2, inf)", "", "number of training states", "Sec. IV-B")
    p_t: float = _stated(0.8, "(0, 1)", "", "probability threshold of S_y, eq. (5)", "Sec. IV-A")
    reward_constant: float = _stated(2.0, "(-inf, inf)", "", "R_c, reward for being safe", "App. C")
    reward_slope: float = _stated(10.0, "[0, inf)", "1/m", "penalty per distance to the target", "App. C")
    n_steps: int = _stated(2048, "[2, inf)", "", "PPO: steps per update", "App. C")
    n_minibatches: int = _stated(128, "[1, inf)", "", "PPO: minibatches per epoch", "App. C")
    n_epochs: int = _stated(10, "[1, inf)", "", "PPO: epochs per update", "App. C")
    learning_rate: float = _stated(1e-4, "(0, inf)", "", "PPO: learning rate", "App. C")
    vf_coef: float = _stated(1.0, "[0, inf)", "", "PPO: value loss coefficient", "App. C")
    max_grad_norm: float = _stated(10.0, "(0, inf)", "", "PPO: gradient norm clipping", "App. C")
    discount: float = _stated(0.99, "[0, 1]", "", "PPO: discount γ", "App. C")
    gae_lambda: float = _stated(0.95, "[0, 1]", "", "PPO: advantage discount λ", "App. C")
    ent_coef: float = _stated(0.0, "[0, inf)", "", "PPO: entropy coefficient", "App. C")
    hidden_layers: int = _stated(2, "[1, 8]", "", "hidden layers of the networks", "App. C")
    hidden_width: int = _stated(128, "[1, 4096]", "", "neurons per hidden layer", "App. C")

    def __post_init__(self) -> None:
        _check_fields(self)
        ok = self.n_steps % self.n_minibatches == 0 and self.n_steps > self.n_minibatches
        check(ok, "n_minibatches", self.n_minibatches, f"a proper divisor of n_steps = {self.n_steps}")

    @property
    def state_max(self) -> tuple[float, ...]:
        """Half ranges of the state space of App. C, [6] in rad and rad/s."""
        angles = (self.theta1_max, self.theta23_max, self.theta23_max)
        return (*angles, self.rate1_max, self.rate23_max, self.rate23_max)


@dataclass(frozen=True)
class Choices:
    """Values that the paper leaves open; the metadata of each field gives the reason of our choice.

    A default follows, in this order: the paper's words; the conditions that the paper states as its set-up
    and that a wrong choice would break; for Ψ and Γ, held-out calibration on nominal data; the library's
    default. Never the outcomes of Fig. 3.
    """

    gravity: float = _chosen(9.81, "(0, inf)", "m/s²", "gravitational acceleration", "standard value")
    control_period: float = _chosen(
        0.01,
        "(0, 0.1]",
        "s",
        "period of π, h and K",
        "the sampled K keeps upright stable for every Δ of the paper, with room to spare",
    )
    substeps: int = _chosen(
        8,
        "[1, 100]",
        "",
        "Runge-Kutta steps per control period",
        "all labels of 4000 UD states equal those of 16 times finer steps; with 4, five in 4000 differ",
    )
    trial_length: float = _chosen(4.0, "(0, 600]", "s", "length of a trial", "two rounds of the circle")
    total_steps: int = _chosen(
        1_500_000,
        "[2, inf)",
        "",
        "training steps of a full run",
        "an exploratory free PPO at Δ = 1.1 levelled off near it",
    )
    quick_steps: int = _chosen(
        4096,
        "[2, inf)",
        "",
        "training steps of a --quick run",
        "two updates: the whole grid in ten minutes on 2 cores",
    )
    lqr_angle_weight: float = _chosen(
        100.0,
        "(0, inf)",
        "1/rad²",
        "LQR: Q on the angles",
        "set-up condition: with Q = I, upright was unstable at Δ = 4 for every R tried",
    )
    lqr_rate_weight: float = _chosen(
        1.0, "(0, inf)", "s²/rad²", "LQR: Q on the rates", "the unit to compare with"
    )
    lqr_torque_weight: float = _chosen(
        0.01,
        "(0, inf)",
        "1/(N·m)²",
        "LQR: R",
        "a torque of 10 N·m weighs as much as 1 rad/s; upright is stable for every Δ of the paper",
    )
    torque_noise: float = _chosen(
        10.0,
        "(0, inf)",
        "N·m",
        "Kalman filter: std of the disturbance torque",
        "a tenth of the torque limit; smaller values trust the wrong model too much and lose Δ = 4",
    )
    angle_noise: float = _chosen(
        1e-3, "(0, inf)", "rad", "Kalman filter: std of the measured angles", "an ordinary joint encoder"
    )
    rate_noise: float = _chosen(
        1e-2,
        "(0, inf)",
        "rad/s",
        "Kalman filter: std of the measured rates",
        "the same, differentiated over 0.1 s",
    )
    recovery_horizon: float = _chosen(
        5.0,
        "(0, 60]",
        "s",
        "time that K has to recover",
        "the slowest of 4000 recoveries from UD takes 3.5 s, at Δ = 4",
    )
    recovered_angle: float = _chosen(
        0.1,
        "(0, 1]",
        "rad",
        "|θ_i| that counts as upright",
        "from the box, K never saturates and always converges",
    )
    recovered_rate: float = _chosen(
        0.5, "(0, 10]", "rad/s", "|θ̇_i| that counts as upright", "as recovered_angle"
    )
    rate_bound: float = _chosen(
        300.0,
        "[50, 1000]",
        "rad/s",
        "|θ̇_i| at which a rollout is given up",
        "the integration is no longer accurate; no recovery from 4000 UD states reaches it",
    )
    random_hold: float = _chosen(
        0.5,
        "(0, 600]",
        "s",
        "random policy: time for which a torque is held",
        "set-up condition: Fig. 2 shows unsafe states for α = 0; with a new torque every 10 ms all are safe",
    )
    random_length: float = _chosen(4.0, "(0, 600]", "s", "random policy: longest rollout", "as a trial")
    random_rollouts: int = _chosen(
        2000,
        "[1, inf)",
        "",
        "random policy: number of rollouts",
        "the standard errors of μ and Σ are a few per cent",
    )
    mnd_outside: str = _chosen(
        "keep",
        "keep|redraw",
        "",
        "MND states outside the ranges of App. C",
        "the paper draws from the MND itself",
    )
    omega_step: float = _chosen(
        0.05, "(0, 1]", "s", "ω: time between compared states", "K settles in about 1 s"
    )
    omega_horizon: float = _chosen(5.0, "(0, 60]", "s", "ω: compared time", "the horizon of K")
    label_gap: float = _chosen(
        1.0,
        "[0, 10]",
        "",
        "Ω: δ, added where labels differ",
        "set-up condition: safe and unsafe are clearly separated in Y; the calibration does not depend on it",
    )
    perplexity: float = _chosen(30.0, "[1, 1000]", "", "t-SNE: perplexity", "openTSNE's default")
    psi_neighbours: int = _chosen(
        16,
        "[1, 200]",
        "",
        "Ψ: number of neighbours",
        "best held-out calibration on nominal data of 4, 8, 16, 32",
    )
    gamma_evidence: str = _chosen(
        "held out",
        "held out|embedded",
        "",
        "Γ: places of the evidence",
        "held-out calibration: a Brier score of 0.11 instead of 0.14 where t-SNE has put the training states",
    )
    gamma_bandwidth: float = _chosen(
        0.2,
        "(0, 1]",
        "",
        "Γ: kernel width in RMS radii of the y_i",
        "best held-out calibration of 0.05 to 0.4",
    )
    gamma_prior: float = _chosen(
        1.0,
        "(0, 1000]",
        "",
        "Γ: pseudo-count of unsafe evidence",
        "best held-out calibration of 0.3, 1 and 3",
    )
    gamma_cells: int = _chosen(
        128, "[8, 1024]", "", "Γ: cells per side of the grid", "a cell is a fraction of the kernel width"
    )
    known_origin: bool = _chosen(
        True,
        "true|false",
        "",
        "the origin joins the training states of Ψ and Γ as one more safe state",
        "set-up condition: the origin is known to be safe; without this, 2 of 8 datasets of α = 1 deny that",
    )
    data_per_seed: bool = _chosen(
        False,
        "true|false",
        "",
        "one training dataset per seed instead of one per α",
        "Fig. 2 shows one per α",
    )
    log_std_init: float = _chosen(
        -1.0,
        "[-5, 2]",
        "",
        "PPO: log of the initial std of the actions",
        "set-up condition: with 0, the states visited first lie far outside the state space of App. C",
    )
    clip_range: float = _chosen(0.2, "(0, 1)", "", "PPO: clip range", "stable-baselines3's default")
    visited_states: int = _chosen(
        20_000,
        "[1, inf)",
        "",
        "visited states kept of a run, about",
        "enough for an error rate to half a per cent",
    )
    checkpoint_updates: int = _chosen(
        10, "[1, inf)", "", "updates between two checkpoints", "about a minute of work is lost at most"
    )
    early_stop: str = _chosen(
        "terminate",
        "terminate|truncate",
        "",
        "what an activation of K is for the learner: the end, or a cut-off with bootstrap",
        "the trial is terminated where unsafe behaviour is predicted (Sec. IV-C)",
    )

    def __post_init__(self) -> None:
        _check_fields(self)


@dataclass(frozen=True)
class Config:
    """All values of one replication."""

    paper: Paper = Paper()
    choices: Choices = Choices()

    def with_values(self, **values: Any) -> "Config":
        """A configuration with some fields of either class replaced.

        Raises:
            ParameterError: an unknown name or a value that is not allowed.
        """
        paper, choices = ({f.name for f in fields(c)} for c in (Paper, Choices))
        for name, value in values.items():
            check(name in paper | choices, name, value, "left out: there is no such parameter")
        return Config(
            replace(self.paper, **{n: v for n, v in values.items() if n in paper}),
            replace(self.choices, **{n: v for n, v in values.items() if n in choices}),
        )

    def as_dict(self) -> dict[str, Any]:
        """{name: value} of every field."""
        return asdict(self.paper) | asdict(self.choices)


def condition(alpha: float | None) -> str:
    """The text of α in names, tables and legends: "0", "0.5", …, or "none" for no supervisor."""
    return "none" if alpha is None else f"{alpha:g}"


def parse_value(name: str, text: str) -> Any:
    """The value of the field ``name`` written as ``text`` on a command line.

    Raises:
        ParameterError: an unknown name, or a text that is not of the field's type.
    """
    types = {f.name: f.type for c in (Paper, Choices) for f in fields(c)}
    check(name in types, name, text, "left out: there is no such parameter")
    if types[name] is str:
        return text
    if types[name] is bool:
        check(text in ("true", "false"), name, text, "true or false")
        return text == "true"
    try:
        return types[name](text)  # type: ignore[operator]
    except ValueError:
        raise ParameterError(
            f"{name} = {text}: must be a {'whole ' if types[name] is int else ''}number"
        ) from None


def parse_settings(settings: Iterable[str]) -> dict[str, Any]:
    """{name: value} of texts such as ``k=500``.

    Raises:
        ParameterError: a text without ``=``, an unknown name, or a value that is not allowed.
    """
    values = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        check(equals == "=", "--set", setting, "of the form NAME=VALUE")
        values[name] = parse_value(name, text)
    Config().with_values(**values)
    return values
