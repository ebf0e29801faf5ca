"""Paths to start from: what the wanted motion and the equations of motion say about them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.physics.dynamics import equations
from jaxball.studies import design
from jaxball.studies.design import optimal_control
from tests.support.sentences import refuses


def on(rail, theta, mass=1.0):
    return jaxball.PointMass(mass, jaxball.OnRail(rail, jaxball.ConstantRate(theta)))


def problem(system, curve, end):
    tracking = design.FollowTrajectory(curve, rest_to_rest=True)
    return optimal_control.Rolling(system, (0.0, end), {"tracking": tracking})


def states(path, problem, times):
    return jax.jit(jax.vmap(problem.packing.unpack))(jnp.asarray(times), jnp.asarray(path.states(times)))


def accelerations(problem, times):
    """z̈ where the ball is wanted."""

    def place(t):
        return problem.objectives["tracking"].targets(t[None])[0]

    return jax.vmap(jax.jacfwd(jax.jacfwd(place)))(jnp.asarray(times))


def disk():
    return jaxball.Disk(mass=1.0, inertia=0.7, masses=[on(jaxball.Circle(0.9), -np.pi / 2)])


@pytest.mark.thorough
def test_the_centre_of_mass_leans_as_far_as_the_balance_of_momentum_asks():
    """A mass that hangs does not turn: (d2 / r + m0 r + m (r − a)) z̈ = M g c1 about the contact point."""
    END = 10.0
    forth = problem(disk(), design.Through([[0.0, 0.0], [1.0, 0.0]]), END)
    times = np.linspace(0.0, END, 21)
    state = states(forth.rolling_along(times), forth, times)
    u = times / END
    np.testing.assert_allclose(state.z, u**3 * (10 - 15 * u + 6 * u**2), atol=3e-5)
    zddot = (60 * u - 180 * u**2 + 120 * u**3) / END**2
    lean = 0.9 * np.cos(state.theta[:, 0] + state.phi)
    np.testing.assert_allclose(lean, (0.7 + 1.0 + 0.1) * zddot, atol=1e-4)


def given_input(t, state, u):
    return u


@pytest.mark.long
def test_what_the_masses_do_by_moving_is_of_fourth_order_in_the_rate_of_the_motion():
    """Of ω̇ = e3 × z̈ / r, by the explicit equations of motion."""
    tubes = [jaxball.Tube(axis, side * np.roll(axis, 1)) for axis in np.eye(3) for side in (0.3, -0.3)]
    masses = [on(tube, -0.6 if k > 3 else 0.0) for k, tube in enumerate(tubes)]
    ball = jaxball.Ball(mass=1.0, inertia=(0.6, 0.7, 0.8), masses=masses)

    @jax.jit
    def omegadot(ball, t, state, u):
        driven = eqx.tree_at(lambda body: body.law, ball, jaxball.FunctionLaw(given_input, u))
        return state.Lambda @ equations.accelerations(driven, t, state).Omegadot

    gaps = {}
    for end in (60.0, 120.0):
        eight = problem(ball, design.FigureEight(2.0, 1.0), end)
        path = eight.rolling_along(np.linspace(0.0, end, 41))
        times = np.linspace(0.2 * end, 0.8 * end, 31)
        state = states(path, eight, times)
        given = jax.vmap(omegadot, in_axes=(None, 0, 0, 0))
        found = given(eight.packing.system, jnp.asarray(times), state, jnp.asarray(path.inputs(times)))
        zddot = accelerations(eight, times)
        gap = found[:, :2] - jnp.stack([-zddot[:, 1], zddot[:, 0]], axis=1)
        gaps[end] = float(jnp.max(jnp.abs(gap)))
    assert gaps[120.0] < 0.2 * float(jnp.max(jnp.abs(zddot)))
    assert 10 < gaps[60.0] / gaps[120.0] < 22


@pytest.mark.thorough
def test_gravity_accelerates_no_disk_faster_than_its_centre_of_mass_allows():
    fast = problem(disk(), design.Through([[0.0, 0.0], [3.0, 0.0]]), 2.0)
    with refuses(design.DesignError, "problem"):
        fast.rolling_along(np.linspace(0.0, 2.0, 21))


def test_a_disk_that_is_wanted_nowhere_has_no_path_to_roll_along():
    nowhere = optimal_control.Rolling(disk(), (0.0, 3.0), {"effort": design.AccelerationEffort()})
    with refuses(design.DesignError, "problem"):
        nowhere.rolling_along(np.linspace(0.0, 3.0, 11))
