"""Runs that slide, fly and strike, against motions that are known in closed form."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Contact
from jaxball.physics import Mode, ReleasedState, SwitchCause

M, R, G, D = 1.3, 0.9, 2.0, 0.6
K = D / (M * R**2)
BALL = jaxball.Ball(mass=M, inertia=(D, D, D), radius=R, gravity=G)
COUNT = 33  # of times: runs of one structure have as many, and share a program
TIMES = np.linspace(0.0, 4.0, COUNT)
CLOSE = 1e-10
FINE = {"rtol": 1e-12, "atol": 1e-12, "step_to_times": True}
Q = (0.6, 0.0, 0.8, 0.0)
E3 = np.array([0.0, 0.0, 1.0])


def turn(q):
    """The rotation matrix of a versor."""
    w, v = q[0], np.array(q[1:])
    return np.eye(3) + 2 * w * np.cross(np.eye(3), v) + 2 * (np.outer(v, v) - v @ v * np.eye(3))


def start(V, omega=(0.0, 0.0, 0.0), height=0.0):
    """A state with the angular velocity ω in space axes."""
    return ReleasedState(jaxball.BallState(q=Q, Omega=turn(Q).T @ np.array(omega)), V, height)


def slide(V, omega, mu, **changes):
    return jaxball.simulate(BALL, TIMES, start(V, omega), contact=Contact(mu, **changes), **FINE)


THROWS = {
    "without spin": ((1.5, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "with side spin": ((1.0, 0.5, 0.0), (1.2, 0.4, -0.7)),
    "with backspin, which returns": ((1.0, 0.0, 0.0), (0.0, -4.0, 0.0)),
}


@pytest.mark.long
@pytest.mark.parametrize("throw", THROWS)
def test_a_homogeneous_ball_slides_in_a_parabola_and_then_rolls(throw):
    V, omega = (np.array(x) for x in THROWS[throw])
    mu = 0.25
    run = slide(V, omega, mu)
    slip = V - R * np.cross(omega, E3)
    sigma, speed = slip / np.linalg.norm(slip), np.linalg.norm(slip)
    rolls = speed * K / (mu * G * (1 + K))
    after = (V + K * R * np.cross(omega, E3)) / (1 + K)
    switches = run.contact.switches
    assert int(switches.count) == 1
    assert run.ok
    assert (switches.source[0], switches.target[0], switches.cause[0]) == (
        Mode.SLIDING,
        Mode.ROLLING,
        SwitchCause.STOPS,
    )
    assert float(switches.times[0]) == pytest.approx(rolls, abs=CLOSE)
    t = TIMES[:, None]
    sliding = V * t - 0.5 * mu * G * sigma * t**2
    at_rolls = V * rolls - 0.5 * mu * G * sigma * rolls**2
    path = np.where(t < rolls, sliding, at_rolls + after * (t - rolls))
    np.testing.assert_allclose(run.state.z, path[:, :2], atol=CLOSE)
    np.testing.assert_allclose(run.contact.V[-1], after, atol=CLOSE)
    np.testing.assert_array_equal(np.asarray(run.contact.mode) == Mode.SLIDING, rolls > TIMES)
    assert np.all(np.asarray(run.contact.slip)[rolls < TIMES] == 0.0)
    seen, slides = run.observables, rolls > TIMES
    np.testing.assert_allclose(seen.normal_force, M * G, rtol=CLOSE)
    np.testing.assert_allclose(seen.friction[slides], np.tile(-mu * M * G * sigma[:2], (slides.sum(), 1)), atol=1e-9)
    np.testing.assert_allclose(seen.energy + run.contact.friction_loss, seen.energy[0], atol=CLOSE)
    # Friction takes the energy of the slip velocity, as of two bodies that collide without rebound.
    assert float(run.contact.friction_loss[-1]) == pytest.approx(0.5 * M * K / (1 + K) * speed**2, abs=CLOSE)


SOLVERS = {
    "multistep, stiff": jaxball.simulation.solvers.NDF(),
    "multistep": pytest.param(jaxball.simulation.solvers.Adams(), marks=pytest.mark.slow),
    "implicit": pytest.param(jaxball.simulation.solvers.RadauIIA(), marks=pytest.mark.slow),
}


@pytest.mark.long
@pytest.mark.parametrize("solver", list(SOLVERS.values()), ids=list(SOLVERS))
def test_every_kind_of_solver_ends_a_slip_when_it_ends(solver):
    """In fewer than 1000 steps: what is set after each of them must not disturb what multistep methods remember."""
    mu, speed = 0.25, 1.5
    run = jaxball.simulate(
        BALL, TIMES, start((speed, 0.0, 0.0)), contact=Contact(mu), solver=solver, rtol=1e-9, atol=1e-9, max_steps=1000
    )
    assert run.ok
    assert float(run.contact.switches.times[0]) == pytest.approx(speed * K / (mu * G * (1 + K)), abs=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_ball_on_a_slope_rolls_only_if_friction_can_hold_it(share):
    """It rolls iff μ > tan α · k/(1 + k)."""
    angle = 0.4
    mu = share * np.tan(angle) * K / (1 + K)
    ball = jaxball.Ball(mass=M, inertia=(D, D, D), radius=R, gravity=G, ground=jaxball.Ground(angle))
    run = jaxball.simulate(ball, TIMES, jaxball.BallState(q=Q), contact=Contact(mu), **FINE)
    rolls = share > 1
    down = G * np.sin(angle) / (1 + K) if rolls else G * (np.sin(angle) - mu * np.cos(angle))
    assert np.all(np.asarray(run.contact.mode) == (Mode.ROLLING if rolls else Mode.SLIDING))
    assert int(run.contact.switches.count) == 0
    np.testing.assert_allclose(np.linalg.norm(run.state.z, axis=1), 0.5 * down * TIMES**2, atol=CLOSE)
    omega = down / R if rolls else mu * G * np.cos(angle) * M * R / D
    np.testing.assert_allclose(np.linalg.norm(run.state.Omega, axis=1), omega * TIMES, atol=CLOSE)


@pytest.mark.thorough
def test_a_ball_that_friction_holds_on_a_slope_does_not_move_at_all():
    """A centre of mass straight over the contact point, as gravity sees it; whatever rounding makes of the torque."""
    angle, low = 0.3, 0.25
    held = jaxball.Ball(
        mass=M,
        inertia=(D, D, D),
        radius=R,
        gravity=G,
        offset=(-(R - low) * np.tan(angle), 0.0, -low),
        ground=jaxball.Ground(angle),
    )
    run = jaxball.simulate(held, 250 * TIMES, jaxball.BallState(), contact=Contact(1.0), step_to_times=True)
    assert np.all(np.asarray(run.contact.mode) == Mode.ROLLING)
    assert np.all(np.asarray(run.contact.slip) == 0.0)
    assert np.all(np.asarray(run.state.z) == 0.0)
    assert np.all(np.asarray(run.state.Omega) == 0.0)
    np.testing.assert_allclose(run.observables.friction_ratio, np.tan(angle), rtol=1e-14)


@pytest.mark.long
@pytest.mark.parametrize("e", [0.6, 0.9])
def test_heights_of_bounces(e):
    """eⁿ² h, at times that accumulate, and then the ball rests: bouncing is ended and said to be."""
    h = 0.8
    fall = np.sqrt(2 * h / G)
    end = fall * (1 + e) / (1 - e)
    times = np.linspace(0.0, 1.5 * end, 40)
    run = jaxball.simulate(
        BALL, times, start((0.0, 0.0, 0.0), height=h), contact=Contact(0.2, restitution=e, capacity=256)
    )
    switches = run.contact.switches
    count = int(switches.count)
    n = np.arange(count)
    expected = fall * (1 + 2 * e * (1 - e**n) / (1 - e))
    np.testing.assert_allclose(switches.times[:count], expected, atol=CLOSE)
    assert np.all(switches.source[:count] == Mode.FLIGHT)
    assert np.all(switches.cause[:count] == SwitchCause.LANDS)
    assert np.all(switches.target[: count - 1] == Mode.FLIGHT)
    assert switches.target[count - 1] == Mode.ROLLING
    speeds = np.asarray(switches.after.V)[: count - 1, 2]
    np.testing.assert_allclose(speeds**2 / (2 * G), e ** (2 * (n[:-1] + 1)) * h, atol=CLOSE)
    assert e**count * fall * G <= 1e-6 * np.sqrt(G * R) < e ** (count - 1) * fall * G
    assert float(run.contact.impact_loss[-1]) == pytest.approx(M * G * h, abs=CLOSE)
    assert float(run.observables.energy[-1]) == pytest.approx(0.0, abs=CLOSE)


@pytest.mark.thorough
@pytest.mark.parametrize(("mu", "sticks"), [(0.5, True), (0.05, False)])
def test_an_impact_sticks_if_friction_can_stop_the_slip(mu, sticks):
    """Sticks if μ (1 + e) |v₃| ≥ |v_s| k/(1 + k)."""
    e, V, omega = 0.7, np.array([1.0, -0.5, 0.0]), np.array([0.3, 0.8, 0.2])
    times, law = np.linspace(0.0, 1.2, COUNT), Contact(mu, restitution=e)
    run = jaxball.simulate(BALL, times, start(V, omega, 0.5), contact=law, **FINE)
    switches, fall = run.contact.switches, np.sqrt(2 * 0.5 / G)
    assert float(switches.times[0]) == pytest.approx(fall, abs=CLOSE)
    down = G * fall
    slip = (V - R * np.cross(omega, E3))[:2]
    share = min(1.0, mu * (1 + e) * down * (1 + K) / (K * np.linalg.norm(slip)))
    assert (share == 1.0) == sticks
    after = np.append(V[:2] - share * slip * K / (1 + K), e * down)
    np.testing.assert_allclose(switches.after.V[0], after, atol=CLOSE)


@pytest.mark.long
def test_flight_keeps_the_angular_momentum_and_the_centre_of_mass_falls():
    """About the centre of mass, with masses that move in the ball."""
    ball = jaxball.Ball(
        mass=M,
        inertia=(0.5, 0.6, 0.7),
        radius=R,
        gravity=G,
        offset=(0.05, 0.0, -0.1),
        masses=[jaxball.PointMass(0.4, jaxball.OnRail(jaxball.Circle(0.7), jaxball.ConstantRate(0.0, 2.0)))],
    )
    times = np.linspace(0.0, 1.5, 16)
    thrown = ReleasedState(jaxball.BallState(q=Q, Omega=(0.4, -1.0, 0.3)), (0.5, 0.2, 1.0), 2.0)
    run = jaxball.simulate(ball, times, thrown, contact=Contact(0.3), **FINE)
    assert np.all(np.asarray(run.contact.mode) == Mode.FLIGHT)
    total, seen, L = M + 0.4, run.observables, []
    centre = np.asarray(seen.geometric_centre + seen.centre_of_mass_space)
    first = centre[0]
    velocity = np.asarray([momentum(ball, t, run, k) / total for k, t in enumerate(times)])
    expected = first + velocity[0] * times[:, None] - 0.5 * G * np.outer(times**2, E3)
    np.testing.assert_allclose(centre, expected, atol=CLOSE)
    L = np.array([spin(ball, t, run, k, centre[k], velocity[k]) for k, t in enumerate(times)])
    np.testing.assert_allclose(L, np.tile(L[0], (times.size, 1)), atol=CLOSE)


def particles(ball, t, run, k):
    """Mass, place and velocity of the shell's centre of mass and of the point mass on its circle, in space."""
    turned, V = turn(np.asarray(run.state.q)[k]), np.asarray(run.contact.V)[k]
    Omega = np.asarray(run.state.Omega)[k]
    place = np.append(np.asarray(run.state.z)[k], run.contact.height[k])
    angle = 2.0 * t
    circle = jaxball.Circle(0.7).prepare().points(jnp.array([angle, angle + 1e-6, angle - 1e-6]))
    chi, rate = np.asarray(circle[0]), np.asarray(circle[1] - circle[2]) / 2e-6 * 2.0
    for m, x, xdot in ((M, np.array([0.05, 0.0, -0.1]), np.zeros(3)), (0.4, chi, rate)):
        yield m, place + turned @ x, V + turned @ (np.cross(Omega, x) + xdot)


def momentum(ball, t, run, k):
    return sum(m * v for m, _, v in particles(ball, t, run, k))


def spin(ball, t, run, k, centre, velocity):
    turned = turn(np.asarray(run.state.q)[k])
    own = turned @ (np.array([0.5, 0.6, 0.7]) * np.asarray(run.state.Omega)[k])
    return own + sum(m * np.cross(x - centre, v - velocity) for m, x, v in particles(ball, t, run, k))


@pytest.mark.long
def test_jelletts_integral_under_any_friction():
    """(ΛI Ω)·r with r from the centre of mass to the contact point, of a body with a rotational symmetry."""
    A, C, low = 0.5, 0.7, 0.2
    top = jaxball.Ball(mass=M, inertia=(A, A, C), radius=R, gravity=G, offset=(0.0, 0.0, -low))
    tilted = (np.cos(0.4), np.sin(0.4), 0.0, 0.0)
    spun = ReleasedState(jaxball.BallState(q=tilted, Omega=(0.3, 0.2, 6.0)), (0.2, -0.1, 0.0))
    run = jaxball.simulate(top, np.linspace(0.0, 5.0, COUNT), spun, contact=Contact(0.15), **FINE)
    assert set(np.unique(run.contact.mode)) >= {int(Mode.SLIDING)}
    Omega, Gamma = np.asarray(run.state.Omega), np.asarray(run.observables.vertical_body)
    arm = R * Gamma + np.array([0.0, 0.0, -low])
    jellett = np.sum(Omega * np.array([A, A, C]) * arm, axis=1)
    np.testing.assert_allclose(jellett, jellett[0], atol=CLOSE)


def swing(t, amplitude):
    """Up and down, three radians a unit of time."""
    return amplitude * jnp.sin(3.0 * t) * jnp.asarray(E3)


@pytest.mark.long
def test_the_plane_is_left_when_the_event_finds():
    """A mass that swings up and down in a ball at rest: N = M g − m a w² sin wt, and no friction at all."""
    m, a, w = 0.8, 0.6, 3.0
    ball = jaxball.Ball(
        mass=M, inertia=(D, D, D), radius=R, gravity=G, masses=[jaxball.PointMass(m, jaxball.Free(swing, jnp.array(a)))]
    )
    times = np.linspace(0.0, 1.0, 11)
    events = {"lift": jaxball.Detachment()}
    lift = float(jaxball.simulate(ball, times, events=events, **FINE).events["lift"].times[0])
    run = jaxball.simulate(ball, times, contact=Contact(0.3), **FINE)
    total, switches = M + m, run.contact.switches
    assert lift == pytest.approx(np.arcsin(total * G / (m * a * w**2)) / w, abs=CLOSE)
    assert float(switches.times[0]) == pytest.approx(lift, abs=CLOSE)
    assert (switches.source[0], switches.target[0], switches.cause[0]) == (Mode.ROLLING, Mode.FLIGHT, SwitchCause.LIFTS)
    flies = (times > lift) & (times < float(switches.times[1]))
    t, drift = times[flies] - lift, a * w * np.cos(w * lift)
    jump = a * (np.sin(w * times[flies]) - np.sin(w * lift))
    np.testing.assert_allclose(run.contact.height[flies], m / total * (drift * t - jump) - 0.5 * G * t**2, atol=CLOSE)
    assert np.all(np.asarray(run.observables.normal_force) >= 0)
    assert np.all(np.asarray(run.contact.height) >= 0)


@pytest.mark.long
def test_a_slip_that_begins_from_rest_takes_what_the_energy_loses():
    """An unbalanced ball on a slope that friction cannot hold; its slip turns, and is stiff as it begins."""
    ball = jaxball.Ball(
        mass=M,
        inertia=(0.5, 0.6, 0.7),
        radius=R,
        gravity=G,
        offset=(0.2, 0.1, -0.1),
        ground=jaxball.Ground(0.9, 0.3),
    )
    body, law = jaxball.BallState(q=Q), Contact(friction=0.35)
    fine, coarse = (
        jaxball.simulate(ball, TIMES / 4, body, contact=law, rtol=tolerance, atol=tolerance, step_to_times=True)
        for tolerance in (1e-12, 1e-8)
    )
    for run, close in ((fine, CLOSE), (coarse, 1e-6)):
        assert run.ok
        assert run.contact.mode[1] == Mode.SLIDING
        energy = run.observables.energy
        np.testing.assert_allclose(energy[0] - energy, run.contact.friction_loss, rtol=0, atol=close)
        np.testing.assert_allclose(run.contact.V, fine.contact.V, rtol=0, atol=close)
    assert fine.contact.friction_loss[-1] > 0.1
