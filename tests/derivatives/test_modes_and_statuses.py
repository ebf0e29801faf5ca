"""Reverse mode against forward mode wherever places are unused: for every event, every extreme and every status.

One program with numbers that lead to each status in turn. What is not a number is left out of the sum that is
differentiated, and must not come back from it. A run that ended because the field is not finite has derivatives in
forward mode alone: the steps that were tried beyond that are part of what reverse mode goes through.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import (
    Ball,
    Circle,
    ConstantRate,
    Detachment,
    Event,
    FunctionForce,
    OnRail,
    PointMass,
    Slip,
    Status,
    contact_extremes,
    simulate,
)

TIMES = np.array([0.0, 0.05, 0.1, 0.4])
CASES = {
    Status.DETACHED: (2.4, 0.9, 0.1, 0.0, 1e-9),
    Status.SUCCESS: (1.2, 0.9, 0.1, 0.0, 1e-9),
    Status.IMPOSSIBLE: (1.2, -0.9, 0.1, 0.0, 1e-9),
    Status.MAX_STEPS: (2000.0, 4e-8, 0.1, 0.0, 1e-9),
}


def growing(t, p):
    """A force that grows from p₀ at the rate p₁."""
    return p[0] * (1 + p[1] * t) * jnp.asarray([1.0, 0.5, 0.0])


def turned(system, t, state):
    """How far the ball has turned past a thousandth of a radian or so."""
    return state.q[2] ** 2 - 1e-6


EVENTS = {"lift": Detachment(), "slip": Slip(0.2, terminal=False), "turn": Event(turned, capacity=4)}


def outcome(p, adjoint):
    """All numbers that a run ends with, those that are not numbers included, and its status."""
    rate, mass, push, growth, tolerance = p
    ball = Ball(
        mass=1.0,
        inertia=(0.3, 0.31, 0.32),
        force=FunctionForce(growing, jnp.stack([push, growth])),
        masses=[PointMass(mass, OnRail(Circle(0.5), ConstantRate(0.3, rate)))],
    )
    run = simulate(
        ball, TIMES, events=EVENTS, dense=True, rtol=tolerance, atol=tolerance, adjoint=adjoint, max_steps=96
    )
    extremes = contact_extremes(run)
    looked_at = [run.events[name].times for name in EVENTS], run.events["turn"].state, run.state, run.at(TIMES)
    values = (extremes.least_normal_force, extremes.friction_needed, extremes.largest_friction)
    leaves = jax.tree.leaves((looked_at, run.observables.energy, values))
    return jnp.concatenate([jnp.ravel(leaf) for leaf in leaves]), run.status


def total(p, adjoint):
    """The sum of all that is finite, each with a weight of its own; at N = 0, |f| / N is what rounding makes it."""
    found, status = outcome(p, adjoint)
    weights = jnp.cos(jnp.arange(found.size, dtype=found.dtype))
    return jnp.sum(jnp.where(jnp.abs(found) < 1e6, weights * found, 0.0)), (found, status)


@pytest.fixture(scope="module")
def modes():
    reverse = jaxball.jit(jax.grad(lambda p: total(p, None), has_aux=True))
    forward = jaxball.jit(jax.jacfwd(lambda p: total(p, diffrax.ForwardMode()), has_aux=True))
    return reverse, forward


@pytest.mark.slow
@pytest.mark.parametrize("status", CASES, ids=lambda status: status.name)
def test_reverse_mode_is_forward_mode(modes, status):
    reverse, forward = modes
    p = jnp.asarray(CASES[status])
    found, (values, ended) = reverse(p)
    expected, _ = forward(p)
    assert ended == status
    assert bool(jnp.any(jnp.isnan(values)))
    # The tolerances of a solve have no derivative that means anything.
    np.testing.assert_allclose(found[:4], expected[:4], rtol=1e-7, atol=1e-9)
    assert (jnp.max(jnp.abs(expected[:4])) > 0.1) == (status != Status.IMPOSSIBLE)
