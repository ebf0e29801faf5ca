"""Signals and schedules from logs: SciPy's splines, closed forms, and runs of the signals that were sampled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import jaxball
from jaxball import (
    Ball,
    BallState,
    Circle,
    JointFriction,
    Motor,
    OnRail,
    PiecewiseSignal,
    PointMass,
    RecordedSchedule,
    RecordedSignal,
    Resistance,
    Sinusoids,
    planar_pendulum,
    simulate,
)
from jaxball.physics import SpeedLimitedMotor
from jaxball.physics.prescribed.recorded import MOST_KINKS
from tests.support.sentences import refuses, said

FREQUENCY, END = 2.0, 2.0
SINE = Sinusoids(0.0, amplitude=[1.0], frequency=[FREQUENCY])
TIGHT = {"rtol": 1e-11, "atol": 1e-11}


def uneven_times(n):
    rng = np.random.default_rng(n)
    return np.cumsum(rng.uniform(0.5, 1.5, n)) / n


def driven(drive):
    return Ball(mass=1.0, inertia=(0.7, 0.6, 0.5), gravity=10.0, mechanisms=[planar_pendulum(0.8, 0.5, drive=drive)])


def end_of_run(drive, end=END, **options):
    run = simulate(driven(drive), [0.0, end], BallState(theta=[0.0], thetadot=[0.0]), **options)
    return run


def place(run):
    return np.asarray(run.state.z[-1])


def sampled(n, interpolation="linear", **options):
    times = np.linspace(0.0, END, n)
    return RecordedSignal(times, np.sin(FREQUENCY * times), interpolation, **options)


@pytest.mark.parametrize("n", [2, 3, 4, 5, 50, MOST_KINKS + 100])
def test_a_spline_and_its_derivatives_are_those_of_scipy(n):
    """To 1e-12 of the largest of each: derivatives amplify the rounding of values by the inverse step, 1/h² of θ̈."""
    times = uneven_times(n)
    values = np.sin(3 * times) + times
    schedule, reference = RecordedSchedule(times, values).prepare(), CubicSpline(times, values)
    # At the last time itself SciPy and a run both have the derivatives of the last interval.
    t = np.sort(np.concatenate([np.linspace(times[0], times[-1], 301), times]))
    ours = np.asarray(jax.vmap(schedule.derivatives)(jnp.asarray(t)))
    for order, row in enumerate(ours):
        exact, step = reference(t, order), np.min(np.diff(times))
        np.testing.assert_allclose(row, exact, rtol=0, atol=1e-12 * max(1.0, np.abs(exact).max(), step**-order / 100))


@pytest.mark.parametrize("n", [6, MOST_KINKS + 100])
def test_lines_and_steps_between_samples_are_those_of_numpy(n):
    times = uneven_times(n)
    values = np.cos(5 * times)
    t = np.linspace(times[0], times[-1], 997)
    linear = jax.vmap(RecordedSignal(times, values, "linear").prepare())(jnp.asarray(t))
    np.testing.assert_allclose(linear, np.interp(t, times, values), rtol=0, atol=1e-14)
    previous = jax.vmap(RecordedSignal(times, values, "previous").prepare())(jnp.asarray(t))
    np.testing.assert_array_equal(previous, values[np.searchsorted(times, t, side="right") - 1])


@pytest.mark.parametrize("interpolation", ["previous", "linear", "spline"])
@pytest.mark.parametrize("n", [6, MOST_KINKS + 100])
def test_impulses_are_integrals(n, interpolation):
    """Gauss's rule with three nodes integrates each interval's polynomial of degree 3 exactly."""
    times = uneven_times(n)
    signal = RecordedSignal(times, np.cos(5 * times), interpolation).prepare()
    nodes, weights = np.polynomial.legendre.leggauss(3)
    h = np.diff(times)
    t = times[:-1, None] + h[:, None] * (nodes + 1) / 2
    parts = (np.asarray(jax.vmap(jax.vmap(signal))(jnp.asarray(t))) * weights).sum(axis=1) * h / 2
    impulses = jax.vmap(signal.impulse)(jnp.asarray(times))
    np.testing.assert_allclose(impulses, np.concatenate([[0.0], np.cumsum(parts)]), rtol=0, atol=1e-13)


def test_outside_of_a_log_a_signal_holds_or_is_zero_and_its_impulse_goes_on():
    times, values = [1.0, 2.0, 3.0], [0.5, 2.0, -1.0]
    t = jnp.array([0.0, 4.0])
    for interpolation in ("previous", "linear", "spline"):
        held = RecordedSignal(times, values, interpolation, outside="hold")
        np.testing.assert_array_equal(jax.vmap(held)(t), [0.5, -1.0])
        assert held.impulse(t[0]) == -0.5
        zero = RecordedSignal(times, values, interpolation, outside="zero")
        np.testing.assert_array_equal(jax.vmap(zero)(t), [0.0, 0.0])
        assert zero.impulse(t[1]) == zero.impulse(jnp.array(3.0))


def test_outside_of_a_log_a_schedule_goes_on_at_its_rate():
    times = np.linspace(0.0, 1.0, 11)
    schedule = RecordedSchedule(times, times**3, outside="continue")
    theta, rate, acceleration = schedule.derivatives(jnp.array(2.0))
    np.testing.assert_allclose([theta, rate, acceleration], [4.0, 3.0, 0.0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(schedule.derivatives(jnp.array(-1.0)), [0.0, 0.0, 0.0], rtol=0, atol=1e-13)


def test_steps_of_a_log_give_the_run_of_a_piecewise_signal():
    """To the rounding of their integrals, which are added up in different ways, and of as many steps."""
    times, values = np.array([0.0, 0.3, 0.7, 2.0]), np.array([1.0, -2.0, 0.5, 0.0])
    run = end_of_run(Motor(RecordedSignal(times, values, "previous")))
    same = end_of_run(Motor(PiecewiseSignal(times, values[:-1])))
    assert (int(run.steps), int(run.rejected)) == (int(same.steps), int(same.rejected))
    np.testing.assert_allclose(run.state.z, same.state.z, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.state.thetadot, same.state.thetadot, rtol=0, atol=1e-12)


@pytest.mark.thorough
def test_the_few_steps_of_a_long_log_are_found_and_cost_no_more_steps():
    """The run of the same steps without the samples between them."""
    times = np.linspace(0.0, END, 4001)
    values = np.select([times < 0.3, times < 0.7], [1.0, -2.0], 0.5)
    run = end_of_run(Motor(RecordedSignal(times, values, "previous")), **TIGHT)
    edges = [0.0, times[times >= 0.3][0], times[times >= 0.7][0], END]
    same = end_of_run(Motor(PiecewiseSignal(edges, [1.0, -2.0, 0.5])), **TIGHT)
    np.testing.assert_allclose(place(run), place(same), rtol=0, atol=1e-10)
    assert int(run.steps) <= int(same.steps) + 2
    assert int(run.rejected) <= int(same.rejected) + 1


def limited(signal):
    return SpeedLimitedMotor(signal, stall=1.0, free_speed=4.0)


def sampled_beyond(n, interpolation):
    """161 samples, the first ``n`` of them in the run, so that runs of any ``n`` are one program."""
    times = END / (n - 1) * np.arange(161)
    return RecordedSignal(times, np.sin(FREQUENCY * times), interpolation)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("motor", "interpolation", "order"),
    [(Motor, "previous", 1), (Motor, "linear", 2), (Motor, "spline", 4), (limited, "spline", 4)],
)
def test_runs_of_a_sampled_sine_approach_its_run_with_the_order_of_the_interpolation(motor, interpolation, order):
    exact = place(end_of_run(motor(SINE), **TIGHT))
    samples = (41, 81, 161) if order == 4 else (21, 41)
    signals = [sampled_beyond(n, interpolation) for n in samples]
    errors = [np.abs(place(end_of_run(motor(signal), **TIGHT)) - exact).max() for signal in signals]
    assert errors[0] < 2 * (FREQUENCY * END / (samples[0] - 1)) ** order
    ratio = (errors[0] / errors[-1]) ** (1 / (len(samples) - 1))
    assert 2 ** (order - 0.5) < ratio < 2 ** (order + 0.7)


@pytest.mark.parametrize(("interpolation", "order"), [("previous", 1), ("linear", 2), ("spline", 4)])
def test_a_sampled_sine_approaches_the_sine_with_the_order_of_the_interpolation(interpolation, order):
    between = np.linspace(0.0, END, 3001)
    errors = [
        np.abs(jax.vmap(sampled(n, interpolation))(between) - np.sin(FREQUENCY * between)).max() for n in (41, 81, 161)
    ]
    ratios = np.divide(errors[:-1], errors[1:])
    np.testing.assert_allclose(ratios, 2.0**order, rtol=0.2)


@pytest.mark.thorough
@pytest.mark.parametrize(("rows", "interpolation"), [(100_001, "linear"), (10_001, "spline")])
def test_a_long_log_takes_no_more_steps_than_the_smooth_signal(rows, interpolation):
    smooth, logged = end_of_run(Motor(SINE)), end_of_run(Motor(sampled(rows, interpolation)))
    assert logged.ok
    assert int(logged.steps) <= 1.5 * int(smooth.steps)
    np.testing.assert_allclose(place(logged), place(smooth), rtol=0, atol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("n", [101, 2001])
def test_a_mass_follows_the_log_of_its_schedule(n):
    """The spline's error is below 5/384 h⁴ θ⁗, that of θ̇ below h³/24 θ⁗ (Hall and Meyer 1976)."""
    times = np.linspace(0.0, END, n)
    log = RecordedSchedule(times, 0.3 * np.sin(FREQUENCY * times))
    rail = Circle(0.6)

    def end(schedule):
        ball = Ball(mass=1.0, inertia=(0.7, 0.6, 0.5), masses=[PointMass(0.5, OnRail(rail, schedule))])
        return simulate(ball, [0.0, END], **TIGHT)

    exact = end(Sinusoids(0.0, amplitude=[0.3], frequency=[FREQUENCY]))
    run = end(log)
    np.testing.assert_allclose(place(run), place(exact), rtol=0, atol=max((END / (n - 1)) ** 3, 1e-9))
    assert n == 101 or int(run.steps) <= 1.5 * int(exact.steps)


@pytest.mark.parametrize("interpolation", ["previous", "linear", "spline"])
def test_derivatives_of_a_signal_by_its_values_are_the_signal_of_their_changes(interpolation):
    """It is linear in them, and so are its integrals."""
    times, random = uneven_times(9), np.random.default_rng(5)
    values, along, weights = map(jnp.asarray, (*random.normal(size=(2, 9)), random.normal(size=(2, 50))))
    t = jnp.linspace(times[0], times[-1], 50)

    @jax.jit
    def both(values):
        signal = RecordedSignal(times, values, interpolation).prepare()
        return jnp.stack([jax.vmap(signal)(t), jax.vmap(signal.impulse)(t)])

    truth, pulled = both(along), jax.vjp(both, values)[1](weights)[0]
    np.testing.assert_allclose(jax.jvp(both, (values,), (along,))[1], truth, rtol=0, atol=1e-13)
    np.testing.assert_allclose(jnp.vdot(pulled, along), jnp.vdot(weights, truth), rtol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize(("interpolation", "compiler"), [("previous", "xla"), ("spline", "native")])
def test_derivatives_by_values_are_right_in_both_modes_and_compilers(interpolation, compiler):
    """Differences of order 2 with steps of 1e-4 have errors of the order of 1e-8."""
    times = np.linspace(0.0, END, 9)
    values = jnp.asarray(np.sin(FREQUENCY * times))
    along = jnp.asarray(np.cos(7 * times))

    def last(values):
        return end_of_run(Motor(RecordedSignal(times, values, interpolation)), **TIGHT).state.z[-1, 0]

    with jaxball.compiler(compiler):
        _, forward = jax.jvp(last, (values,), (along,))
        reverse = jnp.vdot(jax.grad(last)(values), along)
        after, before = (jax.jvp(last, (values + step * along,), (along,))[0] for step in (1e-4, -1e-4))
        difference = (after - before) / 2e-4
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)
    np.testing.assert_allclose(forward, difference, rtol=0, atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("interpolation", ["previous", "spline"])
def test_logs_are_mapped_as_single_runs(interpolation):
    # Where not all jumps are stepped to, a difference in rounding grows to the tolerance of the solve.
    times = np.linspace(0.0, END, 60 if interpolation == "previous" else MOST_KINKS + 50)
    logs = jnp.asarray([np.sin(k * times) for k in (1.0, 2.0)])

    def last(values):
        return end_of_run(Motor(RecordedSignal(times, values, interpolation)), rtol=1e-7, atol=1e-7).state.z[-1]

    each = [last(values) for values in logs]
    np.testing.assert_allclose(jax.vmap(last)(logs), each, rtol=0, atol=1e-12)


@pytest.mark.thorough
def test_a_limit_bounds_the_steps_of_a_log():
    times, values = [0.0, 0.5, 1.0, END], [3.0, -0.2, 0.4, 0.0]
    bounded = end_of_run(Motor(RecordedSignal(times, values, "previous"), limit=1.0))
    same = end_of_run(Motor(RecordedSignal(times, np.clip(values, -1.0, 1.0), "previous")))
    np.testing.assert_array_equal(bounded.state.z, same.state.z)


def test_a_log_shorter_than_the_run_is_impossible_and_says_why():
    signal = RecordedSignal([0.0, 1.0], [0.1, 0.2])
    run = end_of_run(Motor(signal))
    assert run.status == jaxball.Status.IMPOSSIBLE
    said(run.message, "mechanisms[0].joints[0].drive.signal")
    assert end_of_run(Motor(signal), end=1.0).ok
    assert end_of_run(Motor(RecordedSignal([0.0, 1.0], [0.1, 0.2], outside="hold"))).ok


@pytest.mark.long
@pytest.mark.parametrize("mode", ["rolls or rests", "slips or sticks"])
def test_a_log_is_as_long_as_the_run_of_a_body_with_modes(mode):
    rests = Resistance(dry=0.01, exact=True) if mode == "rolls or rests" else None
    sticks = [] if rests else [planar_pendulum(0.8, 0.5, drive=JointFriction(0.1))]
    mass = PointMass(0.1, OnRail(Circle(0.5), RecordedSchedule([0.0, 1.0], [0.0, 0.1])))
    ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), masses=[mass], mechanisms=sticks, resistance=rests)
    start = BallState(theta=[0.0] * len(sticks), thetadot=[0.0] * len(sticks), Omega=(0.0, 1.0, 0.0))
    assert simulate(ball, [0.0, 1.5], start).status == jaxball.Status.IMPOSSIBLE
    assert simulate(ball, [0.0, 1.0], start).ok


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (([0.0, 1.0, 1.0], [1.0, 2.0, 3.0]), "times[2]"),
        (([0.0, 2.0, 1.0], [1.0, 2.0, 3.0]), "times[2]"),
        (([0.0, np.nan], [1.0, 2.0]), "times[1]"),
        (([0.0, 1.0], [1.0, np.inf]), "values[1]"),
        (([0.0, 1.0], [1.0]), "times"),
        (([0.0], [1.0]), "times"),
        (([0.0, 1.0], [1.0, 2.0], "cubic"), "interpolation"),
        (([0.0, 1.0], [1.0, 2.0], "linear", "continue"), "outside"),
    ],
)
def test_impossible_logs_are_refused_in_a_sentence(arguments, named, no_type_checks):
    with refuses(ValueError, named):
        RecordedSignal(*arguments)
