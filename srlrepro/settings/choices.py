"""What the paper leaves open and we chose, each value with its reason."""

from dataclasses import dataclass

from srlrepro.settings.fields import check_fields, chosen


@dataclass(frozen=True)
class Choices:
    """Values that the paper leaves open, with the reason of our choice as metadata.

    A default follows, in this order: the paper's words; the conditions that the paper states as its set-up;
    for Ψ and Γ, held-out calibration on nominal data; the library's default. Never the outcomes of Fig. 3.
    """

    # fmt: off
    gravity: float = chosen("physics", 9.81, "(0, inf)", "m/s²", "acceleration by gravity", "standard value")
    control_period: float = chosen("physics", 0.01, "(0, 0.1]", "s", "period of π, h and K",
        "the sampled K keeps upright stable for every Δ of the paper, with room to spare")
    substeps: int = chosen("physics", 8, "[1, 100]", "", "Runge-Kutta steps per control period",
        "labels of UD states equal those of much finer steps; the outer links are light and fast")
    trial_length: float = chosen("task", 4.0, "(0, 600]", "s", "length of a trial", "twice round the circle")
    total_steps: int = chosen("learner", 1_500_000, "[2, inf)", "", "training steps of a full run",
        "set-up condition: free PPO at Δ = 1.1 has levelled off (06_learning_performance)")
    quick_steps: int = chosen("learner", 20_480, "[2, inf)", "", "training steps of a --quick run",
        "ten updates: the whole grid in ten minutes on 2 cores")
    lqr_angle_weight: float = chosen("physics", 100.0, "(0, inf)", "1/rad²", "LQR: Q on the angles",
        "set-up condition: with Q = I, upright is unstable at Δ = 4")
    lqr_rate_weight: float = chosen("physics", 1.0, "(0, inf)", "s²/rad²", "LQR: Q on the rates",
        "the unit to compare with")
    lqr_torque_weight: float = chosen("physics", 0.01, "(0, inf)", "1/(N·m)²", "LQR: R",
        "a torque of 10 N·m weighs as much as 1 rad/s; upright is stable for every Δ of the paper")
    torque_noise: float = chosen("physics", 10.0, "(0, inf)", "N·m",
        "Kalman filter: std of the disturbance torque",
        "a tenth of the torque limit; smaller values trust the wrong model too much and lose Δ = 4")
    angle_noise: float = chosen("physics", 1e-3, "(0, inf)", "rad",
        "Kalman filter: std of the measured angles", "an ordinary joint encoder")
    rate_noise: float = chosen("physics", 1e-2, "(0, inf)", "rad/s",
        "Kalman filter: std of the measured rates", "the same, differentiated over 0.1 s")
    recovery_horizon: float = chosen("physics", 5.0, "(0, 60]", "s", "time that K has to recover",
        "longer than the slowest recovery from UD, which is at Δ = 4")
    recovered_angle: float = chosen("physics", 0.1, "(0, 1]", "rad", "|θ_i| that counts as upright",
        "from the box, K never saturates and always converges")
    recovered_rate: float = chosen("physics", 0.5, "(0, 10]", "rad/s", "|θ̇_i| that counts as upright",
        "as recovered_angle")
    rate_bound: float = chosen("physics", 300.0, "[50, 1000]", "rad/s",
        "|θ̇_i| at which a rollout is given up",
        "the integration is no longer accurate; no recovery from UD comes near it")
    random_law: str = chosen("data", "uniform", "uniform|normal", "",
        "random policy: law of a torque, uniform within its limits or normal with random_std, cut at them",
        "nothing is known of the learner yet; the limits are")
    random_std: float = chosen("data", 36.8, "(0, inf)", "N·m", "random policy: std of a normal torque",
        "that of the learner's first actions, exp(log_std_init) times action_unit")
    random_hold: float = chosen("data", 0.5, "(0, 600]", "s",
        "random policy: time for which a torque is held",
        "set-up condition: Fig. 2 shows unsafe states for α = 0; with a new torque every period all are safe")
    random_length: float = chosen("data", 4.0, "(0, 600]", "s", "random policy: longest rollout",
        "as a trial")
    random_stop: str = chosen("data", "ranges", "ranges|ground", "",
        "random policy: a rollout ends where it leaves the ranges of App. C, or only on the ground",
        "set-up condition: the states of Fig. 2 lie in the state space; without it, most lie far outside")
    random_rollouts: int = chosen("data", 2000, "[1, inf)", "", "random policy: number of rollouts",
        "thousands of states, for 27 numbers")
    mnd_outside: str = chosen("data", "keep", "keep|redraw", "", "MND states outside the ranges of App. C",
        "the paper draws from the MND itself")
    omega_step: float = chosen("region", 0.05, "(0, 1]", "s", "ω: time between compared states",
        "K settles in about 1 s")
    omega_horizon: float = chosen("region", 5.0, "(0, 60]", "s",
        "ω: compared time, or the horizon of K if that is shorter", "the horizon of K")
    label_gap: float = chosen("region", 1.0, "[0, 10]", "", "Ω: δ, added where labels differ",
        "set-up condition: safe and unsafe are clearly separated in Y; the calibration does not depend on it")
    perplexity: float = chosen("region", 30.0, "[1, 1000]", "", "t-SNE: perplexity", "openTSNE's default")
    psi: str = chosen("region", "network", "network|neighbours", "",
        "Ψ: a small neural regression, or the mean of the nearest neighbours, weighted by inverse distance",
        "held-out calibration on nominal data, given the evidence: far better than neighbours of any number")
    psi_width: int = chosen("region", 32, "[1, 1024]", "", "Ψ: neurons in each of its two hidden layers",
        "held-out calibration on nominal data: half as many are worse, twice as many hardly better")
    psi_penalty: float = chosen("region", 1.0, "[0, 1e6]", "", "Ψ: penalty on the squared weights",
        "held-out calibration on nominal data: better than a tenth or ten times as much")
    psi_neighbours: int = chosen("region", 16, "[1, 200]", "",
        "Ψ: number of neighbours, where it is by neighbours",
        "held-out calibration on nominal data, given held-out evidence: a flat optimum around 8 to 16")
    gamma_evidence: str = chosen("region", "embedded", "held out|embedded", "", "Γ: places of the evidence",
        "the paper's words: the simplified states y_i are used to approximate Γ (Sec. II-C)")
    gamma_weights: str = chosen("region", "none", "none|density ratio", "",
        "Γ: weights of the evidence, all 1 or by how much denser the MND is there than the training states",
        "the paper has none")
    gamma_bandwidth: float = chosen("region", 0.4, "(0, 1]", "", "Γ: kernel width in RMS radii of the y_i",
        "held-out calibration on nominal data: a flat optimum from 0.3 to 0.4")
    gamma_prior: float = chosen("region", 0.01, "(0, 1]", "",
        "Γ: pseudo-count of evidence, unsafe but for gamma_empty, as a share of the training states",
        "held-out calibration on nominal data: the optimum, with gamma_bandwidth")
    gamma_empty: float = chosen("region", 0.0, "[0, 1)", "",
        "Γ: probability of safe where there is no evidence, the mean of the pseudo-count",
        "unknown is unsafe")
    gamma_cells: int = chosen("region", 128, "[8, 1024]", "", "Γ: cells per side of the grid",
        "a cell is a fraction of the kernel width")
    known_origin: bool = chosen("region", True, "true|false", "",
        "the origin joins the training states of Ψ and Γ as one more safe state",
        "set-up condition: the origin is known to be safe (Sec. II-A), and so no region shall deny it")
    data_per_seed: bool = chosen("learner", True, "true|false", "",
        "one training dataset per seed instead of one per α",
        "what holds for α must not hold for one draw of its data alone; the paper does not say")
    observation: str = chosen("task", "state", "state|scaled", "",
        "what π sees: x itself or x in half ranges of App. C; and the sine and cosine of the target's phase",
        "the paper's π(x) sees x; the target moves, so that without its phase the task is no function of x")
    action_unit: float = chosen("task", 100.0, "[1, 1000]", "N·m", "torque of an action of 1",
        "the torque limit: actions then lie in [-1, 1], as stable-baselines3 advises")
    log_std_init: float = chosen("learner", -1.0, "[-5, 2]", "", "PPO: log of the initial std of the actions",
        "set-up condition: more of the states visited first lie in the state space of App. C than with 0")
    clip_range: float = chosen("learner", 0.2, "(0, 1)", "", "PPO: clip range", "stable-baselines3's default")
    learner: str = chosen("learner", "compiled", "compiled|stock", "",
        "PPO: stable-baselines3's, or the same with compiled rollouts and updates",
        "the same algorithm and random numbers in a fraction of the time (the benchmark measures it)")
    visited_states: int = chosen("learner", 20_000, "[1, inf)", "", "visited states kept of a run, about",
        "enough for an error rate to within half a per cent")
    evaluation_steps: int = chosen("learner", 50_000, "[1, inf)", "",
        "steps between two trials of the mean policy without a supervisor",
        "thirty in a full run: when a policy was found, not only whether")
    checkpoint_updates: int = chosen("none", 100, "[1, inf)", "", "updates between two checkpoints",
        "half a minute of work is lost at most")
    hypothesis: str = chosen("task", "tsne", "tsne|euclidean|pca|knn|svm|mlp|nominal|real", "",
        "what the supervisor predicts safety with (`replication.studies.alternatives`)",
        "the paper's low-dimensional safe region; the others ask what the low dimension is worth")
    corrective: str = chosen("task", "K", "K|none", "",
        "what acts after an early stop: K, or nothing, and the trial ends all the same",
        "eq. (6); without K, what the early stop alone does for learning")
    early_stop: str = chosen("task", "terminate", "terminate|truncate", "",
        "what an activation of K is for the learner: the end, or a cut-off with bootstrap",
        "the trial is terminated where unsafe behaviour is predicted (Sec. IV-C)")
    # fmt: on

    def __post_init__(self) -> None:
        check_fields(self)
