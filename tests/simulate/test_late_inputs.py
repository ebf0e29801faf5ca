"""What drives a body at rest is seen whenever it comes: pushes, series and moving ground, against closed forms."""

from collections.abc import Callable

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
from jax.scipy.special import erf
from jaxtyping import Array, Float

import jaxball
from jaxball import Disk, DiskState, FunctionForce, HarmonicSeries, simulate
from jaxball.physics import HarmonicForce
from jaxball.physics.classical import LagrangianState, LagrangianSystem
from jaxball.simulation.ensemble import simulate_ensemble
from jaxball.simulation.solvers import NDF, TRBDF2, Adams, Gauss, RadauIIA, Trapezoidal

TOLERANCES = (1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
LENGTHS = (10.0, 100.0)
WIDTHS = (1.0, 0.3, 0.1, 0.03, 0.01)
INERTIA = 1.5  # of a disk of mass 1, radius 1 and inertia 1/2 about its centre, about the point of contact
# Every step of a push has an error of about the tolerance at most; some ten steps of one sign are within this many.
ERRORS = 10


def push(t, numbers):
    centre, width = numbers
    return jnp.array([1.0, 0.0, 0.0]) * jnp.exp(-(((t - centre) / width) ** 2))


def pushed(centre, width):
    return Disk(mass=1.0, inertia=0.5, force=FunctionForce(push, (jnp.asarray(centre), jnp.asarray(width))))


def momentum(length, centre, width):
    """The integral of the push over a run."""
    return 0.5 * width * np.sqrt(np.pi) * (erf((length - centre) / width) + erf(centre / width))


def speed(length, centre, width, **settings):
    """The speed of the disk at the end of a run that starts at rest."""
    run = simulate(pushed(centre, width), [0.0, length], **settings)
    return -run.state.phidot[-1]


@pytest.mark.thorough
@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_pushes_move_a_disk_by_their_momentum(tolerance):
    for length in LENGTHS:
        for width in WIDTHS:
            v = speed(length, 0.47 * length, width, rtol=tolerance, atol=tolerance)
            expected = momentum(length, 0.47 * length, width) / INERTIA
            assert abs(v - expected) <= ERRORS * tolerance, (length, width)


@pytest.mark.thorough
@pytest.mark.parametrize("share", [1.0, 0.1, 0.01, 0.003, 0.001])
def test_pushes_are_seen_wherever_they_are(share):
    tolerance = 1e-6
    for length in (0.02, 10.0, 1e4):
        # None of these is a round part of the run.
        for place in (0.0131, 0.2718, 0.6181, 0.9317):
            # As an impulse of 1, which does not become small with the run.
            width = share * length
            run = simulate(
                Disk(mass=width, inertia=0.5 * width, force=pushed(place * length, width).force),
                [0.0, length],
                rtol=tolerance,
                atol=tolerance,
            )
            expected = momentum(length, place * length, width) / (INERTIA * width)
            assert abs(-run.state.phidot[-1] - expected) <= ERRORS * tolerance, (length, place)


SOLVERS = [
    diffrax.Heun(),
    diffrax.Bosh3(),
    diffrax.Tsit5(),
    diffrax.Kvaerno5(),
    RadauIIA(stages=3),
    RadauIIA(stages=7),
    Gauss(stages=4),
    Adams(),
    NDF(),
    Trapezoidal(),
    TRBDF2(),
]


@pytest.mark.long
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)
def test_every_solver_sees_pushes(solver):
    for length, width in ((10.0, 1.0), (10.0, 0.1), (10.0, 0.01), (100.0, 0.01)):
        for tolerance in (1e-3, 1e-6):
            v = speed(length, 0.47 * length, width, rtol=tolerance, atol=tolerance, solver=solver)
            # The methods of order 2 make several errors of one sign in the many steps of a push; measured: up to 73.
            expected = momentum(length, 0.47 * length, width) / INERTIA
            assert abs(v - expected) <= 100 * tolerance, (length, width, tolerance)


@pytest.mark.long
def test_derivatives_and_batches_see_pushes():
    tolerance = 1e-8

    def of(width):
        return speed(10.0, 4.7, width, rtol=tolerance, atol=tolerance)

    widths = jnp.array(WIDTHS)
    expected = momentum(10.0, 4.7, widths) / INERTIA
    slopes = jax.vmap(jax.grad(lambda width: momentum(10.0, 4.7, width) / INERTIA))(widths)
    np.testing.assert_allclose(jax.jit(jax.vmap(of))(widths), expected, atol=ERRORS * tolerance)
    disks = jax.vmap(lambda width: pushed(4.7, width))(widths)
    ensemble = simulate_ensemble(disks, [0.0, 10.0], DiskState(), in_axes=(0, None), rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(-ensemble.state.phidot[:, -1], expected, atol=ERRORS * tolerance)
    # A derivative by the width is off by the error over the width, at most.
    for derivative in (jax.grad(of), jax.jacfwd(of)):
        for width, slope in zip(WIDTHS, slopes, strict=True):
            assert abs(derivative(jnp.asarray(width)) - slope) <= ERRORS * tolerance / width


@pytest.mark.thorough
def test_a_push_that_captures_a_number_has_its_derivative():
    def of(width):
        force = FunctionForce(lambda t, _: jnp.array([1.0, 0.0, 0.0]) * jnp.exp(-(((t - 4.7) / width) ** 2)))
        return -simulate(Disk(mass=1.0, inertia=0.5, force=force), [0.0, 10.0]).state.phidot[-1]

    slope = jax.grad(of)(jnp.asarray(0.01))
    np.testing.assert_allclose(slope, np.sqrt(np.pi) / INERTIA, rtol=1e-6)  # the tolerance of 1e-10 over the width


class Place(jaxball.physics.AbstractState):
    x: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.0)
    v: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.0)


class Pushed(jaxball.AbstractSystem):
    """A mass on a line under a push that travels along it with a speed of 1, a function of (t − 4.7 − x)/w."""

    title = "mass on a line"
    state_type = Place
    width: Float[Array, ""]
    push: Callable = eqx.field(static=True)

    def field(self, t, state):
        return Place(state.v, self.push((t - 4.7 - state.x) / self.width))


# Each with its integral, and how many errors of a step are allowed: a step across a jump knows its error only roughly.
SHAPES = {
    "bell": (lambda s: jnp.exp(-(s**2)), np.sqrt(np.pi), ERRORS),
    "power": (lambda s: (1 + s**2) ** -3, 3 * np.pi / 8, ERRORS),
    "parabola": (lambda s: jnp.maximum(0.0, 1 - s**2), 4 / 3, ERRORS),
    "triangle": (lambda s: jnp.maximum(0.0, 1 - jnp.abs(s)), 1.0, ERRORS),
    "window": (lambda s: jnp.where(jnp.abs(s) < 1, 1.0, 0.0), 2.0, 2 * ERRORS),
}


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::jaxball.simulation.KinkWarning")  # of the window, which jumps
@pytest.mark.parametrize(("push", "integral", "errors"), SHAPES.values(), ids=SHAPES)
def test_a_system_of_ones_own_sees_what_depends_on_its_state_too(push, integral, errors):
    for width in (0.1, 0.01):
        for tolerance in (1e-4, 1e-9):
            system = Pushed(jnp.asarray(width), push)
            run = simulate(system, [0.0, 10.0], Place(), rtol=tolerance, atol=tolerance)
            # With s = t − x, ds = (1 − v) dt, so that ∫ (1 − v) dv = v − v²/2 is the integral of the push.
            expected = 1 - np.sqrt(1 - 2 * integral * width)
            assert abs(run.state.v[-1] - expected) <= errors * tolerance, (width, tolerance)


QUOTIENTS = {
    "of a sine": lambda t, x: jnp.sin(20 * t) / (1 + x**2),
    "of the time": lambda t, x: t / (1 + x**2),
    "of a push": lambda t, x: jnp.exp(-(((t - 4.7) / 0.01) ** 2)) / (1 + x**2),
    "by both": lambda t, x: 1 / (1 + ((t - 4.7) / 0.01) ** 2 + x**2),
    "by a product": lambda t, x: (1 + x) / ((1 + ((t - 4.7) / 0.01) ** 2) * (1 + x**2)),
}


class Resting(jaxball.AbstractSystem):
    """A mass on a line that rests until a quotient of the time and its place drives it."""

    title = "mass at rest"
    state_type = Place
    drive: Callable = eqx.field(static=True)

    def field(self, t, state):
        return Place(state.v, self.drive(t, state.x))


@pytest.mark.thorough
@pytest.mark.parametrize("drive", QUOTIENTS.values(), ids=QUOTIENTS)
def test_quotients_of_the_time_and_the_state_are_seen_from_rest(drive):
    compiled, state = jax.jit(drive), np.zeros(2)
    for start, end, step in ((0.0, 4.5, 0.1), (4.5, 4.9, 0.001), (4.9, 10.0, 0.1)):
        state = scipy.integrate.solve_ivp(
            lambda t, y: [y[1], float(compiled(t, y[0]))],
            (start, end),
            state,
            method="DOP853",
            rtol=1e-11,
            atol=1e-13,
            max_step=step,
        ).y[:, -1]
    for tolerance in (1e-4, 1e-7, 1e-10):
        run = simulate(Resting(drive), [0.0, 10.0], Place(), rtol=tolerance, atol=tolerance)
        assert abs(run.state.v[-1] - state[1]) <= ERRORS * tolerance, tolerance


def lagrangian(t, q, qdot):
    return 0.5 * qdot[0] ** 2 + q[0] * jnp.exp(-(((t - 4.7) / 0.01) ** 2))


@pytest.mark.thorough
def test_a_lagrangian_sees_its_explicit_time():
    system, start = LagrangianSystem(lagrangian, ("x",)), LagrangianState(jnp.zeros(1), jnp.zeros(1))
    run = simulate(system, [0.0, 10.0], start, rtol=1e-9, atol=1e-9)
    assert abs(run.state.qdot[-1, 0] - 0.01 * np.sqrt(np.pi)) <= ERRORS * 1e-9


TERMS, PERIOD, WIDTH = 700, 20.0, 0.05  # the last term is below 1e-13


def gaussian_train():
    """The amplitudes, frequencies and phases of a Gaussian of height 1 at t = 4.7, once in a period, and its mean."""
    k = np.arange(1, TERMS + 1)
    mean = np.sqrt(np.pi) * WIDTH / PERIOD
    frequency = 2 * np.pi * k / PERIOD
    amplitude = 2 * mean * np.exp(-((frequency * WIDTH / 2) ** 2))
    return mean, amplitude[:, None] * np.array([1.0, 0.0, 0.0]), frequency, np.pi / 2 - frequency * 4.7


@pytest.mark.thorough
def test_a_series_that_is_zero_for_long_is_seen():
    mean, amplitude, frequency, phase = gaussian_train()
    force = HarmonicForce((mean, 0.0, 0.0), amplitude, frequency, phase)
    run = simulate(Disk(mass=1.0, inertia=0.5, force=force), [0.0, 10.0], rtol=1e-6, atol=1e-6)
    expected = WIDTH * np.sqrt(np.pi) / INERTIA
    assert abs(-run.state.phidot[-1] - expected) <= ERRORS * 1e-6


@pytest.mark.thorough
def test_a_ground_that_moves_late_is_seen():
    # The disk keeps its angular momentum about the point of contact in space: (m r² + d) ż = −m r² Ẋ on the ground.
    mean, amplitude, frequency, phase = gaussian_train()
    ground = jaxball.Ground(motion=jaxball.Oscillating(HarmonicSeries((mean, 0.0, 0.0), amplitude, frequency, phase)))
    times = np.array([0.0, 4.7, 4.72, 10.0])
    run = simulate(Disk(mass=1.0, inertia=0.5, ground=ground), times, rtol=1e-6, atol=1e-6)
    moved = np.exp(-(((times - 4.7) / WIDTH) ** 2))
    np.testing.assert_allclose(np.abs(run.state.z), moved / INERTIA, atol=ERRORS * 1e-6)


def wind(t, numbers):
    return jnp.array([0.3, 0.1, 0.0]) * jnp.exp(-(((t - 2.0) / 1.5) ** 2)) + jnp.where(t < 1.3, numbers, 0.0)


@pytest.mark.long
def test_smooth_inputs_leave_the_steps_of_a_body_that_moves(monkeypatch):
    rail = jaxball.Circle(radius=0.9, frame=jaxball.SphericalFrame(azimuth=0.3, elevation=0.5))
    mass = jaxball.PointMass(mass=0.5, motion=jaxball.OnRail(rail, jaxball.Pulse(theta=0.8, height=2.0)))
    force = FunctionForce(wind, jnp.array([0.0, 0.2, 0.0]))
    ball = jaxball.Ball(mass=1.0, inertia=(0.9, 1.0, 1.1), masses=[mass], force=force)
    for tolerance in (1e-4, 1e-7, 1e-10):
        limited = simulate(ball, [0.0, 4.0], rtol=tolerance, atol=tolerance)
        with monkeypatch.context() as patch:
            patch.setattr("jaxball.simulation.simulate.limits_of_steps", lambda *_: None)
            # With another number of steps it is another program.
            free = simulate(ball, [0.0, 4.0], rtol=tolerance, atol=tolerance, max_steps=4000)
        assert limited.steps == free.steps
        np.testing.assert_array_equal(limited.state.Omega, free.state.Omega)
