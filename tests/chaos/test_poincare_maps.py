"""Poincaré maps of motions whose period and integrals are known."""

import numpy as np
import pytest

import jaxball
from jaxball.chaos import PoincareMap, poincare_map

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
    assert found.message.endswith("Of 10 crossings 10 were kept.")


def test_crossings_without_room_are_counted():
    found = PoincareMap(np.arange(4.0), None, count=10, status=0, reached=5.0, end=5.0)
    assert not found.ok
    assert found.message.endswith("Of 10 crossings 4 were kept; raise `capacity` to keep them all.")
