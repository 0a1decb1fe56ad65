r"""The corrective controller K(x): a linear-quadratic-Gaussian regulator of the nominal system.

**Problem.** The nominal system linearised at upright and sampled with zero-order hold every
``control_period`` seconds is

    x_{t+1} = A x_t + B (u_t + w_t),     y_t = x_t + v_t,

with independent white noises w_t ~ N(0, σ_w² I) (a disturbance torque, N·m, held over the period) and
v_t ~ N(0, diag(σ_θ² I, σ_θ̇² I)) (of the measured angles, rad, and rates, rad/s). The regulator
minimises E Σ_t x_tᵀ Q x_t + u_tᵀ R u_t. By the separation principle it is u_t = −L x̂_t with

    L = (R + Bᵀ P B)⁻¹ Bᵀ P A,           P = Aᵀ P A + Q − Aᵀ P B L          (control Riccati equation)
    K_f = S (S + V)⁻¹,                   S = A S Aᵀ + W − A K_f S Aᵀ        (filter Riccati equation)

where W = σ_w² B Bᵀ and S is the covariance of the one-step prediction x̄_t. Every control period:

    x̂_t = x̄_t + K_f (y_t − x̄_t);   u_t = sat(−L x̂_t);   x̄_{t+1} = A x̂_t + B u_t.

The prediction uses the *saturated* torque. When K is activated at the state x, x̄_0 = x: the supervisor
has just read that state. The covariances only design the filter; rollouts are free of noise, because
the label l(x) of eq. (2) is a function of x.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from srlrepro.compiled.jit import jit
from srlrepro.compiled.stack import room
from srlrepro.dynamics.pendulum import Floats, Pendulum
from srlrepro.settings.choices import Choices
from srlrepro.settings.config import check_parameters
from srlrepro.settings.fields import check
from srlrepro.settings.paper import Paper

Gains = tuple[Floats, Floats, Floats, Floats, float]  # A, B, L, K_f, torque limit


def riccati(a: Floats, b: Floats, q: Floats, r: Floats) -> Floats:
    """P of the module's control equation, for A [n, n], B [n, m], Q [n, n], R [m, m].

    Raises:
        LinAlgError: there is none, or the numbers are too large or too small to find it.
    """
    try:
        return np.asarray(solve_discrete_are(a, b, q, r), np.float64)
    except ValueError as error:  # of infinite numbers, and of an order that rounding has spoilt
        raise np.linalg.LinAlgError(str(error)) from error


@jit
def lqg_update(gains: Gains, xbar: Floats, y: Floats, u: Floats) -> None:
    """One period of K: reads the measurement y [2n], writes u [n], advances the prediction x̄ [2n]."""
    a, b, gain, filter_gain, limit = gains
    size, xhat = xbar.size, room()
    for i in range(size):
        s = xbar[i]
        for j in range(size):
            s += filter_gain[i, j] * (y[j] - xbar[j])
        xhat[i] = s
    for i in range(u.size):
        s = 0.0
        for j in range(size):
            s -= gain[i, j] * xhat[j]
        u[i] = min(max(s, -limit), limit)
    for i in range(size):
        s = 0.0
        for j in range(size):
            s += a[i, j] * xhat[j]
        for j in range(u.size):
            s += b[i, j] * u[j]
        xbar[i] = s


@dataclass(frozen=True)
class LQG:
    """K(x) for one nominal system; see the module for the problem that it solves.

    Raises:
        ParameterError: a value is not allowed, or the "nominal" system has Δ ≠ 1.
        LinAlgError (from its gains): there is no K for these values, as far as rounding allows to tell.
    """

    nominal: Pendulum = Pendulum()
    control_period: float = Choices.control_period  # s
    lqr_angle_weight: float = Choices.lqr_angle_weight  # first n of diag Q, 1/rad²
    lqr_rate_weight: float = Choices.lqr_rate_weight  # last n of diag Q, s²/rad²
    lqr_torque_weight: float = Choices.lqr_torque_weight  # diag R, 1/(N·m)²
    torque_noise: float = Choices.torque_noise  # σ_w, N·m
    angle_noise: float = Choices.angle_noise  # σ_θ, rad
    rate_noise: float = Choices.rate_noise  # σ_θ̇, rad/s
    torque_limit: float = Paper.torque_limit  # saturation of each torque, N·m

    def __post_init__(self) -> None:
        check_parameters(vars(self))
        delta = self.nominal.delta
        check(delta == 1.0, "nominal.delta", delta, "1: K knows the nominal system only")

    def sampled(self, system: Pendulum) -> tuple[Floats, Floats]:
        """A [2n, 2n], B [2n, n] of a system linearised at upright under zero-order hold."""
        a, b = system.linearize()
        n, m = b.shape
        # As scipy.signal's cont2discrete; importing that takes half a second of every process.
        held = expm(self.control_period * np.block([[a, b], [np.zeros((m, n + m))]]))
        return held[:n, :n], held[:n, n:]

    @cached_property
    def model(self) -> tuple[Floats, Floats]:
        """A [2n, 2n], B [2n, n] of the sampled nominal system."""
        return self.sampled(self.nominal)

    @cached_property
    def weights(self) -> tuple[Floats, Floats]:
        """Q [2n, 2n] and R [n, n]."""
        n = self.nominal.links
        q = np.diag([self.lqr_angle_weight] * n + [self.lqr_rate_weight] * n)
        return q, self.lqr_torque_weight * np.eye(n)

    @cached_property
    def noise(self) -> tuple[Floats, Floats]:
        """W and V [2n, 2n], the covariances of B w_t and v_t."""
        n, (_, b) = self.nominal.links, self.model
        measured = np.diag([self.angle_noise**2] * n + [self.rate_noise**2] * n)
        return self.torque_noise**2 * b @ b.T, measured

    @cached_property
    def gain(self) -> Floats:
        """The feedback gain L [n, 2n] in N·m per rad and rad/s."""
        (a, b), (q, r) = self.model, self.weights
        p = riccati(a, b, q, r)
        return np.asarray(np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a), np.float64)

    @cached_property
    def filter_gain(self) -> Floats:
        """The steady-state Kalman gain K_f [2n, 2n] of the measurement update."""
        (a, _), (w, v) = self.model, self.noise
        s = riccati(a.T, np.eye(len(a)), w, v)
        return np.asarray(np.linalg.solve(s + v, s).T, np.float64)

    @property
    def arrays(self) -> Gains:
        """(A, B, L, K_f, torque limit) as the compiled kernels take them."""
        a, b = self.model
        ordered = [np.ascontiguousarray(m) for m in (a, b, self.gain, self.filter_gain)]
        return ordered[0], ordered[1], ordered[2], ordered[3], self.torque_limit

    def closed_loop(self, system: Pendulum) -> Floats:
        """Transition matrix [4n, 4n] of (x, x̄) near upright, without saturation.

        x_{t+1} = A_Δ x − B_Δ L x̂ and x̄_{t+1} = (A − B L) x̂, where x̂ = (I − K_f) x̄ + K_f x.
        """
        (a, b), (a_real, b_real) = self.model, self.sampled(system)
        from_x, from_xbar = self.filter_gain, np.eye(len(a)) - self.filter_gain
        to_x = [a_real - b_real @ self.gain @ from_x, -b_real @ self.gain @ from_xbar]
        regulated = a - b @ self.gain
        return np.block([to_x, [regulated @ from_x, regulated @ from_xbar]])

    def spectral_radius(self, system: Pendulum) -> float:
        """Largest |eigenvalue| of `closed_loop`; below 1, upright is locally asymptotically stable."""
        return float(np.abs(np.linalg.eigvals(self.closed_loop(system))).max())
