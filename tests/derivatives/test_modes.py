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
@pytest.mark.parametrize("around", [lambda f: f, jax.jit, jaxball.jit], ids=["as typed", "jax.jit", "jaxball.jit"])
def test_without_an_adjoint_both_modes_are_there(around):
    for first in (
        jax.grad(omega),
        jax.jacfwd(omega),
        lambda w: jax.linearize(omega, w)[1](jnp.ones_like(w)),
        lambda w: jax.vjp(omega, w)[1](jnp.ones_like(w))[0],
        jax.grad(jax.checkpoint(omega)),
    ):
        np.testing.assert_allclose(around(first)(W), derivative(closed_form, 1), rtol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("outer", [jax.jacfwd, jax.jacrev], ids=["forward", "reverse"])
@pytest.mark.parametrize("inner", [jax.jacfwd, jax.jacrev], ids=["over forward", "over reverse"])
def test_without_an_adjoint_second_derivatives_are_there(outer, inner):
    np.testing.assert_allclose(jax.jit(outer(inner(omega)))(W), derivative(closed_form, 2), rtol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("around", [lambda f: f, jax.jit], ids=["as typed", "jax.jit"])
def test_a_number_in_a_closure_has_derivatives_and_rows(around):
    """Ω2 = ℓ at the time t(ℓ): dt/dℓ = 1/Ω̇2 = d2/((d3 − d1) Ω3 Ω1)."""
    body, start = FreeRigidBody(inertia=INERTIA), RigidBodyState(Omega=jnp.array([0.4, 0.0, 1.5]))

    def reaches(level):
        events = {"there": Event(lambda body, t, state: state.Omega[1] - level, terminal=True)}
        run = simulate(body, [0.0, END], start, events=events, rtol=1e-12, atol=1e-12)
        return run.events["there"].times[0], run.events["there"].state.Omega[0]

    levels = jnp.asarray([0.05, 0.1])
    (_, Omega), rates = around(jax.vmap(lambda level: (reaches(level), jax.grad(lambda x: reaches(x)[0])(level))))(
        levels
    )
    np.testing.assert_allclose(Omega[:, 1], levels, rtol=1e-12)
    d1, d2, d3 = INERTIA
    np.testing.assert_allclose(rates, d2 / ((d3 - d1) * Omega[:, 2] * Omega[:, 0]), rtol=1e-9)


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


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("outer", "inner"),
    [
        (jax.jacfwd, jax.jacfwd),
        pytest.param(jax.jacfwd, jax.jacrev, marks=pytest.mark.long),
        pytest.param(jax.jacrev, jax.jacfwd, marks=pytest.mark.long),
        pytest.param(jax.jacrev, jax.jacrev, marks=pytest.mark.long),
    ],
)
def test_events_have_second_derivatives(outer, inner):
    """Against those of an elliptic integral; 1e-8, because dense output errs by some 100 tolerances."""
    expected = derivative(time_in_closed_form, 2)
    np.testing.assert_allclose(jax.jit(outer(inner(time_of_crossing)))(W), expected, rtol=1e-8)


@pytest.mark.long
def test_events_have_no_third_derivatives():
    with refuses(TypeError):
        jax.jacfwd(jax.jacfwd(jax.jacfwd(time_of_crossing)))(W)
