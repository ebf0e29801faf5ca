"""What jumps as a run ends is told from before: it is what a run that ends a little earlier tells of its end."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import (
    Ball,
    BallState,
    CarriedMass,
    Circle,
    Contact,
    Disk,
    DiskState,
    Driven,
    FollowSchedules,
    FunctionForce,
    Hinge,
    Mechanism,
    Motor,
    OnRail,
    PiecewiseAcceleration,
    PiecewiseSignal,
    PointMass,
    load_run,
    simulate,
)
from jaxball.numerics.kinks import just_before
from jaxball.physics.sensors import Accelerometer
from jaxball.plot.coordinates import accelerations
from jaxball.simulation.ensemble import simulate_ensemble
from jaxball.simulation.one_sided import with_one_sided_limits
from jaxball.studies.design.problem.run import Run
from tests.support.differences import jacobian

END, LITTLE = 1.0, 1e-9
SHELL = {"mass": 1.0, "inertia": (0.5, 0.6, 0.7)}
STEPS = PiecewiseSignal([0.0, 0.4, END], [0.3, -0.5])
PUSHED = PiecewiseAcceleration(0.0, [0.0, 0.4, END], [[1.0], [-1.5]])


def gust(t, parameters):
    """A wind that stops."""
    return jnp.where(t < END, 1.0, 0.0) * jnp.array([0.2, 0.1, 0.0])


def robot(drive):
    pendulum = Mechanism([Hinge((0.0, 1.0, 0.0), drive=drive)], [CarriedMass(0.3, (0.0, 0.0, -0.5))])
    return Ball(**SHELL, mechanisms=[pendulum])


RAIL = Circle(0.5)
SYSTEMS = {
    "motor": (robot(Motor(STEPS)), BallState(theta=[0.1], thetadot=[0.0])),
    "schedule": (Ball(**SHELL, masses=[PointMass(0.4, OnRail(RAIL, PUSHED))]), BallState()),
    "law": (
        Ball(**SHELL, masses=[PointMass(0.4, Driven(RAIL))], law=FollowSchedules((PUSHED,))),
        BallState(theta=[0.0], thetadot=[0.0]),
    ),
}


@pytest.mark.long
def test_the_end_is_that_of_a_run_that_ends_a_little_earlier():
    """Of a robot of which at the end the torque of a motor, the acceleration of a mass on its way, that of one that
    a law drives, and the wind jump together.
    """
    pendulum = Mechanism([Hinge((0.0, 1.0, 0.0), drive=Motor(STEPS))], [CarriedMass(0.3, (0.0, 0.0, -0.5))])
    system = Ball(
        **SHELL,
        masses=[PointMass(0.4, OnRail(RAIL, PUSHED)), PointMass(0.2, Driven(RAIL))],
        mechanisms=[pendulum],
        law=FollowSchedules((PUSHED,)),
        force=FunctionForce(gust, None, (END,)),
    )
    start = BallState(theta=[0.0, 0.1], thetadot=[0.0, 0.0])
    run, earlier, beyond = (simulate(system, np.array([0.0, 0.5, END + by]), start) for by in (0.0, -LITTLE, LITTLE))
    for of in ("joint_efforts", "friction", "normal_force", "power"):
        ends = [np.asarray(getattr(one.observables, of))[-1] for one in (run, earlier, beyond)]
        np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-7)
        assert np.max(np.abs(ends[0] - ends[2])) > 0.01  # it does jump there


def agrees(efforts):
    np.testing.assert_allclose(efforts[:, 0], [0.3, -0.5, -0.5], rtol=0, atol=1e-12)


@pytest.mark.slow
def test_a_motor_has_the_last_step_at_the_end_wherever_it_is_looked_at(tmp_path):
    system, start = SYSTEMS["motor"]
    times = np.array([0.0, 0.5, END])
    run = simulate(system, times, start)
    agrees(run.observables.joint_efforts)
    agrees(run.to_dataset()["joint_efforts"].values)
    again = load_run(run.save(tmp_path / "run.npz"), system)
    agrees(again.observables.joint_efforts)
    sliding = simulate(system, times, start, contact=Contact(friction=0.9))
    agrees(sliding.observables.joint_efforts)
    starts = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), start)
    ensemble = simulate_ensemble(system, times, starts, in_axes=(None, 0))
    agrees(ensemble.trajectory.observables.joint_efforts[0])
    agrees(ensemble.trajectory.observables.joint_efforts[1])
    designed = Run(system, jnp.asarray(times), run.state, run.status)
    agrees(designed.observables.joint_efforts)
    agrees(designed.joint_efforts)


@pytest.mark.thorough
def test_the_end_of_a_figure_of_accelerations():
    system, start = SYSTEMS["schedule"]
    run = simulate(system, np.array([0.0, 0.5, END]), start)
    assert accelerations(run)[1][1][-1] == 1.5
    driven, start = SYSTEMS["law"]
    assert accelerations(simulate(driven, np.array([0.0, 0.5, END]), start))[1][1][-1] == 1.5


@pytest.mark.parametrize(
    ("kinks", "end", "expected"),
    [
        ([0.5, 1.0], 1.0, np.nextafter(1.0, 0)),
        ([0.3], 0.1 + 0.2, np.nextafter(0.3, 0)),  # sums of numbers are rounded
        ([0.5, 1.1, np.inf], 1.0, 1.0),
        ([1.0 - 1e-9], 1.0, 1.0),
        ([], 1.0, 1.0),
    ],
)
def test_where_the_end_is_looked_at(kinks, end, expected):
    kinks, end = jnp.asarray(kinks, float), jnp.asarray(end)
    assert float(just_before(kinks, end)) == expected
    assert float(jax.grad(lambda end: just_before(kinks, end))(end)) == 1.0


@pytest.mark.slow
def test_what_bends_at_the_end_needs_no_more_than_its_own_derivative():
    """N at the end of a disk that is pushed to there, against differences of runs, of the times of the last piece."""

    def last(height, end):
        push = PiecewiseAcceleration(0.0, jnp.stack([0.0, end]), jnp.stack([height])[:, None])
        disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.4, OnRail(RAIL, push))])
        return simulate(disk, jnp.stack([0.0, 0.5 * end, end]), DiskState()).observables.normal_force[-1]

    given = jnp.array([1.0, 1.0])
    found = jaxball.jit(jax.jacrev(lambda x: last(*x)))(given)
    np.testing.assert_allclose(found, jacobian(lambda x: last(*x), given, 1e-5, points=2), atol=1e-6)


@pytest.mark.parametrize("end", [1e-20, 1e-60, 1e-120])
def test_a_run_may_be_as_short_as_a_unit_of_time_makes_it(end):
    """A disk that rolls freely, z = v t with v = 1 / end."""
    run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, end / 4, end], DiskState(phidot=-1 / end))
    assert run.ok
    np.testing.assert_allclose(run.state.z, [0.0, 0.25, 1.0], rtol=1e-12)


def test_what_ends_a_mode_by_a_jump_is_told_from_before_as_the_mode_is():
    """A wheel at rest with its pendulum, whose motor jumps to 6 at t = 1: friction of 0.3 cannot hold it from then on.

    Where it rolls, as it is said to do at the time of the jump, nothing acts but its weight; just after, it slides.
    """
    motor = Motor(PiecewiseSignal([0.0, 1.0, 2.0], [0.0, 6.0]))
    arm = jaxball.planar_pendulum(0.5, 0.3, drive=motor)
    wheel = Disk(mass=1.0, inertia=0.05, radius=0.3, gravity=9.81, mechanisms=[arm])
    times = np.array([0.0, 0.5, 1.0, 1.0 + 1e-3])
    run = simulate(wheel, times, DiskState(theta=[0.0], thetadot=[0.0]), contact=Contact(0.3))
    np.testing.assert_allclose(run.switches.times[0], 1.0, rtol=1e-12)
    np.testing.assert_array_equal(run.contact.mode, [0, 0, 0, 1])
    seen = run.observables
    np.testing.assert_allclose(seen.joint_efforts[:, 0], [0.0, 0.0, 0.0, 6.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(seen.normal_force[:3], 1.5 * 9.81, rtol=1e-12)
    np.testing.assert_allclose(seen.friction_ratio, [0.0, 0.0, 0.0, 0.3], rtol=0, atol=1e-9)
    felt = run.measured({"centre": Accelerometer()})["centre"]
    np.testing.assert_allclose(felt[:3], np.tile([0.0, 0.0, 9.81], (3, 1)), rtol=0, atol=1e-9)
    # A figure has both sides, in two rows of the same time, a rounding after the jump.
    both = with_one_sided_limits(run)
    efforts = both.observables.joint_efforts[:6, 0]
    np.testing.assert_array_equal(both.contact.mode[:6], [0, 0, 0, 0, 1, 1])
    np.testing.assert_allclose(efforts, [0.0, 0.0, 0.0, 0.0, 6.0, 6.0], rtol=0, atol=1e-12)
    # Without a law of contact no mode ends, and the row is of the later side.
    rolling = simulate(wheel, times, DiskState(theta=[0.0], thetadot=[0.0]))
    np.testing.assert_allclose(rolling.observables.joint_efforts[:, 0], [0.0, 0.0, 6.0, 6.0], rtol=0, atol=1e-12)
