"""The pendulum against two other derivations, conservation laws, finite differences and a second geometry."""

import math
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from numba import njit
from scipy.linalg import eigh
from sympy.physics import mechanics

from srlrepro.dynamics import pendulum
from srlrepro.dynamics.pendulum import Floats, Pendulum, derivative, rk4_step, tip
from srlrepro.settings.fields import ParameterError
from srlrepro.settings.paper import Paper

DELTAS = (0.3, 1.0, 1.1, 1.5, 4.0)
LINKS = range(1, 9)
SYSTEMS = [Pendulum(delta) for delta in DELTAS] + [Pendulum(1.5, 3, 2.1, 1.2, 3.7)]
CHAINS = [Pendulum(1.5, links) for links in LINKS]
SYMBOLIC = [system for system in SYSTEMS + CHAINS if system.links <= 3]  # beyond, the symbols take minutes


def draw_states(system: Pendulum, count: int) -> Floats:
    """States [count, 2n], uniform over the state space of the configuration."""
    high = np.array(Paper(links=system.links).state_max)
    return np.random.default_rng(0).uniform(-high, high, (count, high.size))


def draw_torques(system: Pendulum, count: int, largest: float = 100.0) -> Floats:
    """Torques [count, n] N·m, uniform within ±largest."""
    return np.random.default_rng(1).uniform(-largest, largest, (count, system.links))


def acceleration(system: Pendulum, x: Floats, u: Floats) -> Floats:
    """θ̈ [B, n] rad/s² at the states x [B, 2n] under the torques u [B, n] N·m."""
    c, n = system.coefficients, system.links
    return np.array([derivative(c, tuple(a), tuple(b))[n:] for a, b in zip(x, u, strict=True)])


@cache
def kane(n: int) -> Callable[..., tuple[Any, Any]]:
    """Mass matrix and forcing of n massless rods with point masses at mid-link, by Kane's method."""
    q, w = (mechanics.dynamicsymbols(f"{name}1:{n + 1}") for name in "qw")
    u, m = (sp.symbols(f"{name}1:{n + 1}") for name in "um")
    length, gravity = sp.symbols("l g")
    world, base = mechanics.ReferenceFrame("N"), mechanics.Point("O")
    base.set_vel(world, 0)
    frame, joint, bodies, loads = world, base, [], []
    frames = []
    for i in range(n):
        link = frame.orientnew(f"L{i}", "Axis", (-q[i], world.z))  # positive angles turn clockwise
        link.set_ang_vel(frame, -w[i] * world.z)
        middle = joint.locatenew(f"M{i}", length / 2 * link.y)
        middle.v2pt_theory(joint, world, link)
        end = joint.locatenew(f"E{i}", length * link.y)
        end.v2pt_theory(joint, world, link)
        bodies.append(mechanics.Particle(f"P{i}", middle, m[i]))
        loads.append((middle, -m[i] * gravity * world.y))
        loads.append((link, -u[i] * world.z))  # the motor of joint i pushes link i ...
        if i:
            loads.append((frame, u[i] * world.z))  # ... and the link before it the other way
        frame, joint = link, end
        frames.append(link)
    rates = [a.diff() - b for a, b in zip(q, w, strict=True)]
    method = mechanics.KanesMethod(world, q_ind=q, u_ind=w, kd_eqs=rates)
    method.kanes_equations(bodies, loads)
    matrices = method.mass_matrix, method.forcing
    return sp.lambdify([q, w, u, m, length, gravity], matrices, "numpy", cse=True)


@pytest.mark.parametrize("system", SYMBOLIC, ids=str)
def test_accelerations_follow_from_kanes_method(system: Pendulum) -> None:
    n, states, torques = system.links, draw_states(system, 50), draw_torques(system, 50)
    expected = []
    for x, u in zip(states, torques, strict=True):
        mass, force = kane(n)(x[:n], x[n:], u, system.masses, system.lengths[0], system.gravity)
        expected.append(np.linalg.solve(mass, force[:, 0]))
    found = acceleration(system, states, torques)
    scale = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_array_less(np.abs(found - expected), 1e-9 * np.broadcast_to(scale, found.shape))


@pytest.mark.parametrize("system", CHAINS, ids=str)
def test_torques_follow_from_newtons_law(system: Pendulum) -> None:
    """The torque of a joint is the moment about it of the forces on the masses beyond (complex plane)."""
    states, torques, n = draw_states(system, 50), draw_torques(system, 50), system.links
    angle, rate = (np.cumsum(part, axis=1) for part in (states[:, :n], states[:, n:]))
    turned = np.cumsum(acceleration(system, states, torques), axis=1)
    along = np.array(system.lengths) * np.exp(-1j * angle)  # a link is i·along
    link, pull = 1j * along, turned * along - 1j * rate**2 * along
    place, moved = (np.cumsum(part, axis=1) - part / 2 for part in (link, pull))  # of the masses
    force = np.array(system.masses) * (moved + 1j * system.gravity)
    joint = np.cumsum(link, axis=1) - link
    for j in range(n):
        arm = place[:, j:] - joint[:, j : j + 1]
        found = -(np.conj(arm) * force[:, j:]).imag.sum(axis=1)  # positive clockwise
        scale = np.abs(arm * force[:, j:]).sum(axis=1)
        assert (np.abs(found - torques[:, j]) < 1e-11 * scale).all()


@njit
def _many_steps(c: Any, x: Any, u: Any, dt: float, n: int) -> Any:
    for _ in range(n):
        x = rk4_step(c, x, u, dt)
    return x


def simulate(system: Pendulum, x: Floats, u: Floats, seconds: float, steps: int) -> Floats:
    c, dt = system.coefficients, seconds / steps
    return np.array([_many_steps(c, tuple(a), tuple(b), dt, steps) for a, b in zip(x, u, strict=True)])


@pytest.mark.parametrize("system", SYSTEMS + CHAINS, ids=str)
def test_energy_is_conserved_without_torque(system: Pendulum) -> None:
    start = 0.3 * draw_states(system, 20)
    end = simulate(system, start, np.zeros((20, system.links)), 0.5, 60_000)
    assert np.abs(end - start).max() > 1.0  # they have moved
    np.testing.assert_allclose(system.energy(end), system.energy(start), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("system", SYSTEMS + CHAINS, ids=str)
def test_energy_grows_by_the_work_of_the_torques(system: Pendulum) -> None:
    """The work of a held torque is Σ u_i (θ_i(T) − θ_i(0)), exactly."""
    start, torques = 0.3 * draw_states(system, 20), draw_torques(system, 20, 10.0 / system.links)
    end = simulate(system, start, torques, 0.25, 40_000)
    work = (torques * (end - start)[:, : system.links]).sum(axis=1)
    assert np.abs(work).min() > 1e-3
    np.testing.assert_allclose(system.energy(end) - system.energy(start), work, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("system", CHAINS, ids=str)
def test_energy_is_that_of_the_moving_masses(system: Pendulum) -> None:
    """Velocities of the masses from a difference quotient of their positions along the motion."""
    states, n, h = draw_states(system, 20), system.links, 1e-6

    def masses_at(x: Floats) -> Floats:
        joints = system.joints(x)
        return (joints[:, 1:] + joints[:, :-1]) / 2

    turned = np.concatenate([states[:, n:], np.zeros((20, n))], axis=1)
    velocity = (masses_at(states + h * turned) - masses_at(states - h * turned)) / (2 * h)
    m = np.array(system.masses)
    kinetic = 0.5 * ((velocity**2).sum(axis=2) * m).sum(axis=1)
    potential = system.gravity * (masses_at(states)[:, :, 1] * m).sum(axis=1)
    np.testing.assert_allclose(system.energy(states), kinetic + potential, rtol=1e-7)


def test_integrator_is_of_fourth_order() -> None:
    system, start, u = Pendulum(1.5), np.array([[0.3, -0.2, 0.4, 0.1, 0.0, -0.3]]), np.ones((1, 3))
    ends = [simulate(system, start, u, 0.5, steps) for steps in (20, 40, 80)]
    ratio = np.linalg.norm(ends[1] - ends[0]) / np.linalg.norm(ends[2] - ends[1])
    assert 14 < ratio < 18.5  # 2⁴; a third-order method would give 8, a fifth-order one 32


@pytest.mark.parametrize("system", SYSTEMS + CHAINS, ids=str)
def test_linearization_is_the_derivative_at_upright(system: Pendulum) -> None:
    (a, b), n, h = system.linearize(), system.links, 1e-5
    zero, rest, turned = np.zeros((2 * n, n)), np.zeros((n, 2 * n)), h * np.eye(2 * n)
    by_x = (acceleration(system, turned, zero) - acceleration(system, -turned, zero)) / (2 * h)
    by_u = acceleration(system, rest, np.eye(n)) - acceleration(system, rest, np.zeros((n, n)))
    np.testing.assert_allclose(a, np.vstack([np.eye(2 * n)[n:], by_x.T]), rtol=1e-7, atol=1e-5)
    np.testing.assert_allclose(b, np.vstack([np.zeros((n, n)), by_u.T]), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("system", CHAINS, ids=str)
def test_it_swings_below_at_the_frequencies_of_its_modes(system: Pendulum) -> None:
    """Hanging at rest it turns to the mirror image of a small mode in half a period: c v ω² = g diag(b) v."""
    n, (c, gb, *_), size = system.links, system.coefficients, 1e-5
    squared, modes = eigh(np.diag(gb), c)
    for frequency, mode in zip(np.sqrt(squared), modes.T, strict=True):
        turned = size * np.diff(mode / np.abs(mode).max(), prepend=0.0)  # joint angles of absolute ones
        hanging, away = math.pi * np.eye(2 * n)[0], np.concatenate([turned, np.zeros(n)])
        (end,) = simulate(system, (hanging + away)[None], np.zeros((1, n)), math.pi / frequency, 4000)
        np.testing.assert_allclose(end - hanging, -away, atol=1e-3 * size * max(1.0, frequency))


def test_a_single_link_swings_as_the_textbook_says() -> None:
    (c, gb, *_), system = Pendulum(4.0, 1).coefficients, Pendulum(4.0, 1)
    assert system == replace(Pendulum(1.0, 1), delta=4.0) and system.masses == Pendulum(1.0, 1).masses
    assert gb[0] / c[0, 0] == pytest.approx(9.81 / 1.5)  # ω² = g / (l / 2)


@pytest.mark.parametrize("links", LINKS)
def test_the_links_share_length_and_mass(links: int) -> None:
    system = Pendulum(4.0, links)
    assert sum(system.lengths) == pytest.approx(3.0) and len(set(system.lengths)) == 1
    assert sum(Pendulum(links=links).masses) == pytest.approx(3.0)
    heavier = np.array(system.masses) / Pendulum(links=links).masses
    np.testing.assert_allclose(heavier, [4.0] * (links - 1) + [1.0])
    assert Pendulum().lengths == Pendulum().masses == (1.0, 1.0, 1.0)  # the paper's


@pytest.mark.parametrize("system", CHAINS, ids=str)
def test_positions_are_sums_of_rotated_links(system: Pendulum) -> None:
    """In the complex plane a link with absolute angle φ is i·l·exp(−iφ)."""
    states, n = draw_states(system, 50), system.links
    links = 3j / n * np.exp(-1j * np.cumsum(states[:, :n], axis=1))
    expected = np.cumsum(np.concatenate([np.zeros((50, 1)), links], axis=1), axis=1)
    joints = system.joints(states)
    np.testing.assert_allclose(joints[..., 0] + 1j * joints[..., 1], expected, atol=1e-12)
    tips = np.array([tip(system.lengths, tuple(x)) for x in states])
    np.testing.assert_allclose(tips, joints[:, n], atol=1e-12)


@pytest.mark.parametrize("links", LINKS)
def test_upright_is_an_equilibrium_with_the_tip_at_three_metres(links: int) -> None:
    system = Pendulum(4.0, links)
    zero = (0.0,) * (2 * links)
    assert tip(system.lengths, zero) == (0.0, pytest.approx(3.0))
    assert derivative(system.coefficients, zero, (0.0,) * links) == zero


@pytest.mark.parametrize("system", SYSTEMS + CHAINS, ids=str)
def test_mirror_images_move_as_mirror_images(system: Pendulum) -> None:
    states, torques = draw_states(system, 50), draw_torques(system, 50)
    for move in (acceleration, lambda system, x, u: simulate(system, x, u, 0.01, 1)):
        np.testing.assert_allclose(
            move(system, -states, -torques), -move(system, states, torques), rtol=1e-12
        )


@pytest.mark.parametrize("system", CHAINS, ids=str)
def test_compiled_code_does_what_the_source_says(system: Pendulum) -> None:
    """To the last bit: no sum is reordered, and no product is fused with it."""
    c = system.coefficients
    for x, u in zip(draw_states(system, 10).tolist(), draw_torques(system, 10).tolist(), strict=True):
        now = c, tuple(x), tuple(u)
        assert derivative.py_func(*now) == derivative(*now)
        assert rk4_step.py_func(*now, 0.001) == rk4_step(*now, 0.001)
        assert tip.py_func(system.lengths, now[1]) == tip(system.lengths, now[1])


def test_three_links_move_by_the_formulas_of_three_links() -> None:
    """M φ̈ = f of the module, written out for n = 3 and solved by Cramer's rule."""
    for system in SYSTEMS:
        c, gb, *_ = system.coefficients
        for x, u in zip(draw_states(system, 50), draw_torques(system, 50), strict=True):
            phi, rate = np.cumsum(x[:3]), np.cumsum(x[3:])
            apart = phi[:, None] - phi
            mass, gone = c * np.cos(apart), (c * np.sin(apart)) @ rate**2
            force = [u[0] - u[1], u[1] - u[2], u[2]] - gone + gb * np.sin(phi)
            columns = [np.column_stack([*mass.T[:j], force, *mass.T[j + 1 :]]) for j in range(3)]
            turned = np.array([np.linalg.det(m) for m in columns]) / np.linalg.det(mass)
            expected = np.diff(turned, prepend=0.0)
            found = derivative(system.coefficients, tuple(x), tuple(u))
            np.testing.assert_array_equal(found[:3], x[3:])
            np.testing.assert_allclose(found[3:], expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("links", [0, 9, 2.5, True, None])
def test_no_other_number_of_links_is_allowed(links: Any) -> None:
    with pytest.raises(ParameterError, match=rf"links = {links}: must be a whole number in \[1, 8\]"):
        Pendulum(links=links)


@pytest.mark.parametrize("name", ["delta", "mass", "length", "gravity"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_impossible_systems_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} = {value}"):
        Pendulum(**{name: value})


def test_bad_input_is_refused_by_name() -> None:
    for bad in (np.zeros((2, 5)), np.zeros((1, 2, 6)), np.full((2, 6), np.nan), np.full((2, 6), np.inf)):
        with pytest.raises(ValueError, match="x = "):
            Pendulum().joints(bad)


LABEL = """
from srlrepro import ClosedLoop
print(ClosedLoop().predict([0.3, 0, 0, 0, 0, 0])[0] == 1)
"""
PREDICTION = """
import numpy as np
from srlrepro import SafeRegion
x = np.random.default_rng(0).normal(size=(20, 6))
region = SafeRegion().fit_embedding(x, np.ones(20), x[:, :2])
print(region.safety(x[:1])[0] > 0.1)
"""
NOTHING_MOVES = "\n\n@jit\ndef derivative(c, x, u):\n    return c.upright\n"
ALL_FAR_AWAY = "\n\n@jit\ndef apply_network(network, scale, x):\n    return 1e9, 1e9\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("edited", "addition", "question"),
    [("dynamics/pendulum.py", NOTHING_MOVES, LABEL), ("region/mapping.py", ALL_FAR_AWAY, PREDICTION)],
    ids=["equations of motion", "another folder"],
)
def test_an_edit_reaches_what_was_compiled_before(
    edited: str, addition: str, question: str, tmp_path: Path
) -> None:
    """Compiled code is kept on disk; it must not outlive the source that it was compiled from."""
    package, ignored = tmp_path / "srlrepro", shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(pendulum.__file__).parents[1], package, ignore=ignored)
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    answers = []
    for text in ("", addition):
        with (package / edited).open("a") as source:
            source.write(text)
        command = [sys.executable, "-c", question]
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, check=True, capture_output=True, text=True
        )
        answers.append(done.stdout.strip())
    assert answers == ["True", "False"]


@pytest.mark.parametrize("system", SYSTEMS, ids=str)
def test_a_step_is_that_of_the_compiled_integrator(system: Pendulum) -> None:
    x, u = draw_states(system, 4), draw_torques(system, 4)
    expected = [rk4_step(system.coefficients, tuple(a), tuple(b), 1e-3) for a, b in zip(x, u, strict=True)]
    np.testing.assert_array_equal(system.step(x, u, 1e-3), expected)
    for wrong in ((x, u[:3], 1e-3), (x, u * np.nan, 1e-3), (x, u, 0.0), (x, u, np.nan), (x[:, :5], u, 1e-3)):
        with pytest.raises(ParameterError):
            system.step(*wrong)
