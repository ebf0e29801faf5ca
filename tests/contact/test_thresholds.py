"""Bodies that need exactly the friction that there is: they roll, whatever rounding makes of the difference."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxball
from jaxball import Contact
from jaxball.control import Push
from jaxball.physics import Mode, ReleasedState, SwitchCause
from jaxball.simulation.ensemble import simulate_ensemble

M, R, G = 1.3, 0.9, 9.81
TIMES = np.linspace(0.0, 2.0, 9)
COEFFICIENTS = np.linspace(0.02, 1.2, 40)
CLOSE = 1e-13  # relative: rounding of a few steps; without slip, a homogeneous body is advanced exactly
BESIDE = 1e-12  # of tan α beside the threshold: there a body slides, or rolls, as it should
DIFFERENTIATE = {
    "forward": (jax.jacfwd, diffrax.ForwardMode()),
    "reverse": (jax.jacrev, diffrax.RecursiveCheckpointAdjoint()),
}
# Half a minute to compile each: of the thorough ones, each body and each mode is in one.
BODIES_AND_MODES = pytest.mark.parametrize(
    ("name", "mode"),
    [
        ("solid ball", "reverse"),
        ("disk", "forward"),
        pytest.param("solid ball", "forward", marks=pytest.mark.slow),
        pytest.param("disk", "reverse", marks=pytest.mark.slow),
    ],
)
SHARES = {"solid ball": 2 / 5, "hollow ball": 2 / 3, "disk": 1 / 2, "hoop": 1.0}


def body(name, **others):
    """A homogeneous body of the inertia k M r², k from ``SHARES``."""
    D, common = SHARES[name] * M * R**2, {"mass": M, "radius": R, "gravity": G, **others}
    return jaxball.Ball(inertia=(D, D, D), **common) if "ball" in name else jaxball.Disk(inertia=D, **common)


def threshold(name, mu):
    """The angle α of the steepest slope on which the body rolls: tan α = μ (1 + 1/k)."""
    return np.arctan((1 + 1 / SHARES[name]) * mu)


def on_slope(name, angle):
    return body(name, ground=jaxball.Ground(angle))


def at_rest(name):
    return jaxball.BallState() if "ball" in name else jaxball.DiskState()


def side_by_side(name, angles):
    """Bodies on slopes of these angles, at rest, and the laws with the coefficients."""
    bodies, laws = jax.vmap(lambda angle: on_slope(name, angle))(angles), jax.vmap(Contact)(COEFFICIENTS)
    states = jax.tree.map(lambda x: jnp.broadcast_to(x, (angles.size, *x.shape)), at_rest(name))
    return simulate_ensemble(bodies, TIMES, states, contact=laws, max_steps=400).trajectory


def places(run):
    """The first coordinates of the places, down the slope."""
    z = np.asarray(run.state.z)
    return z[..., 0] if z.ndim > np.asarray(run.contact.mode).ndim else z


def require_rolling(name, run, mu, angle):
    """That a run from rest rolls all the time, at (g sin α)/(1 + k), with |f| = μ N."""
    assert np.all(np.asarray(run.status) == 0)
    assert np.all(np.asarray(run.contact.mode) == Mode.ROLLING)
    assert np.all(np.asarray(run.contact.switches.count) == 0)
    expected = 0.5 * G * np.sin(angle)[..., None] / (1 + SHARES[name]) * TIMES**2
    np.testing.assert_allclose(places(run), expected, rtol=CLOSE, atol=CLOSE)
    np.testing.assert_allclose(
        run.observables.friction_ratio, np.broadcast_to(mu[..., None], expected.shape), rtol=1e-12
    )


@pytest.mark.long
@pytest.mark.parametrize("name", ["solid ball", "disk"])
def test_an_ensemble_at_the_threshold_rolls(name):
    """tan α = 7/2 μ for a solid ball, 3 μ for a disk."""
    angles = threshold(name, COEFFICIENTS)
    require_rolling(name, side_by_side(name, angles), COEFFICIENTS, angles)


@pytest.mark.long
@pytest.mark.parametrize("tolerance", [1e-4, 1e-8, 1e-12])
@pytest.mark.parametrize("name", SHARES)
def test_single_runs_at_the_threshold_roll(name, tolerance):
    for mu in COEFFICIENTS:
        angle = threshold(name, mu)
        run = jaxball.simulate(
            on_slope(name, float(angle)), TIMES, contact=Contact(mu), rtol=tolerance, atol=tolerance, max_steps=400
        )
        require_rolling(name, run, mu, angle)


@pytest.mark.long
@pytest.mark.parametrize("name", ["solid ball", "disk"])
def test_runs_through_xla_at_the_threshold_roll(name):
    """One after another and side by side."""

    def run(mu, angle):
        return jaxball.simulate(on_slope(name, angle), TIMES, contact=Contact(mu), max_steps=400)

    angles, single = threshold(name, COEFFICIENTS), jax.jit(run)
    require_rolling(name, jax.jit(jax.vmap(run))(COEFFICIENTS, angles), COEFFICIENTS, angles)
    for mu, angle in zip(COEFFICIENTS[::4], angles[::4], strict=True):
        require_rolling(name, single(mu, angle), mu, angle)


@pytest.mark.long
@pytest.mark.parametrize("name", ["solid ball", "disk"])
def test_beside_the_threshold_a_body_slides_or_rolls(name):
    for beside, mode in ((-BESIDE, Mode.ROLLING), (BESIDE, Mode.SLIDING)):
        angles = np.arctan((1 + 1 / SHARES[name]) * COEFFICIENTS * (1 + beside))
        run = side_by_side(name, angles)
        assert np.all(np.asarray(run.contact.mode) == mode)
        expected = 0.5 * G * np.sin(angles)[:, None] / (1 + SHARES[name]) * TIMES**2
        np.testing.assert_allclose(places(run), expected, rtol=10 * BESIDE)


@pytest.mark.long
@BODIES_AND_MODES
def test_derivatives_at_the_threshold_are_those_of_rolling(name, mode):
    """By α, ½ t² g cos α/(1 + k), and 0 by μ."""
    mu, (differentiate, adjoint) = 0.4, DIFFERENTIATE[mode]
    angle = float(threshold(name, mu))

    def end(numbers):
        settings = {"contact": Contact(numbers[1]), "max_steps": 400, "adjoint": adjoint}
        return jnp.ravel(jaxball.simulate(on_slope(name, numbers[0]), TIMES, **settings).state.z[-1])[0]

    by_angle, by_mu = jaxball.jit(differentiate(end))(jnp.array([angle, mu]))
    assert float(by_angle) == pytest.approx(0.5 * TIMES[-1] ** 2 * G * np.cos(angle) / (1 + SHARES[name]), rel=1e-12)
    assert float(by_mu) == 0.0


@pytest.mark.long
@pytest.mark.parametrize("name", SHARES)
def test_a_slip_that_ends_at_the_threshold_is_followed_by_rolling(name):
    """Thrown up the slope, it slips at the rate −2 g sin α there, and has risen by what friction leaves."""
    up = 1.5
    for mu in COEFFICIENTS[::5]:
        angle = float(threshold(name, mu))
        slope = on_slope(name, angle)
        thrown = ReleasedState(at_rest(name), V=(-up, 0.0, 0.0))
        stops = up / (2 * G * np.sin(angle))
        run = jaxball.simulate(slope, [0.0, 2 * stops], thrown, contact=Contact(mu), rtol=1e-11, atol=1e-11)
        switches = run.contact.switches
        assert int(switches.count) == 1
        assert (switches.target[0], switches.cause[0]) == (Mode.ROLLING, SwitchCause.STOPS)
        assert float(switches.times[0]) == pytest.approx(stops, rel=1e-9)
        slides, rolls = G * (np.sin(angle) + mu * np.cos(angle)), G * np.sin(angle) / (1 + SHARES[name])
        expected = -up * stops + 0.5 * slides * stops**2 + (slides * stops - up) * stops + 0.5 * rolls * stops**2
        assert float(places(run)[-1]) == pytest.approx(expected, rel=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("name", SHARES)
def test_a_constant_force_that_needs_all_friction_rolls_the_body(name):
    """On a level plane, |f| = k/(1 + k) F."""
    k = SHARES[name]
    for mu in COEFFICIENTS[::3]:
        force = mu * M * G * (1 + k) / k
        driven = body(name, force=jaxball.physics.HarmonicForce((force, 0.0, 0.0)))
        run = jaxball.simulate(driven, TIMES, contact=Contact(mu), max_steps=400)
        assert np.all(np.asarray(run.contact.mode) == Mode.ROLLING)
        np.testing.assert_allclose(places(run), 0.5 * force / (M * (1 + k)) * TIMES**2, rtol=CLOSE)


@pytest.mark.long
@pytest.mark.parametrize("mu", [0.05, 0.3, 0.9])
@pytest.mark.parametrize("name", ["solid ball", "disk"])
def test_a_force_that_needs_all_friction_at_its_peaks_rolls_the_body(name, mu):
    k, w = SHARES[name], 2.7
    force = mu * M * G * (1 + k) / k
    shaken = body(
        name, force=jaxball.physics.HarmonicForce((0.0, 0.0, 0.0), amplitude=[(force, 0.0, 0.0)], frequency=[w])
    )
    run = jaxball.simulate(shaken, TIMES, contact=Contact(mu), rtol=1e-10, atol=1e-10)
    assert run.ok
    assert np.all(np.asarray(run.contact.mode) == Mode.ROLLING)
    expected = force / (M * (1 + k)) * (TIMES / w - np.sin(w * TIMES) / w**2)
    np.testing.assert_allclose(places(run), expected, atol=1e-8)


# What a push changes at once.

MU = 0.25


def pushed(name, force, start, T, mode="reverse"):
    """A body at rest that is pushed for a time of 0.5."""
    pushed_body, adjoint = body(name, force=Push(force, start, 0.5)), DIFFERENTIATE[mode][1]
    settings = {"contact": Contact(MU), "rtol": 1e-11, "atol": 1e-11, "max_steps": 800, "adjoint": adjoint}
    return jaxball.simulate(pushed_body, jnp.array([0.0, T]), **settings)


@pytest.mark.long
@pytest.mark.parametrize("name", ["solid ball", "disk"])
def test_friction_gives_way_at_the_start_of_a_push(name):
    """Then the slip grows, and after the push it ends; all of it moves with the start."""
    k, start, push = SHARES[name], 0.7, 20.0
    run = pushed(name, (push, 0.0, 0.0), start, 3.0)
    growth, decay = push / M - MU * G * (1 + 1 / k), MU * G * (1 + 1 / k)
    stops = start + 0.5 + growth * 0.5 / decay
    switches = run.contact.switches
    assert switches.cause[: int(switches.count)].tolist() == [SwitchCause.GIVES_WAY, SwitchCause.STOPS]
    np.testing.assert_allclose(switches.times[:2], [start, stops], atol=1e-9)
    assert not np.any(switches.grazing[:2])
    # The momentum about a line in the plane is that of the push.
    speed = push * 0.5 / (M * (1 + k))
    assert float(run.contact.V[-1, 0]) == pytest.approx(speed, rel=1e-9)


@pytest.mark.long
@BODIES_AND_MODES
def test_derivatives_by_the_start_of_a_push_that_slips(name, mode):
    """The motion after it is that after an earlier start, later: dz/d(start) = −V."""
    differentiate = DIFFERENTIATE[mode][0]

    def end(start):
        run = pushed(name, (20.0, 0.0, 0.0), start, 3.0, mode)
        return jnp.ravel(run.state.z[-1])[0], run.contact.V[-1, 0], run.contact.switches.times[:2]

    values = end(0.7)
    place, speed, times = jaxball.jit(differentiate(end))(0.7)
    assert float(place) == pytest.approx(-float(values[1]), rel=1e-8)
    assert float(speed) == pytest.approx(0.0, abs=1e-8)
    np.testing.assert_allclose(times, 1.0, rtol=1e-8)


@pytest.mark.long
@pytest.mark.parametrize("name", ["solid ball", "disk"])
def test_a_push_lifts_the_body_at_its_start(name):
    start, push, T = 0.7, 30.0, 1.25
    run = pushed(name, (0.0, 0.0, push), start, T)
    switches, rise = run.contact.switches, push / M - G
    assert (switches.cause[0], switches.target[0]) == (SwitchCause.LIFTS, Mode.FLIGHT)
    assert float(switches.times[0]) == pytest.approx(start, abs=1e-12)
    later = T - start - 0.5
    height = 0.5 * rise * 0.5**2 + 0.5 * rise * later - 0.5 * G * later**2
    assert float(run.contact.height[-1]) == pytest.approx(height, rel=1e-9)
    derivative = jax.grad(lambda start: pushed(name, (0.0, 0.0, push), start, T).contact.height[-1])
    assert float(jaxball.jit(derivative)(start)) == pytest.approx(-(0.5 * rise - G * later), rel=1e-9)


def on_turntable(share, times=(0.0, 0.1, 1.0), solver=None, max_steps=1000):
    """A ball that sets out at 0.5 on a table that turns at 1, with a share of the friction that its circle needs: it
    would go round at 2/7 of the table's rate, held by 2/7 of W v on each unit of its mass.
    """
    table = jaxball.Ground(turntable=jaxball.Turntable(jaxball.ConstantRate(0.0, rate=1.0)))
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=table)
    law, start = Contact(friction=share / 7), jaxball.BallState(Omega=(0.0, 0.5, 0.0))
    return jaxball.simulate(ball, times, start, contact=law, solver=solver, max_steps=max_steps)


def slips_on_turntable(share, times):
    """The places and the slip velocities of that ball, by SciPy: v̇ = −μ g σ and v̇_s = −7/2 μ g σ − W e3 × v.

    It sets out a little after the slip has begun, where that grows along −e3 × v.
    """
    mu, begun = share / 7, 1e-8

    def turn(v):
        return np.array([-v[1], v[0]])

    def rates(t, x):
        friction = -mu * x[4:] / np.linalg.norm(x[4:])
        return np.concatenate([x[2:4], friction, 3.5 * friction - turn(x[2:4])])

    start = [0.5 * begun, 0.0, 0.5, mu * begun, 0.0, -(0.5 - 3.5 * mu) * begun]
    limits = {"rtol": 1e-9, "atol": 1e-18, "first_step": 0.1 * begun}
    with np.errstate(over="ignore"):
        motion = solve_ivp(rates, (begun, times[-1]), start, method="Radau", t_eval=times[1:], **limits)
    return motion.y[:2].T, motion.y[4:].T


FEW_STEPS = 60  # a window takes one or two; steps fitted to the direction would be 3,000,000 at 1e-6


@pytest.mark.thorough
def test_a_slip_just_beyond_its_threshold_is_followed_in_few_steps():
    times = np.array([0.0, 0.1, 0.5, 1.0])
    for beside in (1e-2, 1e-4, 1e-6):
        run, (places, slips) = on_turntable(1 - beside, times), slips_on_turntable(1 - beside, times)
        assert run.ok
        assert int(run.steps) < FEW_STEPS
        assert np.all(np.asarray(run.contact.mode) == Mode.SLIDING)
        np.testing.assert_allclose(run.state.z[1:], places, atol=1e-8)  # the model's own error, at 1e-9
        np.testing.assert_allclose(np.asarray(run.contact.slip)[1:, :2], slips, rtol=1e-5, atol=1e-7 * beside)
    # Beyond what SciPy's steps resolve, the slip is to the first order what is missing of the friction, times t.
    run = on_turntable(1 - 1e-9, times)
    assert run.ok
    assert int(run.steps) < FEW_STEPS
    assert np.linalg.norm(run.contact.slip[1]) == pytest.approx(0.5e-9 * 0.1, rel=1e-2)


def against_resistance(dry, law, T=1.0, force=None, **others):
    """A solid ball at rest on a slope of 0.3 with exact dry resistance."""
    resisted = jaxball.Resistance(dry=dry, exact=True)
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=jaxball.Ground(0.3), resistance=resisted, force=force)
    return jaxball.simulate(ball, [0.0, T], contact=law, **others)


@pytest.mark.long
@pytest.mark.parametrize("law", [None, Contact(friction=0.8)])
def test_rolling_just_beyond_its_threshold_is_followed_in_few_steps(law):
    """The ball goes (5/14) (sin α − c cos α) t²: where that is next to nothing, its direction is stiff."""
    for beside in (1e-1, 1e-3, 1e-6, 1e-9):
        run = against_resistance(np.tan(0.3) * (1 - beside), law)
        assert run.ok
        assert int(run.steps) < FEW_STEPS
        # The threshold itself is rounded, relative to what is left of it.
        assert float(run.state.z[-1, 0]) == pytest.approx(5 / 14 * np.sin(0.3) * beside, rel=1e-12 + 1e-15 / beside)
        assert abs(float(run.state.z[-1, 1])) < 1e-12


DOUBLED_WINDOWS = 15  # of 0.1, 0.2, 0.4, …, to 100, and some steps in them: those of one length would be 1,000


@pytest.mark.long
@pytest.mark.parametrize("law", [None, Contact(friction=0.8)])
def test_windows_grow_while_their_directions_are_resolved(law):
    for beside in (1e-3, 1e-5, 1e-7, 1e-9):
        run = against_resistance(np.tan(0.3) * (1 - beside), law, 100.0)
        assert run.ok
        assert int(run.steps) < DOUBLED_WINDOWS
        expected = 5 / 14 * np.sin(0.3) * beside * 100.0**2
        assert float(run.state.z[-1, 0]) == pytest.approx(expected, rel=1e-12 + 1e-15 / beside)


def late_push(t, motion):
    return 0.3 * jnp.exp(-(((t - 47.0) / 0.3) ** 2)) * jnp.array([0.0, 1.0, 0.0])


@pytest.mark.long
def test_no_window_grows_over_a_push_that_comes_late():
    """It is the same run as that without windows, by an implicit solver."""
    dry, force = np.tan(0.3) * (1 - 1e-3), jaxball.FunctionWrench(late_push)
    run = against_resistance(dry, None, 50.0, force)
    implicit = against_resistance(
        dry, None, 50.0, force, solver=jaxball.simulation.solvers.RadauIIA(3), max_steps=20000
    )
    assert run.ok
    assert implicit.ok
    assert abs(float(run.state.z[-1, 1])) > 0.01
    np.testing.assert_allclose(run.state.z[-1], implicit.state.z[-1], rtol=1e-6, atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("law", [None, Contact(friction=0.8)])
def test_derivatives_just_beyond_the_threshold_of_rolling(law):
    """By the coefficient, −(5/14) cos α t², through all windows."""

    def end(dry):
        return against_resistance(dry, law, adjoint=diffrax.ForwardMode()).state.z[-1, 0]

    derivative = jaxball.jit(jax.jacfwd(end))(np.tan(0.3) * (1 - 1e-6))
    assert float(derivative) == pytest.approx(-5 / 14 * np.cos(0.3), rel=1e-8)


@pytest.mark.thorough
def test_a_slow_slip_without_steps_left_says_what_is_slow_and_what_helps():
    """The advice holds: the solver that it names ends the run."""
    share = 1 - 1e-6
    run = on_turntable(share, max_steps=4)
    assert run.status == jaxball.Status.MAX_STEPS
    assert "The body slides, at 5e-08 at the last saved time" in run.message
    assert "RadauIIA(3) of jaxball.simulation.solvers" in run.message
    followed = on_turntable(share, solver=jaxball.simulation.solvers.RadauIIA(3))
    assert followed.status == jaxball.Status.SUCCESS
    assert followed.contact.mode[-1] == Mode.SLIDING
    assert np.linalg.norm(followed.contact.slip[1]) == pytest.approx(3.5 * 1e-6 * share / 7 * 0.1, rel=1e-2)
    assert "RadauIIA" not in followed.message
    for law in (None, Contact(friction=0.8)):
        run = against_resistance(np.tan(0.3) * (1 - 1e-6), law, max_steps=4)
        assert run.status == jaxball.Status.MAX_STEPS
        assert "Slow rolling is stiff" in run.message


@pytest.mark.thorough
def test_a_run_that_starts_in_a_slow_slip_aside_says_so_and_the_advice_holds():
    """The slip turns into the slope's direction within a time of 1e-7; then it grows by g (sin α − 7/2 μ cos α)."""
    mu, beside, aside, T = 0.3, 1e-6, 1e-6, 1.0
    angle = np.arctan(3.5 * mu * (1 + beside))
    slope = on_slope("solid ball", angle)
    start = ReleasedState(jaxball.BallState(Omega=(0.0, 1.0, 0.0)), V=(R, aside, 0.0))
    stiff = jaxball.simulate(slope, [0.0, T], start, contact=Contact(mu), max_steps=500)
    assert stiff.status == jaxball.Status.MAX_STEPS
    assert "The body slides, at 1e-06 at the last saved time" in stiff.message
    assert "RadauIIA(3) of jaxball.simulation.solvers" in stiff.message
    run = jaxball.simulate(slope, [0.0, T], start, contact=Contact(mu), solver=jaxball.simulation.solvers.RadauIIA(3))
    assert run.ok
    grown = G * (np.sin(angle) - 3.5 * mu * np.cos(angle)) * T
    slip = np.asarray(run.contact.slip)[-1, :2]
    # What there was aside is a millionth of a speed of 1, and is spent before the slip has grown by as much.
    np.testing.assert_allclose(slip, [grown, 0.0], rtol=0, atol=aside)
