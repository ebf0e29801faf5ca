"""Sentences for mechanisms, grounds and resistances that cannot be, and for states that are not theirs."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import CarriedMass, Hinge, Mechanism, Slider
from tests.support.sentences import refuses, said

SHELL = {"mass": 1.0, "inertia": (0.4, 0.45, 0.5)}
BOB = CarriedMass(0.5, (0.0, 0.0, -0.6))
SWINGING = jaxball.BallState(theta=[0.3], thetadot=[0.0])


def hinge(axis=(0.0, 1.0, 0.0), drive=None, on=None):
    return Hinge(axis, drive=drive, on=on)


@pytest.mark.thorough
def test_joints_start_at_0_where_no_state_is_given():
    """As in files; what a law drives has a start that it follows from, which must be given."""
    spring = hinge(drive=jaxball.Spring(stiffness=0.1, rest=0.3))
    ball = jaxball.Ball(**SHELL, mechanisms=[Mechanism([spring, hinge((1.0, 0.0, 0.0))], [BOB])])
    run, given = (
        jaxball.simulate(ball, [0.0, 0.5], state)
        for state in (None, jaxball.BallState(theta=[0.0, 0.0], thetadot=[0.0, 0.0]))
    )
    assert run.ok
    assert run.start.theta.tolist() == [0.0, 0.0]
    np.testing.assert_array_equal(run.state.theta, given.state.theta)
    assert abs(run.state.theta[1, 0]) > 1e-3
    driven = Mechanism([hinge(drive=jaxball.Accelerated())], [BOB])
    law = jaxball.FunctionLaw(lambda t, state, _: jnp.zeros(1))
    with refuses(ValueError, "mechanisms[0].joints[0]"):
        jaxball.simulate(jaxball.Ball(**SHELL, mechanisms=[driven], law=law), [0.0, 0.5])


@pytest.mark.parametrize(
    ("make", "kind", "named"),
    [
        (lambda: Mechanism([hinge(), hinge()], [CarriedMass(0.5, joint=0)]), ValueError, "joints[1]"),
        (lambda: Mechanism([hinge(on=1), hinge(on=0)], [BOB]), ValueError, "joints[0].on"),
        (lambda: Mechanism([hinge()], [CarriedMass(0.5, joint=1)]), ValueError, "masses[0].joint"),
        (lambda: Mechanism([BOB], [BOB]), TypeError, "joints[0]"),
        (lambda: hinge(drive=3.0), TypeError, "drive"),
        (lambda: jaxball.Motor("fast"), TypeError, "signal"),
        (lambda: jaxball.PiecewiseSignal([0.0, 1.0], [1.0, 2.0]), ValueError, "values"),
        (lambda: jaxball.Ground(motion=3.0), TypeError, "motion"),
        (lambda: jaxball.Turntable(2.0), TypeError, "turning"),
        (lambda: jaxball.Ball(**SHELL, ground=0.1), TypeError, "ground"),
        (lambda: jaxball.Ball(**SHELL, mechanisms=[hinge()]), TypeError, "mechanisms[0]"),
        (
            lambda: jaxball.Ball(**SHELL, mechanisms=[Mechanism([hinge(drive=jaxball.Accelerated())], [BOB])]),
            ValueError,
            "law",
        ),
        (
            lambda: jaxball.Disk(
                mass=1.0, inertia=0.5, ground=jaxball.Ground(turntable=jaxball.Turntable(jaxball.ConstantRate(0.0)))
            ),
            ValueError,
            "ground",
        ),
    ],
)
@pytest.mark.usefixtures("no_type_checks")
def test_what_cannot_be_made(make, kind, named):
    with refuses(kind, named):
        make()


def ball(drive=None, **parts):
    return jaxball.Ball(**SHELL, mechanisms=[Mechanism([hinge(drive=drive)], [BOB])], **parts)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("system", "named"),
    [
        (ball(jaxball.Damper(-0.1)), "mechanisms[0].joints[0].drive.coefficient"),
        (ball(jaxball.Spring(1.0) + jaxball.Damper(-0.1)), "joints[0].drive.terms[1].coefficient"),
        (ball(jaxball.Motor(1.0, limit=-1.0)), "joints[0].drive.limit"),
        (ball(jaxball.EndStops(1.0, -1.0, stiffness=1.0)), "drive.lower"),
        (ball(resistance=jaxball.Resistance(rolling=-0.1)), "resistance.rolling"),
        (ball(resistance=jaxball.Resistance(dry=0.1, smoothing=0.0)), "resistance.smoothing"),
        (ball(ground=jaxball.Ground(angle=2.0)), "ground.angle"),
    ],
)
def test_numbers_that_cannot_be(system, named):
    """test_failed_solves has it that such a run does not start."""
    (problem,) = jaxball.problems(system, SWINGING)
    said(problem, named)


@pytest.mark.thorough
def test_what_is_allowed_if_it_is_said():
    system = ball(jaxball.Damper(-0.1, negative=True), resistance=jaxball.Resistance(rolling=-0.1, negative=True))
    assert jaxball.problems(system, SWINGING) == []


@pytest.mark.thorough
def test_joints_whose_inertia_is_singular_are_named():
    on_the_axis = Mechanism([hinge()], [CarriedMass(0.5, (0.0, 0.3, 0.0))])
    (problem,) = jaxball.problems(jaxball.Ball(**SHELL, mechanisms=[on_the_axis]), SWINGING)
    said(problem, "mechanisms[0].joints[0]")
    pendulum = jaxball.Ball(**SHELL, mechanisms=[jaxball.spherical_pendulum(0.5, 0.6)])
    aligned = jaxball.BallState(theta=[0.0, np.pi / 2], thetadot=[0.0, 0.0])
    (problem,) = jaxball.problems(pendulum, aligned)
    said(problem, "mechanisms[0].joints[0]")
    assert jaxball.problems(pendulum, jaxball.BallState(theta=[0.0, 1.5], thetadot=[0.0, 0.0])) == []


def test_states_need_the_angles_of_joints():
    with refuses(ValueError, "state"):
        jaxball.simulate(ball(), [0.0, 1.0], jaxball.BallState())


@pytest.mark.thorough
def test_a_reduced_ball_knows_no_ground():
    reduced = jaxball.physics.ReducedState(theta=[0.3], thetadot=[0.0])
    with refuses(ValueError, "ground"):
        jaxball.simulate(ball(ground=jaxball.Ground(angle=0.1)), [0.0, 1.0], reduced)
    slowed = ball(resistance=jaxball.Resistance(rolling=0.1, dry=0.05))
    full = jaxball.simulate(slowed, [0.0, 1.0], SWINGING).state
    found = jaxball.simulate(slowed, [0.0, 1.0], reduced).state
    np.testing.assert_allclose(found.theta, full.theta, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.Omega, full.Omega, rtol=0, atol=1e-9)


@pytest.mark.long
def test_a_mass_that_a_force_pushes_out_is_told():
    pushed = jaxball.Ball(
        **SHELL, mechanisms=[jaxball.physics.mass_in_tube(0.5, (1.0, 0.0, 0.0), drive=jaxball.Motor(1.0))]
    )
    run = jaxball.simulate(pushed, np.linspace(0.0, 1.0, 11), jaxball.BallState(theta=[0.9], thetadot=[0.0]))
    assert run.status == jaxball.Status.LEFT_SHELL
    said(run.message, "mechanisms[0]")
    stops = jaxball.Motor(1.0) + jaxball.EndStops(-0.9, 0.9, stiffness=1e3, damping=1.0)
    held = jaxball.Ball(**SHELL, mechanisms=[jaxball.physics.mass_in_tube(0.5, (1.0, 0.0, 0.0), drive=stops)])
    run = jaxball.simulate(held, np.linspace(0.0, 1.0, 11), jaxball.BallState(theta=[0.8], thetadot=[0.0]))
    assert run.ok


@pytest.mark.thorough
def test_a_prescribed_joint_is_looked_at_between_saved_times():
    """0.5 + 0.6 sin² t is over 1 between t = 1.13 and 2.01, and under it at all saved times."""
    swing = jaxball.Sinusoids(0.3, [-0.3], [2.0], [np.pi / 2])
    tube = jaxball.physics.mass_in_tube(0.5, (1.0, 0.0, 0.0), centre=(0.5, 0.0, 0.0), drive=swing)
    body = jaxball.Ball(**SHELL, mechanisms=[tube])
    (problem,) = jaxball.problems(body, jaxball.BallState(), t=[0.0, np.pi])
    said(problem, "mechanisms[0]")
    run = jaxball.simulate(body, [0.0, np.pi])
    assert run.status == jaxball.Status.LEFT_SHELL
    first = np.arcsin(np.sqrt(0.5 / 0.6))
    assert first <= run.reached <= first + np.pi / 256


@pytest.mark.thorough
def test_a_disk_turns_in_its_plane():
    aside = jaxball.Disk(mass=1.0, inertia=0.5, mechanisms=[jaxball.planar_pendulum(0.5, 0.6, axis=(1.0, 0.0, 0.0))])
    still = jaxball.DiskState(theta=[0.0], thetadot=[0.0])
    (problem,) = jaxball.problems(aside, still)
    said(problem, "mechanisms[0]")
    for ground in (jaxball.Ground(0.1, heading=0.5), jaxball.Ground(motion=jaxball.Free(sideways))):
        tilted = jaxball.Disk(mass=1.0, inertia=0.5, ground=ground)
        (problem,) = jaxball.problems(tilted, jaxball.DiskState(), t=[0.0, 1.0])
        said(problem)


def sideways(t, parameters):
    return jnp.stack([jnp.zeros_like(t), jnp.sin(t), jnp.zeros_like(t)])


@pytest.mark.long
def test_a_disk_with_mechanisms_rolls_like_the_ball_in_which_it_is_embedded():
    disk = jaxball.Disk(
        mass=1.0,
        inertia=0.5,
        mechanisms=[
            jaxball.physics.double_pendulum((0.3, 0.2), (0.4, 0.3)),
            Mechanism([Slider((1.0, 0.0, 0.3))], [CarriedMass(0.1)]),
        ],
        ground=jaxball.Ground(angle=0.1),
        resistance=jaxball.Resistance(rolling=0.05, drag=0.02),
    )
    start = jaxball.DiskState(phi=0.2, phidot=-0.3, theta=[0.4, -0.2, 0.1], thetadot=[0.1, 0.3, 0.0])
    flat = jaxball.simulate(disk, [0.0, 1.0], start).raise_if_failed().state
    space = jaxball.simulate(disk.embed(), [0.0, 1.0], start.in_space()).raise_if_failed().state
    np.testing.assert_allclose(flat.theta, space.theta, rtol=0, atol=1e-9)
    np.testing.assert_allclose(flat.z, space.z[:, 0], rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_a_servo_drives_a_mass_beside_a_free_joint():
    target = jaxball.ConstantRate(1.0)
    system = jaxball.Ball(
        **SHELL,
        masses=[jaxball.PointMass(0.1, jaxball.Driven(jaxball.Circle(0.5)))],
        mechanisms=[Mechanism([hinge()], [BOB])],
        law=jaxball.Servo((target,), stiffness=[9.0], damping=[6.0]),
    )
    start = jaxball.BallState(theta=[0.0, 0.3], thetadot=[0.0, 0.0])
    run = jaxball.simulate(system, [0.0, 2.0], start).raise_if_failed()
    exact = 1.0 - (1.0 + 3.0 * 2.0) * np.exp(-3.0 * 2.0)  # critically damped
    np.testing.assert_allclose(run.state.theta[-1, 0], exact, rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_an_event_at_a_joint_ends_a_run():
    hanging = jaxball.Event(first_angle, terminal=True)
    run = jaxball.simulate(ball(), [0.0, 5.0], SWINGING, events={"hangs": hanging})
    assert run.status == jaxball.Status.EVENT
    np.testing.assert_allclose(run.events["hangs"].state.theta[0], 0.0, rtol=0, atol=1e-9)


def first_angle(system, t, state):
    return state.theta[0]
