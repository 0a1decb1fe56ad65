"""The pendulum against a symbolic derivation, conservation laws, finite differences and a second geometry."""

import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from numba import njit
from sympy.physics import mechanics

from srlrepro.dynamics import pendulum
from srlrepro.dynamics.pendulum import Floats, Pendulum, derivative, rk4_step, tip
from srlrepro.settings.fields import ParameterError

DELTAS = (0.3, 1.0, 1.1, 1.5, 4.0)
SYSTEMS = [Pendulum(delta) for delta in DELTAS] + [Pendulum(1.5, 0.7, 0.4, 3.7)]
Draw = Callable[..., Floats]


def acceleration(system: Pendulum, x: Floats, u: Floats) -> Floats:
    """θ̈ [B, 3] rad/s² at the states x [B, 6] under the torques u [B, 3] N·m."""
    c = system.coefficients
    return np.array([derivative(c, tuple(a), tuple(b))[3:] for a, b in zip(x, u, strict=True)])


@cache
def kane() -> Callable[..., tuple[Any, Any]]:
    """Mass matrix and forcing of three massless rods with point masses at mid-link, by Kane's method."""
    q, w = mechanics.dynamicsymbols("q1:4"), mechanics.dynamicsymbols("w1:4")
    u, m = sp.symbols("u1:4"), sp.symbols("m1:4")
    length, gravity = sp.symbols("l g")
    world, base = mechanics.ReferenceFrame("N"), mechanics.Point("O")
    base.set_vel(world, 0)
    frame, joint, bodies, loads = world, base, [], []
    frames = []
    for i in range(3):
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


@pytest.mark.parametrize("system", SYSTEMS, ids=str)
def test_accelerations_follow_from_kanes_method(system: Pendulum, draw: Draw) -> None:
    states, torques = draw(50), np.random.default_rng(1).uniform(-100, 100, (50, 3))
    expected = []
    for x, u in zip(states, torques, strict=True):
        mass, force = kane()(x[:3], x[3:], u, system.masses, system.link_length, system.gravity)
        expected.append(np.linalg.solve(mass, force[:, 0]))
    found = acceleration(system, states, torques)
    scale = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_array_less(np.abs(found - expected), 1e-9 * np.broadcast_to(scale, found.shape))


@njit
def _many_steps(c: Any, x: Any, u: Any, dt: float, n: int) -> Any:
    for _ in range(n):
        x = rk4_step(c, x, u, dt)
    return x


def simulate(system: Pendulum, x: Floats, u: Floats, seconds: float, steps: int) -> Floats:
    c, dt = system.coefficients, seconds / steps
    return np.array([_many_steps(c, tuple(a), tuple(b), dt, steps) for a, b in zip(x, u, strict=True)])


@pytest.mark.parametrize("system", SYSTEMS, ids=str)
def test_energy_is_conserved_without_torque(system: Pendulum, draw: Draw) -> None:
    start = 0.3 * draw(20)
    end = simulate(system, start, np.zeros((20, 3)), 1.0, 60_000)
    assert np.abs(end - start).max() > 1.0  # they have moved
    np.testing.assert_allclose(system.energy(end), system.energy(start), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("system", SYSTEMS, ids=str)
def test_energy_grows_by_the_work_of_the_torques(system: Pendulum, draw: Draw) -> None:
    """The work of a held torque is Σ u_i (θ_i(T) − θ_i(0)), exactly."""
    start, torques = 0.3 * draw(20), np.random.default_rng(2).uniform(-10, 10, (20, 3))
    end = simulate(system, start, torques, 0.5, 20_000)
    work = (torques * (end - start)[:, :3]).sum(axis=1)
    assert np.abs(work).min() > 1e-3
    np.testing.assert_allclose(system.energy(end) - system.energy(start), work, rtol=1e-8, atol=1e-8)


def test_energy_is_that_of_the_moving_masses(draw: Draw) -> None:
    """Velocities of the masses from a difference quotient of their positions along the motion."""
    system, states, h = Pendulum(1.5), draw(20), 1e-6

    def masses_at(x: Floats) -> Floats:
        joints = system.joints(x)
        return (joints[:, 1:] + joints[:, :-1]) / 2

    turned = np.concatenate([states[:, 3:], np.zeros((20, 3))], axis=1)
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


@pytest.mark.parametrize("system", SYSTEMS, ids=str)
def test_linearization_is_the_derivative_at_upright(system: Pendulum) -> None:
    a, b = system.linearize()
    h, zero = 1e-5, np.zeros((6, 3))
    by_x = (acceleration(system, h * np.eye(6), zero) - acceleration(system, -h * np.eye(6), zero)) / (2 * h)
    rest = np.zeros((3, 6))
    by_u = acceleration(system, rest, np.eye(3)) - acceleration(system, rest, np.zeros((3, 3)))
    np.testing.assert_allclose(a, np.vstack([np.eye(6)[3:], by_x.T]), rtol=1e-7, atol=1e-6)
    np.testing.assert_allclose(b, np.vstack([np.zeros((3, 3)), by_u.T]), rtol=1e-9, atol=1e-9)


def test_positions_are_sums_of_rotated_links(draw: Draw) -> None:
    """In the complex plane a link with absolute angle φ is i·l·exp(−iφ)."""
    system, states = Pendulum(link_length=0.8), draw(50)
    links = 0.8j * np.exp(-1j * np.cumsum(states[:, :3], axis=1))
    expected = np.cumsum(np.concatenate([np.zeros((50, 1)), links], axis=1), axis=1)
    joints = system.joints(states)
    np.testing.assert_allclose(joints[..., 0] + 1j * joints[..., 1], expected, atol=1e-12)
    tips = np.array([tip(system.lengths, tuple(x)) for x in states])
    np.testing.assert_allclose(tips, joints[:, 3], atol=1e-12)


def test_upright_is_an_equilibrium_with_the_tip_at_three_metres() -> None:
    system = Pendulum(4.0)
    assert tip(system.lengths, (0.0,) * 6) == (0.0, 3.0)
    assert derivative(system.coefficients, (0.0,) * 6, (0.0,) * 3) == (0.0,) * 6


@pytest.mark.parametrize("system", SYSTEMS, ids=str)
def test_mirror_images_move_as_mirror_images(system: Pendulum, draw: Draw) -> None:
    states, torques = draw(50), np.random.default_rng(3).uniform(-100, 100, (50, 3))
    for move in (acceleration, lambda system, x, u: simulate(system, x, u, 0.01, 1)):
        np.testing.assert_allclose(
            move(system, -states, -torques), -move(system, states, torques), rtol=1e-12
        )


def test_compiled_code_does_what_the_source_says(draw: Draw) -> None:
    c, u = Pendulum(1.5).coefficients, (1.0, -20.0, 3.0)
    for x in draw(10):
        np.testing.assert_allclose(derivative.py_func(c, tuple(x), u), derivative(c, tuple(x), u), rtol=1e-9)
        step = rk4_step.py_func(c, tuple(x), u, 0.001)
        np.testing.assert_allclose(step, rk4_step(c, tuple(x), u, 0.001), rtol=1e-9)


@pytest.mark.parametrize("name", ["delta", "link_mass", "link_length", "gravity"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_impossible_systems_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} = {value}"):
        Pendulum(**{name: value})


def test_bad_input_is_refused_by_name() -> None:
    for bad in (np.zeros((2, 5)), np.zeros((1, 2, 6)), np.full((2, 6), np.nan), np.full((2, 6), np.inf)):
        with pytest.raises(ValueError, match="x = "):
            Pendulum().joints(bad)


def test_one_integration_step_takes_at_most_a_microsecond() -> None:
    """The best of many short turns: on a busy machine a long one is always interrupted."""
    c, start, n = Pendulum().coefficients, (0.1, 0.2, 0.3, 0.0, 0.0, 0.0), 500
    u = (0.0, 0.0, 0.0)
    _many_steps(c, start, u, 1e-3, 1)
    seconds = []
    for _ in range(1000):
        before = time.perf_counter()
        end = _many_steps(c, start, u, 1e-3, n)
        seconds.append((time.perf_counter() - before) / n)
    assert all(math.isfinite(v) for v in end)
    assert min(seconds) < 1e-6


LABEL = """
from srlrepro import ClosedLoop
print(ClosedLoop().predict([0.3, 0, 0, 0, 0, 0])[0] == 1)
"""
PREDICTION = """
import numpy as np
from srlrepro import SafeRegion
x = np.random.default_rng(0).normal(size=(20, 6))
region = SafeRegion(gamma_evidence="embedded").fit_embedding(x, np.ones(20), x[:, :2])
print(region.safety(x[:1])[0] > 0.1)
"""
NOTHING_MOVES = "\n\n@jit\ndef derivative(c, x, u):\n    return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)\n"
ALL_FAR_AWAY = "\n\n@jit\ndef map_state(scale, x_train, y_train, neighbours, skip, x):\n    return 1e9, 1e9\n"


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
def test_a_step_is_that_of_the_compiled_integrator(system: Pendulum, draw: Draw) -> None:
    x, u = draw(4), np.random.default_rng(1).uniform(-100, 100, (4, 3))
    expected = [rk4_step(system.coefficients, tuple(a), tuple(b), 1e-3) for a, b in zip(x, u, strict=True)]
    np.testing.assert_array_equal(system.step(x, u, 1e-3), expected)
    for wrong in ((x, u[:3], 1e-3), (x, u * np.nan, 1e-3), (x, u, 0.0), (x, u, np.nan), (x[:, :5], u, 1e-3)):
        with pytest.raises(ParameterError):
            system.step(*wrong)
