"""A body that slides, rolls, rests and flies under exact dry resistance, against closed forms.

Dry resistance c acts on a body that slides, too: on level ground a solid ball thrown without spin has
u̇ = −(7/2) μ g + (5/2) c g for its slip u, and, once it rolls, decelerates at (5/7) c g. Where a bound has no reason of
its own, 1e-9 is ten times the tolerance, as errors of a few steps add up.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Contact, Disk, DiskState, Ground, Motor, Resistance, planar_pendulum
from jaxball.physics import Mode, ReleasedState, SwitchCause
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.differences import jacobian

G, M, R, C, MU, SPEED, ALPHA = 9.81, 2.0, 0.3, 0.02, 0.2, 3.0, 0.3
SOLID = 0.4 * M * R**2
SPAN = (0.0, 30.0)


def ball(c=C, angle=0.0, spinning=0.01, **others):
    resistance = Resistance(dry=c, dry_spinning=spinning, exact=True)
    ground = Ground(angle=angle, heading=0.7)
    given = {"mass": M, "inertia": (SOLID,) * 3, "radius": R, "gravity": G, "ground": ground, "resistance": resistance}
    return Ball(**given | others)


def disk(c=C, angle=0.0):
    """A disk with the inertia of a solid ball."""
    resistance = Resistance(dry=c, exact=True)
    return Disk(mass=M, inertia=SOLID, radius=R, gravity=G, ground=Ground(angle=angle), resistance=resistance)


def thrown(speed):
    return ReleasedState(BallState(), V=speed * jnp.array([0.6, 0.8, 0.0]))


def bowled(x):
    """When a ball bowled without spin ceases to slide, when it stops, and how far from its start."""
    mu, c, v = x
    slides = 2 * v / ((7 * mu - 5 * c) * G)
    rolls = v - mu * G * slides
    way = v * slides - mu * G * slides**2 / 2 + 7 * rolls**2 / (10 * c * G)
    return jnp.stack([slides, slides + 7 * rolls / (5 * c * G), way])


def bowl(x):
    mu, c, v = x
    run = jaxball.simulate(ball(c), SPAN, thrown(v), contact=Contact(mu))
    return jnp.append(run.switches.times[:2], 0.6 * run.state.z[-1, 0] + 0.8 * run.state.z[-1, 1])


X = jnp.array([MU, C, SPEED])


@pytest.mark.long
def test_a_bowling_ball_slides_then_rolls_then_rests():
    times = np.linspace(*SPAN, 61)
    run = jaxball.simulate(ball(), times, thrown(SPEED), contact=Contact(MU), throw=True)
    slides, stops, way = bowled(X)
    assert [line.split(": ")[1] for line in run.switches.lines] == [
        "from sliding to rolling, as the slip ended",
        "from rolling to rest, as its rolling ended",
    ]
    np.testing.assert_allclose(run.switches.times[:2], [slides, stops], rtol=1e-10)
    modes = np.where(times < slides, Mode.SLIDING, np.where(times < stops, Mode.ROLLING, Mode.REST))
    np.testing.assert_array_equal(run.contact.mode, modes)
    np.testing.assert_array_equal(run.contact.rests, times > stops)
    np.testing.assert_allclose(run.state.z[-1], way * np.array([0.6, 0.8]), rtol=1e-9)
    at_rest = times > stops
    np.testing.assert_array_equal(run.state.z[at_rest], np.broadcast_to(run.state.z[-1], (at_rest.sum(), 2)))
    np.testing.assert_array_equal(run.state.Omega[at_rest], 0.0)
    np.testing.assert_array_equal(run.contact.V[at_rest], 0.0)
    rolls = (times > slides) & ~at_rest
    speed = 5 / 7 * C * G * (stops - times)
    np.testing.assert_allclose(np.linalg.norm(run.contact.V[rolls], axis=1), speed[rolls], rtol=1e-9)
    seen = run.observables
    np.testing.assert_allclose(seen.dissipation[rolls], C * M * G * speed[rolls], rtol=1e-9)
    np.testing.assert_allclose(seen.dissipation[0], MU * M * G * SPEED, rtol=1e-9)  # no rolling yet
    np.testing.assert_allclose(np.linalg.norm(seen.friction[rolls], axis=1), 5 / 7 * C * M * G, rtol=1e-9)
    np.testing.assert_array_equal(seen.dissipation[at_rest], 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("mode", [jax.jacrev, jax.jacfwd])
def test_derivatives_of_when_and_where_it_stops(mode):
    np.testing.assert_allclose(jaxball.jit(mode(bowl))(X), jax.jacrev(bowled)(X), rtol=1e-8, atol=1e-8)


@pytest.mark.long
def test_lanes_of_coefficients_and_speeds():
    mu, v = jnp.array([0.1, 0.2, 0.4]), jnp.array([3.0, 2.0, 1.0])
    laws = jax.vmap(Contact)(mu)
    runs = simulate_ensemble(ball(), SPAN, jax.vmap(thrown)(v), contact=laws, in_axes=(None, 0))
    expected = np.stack([bowled(jnp.array([m, C, s])) for m, s in zip(mu, v, strict=True)])
    np.testing.assert_allclose(runs.trajectory.switches.times[:, :2], expected[:, :2], rtol=1e-9)


@pytest.mark.long
def test_backspin_that_friction_turns_round_while_the_ball_slides():
    """ω reaches 0 as friction μ and resistance c both brake it, and grows by their difference from there on."""
    v, spin = 2.0, 3.0
    state = ReleasedState(BallState(Omega=(0.0, -spin, 0.0)), V=(v, 0.0, 0.0))
    run = jaxball.simulate(ball(), SPAN, state, contact=Contact(MU), throw=True)
    turns = spin * R / (2.5 * (MU + C) * G)
    slides = turns + 2 * (v - MU * G * turns) / ((7 * MU - 5 * C) * G)
    stops = slides + 7 * (v - MU * G * slides) / (5 * C * G)
    np.testing.assert_allclose(run.switches.times[:3], [turns, slides, stops], rtol=1e-9)
    causes = [SwitchCause.ROLLING_ENDS, SwitchCause.STOPS, SwitchCause.ROLLING_ENDS]
    np.testing.assert_array_equal(run.contact.switches.cause[:3], causes)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["ball", "disk"])
def test_on_a_slope_a_body_rests_rolls_slides_or_does_both(kind):
    """By its two coefficients, (μ, c) over tan α: all that must give way does, and nothing else."""
    share = [(1.01, 1.01), (1.01, 0.5), (0.5, 0.6), (0.2, 0.1)]
    mu, c = np.tan(ALPHA) * np.array(share).T
    s, n = G * np.sin(ALPHA), G * np.cos(ALPHA)
    a = np.array([0.0, 5 / 7 * (s - c[1] * n), s - mu[2] * n, s - mu[3] * n])
    turns = np.array([0.0, a[1], 0.0, 2.5 * (mu[3] - c[3]) * n]) / R
    make, state = (ball, BallState()) if kind == "ball" else (disk, DiskState())
    laws, bodies = jax.vmap(Contact)(jnp.asarray(mu)), jax.vmap(lambda c: make(c, ALPHA))(jnp.asarray(c))
    runs = simulate_ensemble(bodies, (0.0, 2.0), state, contact=laws, in_axes=(0, None)).trajectory
    np.testing.assert_array_equal(runs.contact.mode[:, -1], [Mode.REST, Mode.ROLLING, Mode.SLIDING, Mode.SLIDING])
    np.testing.assert_array_equal(runs.contact.rests[:, -1], [True, False, True, False])
    z = runs.state.z[:, -1]
    np.testing.assert_allclose(np.linalg.norm(z, axis=-1) if kind == "ball" else z, 2.0 * a, rtol=1e-9)
    rate = np.linalg.norm(runs.state.Omega[:, -1], axis=-1) if kind == "ball" else -runs.state.phidot[:, -1]
    np.testing.assert_allclose(rate, 2.0 * turns, rtol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(("mu", "c"), [(0.5, 0.1), (0.1, 0.5)])
def test_a_growing_push_breaks_a_ball_loose(mu, c):
    """It rolls as its torque about the contact exceeds c M g r, or slides as it exceeds μ M g, held against rolling."""
    ramp = 1.5
    push = jaxball.FunctionWrench(lambda t, motion, _: jnp.stack([ramp * t, 0.0 * t, 0.0 * t]))
    run = jaxball.simulate(ball(c, force=push), (0.0, 9.0), BallState(), contact=Contact(mu), throw=True)
    loose, inertia = min(mu, c) * M * G / ramp, 1.4 if c < mu else 1.0
    np.testing.assert_allclose(run.switches.times[0], loose, rtol=1e-9)
    np.testing.assert_allclose(run.state.z[-1], [ramp * (9 - loose) ** 3 / (6 * M * inertia), 0.0], atol=1e-8)
    assert int(run.contact.mode[-1]) == (Mode.ROLLING if c < mu else Mode.SLIDING)
    assert bool(run.contact.rests[-1]) == (c > mu)


@pytest.mark.long
def test_bounces_end_in_rest():
    """The first sticks, so that it leaves 5/7 of the speed; no other changes that, and nothing resists in flight."""
    h, e, v = 0.5, 0.4, 1.0
    state = ReleasedState(BallState(), V=(v, 0.0, 0.0), height=h)
    law = Contact(0.5, restitution=e)
    run = jaxball.simulate(ball(), (0.0, 12.0), state, contact=law, throw=True)
    first = np.sqrt(2 * h / G)
    landed = first * (1 + 2 * e / (1 - e))
    stopped = landed + v / (C * G)
    switches, last = run.contact.switches, int(run.switches.count) - 1
    assert (int(switches.source[last]), int(switches.target[last])) == (Mode.ROLLING, Mode.REST)
    # The last bounces, slower than `slowest` √(g r), are left out.
    np.testing.assert_allclose(switches.times[last], stopped, atol=1e-5)
    way = v * first + 5 / 7 * v * (landed - first) + 7 * (5 / 7 * v) ** 2 / (10 * C * G)
    np.testing.assert_allclose(run.state.z[-1], [way, 0.0], atol=1e-5)
    np.testing.assert_array_equal(run.state.Omega[-1], 0.0)


def robot(c=0.1, spinning=0.03, angle=0.02, **others):
    """A ball without symmetry, in which a mass swings."""
    frame = jaxball.SphericalFrame(0.4, 0.3)
    swing = jaxball.Sinusoids(-1.6, amplitude=[0.6], frequency=[1.5])
    masses = [jaxball.PointMass(0.4, jaxball.OnRail(jaxball.Circle(0.2, (0.02, -0.03, 0.05), frame), swing))]
    law = Resistance(dry=c, dry_spinning=spinning, **{"exact": True, **others})
    moments = (0.9 * SOLID, 1.1 * SOLID, 1.3 * SOLID)
    return ball(0.0, angle, inertia=moments, offset=(0.01, 0.0, -0.02), masses=masses, resistance=law)


PUSHED = jnp.array([0.75, 3.0, 0.7])
THROWN = ReleasedState(BallState(Omega=PUSHED), V=(1.0, 0.5, 0.0))
EPISODES = (
    "from sliding to sliding, as its spinning ended",
    "from sliding to sliding, as its rolling ended",
    "from sliding to rest, as the slip ended",
    "from rest to rolling, as rolling friction gave way",
    "from rolling to rest, as its rolling ended",
)


@pytest.mark.long
def test_where_friction_suffices_it_is_the_body_that_only_rolls():
    times = (0.0, 1.3, 5.0)
    alone = jaxball.simulate(robot(), times, BallState(Omega=PUSHED), throw=True)
    run = jaxball.simulate(robot(), times, BallState(Omega=PUSHED), contact=Contact(2.0), throw=True)
    np.testing.assert_allclose(run.state.z, alone.state.z, atol=1e-9)
    np.testing.assert_allclose(run.switches.times[:4], alone.switches.times[:4], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["slides", "begins to slide and to roll"])
def test_the_smoothed_laws_tend_to_the_exact_ones(case):
    """Their distance is proportional to their width at first, where both directions begin at once, too."""
    angle, c, mu, state, end = (0.02, 0.1, 0.1, THROWN, 2.0) if case == "slides" else (0.35, 0.05, 0.06, None, 0.5)
    state = BallState() if state is None else state
    exact = jaxball.simulate(robot(c, 0.03, angle), (0.0, end), state, contact=Contact(mu), throw=True)
    errors = []
    for width in (2e-4, 1e-4):
        smoothed = robot(c, 0.03, angle, exact=False, smoothing=width)
        law = Contact(jaxball.physics.SmoothedCoulomb(mu, R * width))
        start = state if case == "slides" else ReleasedState(state)
        solver = jaxball.simulation.solvers.RadauIIA(3)
        run = jaxball.simulate(smoothed, (0.0, end), start, contact=law, solver=solver, max_steps=100_000, throw=True)
        errors.append(np.linalg.norm(run.state.z[-1] - exact.state.z[-1]))
    assert errors[1] < 0.65 * errors[0]
    assert errors[1] < 1e-3


@pytest.mark.thorough
def test_a_disk_that_begins_to_slide_and_to_roll_at_once_rolls_as_its_slip_drives_it():
    """A pendulum's torque would roll it backwards; as friction cannot hold that, the slip rolls it on."""
    pendulum = planar_pendulum(0.5, 0.6, drive=Motor(0.45))
    robot = Disk(mass=1.0, inertia=0.5, mechanisms=[pendulum], resistance=Resistance(dry=0.01, exact=True))

    def run(t, rate=0.0):
        start = DiskState(phidot=rate, theta=(0.0,), thetadot=(0.0,))
        return jaxball.simulate(robot, jnp.stack([t, t + 0.1]), start, contact=Contact(0.12), rtol=1e-10, atol=1e-10)

    held = run(0.0)
    assert int(held.switches.count) == 0
    np.testing.assert_allclose(held.state.phidot[-1], run(0.0, 1e-9).state.phidot[-1], rtol=0, atol=2e-9)
    # Nothing depends on the time itself, in either mode of differentiation.
    for derivative in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(derivative(lambda t: run(t).state.phidot[-1])(0.3), 0, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_the_energy_changes_by_the_power_of_all_forces_in_every_mode():
    """By differences over four points, at times of each mode; friction that holds has none."""
    middles = np.array([0.2, 0.55, 1.0, 1.8, 3.0, 4.6])
    h = 1e-3
    times = np.ravel(middles[:, None] + h * np.arange(-2, 3))
    run = jaxball.simulate(robot(), [0.0, *times], THROWN, contact=Contact(0.1), throw=True, rtol=1e-12, atol=1e-12)
    assert tuple(line.split(": ")[1] for line in run.switches.lines) == EPISODES
    seen = run.observables
    energy = np.reshape((seen.kinetic_energy + seen.potential_energy)[1:], (-1, 5))
    rate = energy @ np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12 * h)
    np.testing.assert_allclose(rate, np.reshape(seen.power[1:], (-1, 5))[:, 2], atol=1e-7)
    held = np.reshape(run.contact.rests[1:], (-1, 5))[:, 2]
    np.testing.assert_array_equal(held, [False, False, True, True, False, True])
    np.testing.assert_allclose(np.reshape(seen.dissipation[1:], (-1, 5))[[3, 5], 2], 0.0, atol=1e-14)


@pytest.mark.slow
def test_derivatives_of_a_robot_in_all_modes():
    """Against differences over four points, whose errors are some 1e-7 of the derivative."""

    def end(x, tolerance=1e-10):
        start = ReleasedState(BallState(Omega=x[3:6]), V=jnp.append(x[6:], 0.0))
        law, span = Contact(x[2]), (0.0, 5.0)
        run = jaxball.simulate(robot(x[0], x[1]), span, start, contact=law, rtol=tolerance, atol=tolerance)
        return jnp.concatenate([run.state.z[-1], run.switches.times[:5]])

    x = jnp.array([0.1, 0.03, 0.1, *PUSHED, 1.0, 0.5])
    told = jaxball.simulate(robot(), (0.0, 5.0), THROWN, contact=Contact(0.1)).switches.lines
    assert tuple(line.split(": ")[1] for line in told) == EPISODES
    expected = jacobian(jaxball.jit(lambda x: end(x, 1e-13)), x, 1e-5)
    np.testing.assert_allclose(jaxball.jit(jax.jacrev(end))(x), expected, rtol=1e-6, atol=1e-6)
