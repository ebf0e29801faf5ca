"""A body that exact dry resistance brings to rest, with a pendulum on a joint that sticks, against a model of its own.

The model has the place x and the pendulum's angle ψ from the vertical as coordinates, and Lagrange's equations by hand.
It does not decide in any order what friction holds: of all modes it takes the one in which everything that is held
needs no more friction than there is, and everything else begins to move against its friction.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxball
from jaxball import Ball, BallState, Disk, DiskState, JointFriction, Resistance
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.differences import jacobian

G, M, R, BOB, L = 9.81, 2.0, 0.3, 0.7, 0.2
SOLID = 0.4 * M * R**2
C, STATIC, VISCOUS = 0.01, 0.1, 0.02


def robot(kind=Disk, c=C, static=STATIC, viscous=VISCOUS):
    pendulum = jaxball.planar_pendulum(BOB, L, drive=JointFriction(static, viscous=viscous))
    inertia, extra = (SOLID, {}) if kind is Disk else ((SOLID,) * 3, {"dry_spinning": 0.01})
    resistance = Resistance(dry=c, exact=True, **extra)
    return kind(mass=M, inertia=inertia, radius=R, gravity=G, resistance=resistance, mechanisms=[pendulum])


def forces(x, mode, c, static, viscous):
    """ẍ, ψ̈, the force of resistance over r, the joint's friction Q, and N, by the rates' signs; 0 where held."""
    v, psi, w = x[1:]
    rolls, slips = mode
    s, cosine, turning = np.sin(psi), np.cos(psi), -w - v / R
    A, b = np.zeros((4, 4)), np.zeros(4)
    A[0] = M + SOLID / R**2 + BOB, BOB * L * cosine, -1.0, 1 / R
    b[0] = BOB * L * w**2 * s
    A[1] = BOB * L * cosine, BOB * L**2, 0.0, 1.0
    b[1] = -BOB * G * L * s
    N0 = (M + BOB) * G + BOB * L * w**2 * cosine
    A[2] = (1.0, 0, 0, 0) if rolls == 0 else (0.0, c * rolls * BOB * L * s, 1.0, 0.0)
    b[2] = 0.0 if rolls == 0 else -c * rolls * N0
    A[3] = (1 / R, 1.0, 0, 0) if slips == 0 else (0, 0, 0, 1.0)
    b[3] = 0.0 if slips == 0 else -slips * static - viscous * turning
    a, alpha, F, Q = np.linalg.solve(A, b)
    return a, alpha, F, Q, N0 + BOB * L * alpha * s


def chosen(x, c, static, viscous, rates):
    """The mode, where ``rates`` are the signs of ẋ and θ̇ that are known to be what they are; 0 at rest."""
    modes = []
    for mode in itertools.product((0, 1, -1), repeat=2):
        if any(rate not in (0, own) for rate, own in zip(rates, mode, strict=True)):
            continue
        a, alpha, F, Q, N = forces(x, mode, c, static, viscous)
        grows = a, -alpha - a / R
        holds = abs(F) <= c * N, abs(Q) <= static
        if all(rate or (own * g > 0 if own else h) for rate, own, g, h in zip(rates, mode, grows, holds, strict=True)):
            modes.append(mode)
    assert len(modes) == 1
    return modes[0]


def reference(x, end, c=C, static=STATIC, viscous=VISCOUS):
    """The times of switches, the modes that begin with them, and the state at the end."""
    t, x, switches = 0.0, np.asarray(x, float), []
    mode = chosen(x, c, static, viscous, (np.sign(x[1]), np.sign(-x[3] - x[1] / R)))

    def field(_, x):
        a, alpha = forces(x, mode, c, static, viscous)[:2]
        return [x[1], a, x[3], alpha]

    def of_body(_, x):
        _, _, F, _, N = forces(x, mode, c, static, viscous)
        return mode[0] * x[1] if mode[0] else c * N - abs(F)

    def of_joint(_, x):
        Q = forces(x, mode, c, static, viscous)[3]
        return mode[1] * (-x[3] - x[1] / R) if mode[1] else static - abs(Q)

    for event in (of_body, of_joint):
        event.terminal, event.direction = True, -1
    while t < end:
        run = solve_ivp(field, (t, end), x, "DOP853", events=(of_body, of_joint), rtol=1e-12, atol=1e-14)
        t, x = run.t[-1], run.y[:, -1].copy()
        if not run.status:
            break
        which = 0 if run.t_events[0].size else 1
        rates = list(mode)
        if mode[which] == 0:  # it gives way against what held it
            rates[which] = -np.sign(forces(x, mode, c, static, viscous)[2 + which])
        elif which == 0:  # ẋ is 0, and where the joint sticks nothing moves
            x[1], rates[0] = 0.0, 0
            x[3] = 0.0 if mode[1] == 0 else x[3]
        else:
            x[3], rates[1] = -x[1] / R, 0
        mode = chosen(x, c, static, viscous, rates)
        switches.append((t, mode))
    return switches, x


def start(kind, v, psi):
    """Rolling forward at v, with the pendulum at rest relative to the body."""
    return (
        (DiskState(phidot=-v / R, theta=[-psi], thetadot=[0.0]))
        if kind is Disk
        else BallState(Omega=(0.0, v / R, 0.0), theta=[-psi], thetadot=[0.0])
    )


def start_of_reference(v, psi):
    return [0.0, v, psi, -v / R]


@pytest.mark.long
def test_a_robot_with_a_damped_pendulum_comes_to_rest_entirely_and_stays():
    times = np.linspace(0.0, 10.0, 11)
    run = jaxball.simulate(robot(), times, start(Disk, 1.2, 0.0), throw=True)
    switches, x = reference(start_of_reference(1.2, 0.0), 10.0)
    count = len(switches)
    assert int(run.switches.count) == count > 5
    np.testing.assert_allclose(run.switches.times[:count], [t for t, _ in switches], rtol=1e-8)
    np.testing.assert_array_equal(run.switches.directions_after[:count, 0], [mode[1] for _, mode in switches])
    np.testing.assert_array_equal(run.switches.rolls_after[:count], [mode[0] != 0 for _, mode in switches])
    assert switches[-1][1] == (0, 0)
    z = run.state.z[-1]
    np.testing.assert_allclose([z, -run.state.theta[-1, 0] - z / R], x[[0, 2]], atol=1e-8)
    later = times > switches[-1][0]
    np.testing.assert_array_equal(run.history.rests, later)
    np.testing.assert_array_equal(run.state.z[later], np.broadcast_to(run.state.z[-1], run.state.z[later].shape))
    np.testing.assert_array_equal(run.state.theta[later], np.broadcast_to(run.state.theta[-1], (later.sum(), 1)))
    np.testing.assert_array_equal(run.state.thetadot[later], 0.0)
    assert run.switches.lines[-1].endswith("the body comes to rest")


@pytest.mark.thorough
def test_a_ball_rests_and_its_joint_sticks_as_those_of_a_disk_do():
    run = jaxball.simulate(robot(Ball), (0.0, 0.8), start(Ball, 1.2, 0.0), throw=True)
    switches, x = reference(start_of_reference(1.2, 0.0), 0.8)
    count = len(switches)
    assert int(run.switches.count) == count > 0
    np.testing.assert_allclose(run.switches.times[:count], [t for t, _ in switches], rtol=1e-8)
    np.testing.assert_array_equal(run.switches.directions_after[:count, 0], [mode[1] for _, mode in switches])
    np.testing.assert_allclose(run.state.z[-1, 0], x[0], atol=1e-8)


CASES = [(1.01, 1.01), (0.99, 1.01), (1.01, 0.99), (0.4, 0.9), (0.9, 0.4), (0.3, 0.3), (0.0, 1.2)]


@pytest.mark.long
def test_what_gives_way_from_rest():
    """The pendulum needs the torque m g l sin ψ of the joint, and the body as much of the plane."""
    psi = 0.5
    torque = BOB * G * L * np.sin(psi)
    static = torque * np.array([max(joint, 1e-3) for joint, _ in CASES])
    c = torque / ((M + BOB) * G * R) * np.array([body for _, body in CASES])
    robots = jax.vmap(lambda c, static: robot(Disk, c, static, 0.0))(jnp.asarray(c), jnp.asarray(static))
    runs = simulate_ensemble(robots, (0.0, 0.05), start(Disk, 0.0, psi), in_axes=(0, None)).trajectory
    x = start_of_reference(0.0, psi)
    modes = [chosen(x, *row, 0.0, (0, 0)) for row in zip(c, static, strict=True)]
    assert len(set(modes)) > 2
    np.testing.assert_array_equal(runs.history.rests[:, 0], [mode[0] == 0 for mode in modes])
    np.testing.assert_array_equal(runs.history.directions[:, 0, 0], [mode[1] for mode in modes])
    ends = np.array([reference(x, 0.05, *row, 0.0)[1] for row in zip(c, static, strict=True)])
    np.testing.assert_allclose(runs.state.z[:, -1], ends[:, 0], atol=1e-11)
    np.testing.assert_allclose(-runs.state.theta[:, -1, 0] - runs.state.z[:, -1] / R, ends[:, 2], atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("mode", [jax.jacrev, jax.jacfwd])
def test_derivatives_of_when_it_comes_to_rest(mode):
    """Against differences of the reference over four points."""

    def stop(p):
        run = jaxball.simulate(robot(Disk, p[0], p[1], VISCOUS), (0.0, 10.0), start(Disk, p[2], 0.0))
        return run.switches.times[9]

    def stop_of_reference(p):
        return reference(start_of_reference(p[2], 0.0), 10.0, p[0], p[1])[0][9][0]

    p = np.array([C, STATIC, 1.2])
    expected = jacobian(stop_of_reference, p, 1e-4 * p)
    np.testing.assert_allclose(jaxball.jit(mode(stop))(jnp.asarray(p)), expected, rtol=1e-6)
