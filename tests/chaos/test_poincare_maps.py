"""Poincaré maps of motions whose period and integrals are known."""

import numpy as np
import pytest

import jaxball
from jaxball.analysis.chaos import poincare_map
from jaxball.analysis.chaos.poincare import PoincareMap
from jaxball.physics.classical import LagrangianState, LagrangianSystem, UnilateralContact
from tests.support.sentences import said

D2, R, G, LOW = 0.6, 1.1, 9.8, 0.2


def upright(system, t, state):
    return state.phi


@pytest.fixture(scope="module")
def rocking():
    """A disk that rocks by 1e-4 for ten periods of ω² = M g a / (d2 + M (r − a)²)."""
    omega = np.sqrt(G * LOW / (D2 + (R - LOW) ** 2))
    disk = jaxball.Disk(mass=1.0, inertia=D2, radius=R, gravity=G, offset=(0.0, 0.0, -LOW))
    start = jaxball.DiskState(phi=1e-4, phidot=0.0)
    times = (0.0, 10 * 2 * np.pi / omega)
    return omega, poincare_map(disk, upright, times, start, rtol=1e-12, atol=1e-16, capacity=16)


@pytest.mark.slow
def test_crossings_are_a_period_apart(rocking):
    omega, found = rocking
    assert found.ok
    assert found.count == 10
    np.testing.assert_allclose(found.times, (np.arange(10) + 0.75) * 2 * np.pi / omega, rtol=1e-7)


@pytest.mark.slow
def test_crossings_lie_on_the_section_and_have_one_energy(rocking):
    """Upwards, and at the speed that the energy gives: φ̇ = 1e-4 ω."""
    omega, found = rocking
    np.testing.assert_allclose(found.state.phi, 0, atol=1e-13)
    np.testing.assert_allclose(found.state.phidot, 1e-4 * omega, rtol=1e-7)
    said(found.message)


def test_crossings_without_room_are_counted():
    found = PoincareMap(np.arange(4.0), None, count=10, status=0, reached=5.0, end=5.0)
    assert not found.ok
    said(found.message, "capacity")


@pytest.mark.thorough
@pytest.mark.parametrize("direction", [-1, 1])
def test_sections_of_a_bounce(direction):
    """Where it is highest each height is e² times the one before; where it rebounds, each speed e times."""
    e, disk = 0.8, jaxball.Disk(mass=1.0, inertia=D2, gravity=G)
    start = jaxball.physics.ReleasedState(jaxball.DiskState(), V=(0.0, 0.0, 0.5), height=1.0)
    law = jaxball.Contact(friction=0.3, restitution=e)
    found = poincare_map(disk, "V[2]", (0.0, 4.0), start, contact=law, direction=direction)
    assert found.ok
    top = 1.0 + 0.5**2 / (2 * G)
    struck = np.sqrt(2 * G * top) * e ** np.arange(1, 8)
    if direction < 0:
        np.testing.assert_allclose(found.state.height[:5], top * e ** (2 * np.arange(5)), rtol=1e-9)
        np.testing.assert_allclose(found.state.V[:5, 2], 0.0, atol=1e-9)
        np.testing.assert_allclose(np.diff(found.times[:5]), (1 + 1 / e) * struck[:4] / G, rtol=1e-9)
    else:
        np.testing.assert_allclose(found.state.V[:5, 2], struck[:5], rtol=1e-9)
        np.testing.assert_allclose(np.diff(found.times[:5]), 2 * struck[:4] / G, rtol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("end", "direction", "height", "velocity"),
    [(1.5, -1, 0.25, 0.0), (2.0 + 1e-14, 1, 0.0, 0.5)],  # roundings decide whether the second strike is before 2.0
    ids=["highest", "impact"],
)
def test_a_crossing_with_which_the_run_ends_has_a_state(end, direction, height, velocity):
    """A ball dropped from g/2 bounces by 1/2: it lands at t = 1 and 2, where it rebounds at 1/2, and turns at 1.5."""
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), gravity=2.0)
    start = jaxball.physics.ReleasedState(jaxball.BallState(), V=(0.0, 0.0, 0.0), height=1.0)
    law = jaxball.Contact(0.3, restitution=0.5, slowest=0.01)
    crossings = poincare_map(ball, "V[2]", [0.0, end], start, contact=law, direction=direction)
    np.testing.assert_allclose(crossings.times[-1], end, rtol=1e-12)
    np.testing.assert_allclose(crossings.state.height[-1], height, rtol=0, atol=1e-9)
    np.testing.assert_allclose(crossings.state.V[-1], [0.0, 0.0, velocity], rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_a_section_of_a_system_with_a_wall():
    """A point that bounces without loss crosses half of its height upwards at the same speed each time."""

    def halfway(system, t, state):
        return state.q[0] - 0.5

    point = LagrangianSystem(
        lambda t, q, qdot: 0.5 * qdot[0] ** 2 - G * q[0],
        ("x",),
        unilateral=UnilateralContact(lambda t, q: q[0], restitution=1.0),
    )
    found = poincare_map(point, halfway, (0.0, 4.0), LagrangianState([1.0], [0.0]))
    assert found.ok
    np.testing.assert_allclose(found.state.qdot[:, 0], np.sqrt(G), rtol=1e-7)
    np.testing.assert_allclose(np.diff(found.times), 2 * np.sqrt(2 / G), rtol=1e-7)
