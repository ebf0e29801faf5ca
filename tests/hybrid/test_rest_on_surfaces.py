"""A ball that exact dry resistance brings to rest on a surface, against the same on a slope and motions in a plane.

A solid ball of radius r in a bowl of radius R, φ from its lowest point, in a vertical plane:
(7/5) (R − r) φ̈ = −g sin φ − c (g cos φ + (R − r) φ̇²) sign φ̇, as N is M times the bracket; it stays where |tan φ| ≤ c.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import jaxball
from jaxball import Ball, BallState, Bowl, ConstantRate, Contact, Resistance
from jaxball.physics import TiltingPlane
from tests.support.differences import jacobian

G, M, R, C, SPINNING, BOWL = 9.81, 2.0, 0.3, 0.1, 0.01, 2.0
SOLID = 0.4 * M * R**2


def ball(ground, c=C, spinning=SPINNING, **others):
    resistance = Resistance(dry=c, dry_spinning=spinning, **{"exact": True, **others})
    return Ball(mass=M, inertia=(SOLID,) * 3, radius=R, gravity=G, ground=ground, resistance=resistance)


@pytest.mark.long
def test_a_plane_that_tilts_at_a_steady_rate_lets_a_ball_go_at_its_static_level():
    """In the axes of the plane, with b its rate: N = M (g cos b t − b² r − 2 b ẋ), and from g sin b t = s N / M on
    1.4 ẍ = g sin b t + b² x − c N / M.
    """
    b, s = 0.05, 0.13
    plane = TiltingPlane(about_e2=ConstantRate(0.0, rate=b))
    times = np.linspace(0.0, 4.0, 5)
    run = jaxball.simulate(ball(plane, static_dry=s), times, BallState(Omega=(0.0, b, 0.0)), throw=True)

    def pressed(t, rate):
        return G * np.cos(b * t) - b**2 * R - 2 * b * rate

    loose = brentq(lambda t: G * np.sin(b * t) - s * pressed(t, 0.0), 0.0, 4.0, xtol=1e-14)
    np.testing.assert_allclose(run.switches.times[0], loose, rtol=1e-9)
    assert int(run.switches.count) == 1

    def field(t, x):
        return [x[1], (G * np.sin(b * t) + b**2 * x[0] - C * pressed(t, x[1])) / 1.4]

    end = solve_ivp(field, (loose, 4.0), [0.0, 0.0], "DOP853", rtol=1e-12, atol=1e-14).y[0, -1]
    np.testing.assert_allclose(run.state.z[-1], [end, 0.0], atol=1e-9)


def swings(phi, c, end, static=None, stribeck=1.0):
    """The times at which the ball stops, as it turns back or for good, from rest at φ; and its place at the last.

    With ``static``, friction falls from that to c as the rate grows.
    """
    t, stops, length, more = 0.0, [], BOWL - R, 0.0 if static is None else static - c
    while abs(np.tan(phi)) > c + more:
        sign = -np.sign(phi)

        def field(_, x, sign=sign):
            pressed = G * np.cos(x[0]) + length * x[1] ** 2
            level = c + more * np.exp(-((length * x[1] / R / stribeck) ** 2))
            return [x[1], -5 / 7 * (G * np.sin(x[0]) + level * sign * pressed) / length]

        def stopped(_, x):
            return x[1]

        stopped.terminal, stopped.direction = True, -sign
        run = solve_ivp(field, (t, end), [phi, 0.0], "DOP853", events=stopped, rtol=1e-12, atol=1e-14)
        t, phi = run.t[-1], run.y[0, -1]
        stops.append(t)
    return stops, phi


def in_bowl(phi, across=0.0):
    """A ball at rest, φ from the lowest point."""
    return BallState(z=2 * BOWL * jnp.tan(phi / 2) * jnp.array([jnp.cos(across), jnp.sin(across)]))


@pytest.mark.long
@pytest.mark.parametrize("static", [C, 3.5 * C], ids=["alike", "more at rest"])
def test_a_ball_in_a_bowl_swings_and_comes_to_rest_where_the_slope_is_less_than_its_resistance(static):
    start, direction = 1.0, 0.6
    times = np.linspace(0.0, 12.0, 13)
    law = {} if static == C else {"static_dry": static, "stribeck": 2.0}
    run = jaxball.simulate(ball(Bowl(BOWL), **law), times, in_bowl(start, direction), throw=True)
    stops, phi = swings(start, C, 12.0, static, 2.0)
    assert len(stops) >= 2
    assert (np.abs(np.tan(phi)) < C) == (static == C)
    assert int(run.switches.count) == len(stops)
    np.testing.assert_allclose(run.switches.times[: len(stops)], stops, rtol=1e-9)
    foot = 2 * BOWL * np.tan(phi / 2) * np.array([np.cos(direction), np.sin(direction)])
    np.testing.assert_allclose(run.state.z[-1], foot, atol=1e-9)
    rests = times > stops[-1]
    np.testing.assert_array_equal(run.history.rests, rests)
    np.testing.assert_array_equal(run.state.z[rests], np.broadcast_to(run.state.z[-1], (rests.sum(), 2)))
    np.testing.assert_array_equal(run.state.Omega[rests], 0.0)
    assert run.switches.lines[-1].endswith("the body comes to rest")
    seen = run.observables
    np.testing.assert_allclose(seen.normal_force[-1], M * G * np.cos(phi), rtol=1e-9)
    np.testing.assert_allclose(seen.dissipation[-1], 0.0, atol=1e-15)


@pytest.mark.long
@pytest.mark.parametrize("share", [0.999, 1.001])
def test_it_stays_where_it_is_placed_up_to_the_angle_of_its_resistance(share):
    phi = jnp.arctan(share * C)
    run = jaxball.simulate(ball(Bowl(BOWL)), (0.0, 1.0), in_bowl(phi), throw=True)
    assert bool(run.history.rests[-1]) == (share < 1)
    moved = np.linalg.norm(run.state.z[-1] - in_bowl(phi).z)
    assert (moved == 0) == (share < 1)


@pytest.mark.long
def test_a_plate_that_tilts_carries_a_ball_until_its_weight_exceeds_resistance():
    """About the foot of the ball: M g r sin a = c N r, with N = M (g cos a − r ȧ²) of a ball that is carried."""
    rate = 0.5
    plane = TiltingPlane(about_e2=ConstantRate(0.0, rate))
    state = BallState(Omega=(0.0, rate, 0.0))
    run = jaxball.simulate(ball(plane), (0.0, 0.1, 0.3), state, throw=True)
    loose = brentq(lambda t: G * np.sin(rate * t) - C * (G * np.cos(rate * t) - R * rate**2), 0.0, 1.0, xtol=1e-14)
    np.testing.assert_allclose(run.switches.times[0], loose, rtol=1e-9)
    assert run.switches.lines[0].endswith("the body rolls")
    np.testing.assert_allclose(run.state.z[1], 0.0, atol=1e-15)
    np.testing.assert_allclose(run.state.Omega[1], [0.0, rate, 0.0], rtol=1e-14, atol=1e-15)


THROWN = BallState(z=(0.8, 0.3), Omega=(2.0, 3.0, 4.0))


@pytest.mark.slow
def test_the_smoothed_law_tends_to_the_exact_one_across_a_bowl():
    """Spinning stops first, and is held along the normal while this turns."""
    run = jaxball.simulate(ball(Bowl(BOWL), 0.05, 0.05), (0.0, 1.5), THROWN, throw=True)
    assert run.switches.lines[0].endswith("its spinning ends")
    normal = (run.observables.geometric_centre[-1] - run.observables.contact_point[-1]) / R
    assert abs(normal @ run.observables.angular_velocity_space[-1]) < 1e-12
    errors = []
    for width in (4e-4, 2e-4):
        smoothed = ball(Bowl(BOWL), 0.05, 0.05, exact=False, smoothing=width)
        solver = jaxball.simulation.solvers.RadauIIA(3)
        end = jaxball.simulate(smoothed, (0.0, 1.5), THROWN, solver=solver, throw=True).state.z[-1]
        errors.append(np.linalg.norm(end - run.state.z[-1]))
    assert errors[1] < 0.6 * errors[0]
    assert errors[1] < 1e-8


@pytest.mark.slow
def test_derivatives_of_when_it_comes_to_rest_in_a_bowl():
    """Against differences of the reference over four points."""

    def stop(x):
        run = jaxball.simulate(ball(Bowl(BOWL), x[0]), (0.0, 12.0), in_bowl(x[1]))
        return run.switches.times[len(stops) - 1]

    x = np.array([C, 1.0])
    stops, _ = swings(1.0, C, 12.0)
    expected = jacobian(lambda x: swings(x[1], x[0], 12.0)[0][-1], x, 1e-4 * x)
    np.testing.assert_allclose(jaxball.jit(jax.jacrev(stop))(jnp.asarray(x)), expected, rtol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize(("contact", "errors"), [(None, 2), (Contact(0.6), 3)], ids=["rolling", "contact"])
def test_a_ball_that_resistance_hardly_holds_comes_to_rest_at_every_tolerance(contact, errors):
    """The slope where it stops is 0.98 of its resistance, so that its last motion lasts long.

    At loose tolerances it crept on for ever. Against a tight one, because its path is no plane curve.
    """
    body, state = ball(Bowl(BOWL), 0.09437949), BallState(Omega=(0.0, 1.9037845, 0.5))

    def rest(tolerance):
        run = jaxball.simulate(body, (0.0, 4.0), state, contact=contact, rtol=tolerance, atol=tolerance, throw=True)
        assert run.history.rests[-1]
        assert int(run.steps) < 400
        return np.asarray(run.state.z[-1])

    exact = rest(1e-11)
    assert 0.97 < np.hypot(*exact) / BOWL / 0.09437949 < 0.99  # the slope over the resistance, in small angles
    for tolerance in (1e-8, 1e-6, 1e-5, 1e-4, 1e-3):
        np.testing.assert_allclose(rest(tolerance), exact, atol=errors * tolerance)
