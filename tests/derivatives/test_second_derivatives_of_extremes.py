"""Second derivatives of the extremes of the contact force, against those of functions of the time in closed form.

At a time t within the run where a function r(t, p) is largest, the largest value has r_pp − r_tp r_tpᵀ / r_tt.
"""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from scipy.optimize import minimize_scalar

import jaxball
from jaxball import contact_extremes, simulate
from jaxball.physics import AbstractRollingSystem, Reaction
from jaxball.simulation.ensemble import Maximum, Minimum, simulate_ensemble
from tests.support.orders import ORDERS

WEIGHT, FRICTION, PULL = 20.0, 3.0, 0.8


class Rocking(jaxball.physics.AbstractState):
    """How far a roller is to one side, and how fast it goes."""

    x: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.0)
    v: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.0)


class Rocker(AbstractRollingSystem[Rocking]):
    """A roller that rocks as ẍ = −ω² x, on which the plane acts with N = G − a x + b t and |f| = F − c v."""

    omega: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    a: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    b: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    title: ClassVar[str] = "rocker"
    state_type: ClassVar[type[Rocking]] = Rocking

    def field(self, t, state):
        return Rocking(state.v, -(self.omega**2) * state.x)

    def plane_reaction(self, t, state):
        return Reaction(WEIGHT - self.a * state.x + self.b * t, (FRICTION - PULL * state.v) ** 2)

    @property
    def weight(self):
        return jnp.asarray(WEIGHT)


# The speed at the start, ω, a, b, and the end, by which N is least within the run and |f| largest at its end.
P = jnp.array([1.5, 2.0, 6.0, 2.0, 1.1])


def extremes(p):
    speed, omega, a, b, end = p
    run = simulate(Rocker(omega, a, b), jnp.stack([0 * end, end]), Rocking(0.0, speed), dense=True, max_steps=100)
    found = contact_extremes(run)
    return jnp.stack([found.least_normal_force, found.friction_needed, found.largest_friction])


def forces(t, p):
    speed, omega, a, b, _ = p
    normal = WEIGHT - a * speed / omega * jnp.sin(omega * t) + b * t
    friction = FRICTION - PULL * speed * jnp.cos(omega * t)
    return jnp.stack([-normal, friction / normal, friction])


def second_derivatives(k):
    """Of the largest value of function ``k``."""

    def function(t, p):
        return forces(t, p)[k]

    found = minimize_scalar(lambda t: -float(function(t, P)), bounds=(0.0, float(P[-1])), options={"xatol": 1e-12})
    t = found.x  # pyright: ignore[reportAttributeAccessIssue]
    if P[-1] - t < 1e-4:
        return function(P[-1], P), jax.hessian(lambda p: function(p[-1], p))(P)
    slope = jax.grad(function)
    for _ in range(3):
        t = t - slope(t, P) / jax.grad(slope)(t, P)
    bends = jax.grad(slope)(t, P)
    both = jax.grad(slope, argnums=1)(t, P)
    return function(t, P), jax.hessian(function, argnums=1)(t, P) - jnp.outer(both, both) / bends


ONE, OTHER = P * jnp.array([0.7, -1.1, 0.9, 0.4, -0.5]), P * jnp.array([1.2, 0.6, -0.8, -0.3, 0.9])
SHARES = jnp.array([1.0, -20.0, 7.0])  # which make the three about equally large


@pytest.mark.slow
@pytest.mark.parametrize("twice", list(ORDERS.values()), ids=list(ORDERS))
def test_second_derivatives_of_extremes_within_a_run_and_at_its_end(twice):
    """N is least, and |f|/N largest, within the run; |f| is largest at its end.

    Of a sum of them, along two directions: all entries of all three are a program that takes minutes to compile.
    """
    values = extremes(P)
    curvature = twice(lambda x: SHARES @ extremes(P + x[0] * ONE + x[1] * OTHER))(jnp.zeros(2))[0, 1]
    expected, size = 0.0, 0.0
    for k, sign in enumerate((-1.0, 1.0, 1.0)):
        value, entries = second_derivatives(k)
        np.testing.assert_allclose(sign * values[k], value, rtol=1e-9)
        expected += sign * SHARES[k] * ONE @ entries @ OTHER
        size += jnp.abs(SHARES[k]) * jnp.abs(ONE) @ jnp.abs(entries) @ jnp.abs(OTHER)
    assert abs(curvature - expected) < 1e-7 * size


@pytest.mark.thorough
def test_second_derivatives_of_largest_values_in_an_ensemble():
    """x is largest within the run, v/ω, and v least at its end, v cos ωT."""
    end = 0.9 * np.pi

    def found(p):
        speed, omega = p
        many = Rocker(jnp.stack([omega, 0.8 * omega]), jnp.ones(2), jnp.ones(2))
        starts = Rocking(jnp.zeros(2), jnp.stack([speed, 2 * speed]))
        sought = {"x": Maximum(lambda system, t, state: state.x), "v": Minimum(lambda system, t, state: state.v)}
        runs = simulate_ensemble(many, [0.0, end], starts, reductions=sought)
        return jnp.stack([runs.reductions["x"], runs.reductions["v"]])

    def in_closed_form(p):
        speed, omega = jnp.array([1.0, 2.0]) * p[0], jnp.array([1.0, 0.8]) * p[1]
        return jnp.stack([speed / omega, speed * jnp.cos(omega * end)])

    def along(function):
        p, one, other = jnp.array([1.5, 1.0]), jnp.array([0.7, -0.4]), jnp.array([-0.5, 0.6])
        (value, _), (_, second) = jax.jvp(lambda p: jax.jvp(function, (p,), (one,)), (p,), (other,))
        return value, second

    np.testing.assert_allclose(along(found), along(in_closed_form), rtol=1e-7)
