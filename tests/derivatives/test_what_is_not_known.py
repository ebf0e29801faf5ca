"""A result that is not a number has derivatives that are not numbers, and spoils those of no other."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import Ball, Circle, Disk, DiskState, Event, FunctionSchedule, OnRail, PointMass, Status, simulate
from jaxball.programs.derivatives.differentiation import with_unknown_derivatives
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.differences import slope

TIMES = np.linspace(0.0, 2.0, 5)


@pytest.mark.thorough
def test_the_mark_on_arrays():
    x = jnp.array([1.0, 2.0])

    def marked(x):
        return with_unknown_derivatives(jnp.stack([x[0], jnp.where(x[1] > 0, jnp.nan, x[1]), jnp.nan]), x)

    expected = [[1.0, 0.0], [np.nan, np.nan], [np.nan, np.nan]]
    np.testing.assert_array_equal(jax.jacrev(marked)(x), expected)
    np.testing.assert_array_equal(jax.jacfwd(marked)(x), [[1.0, 0.0], [np.nan, np.nan], [np.nan, np.nan]])
    np.testing.assert_array_equal(marked(x), [1.0, np.nan, np.nan])
    # What is left out does not come back, in both modes, and in batches.
    for derivative in (jax.grad, jax.jacfwd):
        part = derivative(lambda x: jnp.nansum(marked(x)))
        np.testing.assert_array_equal(part(x), [1.0, 0.0])
        np.testing.assert_array_equal(jax.vmap(part)(jnp.stack([x, x])), [[1.0, 0.0], [1.0, 0.0]])


def breaks_off(t, p):
    """A schedule with the rate p₁ that is not a number after p₀."""
    return jnp.where(t < p[0], p[1] * t, jnp.nan)


def broken(p, adjoint=None):
    mass = PointMass(0.5, OnRail(Circle(0.5), FunctionSchedule(breaks_off, p)))
    return simulate(Ball(mass=1.0, inertia=(0.5, 0.6, 0.7), masses=[mass]), TIMES, adjoint=adjoint)


@pytest.mark.slow
def test_a_run_that_stops_where_a_number_is_not_finite():
    p = jnp.array([1.3, 1.0])

    def paths(p, adjoint=None):
        run = broken(p, adjoint)
        return jnp.concatenate([run.state.z[:, 0], run.observables.normal_force[-1:]]), run.status

    reverse, status = jax.jacrev(paths, has_aux=True)(p)
    assert status == Status.NOT_FINITE
    assert np.all(np.isnan(reverse))  # the steps that were tried beyond are part of what it goes through
    forward, _ = jax.jacfwd(lambda p: paths(p, diffrax.ForwardMode()), has_aux=True)(p)
    known = TIMES < 1.3
    assert np.all(np.isnan(forward[:-1][~known]))
    assert np.all(np.isnan(forward[-1]))
    differences = slope(lambda rate: paths(p.at[1].set(rate))[0], p[1], 1e-5, points=2)
    np.testing.assert_allclose(forward[:-1][known, 1], differences[:-1][known], atol=1e-7)


def at_the_post(system, t, state):
    return state.z - 0.1


def far_away(system, t, state):
    return state.z - 100.0


EVENTS = {"far": Event(far_away, capacity=2), "post": Event(at_the_post, capacity=2)}


@pytest.fixture(scope="module", params=[None, diffrax.ForwardMode()], ids=["reverse", "forward"])
def jacobian(request):
    """Of the times of both events and the place of the second, with respect to the speed: z = speed · t."""

    def found(speed):
        disk, start = Disk(mass=1.0, inertia=0.5), DiskState(phidot=-speed)
        run = simulate(disk, TIMES, start, events=EVENTS, adjoint=request.param, dense=True)
        far, post = (run.events[name] for name in EVENTS)
        return far.times, far.state.z, post.times, post.state.z, run.at(3.0).z

    return (jax.jacrev if request.param is None else jax.jacfwd)(found)(jnp.array(0.5))


@pytest.mark.long
def test_an_event_that_never_happens_has_no_derivative(jacobian):
    far, place_then, *_, beyond = jacobian
    assert np.all(np.isnan(far))
    assert np.all(np.isnan(place_then))
    assert np.isnan(beyond)


@pytest.mark.long
def test_one_that_happens_has_its_own_beside_it(jacobian):
    *_, post, place, _ = jacobian
    np.testing.assert_allclose(post[0], -0.1 / 0.5**2, atol=1e-8)  # t = 0.1 / speed
    np.testing.assert_allclose(place[0], 0.0, atol=1e-8)
    assert np.all(np.isnan(post[1:]))


@pytest.mark.thorough
def test_a_run_of_an_ensemble_that_cannot_be():
    def ends(mass):
        disks = jax.vmap(lambda m: Disk(mass=m, inertia=0.5, offset=(0.1, 0.0, 0.0)))(mass)
        start = DiskState(phidot=1.0)
        return simulate_ensemble(disks, TIMES, start, in_axes=(0, None)).trajectory.state.z[:, -1]

    mass = jnp.array([1.0, -1.0, 2.0])
    values, derivatives = jax.jvp(ends, (mass,), (jnp.ones(3),))
    assert np.all(np.isnan(derivatives[1]))
    assert np.all(np.isnan(values[1]))
    assert np.all(np.isfinite(derivatives[::2]))
    assert np.all(derivatives[::2] != 0)
