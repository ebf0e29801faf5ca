"""Contact in float32, at tolerances that it can meet, against closed forms.

A rounding of float32 is 1e-7; of angles and times that follow from tens of steps at 1e-5 some 1e-5 are left.
"""

import numpy as np
import pytest

from jaxball import Ball, BallState, Contact, Detachment, Resistance, Status, simulate
from jaxball.physics import Mode, ReleasedState, SignedDistance
from tests.support.precision import enable_x64
from tests.support.signed_distances import outside_sphere

G = 9.81
FEASIBLE = {"rtol": 1e-5, "atol": 1e-5}
CLOSE_IN_FLOAT32 = 1e-4


@pytest.mark.thorough
def test_a_bowled_ball_slides_rolls_and_rests():
    """The slip ends at t = 2 u / ((7 μ − 5 c) g), and the rolling 7 v / (5 c g) later."""
    mu, c, speed = 0.2, 0.02, 3.0
    slides = 2 * speed / ((7 * mu - 5 * c) * G)
    stops = slides + 7 * (speed - mu * G * slides) / (5 * c * G)
    with enable_x64(False):
        felt = Resistance(dry=c, exact=True)
        ball = Ball(mass=7.0, inertia=(0.028, 0.028, 0.028), radius=0.1, gravity=G, resistance=felt)
        thrown = ReleasedState(BallState(), V=(speed, 0.0, 0.0))
        run = simulate(ball, [0.0, 16.0, 20.0], thrown, contact=Contact(mu), **FEASIBLE)
        assert run.ok
        assert run.state.z.dtype == np.float32
        switches = run.contact.switches
        assert int(switches.count) == 2
        np.testing.assert_allclose(switches.times[:2], [slides, stops], rtol=CLOSE_IN_FLOAT32)
        assert run.contact.mode[-1] == Mode.REST
        np.testing.assert_array_equal(run.state.z[-1], run.state.z[-2])


@pytest.mark.thorough
def test_a_ball_leaves_a_sphere_that_is_a_signed_distance():
    """From φ₀ with great friction at cos φ = (10/17) cos φ₀, where the event of a law of contact ends the run."""
    phi = 0.3
    with enable_x64(False):
        ground = SignedDistance(outside_sphere, 1.0, centre=(0.0, 0.0, -1.0), guess=1.0)
        ball = Ball(mass=1.0, radius=0.1, inertia=(0.004, 0.004, 0.004), gravity=G, ground=ground)
        start, law = BallState(z=(2 * np.tan(phi / 2), 0.0)), Contact(1.0, static_friction=1e9)
        run = simulate(ball, [0.0, 1.2], start, contact=law, events={"off": Detachment()}, **FEASIBLE)
        assert run.status == Status.DETACHED
        u = float(run.events["off"].state.z[0, 0])
        np.testing.assert_allclose(np.cos(2 * np.arctan(u / 2)), 10 / 17 * np.cos(phi), rtol=CLOSE_IN_FLOAT32)
