"""Bodies that nothing presses on the plane: they land and stay, bounce once, or are pushed off again."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import BallState, Contact
from jaxball.control import Push
from jaxball.physics import Mode, ReleasedState, SwitchCause
from jaxball.simulation.ensemble import simulate_ensemble

M, R, K = 1.3, 0.9, 0.5
D = K * M * R**2
TIMES = np.linspace(0.0, 3.0, 13)
HEIGHT = 0.5
CLOSE = 1e-10
LIMITS = {"rtol": 1e-11, "atol": 1e-11, "max_steps": 300}
V, OMEGA = np.array([1.0, 0.3, -1.0]), np.array([0.3, -0.2, 0.7])
E3 = np.array([0.0, 0.0, 1.0])


def ball(force=None, gravity=0.0):
    return jaxball.Ball(mass=M, inertia=(D, D, D), radius=R, gravity=gravity, force=force)


def falling(V=V, omega=OMEGA):
    return ReleasedState(BallState(Omega=omega), V, HEIGHT)


def space_rates(run):
    """ω in space axes."""
    return np.einsum("...ij,...j->...i", np.asarray(jax.vmap(lambda state: state.Lambda)(run.state)), run.state.Omega)


def after_impact(mu, e, V=V, omega=OMEGA):
    """V and ω by Coulomb's and Newton's laws: the impulse M (1 + e) |V₃| upwards, and at most μ times that along it."""
    slip = V - R * np.cross(omega, E3)
    slip[2] = 0.0
    speed, normal = np.linalg.norm(slip), M * (1 + e) * -V[2]
    sticking = M * K / (1 + K) * speed
    impulse = -min(sticking, mu * normal) * (slip / speed if speed else slip)
    after = V + impulse / M
    after[2] = -e * V[2]
    return after, omega + np.cross(-R * E3, impulse) / D, sticking <= mu * normal


def require_at_rest_on_the_plane(run, V, omega, mode):
    """That the ball has landed once, and then moves steadily, without any force of the plane."""
    landed = TIMES > HEIGHT
    assert run.ok
    assert int(run.contact.switches.count) == 1
    assert (run.contact.switches.cause[0], run.contact.switches.target[0]) == (SwitchCause.LANDS, mode)
    assert float(run.contact.switches.times[0]) == pytest.approx(HEIGHT, abs=CLOSE)
    np.testing.assert_array_equal(np.asarray(run.contact.height)[landed], 0.0)
    np.testing.assert_allclose(np.asarray(run.contact.V)[landed], np.tile(V, (landed.sum(), 1)), atol=CLOSE)
    np.testing.assert_allclose(space_rates(run)[landed], np.tile(omega, (landed.sum(), 1)), atol=CLOSE)
    np.testing.assert_allclose(run.observables.normal_force, 0.0, atol=1e-14)
    np.testing.assert_allclose(run.observables.friction, 0.0, atol=1e-14)


@pytest.mark.long
def test_a_ball_that_lands_without_a_rebound_stays_where_it_lands():
    run = jaxball.simulate(ball(), TIMES, falling(-E3, np.zeros(3)), contact=Contact(0.3), **LIMITS)
    require_at_rest_on_the_plane(run, np.zeros(3), np.zeros(3), Mode.ROLLING)
    assert np.all(np.asarray(run.state.z) == 0.0)
    assert float(run.contact.impact_loss[-1]) == pytest.approx(0.5 * M, rel=CLOSE)


@pytest.mark.thorough
@pytest.mark.parametrize("mu", [0.0, 0.1, 0.5])
def test_an_oblique_landing_slips_or_sticks(mu):
    after, omega, sticks = after_impact(mu, 0.0)
    assert sticks == (mu == 0.5)
    run = jaxball.simulate(ball(), TIMES, falling(), contact=Contact(mu), **LIMITS)
    require_at_rest_on_the_plane(run, after, omega, Mode.ROLLING if sticks else Mode.SLIDING)


@pytest.mark.thorough
@pytest.mark.parametrize("mu", [0.1, 0.5])
def test_a_ball_bounces_once_and_flies_away(mu):
    after, omega, _ = after_impact(mu, 0.5)
    run = jaxball.simulate(ball(), TIMES, falling(), contact=Contact(mu, restitution=0.5), **LIMITS)
    assert run.ok
    assert int(run.contact.switches.count) == 1
    assert np.all(np.asarray(run.contact.mode) == Mode.FLIGHT)
    np.testing.assert_allclose(run.contact.height, np.where(TIMES < 0.5, 0.5 - TIMES, 0.5 * (TIMES - 0.5)), atol=CLOSE)
    np.testing.assert_allclose(run.contact.V[-1], after, atol=CLOSE)
    np.testing.assert_allclose(space_rates(run)[-1], omega, atol=CLOSE)


@pytest.mark.thorough
@pytest.mark.parametrize("gravity", [1e-300, 1e-30, 1e-12])
def test_next_to_no_gravity_presses_the_ball_on(gravity):
    for mu in (0.1, 0.5):
        after, omega, sticks = after_impact(mu, 0.0)
        run = jaxball.simulate(ball(gravity=gravity), TIMES, falling(), contact=Contact(mu), **LIMITS)
        require_at_rest_on_the_plane_within(run, after, omega, Mode.ROLLING if sticks else Mode.SLIDING, gravity)


def require_at_rest_on_the_plane_within(run, V, omega, mode, gravity):
    assert run.ok
    assert int(run.contact.switches.count) == 1
    assert run.contact.mode[-1] == mode
    np.testing.assert_allclose(run.contact.V[-1], V, atol=CLOSE)
    np.testing.assert_allclose(space_rates(run)[-1], omega, atol=CLOSE)
    np.testing.assert_allclose(run.observables.normal_force[3:], M * gravity, atol=1e-14)


@pytest.mark.long
def test_a_ball_that_starts_on_the_plane_goes_on():
    """At rest, rolling and sliding, each for itself and released."""
    starts = {
        "at rest": (BallState(), Mode.ROLLING),
        "rolling": (BallState(Omega=OMEGA), Mode.ROLLING),
        "released": (ReleasedState(BallState()), Mode.ROLLING),
        "sliding": (ReleasedState(BallState(Omega=OMEGA), (1.0, 0.3, 0.0)), Mode.SLIDING),
    }
    for state, mode in starts.values():
        run = jaxball.simulate(ball(), TIMES, state, contact=Contact(0.3), **LIMITS)
        assert run.ok
        assert int(run.contact.switches.count) == 0
        assert np.all(np.asarray(run.contact.mode) == mode)
        np.testing.assert_allclose(run.contact.V, np.tile(run.contact.V[0], (TIMES.size, 1)), atol=CLOSE)


@pytest.mark.long
def test_a_push_lifts_a_ball_that_has_landed():
    """Its height is saved at the very times at which the push begins and ends, too."""
    after, omega, _ = after_impact(0.1, 0.0)
    push, start, lasts = 2.0, 1.5, 0.5
    lifted = ball(Push((0.0, 0.0, push), start, lasts))
    run = jaxball.simulate(lifted, TIMES, falling(), contact=Contact(0.1), **LIMITS)
    switches, t = run.contact.switches, TIMES - start
    assert run.ok
    assert switches.cause[: int(switches.count)].tolist() == [SwitchCause.LANDS, SwitchCause.LIFTS]
    np.testing.assert_allclose(switches.times[:2], [HEIGHT, start], atol=CLOSE)
    pushes = np.clip(t, 0.0, lasts)
    height = push / M * (0.5 * pushes**2 + pushes * (np.maximum(t, 0.0) - pushes))
    np.testing.assert_allclose(run.contact.height[3:], height[3:], atol=CLOSE)
    np.testing.assert_allclose(run.contact.V[-1, :2], after[:2], atol=CLOSE)
    np.testing.assert_allclose(space_rates(run)[-1], omega, atol=CLOSE)


@pytest.mark.thorough
def test_a_push_against_the_plane_brakes_a_ball_that_slides():
    """By μ F as long as it slips; the stronger one lasts until it rolls."""
    mu = 0.1
    after, omega, _ = after_impact(mu, 0.0)
    slip = after - R * np.cross(omega, E3)
    slip[2] = 0.0
    speed = np.linalg.norm(slip)
    for push, start, lasts in ((2.0, 1.5, 0.5), (30.0, 1.5, 1.0)):
        pressed = ball(Push((0.0, 0.0, -push), start, lasts))
        run = jaxball.simulate(pressed, TIMES, falling(), contact=Contact(mu), **LIMITS)
        stops = speed / (mu * push / M * (1 + 1 / K))
        brakes, switches = min(stops, lasts), run.contact.switches
        assert run.ok
        assert switches.cause[: int(switches.count)].tolist() == [
            SwitchCause.LANDS,
            *([SwitchCause.STOPS] if stops < lasts else []),
        ]
        impulse = -mu * push * brakes * slip / speed
        np.testing.assert_allclose(run.contact.V[-1], after + impulse / M, atol=CLOSE)
        np.testing.assert_allclose(space_rates(run)[-1], omega + np.cross(-R * E3, impulse) / D, atol=CLOSE)


@pytest.mark.thorough
def test_a_push_along_the_plane_slides_a_ball_that_nothing_presses():
    run = jaxball.simulate(
        ball(Push((2.0, 0.0, 0.0), 1.5, 0.5)), TIMES, falling(-E3, np.zeros(3)), contact=Contact(0.5), **LIMITS
    )
    assert run.ok
    assert run.contact.mode[-1] == Mode.SLIDING
    np.testing.assert_allclose(run.contact.V[-1], [1.0 / M, 0.0, 0.0], atol=CLOSE)
    np.testing.assert_allclose(run.state.Omega[-1], 0.0, atol=1e-12)


@pytest.mark.long
def test_bounces_under_a_force_are_those_under_gravity():
    """A constant force at the centre is a weight: bounces end at the same time."""
    dropped, law, times = ReleasedState(BallState(), height=HEIGHT), Contact(0.2, restitution=0.5), [0.0, 4.0]
    limits = {"rtol": 1e-11, "atol": 1e-11, "max_steps": 800}
    forced = jaxball.simulate(
        ball(jaxball.physics.HarmonicForce((0.0, 0.0, -2.0 * M))), times, dropped, contact=law, **limits
    ).contact.switches
    heavy = jaxball.simulate(ball(gravity=2.0), times, dropped, contact=law, **limits).contact.switches
    fall, e = np.sqrt(0.5), 0.5
    assert int(forced.count) == int(heavy.count)
    assert forced.target[int(forced.count) - 1] == Mode.ROLLING
    np.testing.assert_allclose(forced.times, heavy.times, atol=CLOSE)
    assert float(forced.times[int(forced.count) - 1]) == pytest.approx(fall * (1 + e) / (1 - e), abs=1e-5)


@pytest.mark.long
@pytest.mark.parametrize("through", ["lanes", "XLA"])
def test_an_ensemble_whose_lanes_are_in_different_modes(through):
    """With and without gravity, landing, resting, bouncing, sliding and rolling side by side."""
    rng, rows = np.random.default_rng(2), 24
    speeds = rng.normal(size=(rows, 3)) - 2 * E3
    omegas, mus = rng.normal(size=(rows, 3)), rng.uniform(0.05, 0.6, rows)
    es, gravity = rng.choice([0.0, 0.5], rows), rng.choice([0.0, 0.0, 9.81], rows)
    speeds[:, 2] = -np.abs(speeds[:, 2])
    balls = jax.vmap(lambda g: ball(gravity=g))(gravity)
    starts = jax.vmap(lambda V, omega: falling(V, omega))(speeds, omegas)
    laws = jax.vmap(lambda mu, e: Contact(mu, restitution=e))(mus, es)
    limits = LIMITS | {"max_steps": 2000}
    if through == "lanes":
        run = simulate_ensemble(balls, TIMES, starts, contact=laws, **limits).trajectory
    else:
        run = jax.jit(jax.vmap(lambda *row: jaxball.simulate(row[0], TIMES, row[1], contact=row[2], **limits)))(
            balls, starts, laws
        )
    assert np.all(np.asarray(run.status) == 0)
    for row in np.flatnonzero(gravity == 0):
        after, _, sticks = after_impact(mus[row], es[row], speeds[row], omegas[row])
        np.testing.assert_allclose(run.contact.V[row, -1], after, atol=CLOSE)
        assert int(run.contact.switches.count[row]) == 1
        mode = Mode.FLIGHT if es[row] else Mode.ROLLING if sticks else Mode.SLIDING
        assert run.contact.mode[row, -1] == mode
    for row in np.flatnonzero((gravity > 0) & (es == 0))[:2]:
        single = jaxball.simulate(
            ball(gravity=gravity[row]), TIMES, falling(speeds[row], omegas[row]), contact=Contact(mus[row]), **limits
        )
        np.testing.assert_allclose(run.contact.V[row], single.contact.V, atol=1e-8)


@pytest.mark.long
@pytest.mark.parametrize(
    ("differentiate", "adjoint"),
    [(jax.jacfwd, diffrax.ForwardMode()), (jax.jacrev, diffrax.RecursiveCheckpointAdjoint())],
    ids=["forward", "reverse"],
)
def test_derivatives_of_where_a_ball_slides_after_it_has_landed(differentiate, adjoint):
    """x = V t − μ |V₃| σ (t − h/|V₃|) along the slip."""

    def end(numbers):
        mu, height = numbers
        thrown = ReleasedState(BallState(), jnp.array([1.0, 0.0, -1.0]), height)
        run = jaxball.simulate(ball(), TIMES, thrown, contact=Contact(mu), adjoint=adjoint, **LIMITS)
        return run.state.z[-1, 0]

    by_mu, by_height = jax.jit(differentiate(end))(jnp.array([0.1, HEIGHT]))
    assert float(by_mu) == pytest.approx(-(TIMES[-1] - HEIGHT), rel=1e-9)
    assert float(by_height) == pytest.approx(0.1, rel=1e-9)
