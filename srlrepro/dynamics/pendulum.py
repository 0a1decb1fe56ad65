r"""The inverted pendulum of n links: equations of motion, integration, geometry. The paper's has three.

**Coordinates.** The state is x = [θ1 … θn θ̇1 … θ̇n] (rad, rad/s) in *joint* angles: θ1 is the angle
of link 1 from the vertical, the others are the angles of links relative to the link before.
Zero is upright; positive angles turn clockwise, so that the *absolute* angles φ_i = θ1 + … + θ_i place
the tip of link i at p_i = p_{i-1} + l_i (sin φ_i, cos φ_i), and the end-effector of the zero
configuration at (0, l1 + … + ln) = (0, 3) m.

**Equations of motion.** The mass m_i sits in the middle of link i, hence

    r_i = Σ_j a_ij (sin φ_j, cos φ_j),     a_ij = l_j (j < i),  l_i / 2 (j = i),  0 (j > i).

With the kinetic energy T = ½ Σ_i m_i ‖ṙ_i‖² = ½ Σ_jk c_jk cos(φ_j − φ_k) φ̇_j φ̇_k, where
c_jk = Σ_i m_i a_ij a_ik, and the potential energy V = g Σ_j b_j cos φ_j, where b_j = Σ_i m_i a_ij,
Lagrange's equations in φ read

    Σ_k c_jk cos(φ_j − φ_k) φ̈_k + Σ_k c_jk sin(φ_j − φ_k) φ̇_k² − g b_j sin φ_j = τ_j.

The joint torques do the work Σ_i u_i δθ_i with δθ_1 = δφ_1, δθ_i = δφ_i − δφ_{i−1}, so that
τ_j = u_j − u_{j+1} and τ_n = u_n. Solving the symmetric positive-definite system for φ̈ by M = L D Lᵀ and
taking differences gives θ̈, i.e. ẋ = f(x) + g(x) u of eq. (7); eq. (1) is the same with other masses, the
difference being d(x).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from srlrepro.compiled.arithmetic import sin_cos
from srlrepro.compiled.jit import jit
from srlrepro.compiled.stack import packed, room, unpacked
from srlrepro.settings.choices import Choices
from srlrepro.settings.condition import check_delta
from srlrepro.settings.config import check_parameters
from srlrepro.settings.fields import check
from srlrepro.settings.paper import Paper

Floats = NDArray[np.float64]
State = tuple[float, ...]  # [2n]; the length of a tuple tells compiled code how many links there are
Torque = tuple[float, ...]  # [n]


class Coefficients(NamedTuple):
    """The equations of motion as compiled code takes them."""

    c: Floats  # [n, n] c_jk, kg·m²
    gb: Floats  # [n] g b_j, N·m
    upright: State  # [2n] zeros
    idle: Torque  # [n] zeros


@jit
def derivative(coefficients: Coefficients, state: State, torque: Torque) -> State:
    """ẋ [2n] of the state [2n] under the torque [n]."""
    c, gb, n = coefficients.c, coefficients.gb, len(torque)
    x, u, rate_of = unpacked(state), unpacked(torque), room()
    sine, cosine, squared, pivot, factor = room(), room(), room(), room(), room()
    angle, rate = 0.0, 0.0
    for j in range(n):
        angle += x[j]  # φ_j
        rate += x[n + j]  # φ̇_j
        sine[j], cosine[j] = sin_cos(angle)
        squared[j] = rate * rate
        rate_of[j] = x[n + j]
        force = u[j] + gb[j] * sine[j]
        rate_of[n + j] = force - u[j + 1] if j < n - 1 else force
    for j in range(n):
        for i in range(j):
            turn = c[j, i] * (sine[j] * cosine[i] - cosine[j] * sine[i])  # c_ji sin(φ_j − φ_i)
            rate_of[n + j] -= turn * squared[i]
            rate_of[n + i] += turn * squared[j]
    for j in range(n):  # M = L D Lᵀ: L D stands below the diagonal of `factor`, Lᵀ above; 1 / D is `pivot`
        diagonal, force = c[j, j], rate_of[n + j]
        for i in range(j):
            below = c[j, i] * (cosine[j] * cosine[i] + sine[j] * sine[i])  # c_ji cos(φ_j − φ_i)
            for k in range(i):
                below -= factor[n * j + k] * factor[n * k + i]
            above = below * pivot[i]
            factor[n * j + i], factor[n * i + j] = below, above
            diagonal -= above * below
            force -= above * rate_of[n + i]
        pivot[j], rate_of[n + j] = 1.0 / diagonal, force
    for step in range(n):  # φ̈_n, …, φ̈_1 by back substitution
        j = n - 1 - step
        angular = rate_of[n + j] * pivot[j]
        for i in range(j + 1, n):
            angular -= factor[n * j + i] * rate_of[n + i]
        rate_of[n + j] = angular
    for step in range(n - 1):
        j = n - 1 - step
        rate_of[n + j] -= rate_of[n + j - 1]
    return packed(rate_of, state)


@jit
def _move(state: State, h: float, rate: State) -> State:
    """x + h ẋ."""
    x, rate_of = unpacked(state), unpacked(rate)
    for i in range(len(state)):
        x[i] += h * rate_of[i]
    return packed(x, state)


@jit
def rk4_step(c: Coefficients, x: State, u: Torque, dt: float) -> State:
    """The state [2n] after one step of the classical 4th-order Runge-Kutta method, the torque u [n] held."""
    k1 = derivative(c, x, u)
    k2 = derivative(c, _move(x, 0.5 * dt, k1), u)
    k3 = derivative(c, _move(x, 0.5 * dt, k2), u)
    k4 = derivative(c, _move(x, dt, k3), u)
    x = _move(_move(x, dt / 6.0, k1), dt / 6.0, k4)
    return _move(_move(x, dt / 3.0, k2), dt / 3.0, k3)


@jit
def tip(lengths: tuple[float, ...], state: State) -> tuple[float, float]:
    """End-effector position (p_x, p_y) of the state [2n]; lengths: [n]."""
    l, x = unpacked(lengths), unpacked(state)
    px, py, angle = 0.0, 0.0, 0.0
    for j in range(len(lengths)):
        angle += x[j]
        sine, cosine = sin_cos(angle)
        px += l[j] * sine
        py += l[j] * cosine
    return px, py


def as_states(x: ArrayLike, dimension: int, name: str = "x") -> Floats:
    """States as a float64 array [B, dimension]; a single state [dimension] becomes [1, dimension].

    Raises:
        ParameterError: other shapes, NaN or infinity.
    """
    array = np.atleast_2d(np.asarray(x, dtype=np.float64))
    fits = array.ndim == 2 and array.shape[1] == dimension
    check(fits, name, f"shape {np.shape(x)}", f"states of shape [B, {dimension}]")
    check(bool(np.isfinite(array).all()), name, "NaN or infinity", "finite numbers (rad, rad/s)")
    return np.ascontiguousarray(array)


@dataclass(frozen=True)
class Pendulum:
    """The pendulum of Sec. IV-A, with any number n of equal links that share its length and mass.

    ``delta`` = 1 is the nominal system (eq. 7), else it is a real one (eq. 1). Δ scales the mass of every
    link but the last, as in the paper; so it changes nothing of a single link.

    Raises:
        ParameterError: a value is not allowed.
    """

    delta: float = 1.0  # mass mismatch Δ
    links: int = Paper.links  # n
    mass: float = Paper.mass  # nominal mass of the whole, kg
    length: float = Paper.length  # of the whole, m
    gravity: float = Choices.gravity  # m/s²

    def __post_init__(self) -> None:
        check_delta(self.delta)
        check_parameters(vars(self))

    @property
    def dimension(self) -> int:
        """2n, of the state."""
        return 2 * self.links

    @property
    def masses(self) -> tuple[float, ...]:
        """(m1, …, mn) in kg: all but the last are those of the nominal system times Δ (Sec. IV-A)."""
        m = self.mass / self.links
        return (*(self.delta * m,) * (self.links - 1), m)

    @property
    def lengths(self) -> tuple[float, ...]:
        """(l1, …, ln) in m (Sec. IV-A)."""
        return (self.length / self.links,) * self.links

    @property
    def coefficients(self) -> Coefficients:
        """The coefficients of the module's equations; each sum is rounded once."""
        n, m, l = self.links, self.masses, self.lengths
        a = [[l[j] if j < i else l[j] / 2 if j == i else 0.0 for j in range(n)] for i in range(n)]  # m
        c = [[math.fsum(m[i] * a[i][j] * a[i][k] for i in range(n)) for k in range(n)] for j in range(n)]
        gb = [self.gravity * math.fsum(m[i] * a[i][j] for i in range(n)) for j in range(n)]
        return Coefficients(np.array(c), np.array(gb), (0.0,) * self.dimension, (0.0,) * n)

    def linearize(self) -> tuple[Floats, Floats]:
        """A [2n, 2n] and B [2n, n] of ẋ ≈ A x + B u at upright, in closed form.

        At φ = 0 the mass matrix is the constant c and the velocity terms vanish to first order, so
        c φ̈ = g diag(b) φ + Dᵀ u, with θ = D φ and φ = D⁻¹ θ.
        """
        n, (c, gb, *_) = self.links, self.coefficients
        d = np.eye(n) - np.eye(n, k=-1)
        a, b = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, n))
        a[:n, n:] = np.eye(n)
        a[n:, :n] = d @ np.linalg.solve(c, np.diag(gb)) @ np.linalg.inv(d)
        b[n:] = d @ np.linalg.solve(c, d.T)
        return a, b

    def energy(self, x: ArrayLike) -> Floats:
        """Kinetic plus potential energy [B], J, of states [B, 2n]; zero at rest at the height of the base."""
        states, n, (c, gb, *_) = as_states(x, self.dimension), self.links, self.coefficients
        phi, rate = np.cumsum(states[:, :n], axis=1), np.cumsum(states[:, n:], axis=1)
        cosine = np.cos(phi[:, :, None] - phi[:, None, :])
        kinetic = 0.5 * np.einsum("bj,jk,bjk,bk->b", rate, c, cosine, rate)
        return np.asarray(kinetic + np.cos(phi) @ gb, np.float64)

    def step(self, x: ArrayLike, u: ArrayLike, dt: float) -> Floats:
        """States [B, 2n] after one Runge-Kutta step of dt s from x [B, 2n]; torques u [B, n] N·m are held.

        Raises:
            ParameterError: shapes or values that are not allowed.
        """
        states, torques = as_states(x, self.dimension), np.atleast_2d(np.asarray(u, np.float64))
        fits = torques.shape == (len(states), self.links) and bool(np.isfinite(torques).all())
        check(fits, "u", f"shape {torques.shape}", f"finite torques of shape [{len(states)}, {self.links}]")
        check(0 < dt < math.inf, "dt", dt, "a finite number of seconds > 0")
        pairs = zip(states.tolist(), torques.tolist(), strict=True)
        c = self.coefficients
        return np.array([rk4_step(c, tuple(a), tuple(b), dt) for a, b in pairs]).reshape(states.shape)

    def joints(self, x: ArrayLike) -> Floats:
        """Positions [B, n + 1, 2] in m of the base, the inner joints and the end-effector."""
        phi = np.cumsum(as_states(x, self.dimension)[:, : self.links], axis=1)
        links = np.array(self.lengths)[:, None] * np.stack([np.sin(phi), np.cos(phi)], axis=-1)
        base = np.zeros((len(phi), 1, 2))
        return np.concatenate([base, np.cumsum(links, axis=1)], axis=1)
