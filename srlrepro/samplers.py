"""Training data (Sec. III): UD, the random policy and its states 𝕏, the MND fit, and their combination.

D_tr = D_ud + D_mnd with |D_ud| = αk and |D_mnd| = (1 − α)k (Sec. III-C): D_ud is uniform over the state
space of App. C, D_mnd is drawn from a normal distribution fitted to the states 𝕏 that a random policy
visits on the nominal system from the origin. Labels and trajectories are those of the nominal system.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from srlrepro.compiled.jit import jit
from srlrepro.compiled.stack import read, write
from srlrepro.dynamics.closed_loop import ClosedLoop, Labels, Limits, hold_torque
from srlrepro.dynamics.pendulum import Coefficients, Floats, as_states
from srlrepro.settings.condition import check_share
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check
from srlrepro.storage.files import ResultError, read_arrays, write_arrays
from srlrepro.storage.made_of import MadeOf, read_made_of, write_made_of

FORMAT = "srlrepro-training-data-2"
PARTS = {"x": "f8", "z": "i8", "n_ud": "i8", "mean": "f8", "covariance": "f8", "made_of": "U"}  # of the file
MOST_ROWS = sys.maxsize // (
    6 * np.dtype(float).itemsize
)  # states that an array can hold, whatever the memory


@dataclass(frozen=True, eq=False)
class MultivariateNormal:
    """The MND(μ, Σ): mean [2n] and covariance [2n, 2n] in rad and rad/s."""

    mean: Floats
    covariance: Floats

    @classmethod
    def fit(cls, states: ArrayLike) -> "MultivariateNormal":
        """Maximum-likelihood mean and the unbiased covariance of the states 𝕏 [N, 2n]."""
        dimension = np.shape(states)[-1] if np.ndim(states) else 1
        x = as_states(states, dimension, "states")
        check(len(x) > dimension, "states", f"{len(x)} states", f"at least {dimension + 1} states")
        fitted = cls(x.mean(axis=0), np.cov(x, rowvar=False).reshape(dimension, dimension))
        try:
            np.linalg.cholesky(fitted.covariance)
        except np.linalg.LinAlgError:
            more = "more links need a smaller torque_limit or shorter control_period"
            check(False, "states", f"{len(x)} states", f"such as vary in every direction ({more})")
        return fitted

    def sample(self, n: int, rng: Generator) -> Floats:
        """n states, a row each; by Cholesky, whose factor has no free signs: every machine draws the same."""
        return rng.multivariate_normal(self.mean, self.covariance, size=n, method="cholesky")


@dataclass(frozen=True, eq=False)
class TrainingData:
    """D_tr, and the normal distribution behind a part of it."""

    x: Floats  # [k, 2n] states, rad and rad/s; the first ones from UD, the others from MND
    z: Labels  # [k] safety labels l_n(x), 1 = safe
    n_ud: int  # number of states from UD
    mnd: MultivariateNormal  # that the others were drawn from
    made_of: MadeOf | None = None  # None: made by hand

    def save(self, path: Path) -> None:
        """Write as npz (no pickle), beside and renamed."""
        parts = {"x": self.x, "z": self.z, "n_ud": self.n_ud, "made_of": write_made_of(self.made_of)}
        parts |= {"mean": self.mnd.mean, "covariance": self.mnd.covariance}
        write_arrays(path, FORMAT, **{name: np.asarray(parts[name], kind) for name, kind in PARTS.items()})

    @classmethod
    def load(cls, path: Path) -> "TrainingData":
        """Read what `save` wrote; `ResultError`: a missing, damaged or other file, or no labelled states."""
        a = read_arrays(path, FORMAT, PARTS)
        try:
            (k, dimension), n_ud = a["x"].shape, int(a["n_ud"])
            as_states(a["x"], dimension)
            shapes = [(k,), (dimension,), (dimension, dimension)]
            fits = [a[name].shape for name in ("z", "mean", "covariance")] == shapes
            fits = fits and bool(np.isfinite(a["mean"]).all() and np.isfinite(a["covariance"]).all())
            if not (fits and np.isin(a["z"], (0, 1)).all() and k >= 2 and 0 <= n_ud <= k):
                raise ValueError("parts that do not fit together")
        except (ValueError, TypeError) as error:
            raise ResultError(f"{path} holds no labelled states: {error}") from error
        mnd = MultivariateNormal(a["mean"], a["covariance"])
        return cls(a["x"], a["z"], n_ud, mnd, read_made_of(a["made_of"], "data", path))


def split(alpha: float, k: int) -> tuple[int, int]:
    """(|D_ud|, |D_mnd|) = (αk, (1 − α)k), αk rounded to the nearest whole number (halves up)."""
    check_share(alpha)
    n_ud = int(np.floor(alpha * k + 0.5))
    return n_ud, k - n_ud


def sample_uniform(n: int, state_max: ArrayLike, rng: Generator) -> Floats:
    """n states, one per row, from the UD over ±state_max (App. C)."""
    high = np.asarray(state_max, dtype=np.float64)
    return rng.uniform(-high, high, size=(n, high.size))


@jit
def _random_rollouts(
    coefficients: Coefficients, limits: Limits, state_max: Floats, torques: Floats, hold: int, out: Floats
) -> int:
    count = 0
    for i in range(torques.shape[0]):
        state = coefficients.upright
        for t in range(torques.shape[1] * hold):
            write(state, out[count])
            inside = True
            for j in range(state_max.size):
                inside = inside and abs(out[count, j]) <= state_max[j]
            if not inside:
                break
            count += 1
            u = read(torques[i, t // hold], coefficients.idle)
            state, outcome = hold_torque(coefficients, limits, state, u)
            if outcome != 0:
                break
    return count


def visited_states(config: Config, rng: Generator) -> Floats:
    """𝕏 [N, 2n]: the states that a random policy visits on the nominal system from the origin (Sec. III-A).

    Each torque is uniform within its limits (or of another ``random_law``) and held for ``random_hold``; a
    rollout ends where it leaves the state space of App. C (or by another ``random_stop``), at the latest
    after ``random_length``. States are recorded every control period.
    """
    paper, choices = config.paper, config.choices
    hold = max(1, round(choices.random_hold / choices.control_period))
    pieces = max(1, round(choices.random_length / (hold * choices.control_period)))
    shape = choices.random_rollouts, pieces, paper.links
    if choices.random_law == "uniform":
        torques = rng.uniform(-paper.torque_limit, paper.torque_limit, shape)
    else:
        torques = np.clip(rng.normal(0.0, choices.random_std, shape), -paper.torque_limit, paper.torque_limit)
    rows = choices.random_rollouts * pieces * hold
    check(rows <= MOST_ROWS, "control_period", choices.control_period, "longer, for so many random_rollouts")
    coefficients, _, limits, _ = ClosedLoop.from_config(config).kernel_arguments
    out = np.empty((rows, len(coefficients.upright)))
    ranges = (
        np.array(paper.state_max) if choices.random_stop == "ranges" else np.full(2 * paper.links, np.inf)
    )
    n = _random_rollouts(coefficients, limits, ranges, torques, hold, out)
    return out[:n].copy()


def sample_mnd(n: int, mnd: MultivariateNormal, config: Config, rng: Generator) -> Floats:
    """n states from the MND, one per row; ``mnd_outside = redraw``: only such inside the ranges of App. C."""
    if config.choices.mnd_outside == "keep":
        return mnd.sample(n, rng)
    high, kept = np.array(config.paper.state_max), np.empty((0, mnd.mean.size))
    while len(kept) < n:
        drawn = mnd.sample(n, rng)
        kept = np.concatenate([kept, drawn[(np.abs(drawn) <= high).all(axis=1)]])
    return kept[:n]


def generate(alpha: float, config: Config, seed: int) -> TrainingData:
    """The training data D_tr of one α, labelled on the nominal system; 𝕏 and the MND do not depend on α."""
    n_ud, n_mnd = split(alpha, config.paper.k)
    policy_rng, state_rng = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    mnd = MultivariateNormal.fit(visited_states(config, policy_rng))
    ud = sample_uniform(n_ud, config.paper.state_max, state_rng)
    x = np.concatenate([ud, sample_mnd(n_mnd, mnd, config, state_rng)])
    made_of = MadeOf(alpha, seed, config.until("data"))
    return TrainingData(x, ClosedLoop.from_config(config).predict(x), n_ud, mnd, made_of)


def density_ratios(data: TrainingData, config: Config, x: Floats) -> Floats:
    """How much denser the MND is than the distribution D_n of the training states, at the states x [B, 2n].

    p_mnd(x) / (α p_ud(x) + (1 − α) p_mnd(x)): the weights with which states of D_n stand for the MND.
    """
    from scipy.stats import multivariate_normal  # here, since it is slow to import and seldom needed

    share, high = data.n_ud / len(data.x), np.array(config.paper.state_max)
    mnd = np.atleast_1d(multivariate_normal(data.mnd.mean, data.mnd.covariance).logpdf(x))
    with np.errstate(divide="ignore"):
        inside = np.log(share) - np.log(2 * high).sum()
        ud = np.where((np.abs(x) <= high).all(axis=1), inside, -np.inf)
        return np.asarray(np.exp(mnd - np.logaddexp(ud, np.log(1 - share) + mnd)), np.float64)


def known_states(data: TrainingData, config: Config) -> tuple[Floats, Labels]:
    """States [k, 2n] and labels [k] that Ψ and Γ learn from: D_tr, and with ``known_origin`` the origin.

    The paper assumes that the origin is a known safe state (Sec. II-A); this is that knowledge, as data.
    """
    if not config.choices.known_origin:
        return data.x, data.z
    return np.concatenate([data.x, np.zeros((1, data.x.shape[1]))]), np.append(data.z, 1)
