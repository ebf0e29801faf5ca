"""Extremes of the contact force are found where the state rests, and a step is as long as the run."""

import numpy as np
import pytest

from jaxball import Ball, Ground, HarmonicSeries, Oscillating, contact_extremes, simulate

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
