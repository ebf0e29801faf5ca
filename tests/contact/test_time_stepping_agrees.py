"""Random unbalanced balls that slip, fly and strike, against an independent scheme of complementarity in NumPy.

The scheme is of first order, so half its steps halve its distance from the exact motion. What is left after these is
the distance between two of its runs, or less. Where a body bounces often, each impact moves by a part of a step, and
that order is seen only with shorter ones.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxball
from jaxball import Contact
from jaxball.physics import ReleasedState
from tests.support import time_stepping
from tests.support.released_cases import random_case

MASSES = 3
NOTHING = 1e-9  # of the masses that a case has not
FEWEST_STEPS, MOST_STEPS = 1000, 16000
REST = 1e-3  # speed below which an impact has no rebound, in both
SEEDS = [*range(3), *(pytest.param(seed, marks=pytest.mark.slow) for seed in (*range(3, 40), 48))]


def orbit(t, curve):
    """A point of a circle: centre, two arms, phase and rate in one array."""
    angle = curve[9] + curve[10] * t
    return curve[0:3] + jnp.cos(angle) * curve[3:6] + jnp.sin(angle) * curve[6:9]


def curve_of(item):
    if isinstance(item, time_stepping.Fixed):
        return np.concatenate([item.chi, np.zeros(8)])
    path = item.path
    return np.concatenate([path.curve.centre, path.curve.first, path.curve.second, [path.phase, path.rate]])


def ball_of(system):
    masses = [(item.mass, curve_of(item)) for item in system.masses]
    masses += [(NOTHING, np.zeros(11))] * (MASSES - len(masses))
    up = -system.g_space / np.linalg.norm(system.g_space)
    return jaxball.Ball(
        mass=system.mass,
        inertia=system.inertia,
        radius=system.radius,
        offset=system.offset,
        gravity=np.linalg.norm(system.g_space),
        masses=[jaxball.PointMass(m, jaxball.Free(orbit, jnp.asarray(curve))) for m, curve in masses],
        ground=jaxball.Ground(np.arccos(min(up[2], 1.0)), np.arctan2(-up[1], -up[0])),
    )


def thrown(state):
    x, y, z, w = Rotation.from_matrix(state.rotation).as_quat()
    body = jaxball.BallState(q=(w, x, y, z), Omega=state.rotation.T @ state.omega, z=state.z)
    return ReleasedState(body, state.V, state.height)


def end_of(run):
    """Place, height, velocity and angular velocity in space at the end."""
    omega = np.asarray(run.observables.angular_velocity_space)[-1]
    return np.concatenate([run.state.z[-1], run.contact.height[-1:], run.contact.V[-1], omega])


def end_by_steps(system, state, duration, steps):
    run = time_stepping.simulate(system, state, duration, steps)
    return np.concatenate([run.z[-1], run.height[-1:], run.V[-1], run.omega[-1]])


@pytest.mark.thorough
@pytest.mark.parametrize("seed", SEEDS)
def test_the_scheme_converges_to_the_run(seed):
    rng = np.random.default_rng(seed)
    system, state, duration = random_case(rng)
    system = time_stepping.System(**{**vars(system), "rest_speed": REST})
    law = Contact(system.mu, restitution=system.restitution, slowest=REST * max(system.restitution, 1e-3))
    run = jaxball.simulate(ball_of(system), [0.0, duration], thrown(state), contact=law, inside=False)
    assert run.ok
    exact = end_of(run)
    steps, fine = FEWEST_STEPS, end_by_steps(system, state, duration, FEWEST_STEPS)
    agrees = False
    while not agrees and steps < MOST_STEPS:
        steps, coarse = 2 * steps, fine
        fine = end_by_steps(system, state, duration, steps)
        agrees = np.max(np.abs(fine - exact)) < 2 * np.max(np.abs(fine - coarse)) + 1e-6
    assert agrees, f"{steps} steps end {np.abs(fine - exact)} from the run, and half of them {np.abs(coarse - exact)}"
