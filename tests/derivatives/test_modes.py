"""Which modes of differentiation go through a solve, against a closed form, and what is said of the others."""

import diffrax
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import jaxball
from jaxball import Event, simulate
from jaxball.physics.classical import FreeRigidBody, RigidBodyState
from tests.support.orders import ORDERS
from tests.support.sentences import refuses

INERTIA = (1.0, 2.0, 3.0)
END = 3.0


def run(w, **options):
    """A motion that starts with Ω = (w, 0, 1.5)."""
    start = RigidBodyState(Omega=jnp.stack([w, jnp.zeros_like(w), jnp.full_like(w, 1.5)]))
    body = FreeRigidBody(inertia=INERTIA)
    return simulate(body, [0.0, END], start, rtol=1e-12, atol=1e-12, max_steps=256, **options)


def omega(w, adjoint=None):
    """Ω2 at the end."""
    return run(w, adjoint=adjoint).state.Omega[-1, 1]


def elliptic(w):
    """B, b and m of Ω2 = B sn(bt | m), Landau & Lifshitz § 37."""
    d1, d2, d3 = INERTIA
    energy, momentum = d1 * w**2 + d3 * 1.5**2, d1**2 * w**2 + d3**2 * 1.5**2
    b = mpmath.sqrt((d3 - d2) * (momentum - energy * d1) / (d1 * d2 * d3))
    m = (d2 - d1) * (energy * d3 - momentum) / ((d3 - d2) * (momentum - energy * d1))
    return mpmath.sqrt((energy * d3 - momentum) / (d2 * (d3 - d2))), b, m


def closed_form(w):
    size, b, m = elliptic(w)
    return size * mpmath.ellipfun("sn", b * END, m=m)


def derivative(function, n):
    """By 30 digits."""
    with mpmath.workdps(30):
        return float(mpmath.diff(function, mpmath.mpf("0.4"), n))


W = jnp.asarray(0.4)


@pytest.mark.thorough
def test_first_and_second_derivatives_in_forward_mode():
    def forward(w):
        return omega(w, diffrax.ForwardMode())

    both = jaxball.jit(lambda w: (jax.jacfwd(forward)(w), jax.jacfwd(jax.jacfwd(forward))(w)))
    np.testing.assert_allclose(both(W), [derivative(closed_form, n) for n in (1, 2)], rtol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("around", [lambda f: f, jax.jit], ids=["as typed", "jax.jit"])
def test_without_an_adjoint_both_modes_are_there(around):
    for first in (
        jax.grad(omega),
        jax.jacfwd(omega),
        lambda w: jax.linearize(omega, w)[1](jnp.ones_like(w)),
        lambda w: jax.vjp(omega, w)[1](jnp.ones_like(w))[0],
        jax.grad(jax.checkpoint(omega)),
    ):
        np.testing.assert_allclose(around(first)(W), derivative(closed_form, 1), rtol=1e-9)


@pytest.mark.long
def test_without_an_adjoint_both_modes_are_there_within_a_program():
    def both(w):
        return jax.grad(jax.checkpoint(omega))(w), jax.linearize(omega, w)[1](jnp.ones_like(w))

    np.testing.assert_allclose(jaxball.jit(both)(W), derivative(closed_form, 1), rtol=1e-9)


@pytest.mark.long
def test_maps_of_derivatives_and_derivatives_of_maps():
    rows = W + 0.01 * jnp.arange(5.0)
    of_each = jnp.stack([jax.grad(omega)(w) for w in rows])
    np.testing.assert_allclose(jax.jit(jax.vmap(jax.grad(omega)))(rows), of_each, rtol=1e-9)
    np.testing.assert_allclose(jax.vmap(jax.jacfwd(omega))(rows), of_each, rtol=1e-9)
    np.testing.assert_allclose(jax.jit(jax.grad(lambda rows: jnp.sum(jax.vmap(omega)(rows))))(rows), of_each, rtol=1e-9)
    np.testing.assert_allclose(jax.jacfwd(jax.vmap(omega))(rows), jnp.diag(of_each), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(jax.lax.map(jax.grad(omega), rows), of_each, rtol=1e-9)


@pytest.mark.thorough
def test_what_is_chosen_is_kept_to():
    by = diffrax.RecursiveCheckpointAdjoint()
    with refuses(TypeError, "adjoint"):
        jax.jacfwd(lambda w: omega(w, by))(W)
    with refuses(TypeError, "adjoint"):
        jax.grad(lambda w: omega(w, diffrax.ForwardMode()))(W)


def test_the_adjoint_whose_derivatives_were_wrong_is_refused():
    with refuses(TypeError, "adjoint"):
        omega(W, diffrax.DirectAdjoint())


def crossing(system, t, state):
    return state.Omega[1] + 0.1


def time_of_crossing(w):
    return run(w, events={"crossing": Event(crossing, capacity=1)}).events["crossing"].times[0]


def time_in_closed_form(w):
    """The least t > 0 with B sn(bt | m) = −0.1, up to the sign of sn."""
    size, b, m = elliptic(w)
    # Up from 0 and down again, through 0, to −0.1.
    return (2 * mpmath.ellipk(m) + mpmath.ellipf(mpmath.asin(0.1 / size), m)) / b


@pytest.mark.long
@pytest.mark.parametrize("twice", ORDERS.values(), ids=ORDERS)
def test_states_and_events_have_second_derivatives(twice):
    """Of Ω2 at the end, and of a time, against those of an elliptic integral; 1e-8, because dense output errs by some
    100 tolerances.
    """

    def found(w):
        solved = run(w, events={"crossing": Event(crossing, capacity=1)})
        return jnp.stack([solved.state.Omega[-1, 1], solved.events["crossing"].times[0]])

    of_state, of_event = jax.jit(twice(found))(W)
    np.testing.assert_allclose(of_state, derivative(closed_form, 2), rtol=1e-9)
    np.testing.assert_allclose(of_event, derivative(time_in_closed_form, 2), rtol=1e-8)


@pytest.mark.long
def test_events_have_no_third_derivatives():
    with refuses(TypeError):
        jax.jacfwd(jax.jacfwd(jax.jacfwd(time_of_crossing)))(W)
