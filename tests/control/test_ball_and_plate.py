"""A ball on a plate whose angles feedback drives: schedules, linearised equations, regulators, basins, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from jaxball import (
    Accelerated,
    Ball,
    BallState,
    ConstantRate,
    Disk,
    DiskState,
    FollowSchedules,
    FunctionLaw,
    FunctionSchedule,
    LinearLaw,
    RecordedSchedule,
    Sinusoids,
    problems,
    simulate,
)
from jaxball.control import Push, tvlqr
from jaxball.physics import TiltingPlane, vector_field
from jaxball.plot.record import record
from jaxball.plot.shapes import place
from tests.support.differences import jacobian
from tests.support.sentences import refuses, said

G, r = 9.81, 0.05
SOLID = {"mass": 1.0, "radius": r, "inertia": (0.001, 0.001, 0.001), "gravity": G}
PLATE = TiltingPlane(Accelerated(), Accelerated())


def pushed(t, state, gains):
    """Angular accelerations that balance a solid ball: of its place and velocity on the plate, and of the angles.

    For small angles ẋ = r (ω₂ − θ̇₂) and ẏ = −r (ω₁ − θ̇₁), and the ball runs to +x where the plate tilts about e2.
    """
    omega = state.Lambda @ state.Omega
    v = r * jnp.stack([omega[1] - state.thetadot[1], state.thetadot[0] - omega[0]])
    side = jnp.stack([-1.0, 1.0])
    by_ball = gains[0] * state.z + gains[1] * v
    return -side * by_ball[::-1] - gains[2] * state.theta - gains[3] * state.thetadot


# Poles of x with ẍ = (5/7) g α − r α̈ and α̈ = −k₀ x − k₁ ẋ − k₂ α − k₃ α̇.
GAINS = np.array([8.0, 8.0, 25.0, 9.0])


def companion(gains):
    """The matrix of (x, ẋ, α, α̇), from the linearised equations of a solid ball on a plate."""
    drive = -np.asarray(gains)
    fall = np.array([0.0, 0.0, 5 / 7 * G, 0.0]) - r * drive
    return np.array([[0.0, 1.0, 0.0, 0.0], fall, [0.0, 0.0, 0.0, 1.0], drive])


@pytest.mark.thorough
def test_driven_angles_are_scheduled_angles():
    """With the angular accelerations of two schedules as the law, and other masses beside, a run is the same."""
    angles = (
        FunctionSchedule(lambda t, _: 0.2 * jnp.sin(1.3 * t)),
        FunctionSchedule(lambda t, _: 0.15 * jnp.sin(0.9 * t + 0.4)),
    )
    pivot, times = (0.1, 0.0, -0.3), np.linspace(0.0, 2.0, 9)
    start = {"z": (0.1, -0.2), "Omega": (0.4, -0.8, 0.3)}
    one = simulate(
        Ball(**SOLID, ground=TiltingPlane(*angles, pivot)), times, BallState(**start), rtol=1e-11, atol=1e-12
    )
    driven = Ball(**SOLID, ground=TiltingPlane(Accelerated(), Accelerated(), pivot), law=FollowSchedules(angles))
    theta, thetadot, _ = zip(*(angle.derivatives(jnp.array(0.0)) for angle in angles), strict=True)
    other = simulate(driven, times, BallState(**start, theta=theta, thetadot=thetadot), rtol=1e-11, atol=1e-12)
    assert driven.coordinates == ("ground.about_e1", "ground.about_e2")
    np.testing.assert_allclose(one.state.z, other.state.z, atol=1e-9)
    for name in ("geometric_centre", "contact_force", "power", "kinetic_energy", "normal_force", "friction"):
        np.testing.assert_allclose(
            getattr(one.observables, name), getattr(other.observables, name), atol=1e-8, err_msg=name
        )


@pytest.mark.thorough
def test_poles_of_a_linear_law():
    """The field, linearised at rest in the middle, has the poles of ẍ = (5/7) g α − r α̈ under the law, twice."""
    ball = Ball(**SOLID, ground=PLATE, law=FunctionLaw(pushed, jnp.asarray(GAINS)))

    def rates(x):
        state = BallState(Omega=jnp.stack([x[2], x[3], 0.0]), z=x[:2], theta=x[4:6], thetadot=x[6:])
        found = vector_field(ball, jnp.array(0.0), state)
        return jnp.concatenate([found.z, found.Omega[:2], found.theta, found.thetadot])

    poles = np.linalg.eigvals(np.asarray(jax.jacfwd(rates)(jnp.zeros(8))))
    expected = np.repeat(np.linalg.eigvals(companion(GAINS)), 2)
    assert np.max(expected.real) < -0.5
    # Of a double pole, an error of rounding has its square root.
    poles, expected = (np.sort_complex(np.round(x, 6)) for x in (poles, expected))
    np.testing.assert_allclose(poles, expected, atol=2e-6)


@pytest.mark.thorough
def test_small_motion_is_that_of_the_linear_equations_and_replays():
    """A run from a small displacement, and the same again with the angles that the law produced as schedules."""
    ball = Ball(**SOLID, ground=PLATE, law=FunctionLaw(pushed, jnp.asarray(GAINS)))
    times = np.linspace(0.0, 3.0, 301)
    start = BallState(z=(1e-4, -2e-4), theta=[0.0, 0.0], thetadot=[0.0, 0.0])
    run = simulate(ball, times, start, rtol=1e-12, atol=1e-14)
    linear = np.stack([expm(companion(GAINS) * t) @ [1e-4, 0.0, 0.0, 0.0] for t in times])
    np.testing.assert_allclose(run.state.z[:, 0], linear[:, 0], atol=1e-10)
    np.testing.assert_allclose(run.state.theta[:, 1], linear[:, 2], atol=1e-10)
    np.testing.assert_allclose(run.state.z[:, 1], -2 * linear[:, 0], atol=1e-10)
    angles = [RecordedSchedule(times, run.state.theta[:, k]) for k in range(2)]
    again = simulate(Ball(**SOLID, ground=TiltingPlane(*angles)), times, BallState(z=(1e-4, -2e-4)))
    np.testing.assert_allclose(again.state.z, run.state.z, atol=1e-9)


def from_beside(track):
    """How far a ball that starts 1.4e-3 beside the motion is from it at each sample, and the run."""
    state = track.nominal.states
    first = {name: getattr(state, name)[0] for name in ("q", "Omega", "theta", "thetadot")}
    held = track.closed_loop(BallState(**first, z=state.z[0] + 1e-3))
    assert held.ok
    return np.linalg.norm(np.asarray(held.states.z) - np.asarray(state.z), axis=1), held


H, Q, R = 0.05, {"z": 10.0, "theta": 1.0}, 0.05


@pytest.fixture(scope="module")
def middle():
    """The regulator that holds a ball in the middle of a plate that is level, for 8 units of time."""
    plate = TiltingPlane(about_e1=ConstantRate(0.0), about_e2=ConstantRate(0.0))
    return tvlqr(simulate(Ball(**SOLID, ground=plate), [0.0, 8.0]), Q=Q, R=R, sample=H)


def linear_flow():
    """A and B of (x, ẋ, α, α̇) over a sample, with α̈ held: ẍ = (5/7) g α − r α̈."""
    rates = np.zeros((5, 5))
    rates[[0, 1, 1, 2, 3], [1, 2, 4, 3, 4]] = 1.0, 5 / 7 * G, -r, 1.0, 1.0
    flow = expm(rates * H)
    return flow[:4, :4], flow[:4, 4]


def linear_gains():
    """Those of the regulator of the same weights for good, by the algebraic Riccati equation."""
    A, B = linear_flow()
    P = solve_discrete_are(A, B[:, None], H * np.diag([Q["z"], 0.0, Q["theta"], 0.0]), np.array([[H * R]]))
    return B @ P @ A / (H * R + B @ P @ B)


@pytest.mark.thorough
def test_regulator_holds_a_ball_in_the_middle(middle):
    assert middle.sampled.inputs == ("ground.about_e1", "ground.about_e2")
    assert middle.uncontrollable == ("Omega[2]",)
    left, held = from_beside(middle)
    assert left[0] > 1e-3
    assert np.max(left[-20:]) < 2e-4 * left[0]  # the slowest pole is −1.33, and exp(−1.33 · 7) is 1e-4
    np.testing.assert_allclose(held.run.observables.normal_force, G, rtol=1e-3)


@pytest.mark.thorough
def test_gains_in_the_middle_are_those_of_linear_theory(middle):
    """With ẋ = r (ω₂ − θ̇₂) and ẏ = −r (ω₁ − θ̇₁), twice the regulator of ẍ = (5/7) g α − r α̈."""
    of_x, of_v, of_angle, of_rate = linear_gains()
    expected = np.zeros((2, 12))
    for row, (axis, sign) in enumerate(((1, -1.0), (0, 1.0))):
        expected[row, 6 + axis], expected[row, 3 + row] = sign * of_x, r * of_v
        expected[row, 8 + row], expected[row, 10 + row] = of_angle, of_rate - r * of_v
    np.testing.assert_allclose(middle.gains[0], expected, atol=1e-8 * of_angle)
    A, B = linear_flow()
    poles = np.linalg.eigvals(np.asarray(middle.linear.A[0] - middle.linear.B[0] @ middle.gains[0]))
    theory = np.repeat(np.linalg.eigvals(A - np.outer(B, linear_gains())), 2)
    # The others are the attitude, which does not count, and the spin, which nothing changes.
    poles, theory = (np.sort_complex(np.round(x, 6)) for x in (poles, [*theory, 0.0, 0.0, 0.0, 1.0]))
    np.testing.assert_allclose(poles, theory, atol=2e-6)


def plane_loop(x, limit, samples):
    """(x, ẋ, α, α̇) at each sample under the gains of linear theory, and N and |f| / N over each, from rows ``x``.

    In the axes of the plate, which turns about e2, the centre is at (x, r), and its acceleration is
    (ẍ + r α̈ − x α̇², −2 ẋ α̇ − r α̇² − x α̈). With ω = ẋ/r + α̇ and (2/5) r ω̇ = −f, Newton's law along the plate is
    (7/5) (ẍ + r α̈) = g sin α + x α̇². Runge and Kutta's steps are a fifth of a sample.
    """

    def rates(x, u):
        place, speed, angle, rate = x.T
        pull = (G * np.sin(angle) + place * rate**2) / 1.4
        return np.stack([speed, pull - r * u, rate, u], axis=1), pull

    states, forces, step = [x], [], H / 5
    for _ in range(samples):
        u = np.clip(-(x @ linear_gains()), -limit, limit)
        place, speed, angle, rate = x.T
        N = G * np.cos(angle) - 2 * speed * rate - r * rate**2 - place * u
        forces.append((N, np.abs(0.4 * rates(x, u)[1]) / N))
        for _ in range(5):
            k1 = rates(x, u)[0]
            k2 = rates(x + 0.5 * step * k1, u)[0]
            k3 = rates(x + 0.5 * step * k2, u)[0]
            x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + rates(x + step * k3, u)[0])
        states.append(x)
    return np.array(states), *np.array(forces).transpose(1, 0, 2)


@pytest.mark.thorough
def test_a_ball_that_starts_elsewhere_has_other_body_axes(middle):
    """From 6 r away it turns by 6 rad on its way to the middle, and Ω with it."""
    states, N, _ = plane_loop(np.array([[0.3, 0.0, 0.0, 0.0]]), np.inf, 160)
    held = middle.closed_loop({"z[0]": 0.3})
    np.testing.assert_allclose(held.states.z[:, 0], states[:, 0, 0], atol=1e-5)
    np.testing.assert_allclose(held.states.theta[:, 1], states[:, 0, 2], atol=1e-5)
    np.testing.assert_allclose(held.run.observables.normal_force[:-1], N[:, 0], rtol=1e-4)
    np.testing.assert_allclose(held.states.z[-1], 0.0, atol=1e-4)


@pytest.mark.thorough
def test_basin_is_that_of_newtons_law_in_the_plane(middle):
    """Starts that return with limited α̈, and how they end, by other equations; and by single runs."""
    limit, within, mu = 3.0, 0.02, 0.5
    places, speeds = np.linspace(-0.6, 0.6, 5), np.linspace(-1.0, 1.0, 5)
    starts = {"z[0]": places, "Omega[1]": speeds / r}
    returned = middle.basin(starts, Q={"z": 1.0}, within=within, limits=limit, friction=mu)
    x = np.zeros((25, 4))
    x[:, 0], x[:, 1] = np.repeat(places, 5), np.tile(speeds, 5)
    with np.errstate(all="ignore"):  # of those that run away
        states, N, ratio = plane_loop(x, limit, middle.nominal.samples)
        remaining, least, most = np.abs(states[-1, :, 0]) / np.sqrt(2), np.min(N, axis=0), np.max(ratio, axis=0)
        np.testing.assert_array_equal(returned.returned, (remaining < within) & (least > 0) & (most <= mu))
    assert 0.2 < returned.share < 0.9
    back = returned.returned
    np.testing.assert_allclose(returned.remaining[back], remaining[back], atol=1e-4)
    np.testing.assert_allclose(returned.ends.least_normal_force[back], least[back], rtol=1e-3)
    np.testing.assert_allclose(returned.ends.friction_needed[back], most[back], rtol=1e-3)
    for start in (np.flatnonzero(back)[0], np.flatnonzero(~back)[0]):
        held = middle.closed_loop(returned.starts[start], limits=limit)
        assert (np.linalg.norm(np.asarray(held.states.z[-1])) / np.sqrt(2) < within) == back[start]


@pytest.mark.thorough
def test_gradient_of_a_tracking_loss_by_gains():
    """∂/∂k of the sum of x² at samples, against that of the exponential of the linearised equations."""
    times, small = np.linspace(0.0, 2.0, 21), 1e-4

    def loss(gains):
        ball = Ball(**SOLID, ground=PLATE, law=FunctionLaw(pushed, gains))
        start = BallState(z=(small, 0.0), theta=[0.0, 0.0], thetadot=[0.0, 0.0])
        return jnp.sum((simulate(ball, times, start).state.z[:, 0] / small) ** 2)

    def by_theory(gains):
        return sum((expm(companion(gains) * t) @ [1.0, 0.0, 0.0, 0.0])[0] ** 2 for t in times)

    expected = jacobian(by_theory, GAINS, 1e-3, points=2)
    np.testing.assert_allclose(jax.grad(loss)(jnp.asarray(GAINS)), expected, rtol=1e-5)


@pytest.fixture(scope="module")
def circle():
    """The regulator along a circle that prescribed angles make.

    With α₂ = −a cos wt and α₁ = a sin wt, ẍ = (5/7) g α₂ − r α̈₂ and ÿ = −(5/7) g α₁ + r α̈₁ are solved by x = b cos wt,
    y = b sin wt, with b w² = a ((5/7) g + r w²), for small a.
    """
    w, a = 2.0, 0.01
    b = a * (5 / 7 * G + r * w**2) / w**2

    def wave(phase):
        return Sinusoids(0.0, amplitude=[a], frequency=[w], phase=[phase])

    # Sinusoids are amplitude · sin(w t + phase): −cos is sin(w t − π/2).
    plate = TiltingPlane(about_e1=wave(0.0), about_e2=wave(-np.pi / 2))
    spin = (a * w - w * b / r, 0.0, 0.0)  # ẏ = −r (ω₁ − θ̇₁) = b w, with θ̇₁ = a w
    run = simulate(Ball(**SOLID, ground=plate), np.linspace(0.0, 6.0, 121), BallState(z=(b, 0.0), Omega=spin))
    np.testing.assert_allclose(np.hypot(*run.state.z.T), b, rtol=0.02)
    return tvlqr(run, Q=Q, R=1e-3, sample=0.05)


@pytest.mark.thorough
def test_regulator_holds_a_ball_on_a_circle(circle):
    """A ball that starts beside the circle comes to it, and not only nearer."""
    left, _ = from_beside(circle)
    assert np.max(left[-60:]) < 1e-3 * left[0]


@pytest.mark.thorough
def test_predictive_control_holds_a_ball_on_a_circle(circle):
    """Within limits that the regulator exceeds, from beside the circle and after a push."""
    limits = 0.15
    start, push = {"z[0]": 5e-3}, Push((0.0, 0.05, 0.0), start=3.0, duration=0.2)
    assert np.max(np.abs(circle.closed_loop(start).u)) > 1.5 * limits
    held = circle.mpc(20, limits=limits).closed_loop(start, limits=limits, push=push)
    left = np.linalg.norm(np.asarray(held.states.z - circle.nominal.states.z), axis=1)
    assert np.max(np.abs(held.u)) < limits * (1 + 1e-6)
    assert np.max(left[50:60]) < 0.01 * left[0]
    assert np.max(left[60:]) > 0.1 * left[0]
    assert np.max(left[60:]) < 0.05 * 0.2  # what the push alone would move it by in 1 unit of time, of mass 1
    assert np.max(left[-10:]) < 0.01 * left[0]


@pytest.mark.thorough
def test_a_driven_plate_is_drawn_where_the_law_has_it():
    """The normals on the page are those of the forces, and the contact points are under the ball."""
    ball = Ball(**SOLID, ground=PLATE, law=FunctionLaw(pushed, jnp.asarray(GAINS)))
    start = BallState(z=(0.05, -0.1), theta=[0.2, -0.1], thetadot=[0.0, 0.0])
    run = simulate(ball, np.linspace(0.0, 1.0, 11), start)
    contacts, seen = place(run, record(run)).setting.contacts, run.observables
    np.testing.assert_allclose(contacts.feet, seen.contact_point, atol=1e-12)
    np.testing.assert_allclose(contacts.feet + r * contacts.normals, seen.geometric_centre, atol=1e-12)
    assert contacts.moves


@pytest.mark.thorough
def test_disk_on_a_driven_line():
    """The planar case has the same equation with k = ½ for 2/5: ẍ = g α/(1 + k) − r α̈."""
    k = np.array([8.0, 0.0, 25.0, 9.0])
    law = LinearLaw(theta=[[-k[2]]], thetadot=[[-k[3]]], z=[[-k[0]]])
    disk = Disk(mass=1.0, radius=r, inertia=0.5 * r**2, gravity=G, ground=TiltingPlane(about_e2=Accelerated()), law=law)
    found = vector_field(disk, jnp.array(0.0), DiskState(z=1e-6, theta=[2e-6], thetadot=[0.0]))
    alphaddot = -k[0] * 1e-6 - k[2] * 2e-6
    np.testing.assert_allclose(found.thetadot[0], alphaddot, rtol=1e-12)
    # ẋ = −r (φ̇ + θ̇) with φ̇ anticlockwise and θ clockwise
    np.testing.assert_allclose(-r * (found.phidot + found.thetadot[0]), G * 2e-6 / 1.5 - r * alphaddot, rtol=1e-6)
    sideways = Disk(
        mass=1.0, radius=r, inertia=0.1, ground=TiltingPlane(about_e1=Accelerated()), law=LinearLaw(theta=[[-1.0]])
    )
    (sentence,) = problems(sideways)
    said(sentence, "ground.about_e1")
    assert "Accelerated()" in sentence


def test_what_a_driven_plate_needs(no_type_checks):
    with refuses(ValueError, "law"):
        Ball(**SOLID, ground=TiltingPlane(Accelerated()))
    ball = Ball(**SOLID, ground=TiltingPlane(Accelerated()), law=LinearLaw(theta=[[-1.0]]))
    with refuses(ValueError, "state"):
        simulate(ball, [0.0, 1.0])
    with refuses(ValueError, "state"):
        simulate(ball, [0.0, 1.0], BallState())
    with refuses(TypeError, "about_e1"):
        TiltingPlane(about_e1=0.1)
    assert TiltingPlane(ConstantRate(0.1)).driven == ()
