"""Forces on the body that depend on the time and on its motion: against closed forms, Newton's and Euler's laws, and
the resistance that is linear in the velocity.
"""

import dataclasses

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import jaxball
from jaxball import Ball, BallState, Contact, Disk, DiskState, FunctionWrench, Wrench
from jaxball.analysis.verify import check_laws
from jaxball.physics import ReleasedState
from jaxball.physics.contact import friction
from jaxball.physics.contact.released import rates, release, response
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support import newton_euler, robots
from tests.support.robot_balls import ball_of, state_of
from tests.support.robots import Pushed
from tests.support.sentences import refuses, said

M, D, R, G = 1.3, 0.6, 0.9, 2.0
FINE = {"rtol": 1e-12, "atol": 1e-12, "step_to_times": True}
TIMES = np.linspace(0.0, 3.0, 13)


def homogeneous(force, **others):
    return Ball(mass=M, inertia=(D, D, D), radius=R, gravity=G, force=force, **others)


def in_medium(t, motion, coefficients):
    """What a medium at rest takes: linear in the velocities."""
    return Wrench(-coefficients[0] * motion.velocity, -coefficients[1] * motion.omega)


def quadratic(t, motion, c):
    """c |v| v against the velocity, differentiable at rest too."""
    square = jnp.sum(motion.velocity**2)
    return -c * jnp.sqrt(jnp.where(square > 0, square, 1.0)) * motion.velocity


def magnet(t, motion, p):
    """A dipole in the ball in a field."""
    return Wrench(jnp.zeros_like(p["field"]), jnp.cross(motion.Lambda @ p["moment"], p["field"]))


def gusts(t, motion, strength):
    """Everything that a force may know, without a symmetry."""
    turned = motion.Lambda @ jnp.stack([motion.position[1], motion.position[2], jnp.cos(t)])
    force = strength * (jnp.cross(motion.omega, motion.velocity) + turned + jnp.sum(motion.theta) * motion.velocity)
    return Wrench(force, strength * (jnp.sum(motion.thetadot) * turned - motion.Lambda @ motion.Omega))


@pytest.mark.long
@pytest.mark.parametrize("v0", [1.5, -0.4])
def test_quadratic_drag_slows_a_rolling_ball_as_one_over_the_time(v0):
    """(m + d/r²) v̇ = −c v |v|: v = v0 / (1 + k |v0| t), k = c / (m + d/r²), so that ∂v/∂c is known, too."""
    inertia = M + D / R**2

    def speeds(c):
        state = BallState(Omega=jnp.stack([0.0 * c, v0 / R + 0.0 * c, 0.0 * c]))
        ball = homogeneous(FunctionWrench(quadratic, c))
        return R * jaxball.simulate(ball, TIMES, state, **FINE, adjoint=diffrax.ForwardMode()).state.Omega[:, 1]

    c = 0.7
    found, slope = jax.jvp(speeds, (jnp.asarray(c),), (jnp.ones(()),))
    grown = 1 + c / inertia * abs(v0) * TIMES
    np.testing.assert_allclose(found, v0 / grown, rtol=0, atol=1e-11)
    np.testing.assert_allclose(slope, -v0 * abs(v0) * TIMES / inertia / grown**2, rtol=0, atol=1e-10)


@pytest.mark.slow
def test_a_force_linear_in_the_velocities_is_the_resistance_of_a_medium():
    """On a slope with a turntable, with an offset and a pendulum, as the ball slides, rolls, flies and bounces."""
    arm = jaxball.planar_pendulum(0.3, 0.4, drive=jaxball.Spring(1.0))
    ground = jaxball.Ground(0.2, 0.3, turntable=jaxball.Turntable(jaxball.ConstantRate(0.0, rate=0.5)))
    body = {"mass": M, "inertia": (0.4, 0.5, 0.6), "offset": (0.1, 0.0, -0.2), "ground": ground, "mechanisms": [arm]}
    start = ReleasedState(BallState(Omega=(0.3, 1.0, 0.2), theta=[0.3], thetadot=[0.1]), (1.0, 0.4, 0.0), 0.1)
    contact = Contact(0.3, restitution=0.5)
    by_force, by_resistance = (
        jaxball.simulate(Ball(**body, **acts), TIMES, start, contact=contact, rtol=1e-10, atol=1e-10)
        for acts in (
            {"force": FunctionWrench(in_medium, jnp.array([0.3, 0.2]))},
            {"resistance": jaxball.Resistance(drag=0.3, rotational_drag=0.2)},
        )
    )
    assert by_force.ok
    assert int(by_force.contact.switches.count) == int(by_resistance.contact.switches.count) > 2
    for name in ("q", "Omega", "z", "theta"):
        found, expected = (getattr(run.state, name) for run in (by_force, by_resistance))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)  # what solves to 1e-10 may differ by
    one, other = by_force.observables, by_resistance.observables
    for name in ("normal_force", "friction", "power", "joint_efforts"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=0, atol=1e-7)


def constant(t, motion, force):
    return force


@pytest.mark.long
def test_a_constant_function_is_a_constant_force():
    force = (0.1, 0.0, -0.3)
    for body, start in ((Ball, BallState(Omega=(0.1, 0.5, 0.2))), (Disk, DiskState(phidot=0.5))):
        arguments = {"mass": M, "inertia": D if body is Disk else (D, 0.7, 0.8), "offset": (0.1, 0.0, 0.2)}
        runs = [
            jaxball.simulate(body(**arguments, force=given), TIMES, start, **FINE)
            for given in (FunctionWrench(constant, jnp.asarray(force)), jaxball.physics.HarmonicForce(force))
        ]
        for one, other in zip(*(jax.tree.leaves(run.observables) for run in runs), strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


@jax.jit
def all_rates(ball, t, state):
    """The rates of the body that rolls, of one that is not touched, and the reaction of the plane where it rolls."""
    rolling = release(ball, t, state.body)
    found, flying = response(ball, t, rolling), response(ball, t, state, jnp.asarray(False))
    held, free = friction.rolling(found), friction.flight(flying)
    return (
        rates(ball, rolling, found, held.amounts),
        ball.field(t, state.body),
        rates(ball, state, flying, free.amounts),
        held.R,
    )


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 6))])
def test_accelerations_are_those_of_newton_and_euler(seed):
    """What the function knows of the motion is the oracle's, and so is what the force that it makes of it does."""
    rng = np.random.default_rng(seed)
    robot = robots.random_robot(rng)
    setting, moment = robots.random_setting(rng), robots.random_moment(rng, robot)
    rolls, strength, height = robots.centre_velocity(robot, setting, moment), 0.3, 0.4
    flies = rolls + rng.normal(size=3)

    def pushed(V, height):
        """The setting with the force and the torque that the function makes of what the oracle knows."""
        knows = np.append(moment.z, height), V, robots.rotation(moment), moment.Omega
        angles = np.concatenate(moment.theta), np.concatenate(moment.thetadot)
        force, torque = gusts(jnp.zeros(()), jaxball.physics.BodyMotion(*map(jnp.asarray, (*knows, *angles))), strength)
        return dataclasses.replace(setting, Fe=np.asarray(force), Te=np.asarray(torque))

    on_plane, in_air = pushed(rolls, 0.0), pushed(flies, height)
    held = newton_euler.solve(robot, on_plane, moment)
    free = newton_euler.solve(robot, in_air, dataclasses.replace(moment, V=flies), Pushed(np.zeros(3), touching=False))

    arguments = ball_of(robot, setting, moment).arguments | {"force": FunctionWrench(gusts, jnp.asarray(strength))}
    state = ReleasedState(state_of(moment), jnp.asarray(flies), jnp.asarray(height))
    rolling, field, flying, R = all_rates(Ball(**arguments).prepare(), jnp.zeros(()), state)
    assert_close(R, held.R)
    for found, answer in ((rolling.body, held), (field, held), (flying.body, free)):
        assert_close(found.Omega, answer.Omegadot)
        assert_close(found.thetadot, np.concatenate(answer.thetaddot))
    assert_close(flying.V, np.append(free.zddot, free.rise))


def assert_close(found, expected):
    expected = np.asarray(expected)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * max(1.0, np.abs(expected).max()))


@pytest.mark.thorough
def test_a_magnet_turns_a_rolling_ball_as_a_pendulum():
    """(d + m r²) φ̈ = −m B sin φ from rest: sin(φ/2) = k cn(ωt)/dn(ωt) with k = sin(φ₀/2), ω² = m B / (d + m r²)."""
    moment, field, start = 0.7, 1.1, 1.2
    p = {"moment": jnp.array([0.0, 0.0, moment]), "field": jnp.array([0.0, 0.0, field])}
    q = (np.cos(start / 2), 0.0, np.sin(start / 2), 0.0)
    times = np.linspace(0.0, 12.0, 25)
    run = jaxball.simulate(homogeneous(FunctionWrench(magnet, p)), times, BallState(q=q), **FINE)
    rate, k = np.sqrt(moment * field / (D + M * R**2)), np.sin(start / 2)
    assert rate * times[-1] > 2 * ellipk(k**2)  # more than half a period
    _, cn, dn, _ = ellipj(rate * times, k**2)
    half = np.arcsin(k * cn / dn)
    np.testing.assert_allclose(run.state.q[:, 0], np.cos(half), rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.state.q[:, 2], np.sin(half), rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.state.z[:, 0], R * (2 * half - start), rtol=0, atol=1e-10)


@pytest.mark.long
def test_drag_on_a_ball_that_falls():
    """v = vₜ tanh(g t/vₜ) and h = h₀ − vₜ²/g ln cosh(g t/vₜ) with c vₜ² = m g."""
    c, height = 0.4, 9.0
    ball = homogeneous(FunctionWrench(quadratic, c))
    run = jaxball.simulate(
        ball, TIMES, ReleasedState(BallState(), (0.0, 0.0, 0.0), height), contact=Contact(0.2), **FINE
    )
    limit = np.sqrt(M * G / c)
    np.testing.assert_allclose(run.contact.V[:, 2], -limit * np.tanh(G * TIMES / limit), rtol=0, atol=1e-10)
    fallen = limit**2 / G * np.log(np.cosh(G * TIMES / limit))
    np.testing.assert_allclose(run.contact.height, height - fallen, rtol=0, atol=1e-10)
    seen = run.observables
    np.testing.assert_allclose(seen.power, -c * np.abs(np.asarray(run.contact.V[:, 2])) ** 3, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(seen.dissipation, 0.0)


def lifting(t, motion, p):
    """A spring along the vertical, and one along the plane."""
    return jnp.stack([-p["side"] * motion.position[0], jnp.zeros(()), p["up"] * (p["height"] - motion.position[2])])


@pytest.mark.thorough
def test_a_ball_in_the_air_on_springs_knows_its_place_and_height():
    p = {"side": 0.8, "up": 1.7, "height": 3.0}
    start = ReleasedState(BallState(z=(0.5, 0.2)), (0.0, 0.3, 0.0), 2.0)
    force = FunctionWrench(lifting, jax.tree.map(jnp.asarray, p))
    run = jaxball.simulate(homogeneous(force), TIMES, start, contact=Contact(0.2), **FINE)
    rest, rate = p["height"] - M * G / p["up"], np.sqrt(p["up"] / M)
    np.testing.assert_allclose(run.contact.height, rest + (2.0 - rest) * np.cos(rate * TIMES), rtol=0, atol=1e-10)
    z = np.stack([0.5 * np.cos(np.sqrt(p["side"] / M) * TIMES), 0.2 + 0.3 * TIMES], axis=1)
    np.testing.assert_allclose(run.state.z, z, rtol=0, atol=1e-10)


@pytest.mark.long
def test_a_force_that_depends_on_the_velocity_leaves_a_sliding_ball_its_friction():
    """A ball of quadratic drag that slides: m v̇ = −μ m g − c v², v = a tan(b − k t) until it rolls."""
    mu, c, v0 = 0.25, 0.4, 1.5
    ball = homogeneous(FunctionWrench(quadratic, c))
    start = ReleasedState(BallState(), (v0, 0.0, 0.0))
    run = jaxball.simulate(ball, TIMES / 6, start, contact=Contact(mu), **FINE)
    scale = np.sqrt(mu * M * G / c)
    v = scale * np.tan(np.arctan(v0 / scale) - np.sqrt(mu * G * c / M) * np.asarray(run.times))
    assert not int(run.contact.switches.count)
    np.testing.assert_allclose(run.contact.V[:, 0], v, rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.observables.friction[:, 0], -mu * M * G, rtol=1e-12)


@pytest.mark.long
def test_the_laws_of_mechanics_hold_under_wind_and_magnets():
    """Energy by its power, the momentum about the contact point by the force and the torque, in ``verify``."""
    ball = Ball(
        mass=M,
        inertia=(0.5, 0.6, 0.7),
        offset=(0.1, 0.0, -0.2),
        force=FunctionWrench(gusts, jnp.asarray(0.2)),
        ground=jaxball.Ground(0.1, turntable=jaxball.Turntable(jaxball.ConstantRate(0.0, rate=0.3))),
        mechanisms=[jaxball.planar_pendulum(0.3, 0.4)],
    )
    start = BallState(Omega=(0.3, 0.5, 0.2), theta=[0.3], thetadot=[0.1])
    scenario = jaxball.Scenario("gusts", ball, start, np.linspace(0.0, 3.0, 4), rtol=1e-10, atol=1e-10)
    report = check_laws(scenario, laws=("energy", "momentum", "jellett-rate", "chaplygin"))
    assert report.ok, str(report)
    assert report["energy"].residual < 1e-8
    said(report["chaplygin"].reason)


@pytest.mark.long
def test_runs_of_an_ensemble_are_single_runs():
    c = jnp.linspace(0.0, 0.8, 5)
    start = BallState(Omega=(0.1, 1.0, 0.0))
    balls = jax.vmap(lambda c: homogeneous(FunctionWrench(quadratic, c)))(c)
    many = simulate_ensemble(balls, TIMES, start, in_axes=(0, None), lanes=2).trajectory
    for k in (0, 3):
        one = jaxball.simulate(homogeneous(FunctionWrench(quadratic, c[k])), TIMES, start)
        np.testing.assert_allclose(many.state.z[k], one.state.z, rtol=0, atol=1e-9)


def sideways(t, motion, p):
    return Wrench(jnp.array([0.1, 5.0, 0.2]), jnp.array([3.0, 0.3, -4.0]))


def in_plane(t, motion, p):
    return Wrench(jnp.array([0.1, 0.0, 0.2]), jnp.array([0.0, 0.3, 0.0]))


@pytest.mark.long
def test_what_is_beside_the_plane_of_a_disk_is_taken_by_what_holds_it_upright():
    runs = [
        jaxball.simulate(
            Disk(mass=M, inertia=D, offset=(0.1, 0.0, 0.2), force=FunctionWrench(force)), TIMES, DiskState(phidot=0.5)
        )
        for force in (sideways, in_plane)
    ]
    for one, other in zip(*(jax.tree.leaves(run.observables) for run in runs), strict=True):
        np.testing.assert_array_equal(one, other)


def two_numbers(t, motion, p):
    return motion.velocity[:2]


def angles_for_a_torque(t, motion, p):
    return Wrench(motion.velocity, motion.theta)


def branching(t, motion, p):
    return motion.velocity if t > 0 else motion.position


class Bare(jaxball.physics.AbstractWrench):
    """Returns a force where it has to return a wrench."""

    def wrench(self, t, motion):
        return motion.velocity


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: homogeneous(Bare()), "force"),
        (lambda: homogeneous(FunctionWrench(two_numbers)), "function"),
        (lambda: homogeneous(FunctionWrench(angles_for_a_torque)), "function"),
        (lambda: homogeneous(FunctionWrench(branching)), "force"),
        (lambda: FunctionWrench(lambda t: t), "function"),
        (lambda: homogeneous(quadratic), "force"),
    ],
)
def test_what_is_no_force_is_refused(make, named, no_type_checks):
    with refuses(TypeError, named):
        make()
