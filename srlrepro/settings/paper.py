"""What the paper states, each value with its place."""

import math
from dataclasses import dataclass

from srlrepro.settings.fields import check, check_fields, stated


@dataclass(frozen=True)
class Paper:
    """Values stated by the paper; the metadata of each field names the place."""

    # fmt: off
    links: int = stated("physics", 3, "[1, 8]", "", "number n of links, all alike", "Sec. IV-A")
    length: float = stated("physics", 3.0, "(0, inf)", "m", "length of all links together", "Sec. IV-A")
    mass: float = stated("physics", 3.0, "(0, inf)", "kg", "nominal mass of all links together", "Sec. IV-A")
    torque_limit: float = stated("physics", 100.0, "(0, inf)", "N·m", "limit of each torque", "Sec. IV-A")
    circle_height: float = stated("task", 2.7, "(-inf, inf)", "m", "height of the circle's centre", "Fig. 1")
    circle_radius: float = stated("task", 0.3, "(0, inf)", "m", "radius r of the target circle", "Fig. 1")
    circle_speed: float = stated("task", math.pi, "(0, inf)", "rad/s", "speed of the target", "Sec. IV-A")
    theta1_max: float = stated("physics", math.pi / 2, "(0, inf)", "rad", "UD range of θ1; ground", "App. C")
    theta23_max: float = stated("data", math.pi, "(0, inf)", "rad", "UD range of θ2 and θ3 (… θn)", "App. C")
    rate1_max: float = stated("data", 10.0, "(0, inf)", "rad/s", "UD range of θ̇1", "App. C")
    rate23_max: float = stated("data", 20.0, "(0, inf)", "rad/s", "UD range of θ̇2 and θ̇3 (… θ̇n)", "App. C")
    k: int = stated("data", 1000, "[4, inf)", "", "number of training states", "Sec. IV-B")
    p_t: float = stated("region", 0.8, "(0, 1)", "", "probability threshold of S_y, eq. (5)", "Sec. IV-A")
    reward_constant: float = stated("task", 2.0, "(-inf, inf)", "", "R_c, reward for being safe", "App. C")
    reward_slope: float = stated("task", 10.0, "[0, inf)", "1/m", "penalty per distance", "App. C")
    n_steps: int = stated("learner", 2048, "[2, inf)", "", "PPO: steps per update", "App. C")
    n_minibatches: int = stated("learner", 128, "[1, inf)", "", "PPO: minibatches per epoch", "App. C")
    n_epochs: int = stated("learner", 10, "[1, inf)", "", "PPO: epochs per update", "App. C")
    learning_rate: float = stated("learner", 1e-4, "(0, inf)", "", "PPO: learning rate", "App. C")
    vf_coef: float = stated("learner", 1.0, "[0, inf)", "", "PPO: value loss coefficient", "App. C")
    max_grad_norm: float = stated("learner", 10.0, "(0, inf)", "", "PPO: gradient norm clipping", "App. C")
    discount: float = stated("learner", 0.99, "[0, 1]", "", "PPO: discount γ", "App. C")
    gae_lambda: float = stated("learner", 0.95, "[0, 1]", "", "PPO: advantage discount λ", "App. C")
    ent_coef: float = stated("learner", 0.0, "[0, inf)", "", "PPO: entropy coefficient", "App. C")
    hidden_layers: int = stated("learner", 2, "[1, 8]", "", "hidden layers of the networks", "App. C")
    hidden_width: int = stated("learner", 128, "[1, 4096]", "", "neurons per hidden layer", "App. C")
    # fmt: on

    def __post_init__(self) -> None:
        check_fields(self)
        ok = self.n_steps % self.n_minibatches == 0 and self.n_steps > self.n_minibatches
        check(ok, "n_minibatches", self.n_minibatches, f"a proper divisor of n_steps = {self.n_steps}")

    @property
    def state_max(self) -> tuple[float, ...]:
        """Half ranges of the state space of App. C, [2n] in rad and rad/s; all joints but the first alike."""
        others = self.links - 1
        angles, rates = (self.theta23_max,) * others, (self.rate23_max,) * others
        return (self.theta1_max, *angles, self.rate1_max, *rates)
