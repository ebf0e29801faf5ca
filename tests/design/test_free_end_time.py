"""Motions in the least time, in closed form: a disk with a wheel is a double integrator with a limited force."""

import numpy as np
import pytest

import jaxball
from jaxball import design
from jaxball.design import optimal_control

LIMIT, PLACE, SOFTNESS = 0.5, 1.0, 1e-7
MESH = np.linspace(0.0, 5.0, 9)
WHEEL, INERTIA = 0.3, 0.5
# A torque u between disk and wheel accelerates the disk by u / (M r² + d), with M = 1.3 and r = 1: for one half of the
# way, and as long against it.
ACCELERATION = LIMIT / (1.0 + WHEEL + INERTIA)
LEAST_TIME = 2 * np.sqrt(PLACE / ACCELERATION)


def rolling():
    wheel = jaxball.ring_rotor(WHEEL, 0.4, axis=(0.0, 1.0, 0.0), drive=jaxball.Motor(0.0, limit=LIMIT))
    disk = jaxball.Disk(mass=1.0, inertia=INERTIA, gravity=2.0, mechanisms=[wheel])
    start = jaxball.DiskState(theta=(0.0,), thetadot=(0.0,))
    # The wheel stops when the disk does.
    return optimal_control.Rolling(disk, (0.0, 5.0), {}, start, place=PLACE, softness=SOFTNESS)


@pytest.mark.long
def test_the_least_time_from_rest_to_rest():
    """Full force, and from the middle on, which is a knot of the mesh, full force against it.

    The end is soft: it is missed by the softness times the multiplier, dT/d(place) = T/2 to a few times that.
    """
    solution = optimal_control.solve_with_free_end(rolling(), MESH, (1.0, 20.0))
    assert solution.path.mesh[-1] == pytest.approx(LEAST_TIME, rel=1e-6)
    torque, half = solution.path.controls[..., 0], len(solution.path.mesh) // 2
    np.testing.assert_allclose(np.abs(torque), LIMIT, atol=1e-4)
    assert abs(np.sum(np.sign(torque[:half])) + np.sum(np.sign(torque[half:]))) == 0
    seen = optimal_control.resimulate(solution)
    assert max(seen.apart, seen.speed, seen.away, seen.missed) < 1e-5
    assert float(optimal_control.scenario_of(solution).times[-1]) == pytest.approx(LEAST_TIME, rel=1e-6)


@pytest.mark.long
def test_the_shortest_time_allowed_is_taken_where_the_motor_could_be_faster():
    solution = optimal_control.solve_with_free_end(rolling(), MESH, (4.5, 20.0))
    assert solution.path.mesh[-1] == pytest.approx(4.5, rel=1e-5)
    assert np.max(np.abs(solution.path.controls)) < LIMIT


@pytest.mark.parametrize("ends", [(0.0, 20.0), (1.0, 5.0), (6.0, 20.0)])
def test_bounds_that_do_not_hold_the_guess_are_refused(ends):
    with pytest.raises(design.DesignError, match=r"`free_end_time` must be the shortest and the longest end time.*5"):
        optimal_control.solve_with_free_end(rolling(), MESH, ends)
