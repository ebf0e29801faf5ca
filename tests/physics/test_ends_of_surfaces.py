"""A ball at the edge of its ground, where the coordinates on it end, and where it does not fit any more."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from scipy.integrate import quad
from scipy.optimize import brentq

from jaxball import Ball, BallState, Bowl, HeightField, Status, load_run, problems, save, simulate
from jaxball.physics import AbstractSurface
from jaxball.simulation.ensemble import simulate_ensemble
from jaxball.simulation.solvers import RadauIIA
from tests.support.differences import slope
from tests.support.sentences import said

G, R = 9.81, 3.0
SHELL = {"mass": 1.0, "radius": 0.5, "inertia": (0.1, 0.1, 0.1), "gravity": G}
EDGE = 1e-6  # radians from where a height field is vertical, or of 1 − r κ, at which a run is ended


def hollow(t, x, y, R):
    return R - jnp.sqrt(R**2 - x**2 - y**2)


def valley(t, x, y, steepness):
    return steepness * x**4


def time_to(angle, rate):
    """When a ball in a hollow sphere is at an angle: a pendulum with φ̈ = −5g/(7(R − r)) sin φ."""
    square = 5 * G / (7 * (R - 0.5))
    return quad(lambda phi: 1 / np.sqrt(rate**2 - 2 * square * (1 - np.cos(phi))), 0, angle, epsabs=1e-13)[0]


def spun(rate):
    """The start at the bottom of a hollow sphere."""
    return BallState(Omega=(0.0, rate * (R - 0.5) / 0.5, 0.0))


@pytest.mark.thorough
@pytest.mark.parametrize("solver", [None, RadauIIA(stages=5)])
def test_height_field_that_becomes_vertical(solver):
    ball, rate = Ball(**SHELL, ground=HeightField(hollow, R)), 4.0
    run = simulate(ball, [0.0, 0.1, 3.0], spun(rate), solver=solver, rtol=1e-11, atol=1e-12)
    assert run.status == Status.LEFT_SURFACE
    said(run.message)
    np.testing.assert_allclose(run.reached, time_to(np.pi / 2, rate), atol=EDGE)
    assert jnp.all(jnp.isfinite(run.state.z[1]))
    assert not jnp.any(jnp.isfinite(run.state.z[2]))


@pytest.mark.thorough
def test_point_of_a_bowl_that_its_coordinates_do_not_reach():
    """They end 1.6e-3 radians from the top, of which half is the square root of the margin; a Bowl goes past π/2."""
    rate = 8.0
    run = simulate(Ball(**SHELL, ground=Bowl(R)), [0.0, 3.0], spun(rate), rtol=1e-11, atol=1e-12)
    assert run.status == Status.LEFT_SURFACE
    assert time_to(np.pi - 2e-3, rate) < run.reached < time_to(np.pi - 1e-3, rate)


@pytest.mark.thorough
def test_ground_that_becomes_as_curved_as_the_ball():
    """The run ends where κ = f″/(1 + f′²)^(3/2) is 1/r."""
    ball = Ball(**SHELL, ground=HeightField(valley, 1.0))
    run = simulate(ball, [0.0, 3.0], BallState(Omega=(0.0, 2.0, 0.0)), dense=True, rtol=1e-11, atol=1e-12)
    assert run.status == Status.WEDGED
    said(run.message)
    x = brentq(lambda x: 12 * x**2 / (1 + 16 * x**6) ** 1.5 - 2, 0, 0.5, xtol=1e-14)
    np.testing.assert_allclose(run.at(run.reached).z[0], x, atol=EDGE)


class Table(AbstractSurface):
    """A level plane with an edge at u1 = 1."""

    motion: ClassVar[None] = None

    def point(self, t, u1, u2):
        return jnp.stack([u1, u2, jnp.zeros_like(u1)])

    def reach(self, t, u1, u2):
        return 1.0 - u1


@pytest.mark.thorough
def test_edge_of_a_table():
    """A ball rolls at r Ω to the edge; a ball beyond it cannot start."""
    ball = Ball(**SHELL, ground=Table())
    run = simulate(ball, [0.0, 10.0], BallState(Omega=(0.0, 0.8, 0.0)))
    assert run.status == Status.LEFT_SURFACE
    np.testing.assert_allclose(run.reached, 1 / 0.4, atol=3 * EDGE)
    beyond = BallState(z=(1.5, 0.0))
    (sentence,) = problems(ball, beyond)
    said(sentence, "state.z")
    assert simulate(ball, [0.0, 10.0], beyond).status == Status.IMPOSSIBLE


class Tide(AbstractSurface):
    """A level plane of which 0.3 + 0.5 sin ωt is left ahead of the origin."""

    frequency: Float[Array, "*group"] = eqx.field(converter=jnp.asarray)
    motion: ClassVar[None] = None

    def point(self, t, u1, u2):
        return jnp.stack([u1, u2, jnp.zeros_like(u1)])

    def reach(self, t, u1, u2):
        return 0.3 + 0.5 * jnp.sin(self.frequency * t) - u1


def breathing(t, x, y, frequency):
    """At the origin of curvature 1.5 + sin ωt."""
    return 0.5 * (1.5 + jnp.sin(frequency * t)) * (x**2 + y**2)


FREQUENCIES = [1.0, 3.0, 20.0, 70.0, 200.0]
GROUNDS = {  # when the ground ends, as a phase: sin ωt = −0.6 ahead of the origin, 1.5 + sin ωt = 1/r below it
    Status.LEFT_SURFACE: (Tide, np.pi + np.arcsin(0.6)),
    Status.WEDGED: (lambda frequency: HeightField(breathing, frequency), np.arcsin(0.5)),
}


@pytest.mark.thorough
@pytest.mark.parametrize("status", GROUNDS)
def test_a_ground_that_ends_where_a_ball_rests(status):
    """The state does not move, so that steps grow over many of the times at which there is ground again."""
    ground, phase = GROUNDS[status]
    for frequency in FREQUENCIES:
        for tol in 10.0 ** -np.arange(3, 14):
            run = simulate(Ball(**SHELL, ground=ground(frequency)), [0.0, 10.0], BallState(), rtol=tol, atol=tol)
            assert run.status == status, (frequency, tol)
            # The margin of 6e-7 that a run ends before, over the slopes 0.4 and 0.43 of both, per radian.
            np.testing.assert_allclose(run.reached * frequency, phase, atol=2e-6)


@pytest.mark.thorough
def test_rows_of_an_ensemble_end_as_runs_do(tmp_path):
    """Some lanes go on while others are at an end, and a file of a run keeps how it ended."""
    rates = jnp.array([1.0, 4.0, 1.5, 5.0])
    balls = jax.vmap(lambda rate: Ball(**SHELL, ground=HeightField(hollow, R)))(rates)
    ensemble = simulate_ensemble(balls, [0.0, 1.0], jax.vmap(spun)(rates), rtol=1e-11, atol=1e-12)
    ends = [Status.SUCCESS, Status.LEFT_SURFACE, Status.SUCCESS, Status.LEFT_SURFACE]
    np.testing.assert_array_equal(ensemble.status, ends)
    for k in (1, 3):
        np.testing.assert_allclose(ensemble.reached[k], time_to(np.pi / 2, float(rates[k])), atol=EDGE)
    run = simulate(Ball(**SHELL, ground=Bowl(R)), [0.0, 3.0], spun(8.0))
    read = load_run(save(run, tmp_path / "run.nc"))
    assert (read.status, read.message) == (run.status, run.message)


@pytest.mark.thorough
def test_derivatives_before_an_end_are_not_known():
    """Reverse mode goes through steps that were tried beyond, as of every run that is not finite."""

    def place(rate):
        return simulate(Ball(**SHELL, ground=HeightField(hollow, R)), [0.0, 0.1, 3.0], spun(rate)).state.z[1, 0]

    assert np.isnan(jax.jacrev(place)(4.0))
    np.testing.assert_allclose(jax.jacfwd(place)(4.0), slope(place, 4.0, 1e-5, points=2), rtol=1e-6)
