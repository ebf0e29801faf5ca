"""A pendulum drives a disk by a torque with a limit that acts: the optimum by Pontryagin's principle, own equations.

x is the place of the disk, a the angle of the pendulum from the vertical, both in space, and u the torque on it:
(M + I/r² + m) ẍ + m l (cos a ä − sin a ȧ²) = u/r  and  m l² ä + m l cos a ẍ + m g l sin a = u.
"""

import numpy as np
import pytest
import scipy.integrate

import jaxball
from jaxball.studies import design
from jaxball.studies.design import optimal_control

SHELL, INERTIA, MASS, LENGTH, GRAVITY = 1.0, 0.5, 0.8, 0.6, 9.81  # r = 1
UNIT = (SHELL + MASS) * GRAVITY
END, PLACE, LIMIT = 3.5, 3.0, 2.4
# The costates of x, a, ẋ and ȧ at the start, for the running cost (u / M g r)²: found by SciPy's `root` from those of
# smaller PLACE and larger LIMIT. `test_the_costates_lead_there` says whether they are right.
COSTATES = (-0.0451655875090, -0.0116424360727, -0.0790397781406, -0.0171019229867)


def field(x):
    """f and b of ẋ = f + b u, for complex numbers as well."""
    _, a, v, w = x
    sine, cosine = np.sin(a), np.cos(a)
    moved, coupled, turned = SHELL + INERTIA + MASS, MASS * LENGTH * cosine, MASS * LENGTH**2

    def accelerations(force, torque):
        whole = moved * turned - coupled**2
        return [(turned * force - coupled * torque) / whole, (moved * torque - coupled * force) / whole]

    drift = accelerations(MASS * LENGTH * sine * w**2, -MASS * GRAVITY * LENGTH * sine)
    return np.array([v, w, *drift]), np.array([0 * v, 0 * v, *accelerations(1.0, 1.0)])


def torque(x, p):
    """Where (u / M g r)² + p · (f + b u) is least within the limit."""
    return np.clip(-(p @ field(x)[1]) * UNIT**2 / 2, -LIMIT, LIMIT)


def rates(_, y):
    x, p = y[:4], y[4:8]
    u = torque(x, p)
    steps = x + 1e-30j * np.eye(4)
    slopes = [(f + b * u).imag / 1e-30 for f, b in map(field, steps)]
    f, b = field(x)
    return np.concatenate([f + b * u, -np.array(slopes) @ p, [(u / UNIT) ** 2]])


def run_from(costates):
    """The run, its costates and ∫ (u / M g r)² dt at the end."""
    start = np.concatenate([np.zeros(4), costates, [0.0]])
    return scipy.integrate.solve_ivp(rates, (0.0, END), start, "DOP853", rtol=1e-11, atol=1e-13, max_step=END / 40).y


LEAST = 0.0133090965494  # the mean of (u / M g r)²


def test_the_costates_lead_there():
    """To the place, at rest, with the least effort: of the principle's conditions nothing else is left to check."""
    y = run_from(COSTATES)
    np.testing.assert_allclose(y[:4, -1], [PLACE, 0.0, 0.0, 0.0], atol=1e-9)
    assert y[8, -1] / END == pytest.approx(LEAST, rel=1e-10)
    largest = [abs(torque(x, p)) for x, p in zip(y[:4].T, y[4:8].T, strict=True)]
    assert np.mean(np.asarray(largest) == LIMIT) > 0.2


@pytest.mark.slow
def test_a_torque_at_its_limit_takes_the_least_effort():
    pendulum = jaxball.planar_pendulum(MASS, LENGTH, drive=jaxball.Motor(0.0, limit=LIMIT))
    disk = jaxball.Disk(mass=SHELL, inertia=INERTIA, gravity=GRAVITY, mechanisms=[pendulum])
    start = jaxball.DiskState(theta=(0.0,), thetadot=(0.0,))
    problem = optimal_control.Rolling(disk, (0.0, END), {"effort": design.JointEffort()}, start, place=PLACE)
    rough = problem.solve(np.linspace(0.0, END, 13))
    found = rough.sharpen()
    # The barrier adds at most 1e-8 for each of two inequalities.
    assert found.means()["effort"] == pytest.approx(LEAST, abs=2e-8)
    assert np.max(np.abs(found.path.controls)) == pytest.approx(LIMIT, rel=1e-6)
    seen = found.resimulate()
    assert seen.violations["motor-limits"] < 1e-5
    assert max(seen.apart, seen.speed, seen.away, seen.missed) < 1e-5
