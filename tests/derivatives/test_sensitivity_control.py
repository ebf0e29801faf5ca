"""Derivatives where the state needs no steps of its own: compared with closed forms, linear theory and SciPy.

At rest the error of the state is 0 in steps of any length, so that only the probe asks for shorter ones.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

import jaxball
from jaxball import (
    Ball,
    BallState,
    Bowl,
    Contact,
    Disk,
    DiskState,
    PiecewiseSignal,
    planar_pendulum,
    programs,
    simulate,
)
from jaxball.control import tvlqr
from jaxball.physics import SpeedLimitedMotor
from jaxball.physics.classical import LagrangianState, LagrangianSystem
from jaxball.simulation.solvers import NDF, Adams, Gauss, RadauIIA

MARBLE = Ball(mass=1.0, radius=0.1, inertia=(0.004,) * 3, gravity=9.81, ground=Bowl(1.0))
OMEGA = np.sqrt(5 * 9.81 / (7 * 0.9))  # of small swings of a solid ball whose centre is 0.9 from that of the bowl
END = 20.0
TOLERANCES = 10.0 ** -np.arange(4, 13, 2)
# A run whose states are of size 1 is within some 100 tolerances after nine swings, its derivatives within four times as
# many, because a quarter of the probe's error counts.
FACTOR = 1000
ROUNDING = 1e-11  # relative: some 200 steps of 14 stages, with a rounding each


def end_of_marble(x, tolerance, **how):
    run = simulate(MARBLE, [0.0, END], BallState(z=(x, 0.0)), rtol=tolerance, atol=tolerance, **how)
    return run.state.z[-1, 0]


def swing(x0, times=(END,)):
    """Computes x(t) and d x(t) / d x(0) of a marble that swings in a plane, where x = 2 tan(a/2), by SciPy."""

    def field(t, y):
        a, rate, moved, moved_rate = y
        return [rate, -(OMEGA**2) * np.sin(a), moved_rate, -(OMEGA**2) * np.cos(a) * moved]

    start, how = 2 * np.arctan(x0 / 2), {"method": "DOP853", "rtol": 3e-14, "atol": 1e-16, "t_eval": times}
    a, _, moved, _ = scipy.integrate.solve_ivp(field, (0, END), [start, 0, 1, 0], **how).y
    return 2 * np.tan(a / 2), moved * np.cos(start / 2) ** 2 / np.cos(a / 2) ** 2


@pytest.fixture(scope="module")
def of_marble():
    """Both modes of the derivative, as functions of the start and the tolerance."""
    return [jax.jit(mode(end_of_marble)) for mode in (jax.jacfwd, jax.jacrev)]


@pytest.mark.parametrize("start", [0.0, 1e-9, 1e-6, 1e-3, 0.1])
def test_a_marble_at_rest_and_close_to_it(of_marble, start):
    exact = swing(start)[1][0]
    for tolerance in TOLERANCES:
        forward, reverse = (float(derivative(start, tolerance)) for derivative in of_marble)
        assert abs(forward / exact - 1) < FACTOR * tolerance + ROUNDING, tolerance
        # The same steps: their lengths differ by rounding, which moves the derivative by a part of its error.
        assert abs(forward / reverse - 1) < 1e-2 * FACTOR * tolerance + ROUNDING, tolerance


def pendulum(p, initial, tolerance=1e-10):
    """Simulates a disk whose pendulum hangs at rest, except for what ``initial`` adds to (z, z', theta, theta')."""
    z, z_rate, theta, theta_rate = initial
    robot = Disk(mass=1.0, inertia=0.5, gravity=9.81, mechanisms=[planar_pendulum(0.5, 0.6, drive=p)])
    start = jaxball.DiskState(phi=-z, phidot=-z_rate, theta=theta[None], thetadot=theta_rate[None], z=z)
    return simulate(robot, [0.0, 5.0], start, rtol=tolerance, atol=tolerance).state.z[-1]


def linear_pendulum(stall=0.0, free_speed=1.0):
    """Builds ẋ = A x + b Q of small motions, x = (z, a, ż, ȧ) with the angle a of the rod from the vertical.

    From the energies ½ (M + I/r²) ż² + ½ m (ż − l ȧ)² and ½ m g l a²; the torque Q acts along θ = a − z/r, less
    ``stall`` θ̇ / ``free_speed``.
    """
    M, inertia, m, length, g = 1.0, 0.5, 0.5, 0.6, 9.81
    mass = np.array([[M + inertia + m, -m * length], [-m * length, m * length**2]])
    stiffness, along = np.diag([0.0, m * g * length]), np.array([-1.0, 1.0])
    damping = stall / free_speed * np.outer(along, along)
    zero, eye = np.zeros((2, 2)), np.eye(2)
    below = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
    return np.vstack([np.hstack([zero, eye]), below]), np.concatenate([np.zeros(2), np.linalg.solve(mass, along)])


def test_the_voltage_of_a_motor_at_its_holding_value():
    knots = np.linspace(0.0, 5.0, 11)
    A, b = linear_pendulum(3.0, 4.0)

    def of_interval(k):
        # A voltage of 1 from knot k to the next moves x by the last column of the flow of (x, 1).
        with_input = np.block([[A, 3.0 * b[:, None]], [np.zeros((1, 5))]])
        moved = scipy.linalg.expm(with_input * 0.5)[:4, 4]
        return (scipy.linalg.expm(A * (5.0 - knots[k + 1])) @ moved)[0]

    exact = np.array([of_interval(k) for k in range(10)])
    motor = lambda values: SpeedLimitedMotor(PiecewiseSignal(knots, values), 3.0, 4.0)  # noqa: E731
    rest = jnp.zeros(4)
    for mode in (jax.jacfwd, jax.jacrev):
        gradient = jax.jit(mode(lambda values: pendulum(motor(values), rest)))(jnp.zeros(10))
        # FACTOR tolerances of the largest entry.
        np.testing.assert_allclose(gradient, exact, atol=FACTOR * 1e-10 * np.max(np.abs(exact)))


@pytest.mark.thorough
def test_states_and_parameters_together():
    A, b = linear_pendulum(3.0, 4.0)
    flow = scipy.linalg.expm(A * 5.0)
    # θ = a − z, so that a start (z, z', θ, θ') is a = θ + z.
    to_x = np.array([[1.0, 0, 0, 0], [1, 0, 1, 0], [0, 1, 0, 0], [0, 1, 0, 1]])
    augmented = scipy.linalg.expm(np.block([[A, b[:, None]], [np.zeros((1, 5))]]) * 5.0)
    exact = np.append((flow @ to_x)[0], 3.0 * augmented[0, 4])

    def end(x):
        return pendulum(SpeedLimitedMotor(x[4], 3.0, 4.0), x[:4])

    forward, reverse = (jax.jit(mode(end))(jnp.zeros(5)) for mode in (jax.jacfwd, jax.jacrev))
    np.testing.assert_allclose(forward, exact, atol=FACTOR * 1e-10 * np.max(np.abs(exact)))
    np.testing.assert_allclose(forward, reverse, atol=1e-9 * np.max(np.abs(exact)))


def test_with_few_checkpoints_steps_are_taken_again_as_they_were(of_marble):
    few = diffrax.RecursiveCheckpointAdjoint(checkpoints=5)
    again = jax.jit(jax.grad(lambda x: end_of_marble(x, 1e-8, adjoint=few)))(0.0)
    # The steps taken twice round differently.
    np.testing.assert_allclose(again, of_marble[1](0.0, 1e-8), rtol=1e-10)


@pytest.mark.thorough
def test_within_vmap_scan_and_checkpoint(of_marble):
    derivative = jax.grad(lambda x: end_of_marble(x, 1e-8))
    starts = jnp.array([0.0, 1e-6, 1e-3])
    single = [float(of_marble[1](x, 1e-8)) for x in starts]
    np.testing.assert_allclose(jax.jit(jax.vmap(derivative))(starts), single, rtol=1e-9)
    _, scanned = jax.jit(lambda starts: jax.lax.scan(lambda carry, x: (carry, derivative(x)), 0.0, starts))(starts)
    np.testing.assert_allclose(scanned, single, rtol=1e-9)
    kept = jax.jit(jax.grad(jax.checkpoint(lambda x: end_of_marble(x, 1e-8))))(0.0)
    np.testing.assert_allclose(kept, single[0], rtol=1e-9)


@pytest.mark.thorough
def test_a_system_from_its_lagrangian():
    system = LagrangianSystem(lambda t, q, qdot: 0.5 * qdot[0] ** 2 + jnp.cos(q[0]), ("q",))

    def end(x, tolerance):
        start = LagrangianState(x[None], jnp.zeros(1))
        return simulate(system, [0.0, END], start, rtol=tolerance, atol=tolerance).state.q[-1, 0]

    derivative = jax.jit(jax.jacfwd(end))
    for tolerance in TOLERANCES:
        assert abs(derivative(jnp.array(0.0), tolerance) / np.cos(END) - 1) < FACTOR * tolerance + ROUNDING


@pytest.mark.thorough
def test_a_ball_that_could_slip_but_rests():
    def end(x, tolerance):
        contact = Contact(friction=0.5)
        return simulate(
            MARBLE, [0.0, END], BallState(z=(x, 0.0)), rtol=tolerance, atol=tolerance, contact=contact
        ).state.z[-1, 0]

    for mode in (jax.jacfwd, jax.jacrev):
        derivative = jax.jit(mode(end))
        for tolerance in (1e-6, 1e-10):
            assert abs(derivative(0.0, tolerance) / np.cos(OMEGA * END) - 1) < FACTOR * tolerance, mode


@pytest.mark.thorough
def test_within_a_program_the_derivative_is_the_same(of_marble):
    """As in searches and fits, which differentiate their runs within programs of their own."""
    for mode, elsewhere in zip((jax.jacfwd, jax.jacrev), of_marble, strict=True):
        within = programs.jit(mode(end_of_marble))(0.0, 1e-8)
        np.testing.assert_allclose(within, elsewhere(0.0, 1e-8), rtol=ROUNDING)


@pytest.mark.long
def test_within_a_program_a_ball_that_could_slip_but_rests():
    """A probe that moved the numbers of its state one by one would let it slip, and be NaN: −298 for 0.18."""

    def end(x):
        start, contact = BallState(z=(x, 0.0)), Contact(friction=0.5)
        return simulate(MARBLE, [0.0, 5.0], start, rtol=1e-8, atol=1e-8, contact=contact).state.z[-1, 0]

    assert abs(programs.jit(jax.grad(end))(0.0) / np.cos(OMEGA * 5.0) - 1) < FACTOR * 1e-8


@pytest.mark.long
@pytest.mark.parametrize(
    ("solver", "factor"),
    [
        (diffrax.Tsit5(), 3000),  # of low order: the error is that of many more steps
        (RadauIIA(3), FACTOR),
        (RadauIIA(5), FACTOR),
        (Gauss(6), FACTOR),
        (Adams(), FACTOR),
        (NDF(), 3000),  # of order 5 at most: the error is that of the tolerance to the power 5/6
    ],
    ids=lambda x: type(x).__name__,
)
def test_every_kind_of_solver(solver, factor):
    for mode in (jax.jacfwd, jax.jacrev):
        derivative = jax.jit(mode(lambda x, tolerance: end_of_marble(x, tolerance, solver=solver)))
        for tolerance in (1e-4, 1e-7):
            assert abs(derivative(0.0, tolerance) / np.cos(OMEGA * END) - 1) < factor * tolerance, (mode, tolerance)


def last_swing(x, tolerance, system=MARBLE):
    """Returns where a marble, or a system of one coordinate, released at x is in the last swing, with ``NDF``."""
    times = jnp.concatenate([jnp.zeros(1), jnp.linspace(END - 2 * np.pi / OMEGA, END, 30)])
    how = {"rtol": tolerance, "atol": tolerance, "solver": NDF()}
    if system is MARBLE:
        return simulate(MARBLE, times, BallState(z=(x, 0.0)), **how).state.z[:, 0]
    return simulate(system, times, LagrangianState(jnp.stack([x]), jnp.zeros(1)), **how).state.q[:, 0]


@pytest.mark.thorough
def test_with_ndf_a_derivative_is_as_exact_as_a_state_that_moves_by_as_much():
    """A method of order 5 that damps: its states of size 1 are themselves wrong by up to 3,500 tolerances where the
    motion is linear, and by 150,000 in a swing from x = 1, so derivatives are not within 3,000 either.

    Errors of a swing's displacement are compared, because at one time they may cancel.
    """
    times = np.concatenate([[0.0], np.linspace(END - 2 * np.pi / OMEGA, END, 30)])
    # A quarter of the probe's error counts, and the state's own error is half as large where parts of it cancel.
    share = 2 * 4
    oscillator = LagrangianSystem(lambda t, q, v: 0.5 * v[0] ** 2 - 0.5 * OMEGA**2 * q[0] ** 2, ("q",))
    linear = jax.jit(lambda x, tolerance: last_swing(x, tolerance, oscillator))
    state, derivative = jax.jit(last_swing), jax.jit(jax.jacfwd(last_swing))
    for tolerance in TOLERANCES:
        of_linear = np.max(np.abs(linear(1.0, tolerance) - np.cos(OMEGA * times)))
        at_rest = np.max(np.abs(derivative(0.0, tolerance) - np.cos(OMEGA * times)))
        assert at_rest < share * of_linear, tolerance
        (of_swing, _), (_, exact) = (swing(x, times) for x in (1.0, 0.1))
        of_state = np.max(np.abs(state(1.0, tolerance) - of_swing))
        moving = np.max(np.abs(derivative(0.1, tolerance) - exact)) / np.max(np.abs(exact))
        assert moving < share * of_state, tolerance


def test_a_regulator_of_a_robot_at_rest():
    robot = Disk(mass=1.0, inertia=0.5, gravity=9.81, mechanisms=[planar_pendulum(0.5, 0.6, drive=jaxball.Motor(0.0))])
    A, _ = linear_pendulum()
    for sample in (0.02, 0.1, 0.5, 2.0):
        track = tvlqr(simulate(robot, [0.0, 2 * sample]), Q={"phi": 1.0, "theta": 1.0}, R=1.0, sample=sample)
        # In whatever coordinates: the multipliers are those of the flow.
        multipliers = np.sort_complex(np.linalg.eigvals(np.asarray(track.linear.A[0])))
        exact = np.sort_complex(np.append(np.linalg.eigvals(scipy.linalg.expm(A * sample)), 1.0))
        # That of the place of rest is a double one, and so known to the root of the error.
        np.testing.assert_allclose(np.abs(multipliers), np.abs(exact), atol=1e-4)
        slow = [np.trace(np.asarray(track.linear.A[0])), np.trace(scipy.linalg.expm(A * sample)) + 1.0]
        assert abs(slow[0] - slow[1]) < 1e-7, sample


@pytest.mark.any_precision
def test_at_a_loose_tolerance_in_any_precision(of_marble):
    # Also in float32, where 1e-4 is a hundred roundings of a step.
    for derivative in of_marble:
        assert abs(derivative(0.0, 1e-4) / np.cos(OMEGA * END) - 1) < 2e-2


@pytest.mark.parametrize("tolerance", [1e-6, 1e-12])
def test_dense_output_has_the_steps_of_its_derivatives(tolerance):
    """Those of the run alone are others, and data of one step beside tangents of another gave 1.59 for 1.82."""
    rocking = Disk(mass=1.0, inertia=0.5, offset=(0.0, 0.0, -0.2))

    def place(start, dense):
        state = DiskState(phidot=start[0], phi=start[1])
        run = simulate(rocking, [0.0, 2.3, 5.0], state, rtol=tolerance, atol=tolerance, dense=dense)
        return run.at(2.3).phi if dense else run.state.phi[1]

    for start in ((0.9, 0.3), (0.0, 0.0)):
        saved = jax.jacfwd(place)(jnp.array(start), False)
        for derivative in (jax.jacfwd(place), jax.grad(place)):
            np.testing.assert_allclose(derivative(jnp.array(start), True), saved, rtol=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("differentiate", [jax.jacrev, jax.jacfwd])
def test_a_derivative_that_runs_out_of_steps_is_nan_where_it_did_not_come(differentiate):
    """Its value alone rests, and needs few steps; in dense output both have the same, and the same status."""

    def ends(x, dense):
        run = simulate(MARBLE, [0.0, 1.0, END], BallState(z=(x, 0.0)), max_steps=32, dense=dense)
        return run.state.z[:, 0], run.status

    for dense, expected in ((False, jaxball.Status.SUCCESS), (True, jaxball.Status.MAX_STEPS)):
        assert jax.jit(ends, static_argnums=1)(0.0, dense)[1] == jaxball.Status.SUCCESS
        derivative, status = jax.jit(differentiate(lambda x, dense=dense: ends(x, dense), has_aux=True))(0.0)
        assert status == expected
        np.testing.assert_allclose(derivative[:2], np.cos(OMEGA * np.array([0.0, 1.0])), atol=1e-8)
        assert np.isnan(derivative[2])
