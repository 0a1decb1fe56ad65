r"""The three-link inverted pendulum: equations of motion, integration, geometry.

**Coordinates.** The state is x = [θ1 θ2 θ3 θ̇1 θ̇2 θ̇3] (rad, rad/s) in *joint* angles: θ1 is the angle
of link 1 from the vertical, θ2 and θ3 are the angles of links 2 and 3 relative to the link before.
Zero is upright; positive angles turn clockwise, so that the *absolute* angles φ_i = θ1 + … + θ_i place
the tip of link i at p_i = p_{i-1} + l_i (sin φ_i, cos φ_i), and the end-effector of the zero
configuration at (0, l1 + l2 + l3) = (0, 3) m.

**Equations of motion.** The mass m_i sits in the middle of link i, hence

    r_i = Σ_j a_ij (sin φ_j, cos φ_j),     a_ij = l_j (j < i),  l_i / 2 (j = i),  0 (j > i).

With the kinetic energy T = ½ Σ_i m_i ‖ṙ_i‖² = ½ Σ_jk c_jk cos(φ_j − φ_k) φ̇_j φ̇_k, where
c_jk = Σ_i m_i a_ij a_ik, and the potential energy V = g Σ_j b_j cos φ_j, where b_j = Σ_i m_i a_ij,
Lagrange's equations in φ read

    Σ_k c_jk cos(φ_j − φ_k) φ̈_k + Σ_k c_jk sin(φ_j − φ_k) φ̇_k² − g b_j sin φ_j = τ_j.

The joint torques do the work Σ_i u_i δθ_i with δθ_1 = δφ_1, δθ_i = δφ_i − δφ_{i−1}, so that
τ = (u1 − u2, u2 − u3, u3). Solving the symmetric positive-definite 3×3 system for φ̈ and taking
differences gives θ̈, i.e. ẋ = f(x) + g(x) u of eq. (7); eq. (1) is the same with other masses, the
difference being d(x).
"""

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from srlrepro.compiled.jit import inner, jit
from srlrepro.settings.choices import Choices
from srlrepro.settings.condition import check_delta
from srlrepro.settings.config import check_parameters
from srlrepro.settings.fields import check
from srlrepro.settings.paper import Paper

Floats = NDArray[np.float64]
State = tuple[float, float, float, float, float, float]
Torque = tuple[float, float, float]
Coefficients = tuple[float, float, float, float, float, float, float, float, float]


@jit
def derivative(c: Coefficients, x: State, u: Torque) -> State:
    """ẋ (6-tuple) of the state x (6-tuple) under the torque u (3-tuple); ``c``: `coefficients`."""
    c11, c12, c13, c22, c23, c33, gb1, gb2, gb3 = c
    s1, k1 = math.sin(x[0]), math.cos(x[0])
    s2, k2 = math.sin(x[0] + x[1]), math.cos(x[0] + x[1])
    s3, k3 = math.sin(x[0] + x[1] + x[2]), math.cos(x[0] + x[1] + x[2])
    w1 = x[3] * x[3]  # φ̇_j²
    w2 = (x[3] + x[4]) * (x[3] + x[4])
    w3 = (x[3] + x[4] + x[5]) * (x[3] + x[4] + x[5])
    n12 = c12 * (s1 * k2 - k1 * s2)  # c_jk sin(φ_j − φ_k)
    n13 = c13 * (s1 * k3 - k1 * s3)
    n23 = c23 * (s2 * k3 - k2 * s3)
    f1 = u[0] - u[1] - n12 * w2 - n13 * w3 + gb1 * s1
    f2 = u[1] - u[2] + n12 * w1 - n23 * w3 + gb2 * s2
    f3 = u[2] + n13 * w1 + n23 * w2 + gb3 * s3
    m12 = c12 * (k1 * k2 + s1 * s2)  # c_jk cos(φ_j − φ_k)
    m13 = c13 * (k1 * k3 + s1 * s3)
    m23 = c23 * (k2 * k3 + s2 * s3)
    l21, l31 = m12 / c11, m13 / c11  # M = L D Lᵀ
    d2 = c22 - l21 * m12
    h32 = m23 - l31 * m12
    l32 = h32 / d2
    d3 = c33 - l31 * m13 - l32 * h32
    f2 -= l21 * f1
    f3 -= l31 * f1 + l32 * f2
    a3 = f3 / d3  # φ̈_3, φ̈_2, φ̈_1 by back substitution
    a2 = f2 / d2 - l32 * a3
    a1 = f1 / c11 - l21 * a2 - l31 * a3
    return (x[3], x[4], x[5], a1, a2 - a1, a3 - a2)


@inner
def _move(x: State, h: float, dx: State) -> State:
    """x + h dx, on 6-tuples."""
    angle1, angle2, angle3 = x[0] + h * dx[0], x[1] + h * dx[1], x[2] + h * dx[2]
    return angle1, angle2, angle3, x[3] + h * dx[3], x[4] + h * dx[4], x[5] + h * dx[5]


@jit
def rk4_step(c: Coefficients, x: State, u: Torque, dt: float) -> State:
    """One step of the classical 4th-order Runge-Kutta method, u held; 6-tuple in, 6-tuple out."""
    k1 = derivative(c, x, u)
    k2 = derivative(c, _move(x, 0.5 * dt, k1), u)
    k3 = derivative(c, _move(x, 0.5 * dt, k2), u)
    k4 = derivative(c, _move(x, dt, k3), u)
    x = _move(_move(x, dt / 6.0, k1), dt / 6.0, k4)
    return _move(_move(x, dt / 3.0, k2), dt / 3.0, k3)


@jit
def as_state(a: Floats) -> State:
    """The first six entries of an array as a tuple."""
    return (a[0], a[1], a[2], a[3], a[4], a[5])


@jit
def tip(lengths: Torque, x: State) -> tuple[float, float]:
    """End-effector position (p_x, p_y) of the state x (6-tuple)."""
    phi2, phi3 = x[0] + x[1], x[0] + x[1] + x[2]
    l1, l2, l3 = lengths
    return (
        l1 * math.sin(x[0]) + l2 * math.sin(phi2) + l3 * math.sin(phi3),
        l1 * math.cos(x[0]) + l2 * math.cos(phi2) + l3 * math.cos(phi3),
    )


def as_states(x: ArrayLike, name: str = "x") -> Floats:
    """States as a float64 array [B, 6]; a single state [6] becomes [1, 6].

    Raises:
        ParameterError: other shapes, NaN or infinity.
    """
    array = np.atleast_2d(np.asarray(x, dtype=np.float64))
    check(array.ndim == 2 and array.shape[1] == 6, name, f"shape {np.shape(x)}", "states of shape [B, 6]")
    check(bool(np.isfinite(array).all()), name, "NaN or infinity", "finite numbers (rad, rad/s)")
    return np.ascontiguousarray(array)


@dataclass(frozen=True)
class ThreeLinkPendulum:
    """The pendulum of Sec. IV-A; ``delta`` = 1 is the nominal system (eq. 7), else a real one (eq. 1).

    Raises:
        ParameterError: a value is not a positive finite number.
    """

    delta: float = 1.0  # mass mismatch Δ
    link_mass: float = Paper.link_mass  # nominal mass of each link, kg
    link_length: float = Paper.link_length  # of each link, m
    gravity: float = Choices.gravity  # m/s²

    def __post_init__(self) -> None:
        check_delta(self.delta)
        check_parameters(vars(self))

    @property
    def masses(self) -> tuple[float, float, float]:
        """(m1, m2, m3) in kg: the first two are those of the nominal system times Δ (Sec. IV-A)."""
        m = self.link_mass
        return (self.delta * m, self.delta * m, m)

    @property
    def lengths(self) -> tuple[float, float, float]:
        """(l1, l2, l3) in m (Sec. IV-A)."""
        return (self.link_length,) * 3

    @property
    def coefficients(self) -> Coefficients:
        """(c11, c12, c13, c22, c23, c33) in kg·m² and (g b1, g b2, g b3) in N·m: see the module."""
        m, l = np.array(self.masses), np.array(self.lengths)
        a = np.tril(np.tile(l, (3, 1)), -1) + np.diag(l / 2)  # a_ij [3, 3] m
        c = a.T @ np.diag(m) @ a
        gb = self.gravity * (m @ a)
        return cast(Coefficients, tuple(float(v) for v in (*c[np.triu_indices(3)], *gb)))

    def linearize(self) -> tuple[Floats, Floats]:
        """A [6, 6] and B [6, 3] of ẋ ≈ A x + B u at upright, in closed form.

        At φ = 0 the mass matrix is the constant c and the velocity terms vanish to first order, so
        c φ̈ = g diag(b) φ + Dᵀ u, with θ = D φ and φ = D⁻¹ θ.
        """
        c11, c12, c13, c22, c23, c33, *gb = self.coefficients
        c = np.array([[c11, c12, c13], [c12, c22, c23], [c13, c23, c33]])
        d = np.eye(3) - np.eye(3, k=-1)
        a, b = np.zeros((6, 6)), np.zeros((6, 3))
        a[:3, 3:] = np.eye(3)
        a[3:, :3] = d @ np.linalg.solve(c, np.diag(gb)) @ np.linalg.inv(d)
        b[3:] = d @ np.linalg.solve(c, d.T)
        return a, b

    def energy(self, x: ArrayLike) -> Floats:
        """Kinetic plus potential energy [B] in J of states [B, 6], zero at rest at the height of the base."""
        states = as_states(x)
        c11, c12, c13, c22, c23, c33, *gb = self.coefficients
        c = np.array([[c11, c12, c13], [c12, c22, c23], [c13, c23, c33]])
        phi, rate = np.cumsum(states[:, :3], axis=1), np.cumsum(states[:, 3:], axis=1)
        cosine = np.cos(phi[:, :, None] - phi[:, None, :])
        kinetic = 0.5 * np.einsum("bj,jk,bjk,bk->b", rate, c, cosine, rate)
        return np.asarray(kinetic + np.cos(phi) @ np.array(gb), np.float64)

    def step(self, x: ArrayLike, u: ArrayLike, dt: float) -> Floats:
        """States [B, 6] after one Runge-Kutta step of dt s from x [B, 6], with the torques u [B, 3] N·m held.

        Raises:
            ParameterError: shapes or values that are not allowed.
        """
        states, torques = as_states(x), np.atleast_2d(np.asarray(u, np.float64))
        fits = torques.shape == (len(states), 3) and bool(np.isfinite(torques).all())
        check(fits, "u", f"shape {torques.shape}", f"finite torques of shape [{len(states)}, 3]")
        check(0 < dt < math.inf, "dt", dt, "a finite number of seconds > 0")
        pairs = zip(states.tolist(), torques.tolist(), strict=True)
        return np.array([rk4_step(self.coefficients, tuple(a), tuple(b), dt) for a, b in pairs])

    def joints(self, x: ArrayLike) -> Floats:
        """Positions [B, 4, 2] in m of the base, the two inner joints and the end-effector."""
        phi = np.cumsum(as_states(x)[:, :3], axis=1)
        links = np.array(self.lengths)[:, None] * np.stack([np.sin(phi), np.cos(phi)], axis=-1)
        base = np.zeros((len(phi), 1, 2))
        return np.concatenate([base, np.cumsum(links, axis=1)], axis=1)
