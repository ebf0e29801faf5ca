"""A body that slips, flies and rests on a surface under exact dry resistance, against planes and pendulums.

A solid ball of radius r in a bowl of radius R that slides at φ from the lowest point, without turning as it begins:
(R − r) φ̈ = −g sin φ − μ N/m, with N/m = g cos φ + (R − r) φ̇², and its rate over the bowl grows by 5/2 (μ − c) N/(m r).
"""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxball import (
    Accelerated,
    Ball,
    BallState,
    Bowl,
    ConstantRate,
    Contact,
    Disk,
    DiskState,
    FollowSchedules,
    FunctionSchedule,
    Resistance,
    Sinusoids,
    simulate,
)
from jaxball.physics import Cylinder, Mode, ReleasedState, SwitchCause, TiltingPlane

G, M, R, BOWL = 9.81, 2.0, 0.3, 2.0
SOLID = 0.4 * M * R**2
FINE = {"rtol": 1e-12, "atol": 1e-12}
CLOSE = 1e-9


def ball(ground, c=0.2, law=None):
    resistance = Resistance(dry=c, dry_spinning=0.01, exact=True)
    return Ball(mass=M, inertia=(SOLID,) * 3, radius=R, gravity=G, ground=ground, resistance=resistance, law=law)


def disk(ground, c=0.2):
    resistance = Resistance(dry=c, exact=True)
    return Disk(mass=M, inertia=SOLID, radius=R, gravity=G, ground=ground, resistance=resistance)


class InBowl:
    """The centre of a ball in a vertical plane of a bowl: φ, φ̇ and the rate at which its rim moves over the bowl.

    While it slides and rolls over the bowl, the slip is L φ̇ − rim with L = R − r.
    """

    def __init__(self, mu, c):
        self.mu, self.c, self.length = mu, c, BOWL - R

    def pressed(self, x):
        return G * np.cos(x[0]) + self.length * x[1] ** 2

    def slides(self, _, x):
        """Forwards: its slip and its rolling are positive."""
        N = self.pressed(x)
        return [x[1], -(G * np.sin(x[0]) + self.mu * N) / self.length, 2.5 * (self.mu - self.c) * N]

    def rolls(self, _, x):
        N = self.pressed(x)
        braking = np.sign(x[1]) * self.c * N
        rate = -5 / 7 * (G * np.sin(x[0]) + braking)
        return [x[1], rate / self.length, rate]

    def run(self, field, start, end, until, direction=0.0):
        def ends(_, x):
            return until(x)

        ends.terminal, ends.direction = True, direction
        run = solve_ivp(field, (start, end[0]), end[1], "DOP853", events=ends, rtol=1e-12, atol=1e-14)
        return run.t[-1], run.y[:, -1]


@pytest.mark.long
def test_a_ball_that_slides_in_a_bowl_rolls_and_stays_where_the_slope_is_less_than_its_resistance():
    mu, c, speed = 0.3, 0.12, 1.5
    own, times = InBowl(mu, c), np.linspace(0.0, 10.0, 41)
    thrown = ReleasedState(BallState(), V=(0.6 * speed, 0.8 * speed, 0.0))
    run = simulate(ball(Bowl(BOWL), c), times, thrown, contact=Contact(mu), throw=True, **FINE)
    t, x = own.run(own.slides, 0.0, (9.0, [0.0, speed / own.length, 0.0]), lambda x: own.length * x[1] - x[2])
    stops, causes = [t], [SwitchCause.STOPS]
    while True:
        t, x = own.run(own.rolls, t, (20.0, x), lambda x: x[1], -np.sign(x[1]))
        stops.append(t)
        causes.append(SwitchCause.ROLLING_ENDS)
        if abs(np.tan(x[0])) < c:
            break
        x = np.array([x[0], -1e-300 * np.sign(x[0]), 0.0])
    assert len(stops) > 2
    assert int(run.switches.count) == len(stops)
    np.testing.assert_allclose(run.switches.times[: len(stops)], stops, atol=CLOSE)
    np.testing.assert_array_equal(run.contact.switches.cause[: len(stops)], causes)
    assert run.contact.mode[-1] == Mode.REST
    np.testing.assert_allclose(run.state.z[-1], 2 * BOWL * np.tan(x[0] / 2) * np.array([0.6, 0.8]), atol=CLOSE)
    rests = times > stops[-1]
    np.testing.assert_array_equal(run.state.z[rests], np.broadcast_to(run.state.z[-1], (rests.sum(), 2)))
    np.testing.assert_array_equal(run.contact.V[rests], 0.0)
    np.testing.assert_allclose(run.observables.normal_force[-1], M * G * np.cos(x[0]), rtol=CLOSE)


@pytest.mark.thorough
@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_disk_stays_in_a_pipe_up_to_the_angle_of_its_resistance(share):
    pipe = Cylinder(BOWL, axis=(0.0, 1.0, 0.0), centre=(0.0, 0.0, BOWL))
    start = DiskState(z=BOWL * np.arctan(share * 0.1))
    run = simulate(disk(pipe, 0.1), (0.0, 1.0), start, contact=Contact(0.5))
    assert bool(run.contact.rests[-1]) == (share < 1)
    assert (float(run.state.z[-1]) == float(start.z)) == (share < 1)


def tilt(t, _):
    return 0.2 * jnp.sin(1.3 * t)


def other_tilt(t, _):
    return 0.15 * jnp.sin(0.9 * t + 0.4)


@pytest.mark.long
def test_a_plate_that_a_law_drives_is_the_plate_of_the_schedules():
    """A ball that is thrown on it bounces, slips, rolls and rests on it."""
    angles = (FunctionSchedule(tilt), FunctionSchedule(other_tilt))
    pivot, times = (0.1, 0.0, -0.3), np.linspace(0.0, 2.0, 9)
    resistance = Resistance(dry=0.1, exact=True)
    given = {"mass": 1.0, "radius": 0.05, "inertia": (0.001,) * 3, "gravity": G, "resistance": resistance}
    law, start = Contact(0.06, restitution=0.4, slowest=0.1), {"z": (0.1, -0.2), "Omega": (0.4, -0.8, 0.3)}
    flight = {"V": (0.3, 0.2, 0.5), "height": 0.1}
    one, other = (
        Ball(**given, ground=TiltingPlane(*angles, pivot)),
        Ball(**given, ground=TiltingPlane(Accelerated(), Accelerated(), pivot), law=FollowSchedules(angles)),
    )
    theta, thetadot, _ = zip(*(angle.derivatives(jnp.array(0.0)) for angle in angles), strict=True)
    driven = BallState(**start, theta=theta, thetadot=thetadot)
    one = simulate(one, times, ReleasedState(BallState(**start), **flight), contact=law, **FINE)
    other = simulate(other, times, ReleasedState(driven, **flight), contact=law, **FINE)
    count = int(one.switches.count)
    assert count > 4
    np.testing.assert_array_equal(one.contact.switches.cause, other.contact.switches.cause)
    np.testing.assert_allclose(one.switches.times[:count], other.switches.times[:count], atol=CLOSE)
    np.testing.assert_allclose(one.state.z, other.state.z, atol=CLOSE)
    for field in ("V", "height", "slip", "friction_loss"):
        np.testing.assert_allclose(
            getattr(one.contact, field), getattr(other.contact, field), atol=CLOSE, err_msg=field
        )
    for field in ("contact_force", "geometric_centre", "power", "dissipation"):
        np.testing.assert_allclose(
            getattr(one.observables, field), getattr(other.observables, field), atol=1e-8, err_msg=field
        )


@pytest.mark.thorough
def test_exact_resistance_on_a_plate_that_a_law_drives():
    """It carries a ball until its weight exceeds resistance: sin a = c (cos a − r ȧ²/g), as with a schedule."""
    rate = 0.5
    body = ball(TiltingPlane(about_e2=Accelerated()), law=FollowSchedules((ConstantRate(0.0, rate),)))
    start = BallState(Omega=(0.0, rate, 0.0), theta=[0.0], thetadot=[rate])
    one = simulate(body, (0.0, 0.1, 0.6), start, throw=True)
    other = simulate(
        ball(TiltingPlane(about_e2=ConstantRate(0.0, rate))),
        (0.0, 0.1, 0.6),
        BallState(Omega=(0.0, rate, 0.0)),
        throw=True,
    )
    assert int(one.switches.count) == int(other.switches.count) == 1
    np.testing.assert_allclose(one.switches.times[0], other.switches.times[0], rtol=CLOSE)
    np.testing.assert_allclose(one.state.z, other.state.z, atol=CLOSE)


def test_what_is_seen_of_a_ball_at_rest_on_a_rocking_plate():
    """It turns with the plate. Its rate over the plate is rounding, whose direction says nothing."""
    rocking = [Sinusoids(0.0, amplitude=[0.05], frequency=[frequency]) for frequency in (2.0, 3.0)]
    times = np.array([0.0, 0.199, 0.2, 0.201])
    run = simulate(ball(TiltingPlane(*rocking)), times, BallState(), **FINE)
    np.testing.assert_array_equal(run.history.rests, [False, True, True, True])
    # By differences over 0.002, whose error is a sixth of the square of half of it times the third derivative, 2.
    wanted = np.diff(np.asarray(run.state.Omega)[[1, 3]], axis=0)[0] / 0.002
    np.testing.assert_allclose(run.observables.angular_acceleration_body[2], wanted, rtol=0, atol=1e-6)
