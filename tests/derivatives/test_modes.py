"""Which modes of differentiation go through a solve, against a closed form, and what is said of the others."""

import diffrax
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import jaxball
from jaxball import Event, simulate
from jaxball.classical import FreeRigidBody, RigidBodyState

INERTIA = (1.0, 2.0, 3.0)
END = 3.0


def omega(w, adjoint=None):
    """Ω2 at the end of a motion that starts with Ω = (w, 0, 1.5)."""
    start = RigidBodyState(Omega=jnp.stack([w, jnp.zeros_like(w), jnp.full_like(w, 1.5)]))
    body = FreeRigidBody(inertia=INERTIA)
    run = simulate(body, [0.0, END], start, rtol=1e-12, atol=1e-12, adjoint=adjoint, max_steps=256)
    return run.state.Omega[-1, 1]


def closed_form(w):
    """B sn(bt | m), Landau & Lifshitz § 37."""
    d1, d2, d3 = INERTIA
    energy, momentum = d1 * w**2 + d3 * 1.5**2, d1**2 * w**2 + d3**2 * 1.5**2
    b = mpmath.sqrt((d3 - d2) * (momentum - energy * d1) / (d1 * d2 * d3))
    m = (d2 - d1) * (energy * d3 - momentum) / ((d3 - d2) * (momentum - energy * d1))
    size = mpmath.sqrt((energy * d3 - momentum) / (d2 * (d3 - d2)))
    return size * mpmath.ellipfun("sn", b * END, m=m)


W = jnp.asarray(0.4)


def test_first_and_second_derivatives_in_forward_mode():
    def forward(w):
        return omega(w, diffrax.ForwardMode())

    both = jaxball.jit(lambda w: (jax.jacfwd(forward)(w), jax.jacfwd(jax.jacfwd(forward))(w)))
    with mpmath.workdps(30):
        expected = [float(mpmath.diff(closed_form, mpmath.mpf("0.4"), n)) for n in (1, 2)]
    np.testing.assert_allclose(both(W), expected, rtol=1e-9)


@pytest.mark.parametrize(
    "differentiated",
    [jax.jacfwd(omega), jax.jit(jax.jacfwd(omega)), lambda w: jax.linearize(omega, w)[1](w), jax.hessian(omega)],
    ids=["jacfwd", "jacfwd within jit", "linearize", "hessian"],
)
def test_forward_mode_wants_another_adjoint(differentiated):
    with pytest.raises(TypeError, match=r"`adjoint` must be diffrax.ForwardMode\(\) where .* in forward mode"):
        differentiated(W)


def test_reverse_mode_goes_once():
    with pytest.raises(TypeError, match=r"`adjoint` must be diffrax.ForwardMode\(\) for second derivatives"):
        jax.grad(jax.grad(omega))(W)


def test_reverse_mode_wants_the_default():
    with pytest.raises(
        TypeError, match=r"`adjoint` must be diffrax.RecursiveCheckpointAdjoint\(\) where .* in reverse mode"
    ):
        jax.grad(lambda w: omega(w, diffrax.ForwardMode()))(W)


def test_the_adjoint_whose_derivatives_were_wrong_is_refused():
    with pytest.raises(TypeError, match=r"`adjoint` must be .*, but it is diffrax.DirectAdjoint\(\)"):
        omega(W, diffrax.DirectAdjoint())


def crossing(system, t, state):
    return state.Omega[1] + 0.1


def test_events_have_first_derivatives_alone():
    def time(w):
        start = RigidBodyState(Omega=jnp.stack([w, jnp.zeros_like(w), jnp.full_like(w, 1.5)]))
        body, events = FreeRigidBody(inertia=INERTIA), {"crossing": Event(crossing, room=1)}
        run = simulate(body, [0.0, END], start, events=events, adjoint=diffrax.ForwardMode(), max_steps=64)
        return run.events["crossing"].times[0]

    with pytest.raises(TypeError, match="requested for times and states of events, which have only first derivatives;"):
        jax.jacfwd(jax.jacfwd(time))(W)
