"""A ball on a plate whose angles feedback drives: schedules, linearised equations, regulators."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

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
    TiltingPlane,
    problems,
    simulate,
    vector_field,
)
from jaxball.control import closed_loop, tvlqr
from jaxball.plot.floor import place
from jaxball.plot.record import record

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
    held = closed_loop(track, BallState(**first, z=state.z[0] + 1e-3))
    assert held.ok
    return np.linalg.norm(np.asarray(held.states.z) - np.asarray(state.z), axis=1), held


@pytest.mark.thorough
def test_regulator_holds_a_ball_in_the_middle():
    plate = TiltingPlane(about_e1=ConstantRate(0.0), about_e2=ConstantRate(0.0))
    run = simulate(Ball(**SOLID, ground=plate), [0.0, 6.0])
    track = tvlqr(run, Q={"z": 10.0, "theta": 1.0}, R=1e-3, sample=0.05)
    assert track.sampled.inputs == ("ground.about_e1", "ground.about_e2")
    left, held = from_beside(track)
    assert left[0] > 1e-3
    assert np.max(left[-20:]) < 1e-7
    np.testing.assert_allclose(held.run.observables.normal_force, G, rtol=1e-3)


@pytest.mark.thorough
def test_regulator_holds_a_ball_on_a_circle():
    """Along a circle that prescribed angles make, the regulator brings a ball nearer that starts beside it.

    With α₂ = −a cos wt and α₁ = a sin wt, ẍ = (5/7) g α₂ − r α̈₂ and ÿ = −(5/7) g α₁ + r α̈₁ are solved by x = b cos wt,
    y = b sin wt, with b w² = a ((5/7) g + r w²), for small a. What is left is forced by a deviation of the spin, which
    the regulator finds to be uncontrollable.
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
    track = tvlqr(run, Q={"z": 10.0, "theta": 1.0}, R=1e-3, sample=0.05)
    assert track.uncontrollable
    left, _ = from_beside(track)
    assert np.max(left[-60:]) < 0.22 * left[0]


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
    assert any("`ground.about_e1` must be" in sentence for sentence in problems(sideways))


def test_what_a_driven_plate_needs(no_type_checks):
    with pytest.raises(ValueError, match=r"one drives ground\.about_e1"):
        Ball(**SOLID, ground=TiltingPlane(Accelerated()))
    ball = Ball(**SOLID, ground=TiltingPlane(Accelerated()), law=LinearLaw(theta=[[-1.0]]))
    with pytest.raises(ValueError, match=r"must be given, because it holds the angles of ground\.about_e1"):
        simulate(ball, [0.0, 1.0])
    with pytest.raises(ValueError, match=r"1 entries in theta and in thetadot, those of ground\.about_e1"):
        simulate(ball, [0.0, 1.0], BallState())
    with pytest.raises(TypeError, match=r"Accelerated\(\) for a law"):
        TiltingPlane(about_e1=0.1)
    assert TiltingPlane(ConstantRate(0.1)).driven == ()
