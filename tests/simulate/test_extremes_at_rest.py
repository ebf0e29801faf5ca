"""Extremes of the contact force are found where the state rests, and a step is as long as the run."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import (
    Ball,
    Disk,
    DiskState,
    FunctionForce,
    Ground,
    HarmonicSeries,
    OnRail,
    Oscillating,
    PiecewiseAcceleration,
    PointMass,
    Tube,
    contact_extremes,
    simulate,
)
from jaxball.simulation.ensemble import REDUCTIONS, Maximum, simulate_ensemble

G, AMPLITUDES, FREQUENCIES = 9.81, np.array([0.01, 0.003]), np.array([20.0, 31.0])


@pytest.mark.thorough
@pytest.mark.parametrize("end", [5.0, 50.0])
def test_a_ball_at_rest_on_a_shaken_ground(end):
    """N = m (g + Z̈), with Z = Σ aₖ sin ωₖ t."""
    amplitude = [(0.0, 0.0, a) for a in AMPLITUDES]
    series = HarmonicSeries(constant=(0, 0, 0), amplitude=amplitude, frequency=FREQUENCIES)
    ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), gravity=G, ground=Ground(motion=Oscillating(series)))
    run = simulate(ball, [0.0, end], dense=True)
    assert run.steps < 10
    times = np.linspace(0.0, end, 1_000_001)

    force = G - np.sum(AMPLITUDES * FREQUENCIES**2 * np.sin(np.outer(times, FREQUENCIES)), axis=1)
    # Samples 50 µs apart miss a peak of the curvature 31² · 7 by 31² · 7 (25 µs)² / 2.
    np.testing.assert_allclose(contact_extremes(run).least_normal_force, np.min(force), rtol=0, atol=3e-6)


def bell(t, at, width):
    return jnp.exp(-(((t - at) / width) ** 2))


def triangle(t, at, width):
    return jnp.maximum(0.0, 1 - jnp.abs((t - at) / width))


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [bell, triangle])
def test_a_lift_within_the_pause_of_a_schedule(shape):
    """A mass of 1/2 goes up and down a tube through the centre of a disk of 1, which stays at rest, and pauses from 2
    to 8: there N = 1.5 g, but for a force upwards of 2, by which N is less than where the mass slows down.
    """
    lift, rate = 2.0, 1.0
    path = PiecewiseAcceleration(0.0, [1.0, 1.5, 2.0, 8.0, 8.5, 9.0], [[rate], [-rate], [0.0], [-rate], [rate]])
    mass = PointMass(0.5, OnRail(Tube((0.0, 0.0, 1.0)), path))

    def disk(at, width):
        def force(t, numbers):
            return jnp.stack([0.0 * t, 0.0 * t, lift * shape(t, *numbers)])

        return Disk(mass=1.0, inertia=0.5, gravity=G, masses=[mass], force=FunctionForce(force, (at, width)))

    own = {"own": Maximum(lambda system, t, state: system.force(t)[2])}
    for width in (0.3, 0.03, 0.01):
        body = disk(jnp.asarray(4.713), jnp.asarray(width))
        run = simulate(body, [0.0, 10.0], dense=True)
        both = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), body)
        found = simulate_ensemble(both, [0.0, 10.0], DiskState(), in_axes=(0, None), reductions=REDUCTIONS | own)
        for least in (contact_extremes(run).least_normal_force, *found.reductions["least_normal_force"]):
            np.testing.assert_allclose(least, 1.5 * G - lift, rtol=1e-9)
        np.testing.assert_allclose(found.reductions["own"], lift, rtol=1e-9)
