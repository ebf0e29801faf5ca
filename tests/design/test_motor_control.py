"""Optimal control by the torques of motors, and by accelerations of joints."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.simulation.equilibrium import imbalance
from jaxball.studies import design
from jaxball.studies.design import optimal_control
from jaxball.studies.design.problem.run import Run
from tests.support.sentences import refuses

END, PLACE = 6.0, -1.0
SLOPE, MASS, LENGTH = np.radians(5.0), 0.8, 0.6
LEAN = np.arcsin((1.0 + MASS) * np.sin(SLOPE) / (MASS * LENGTH))  # M r sin a = m l sin(lean), from the vertical
MESH = np.linspace(0.0, END, 9)


def climber(drive):
    pendulum = jaxball.planar_pendulum(MASS, LENGTH, drive=drive)
    return jaxball.Disk(mass=1.0, inertia=0.5, mechanisms=[pendulum], ground=jaxball.Ground(angle=SLOPE))


def climb(drive, theta, **constraints):
    state = jaxball.DiskState(theta=theta, thetadot=np.zeros(len(theta)))
    objectives = {"effort": design.JointEffort()}
    return optimal_control.Rolling(climber(drive), (0.0, END), objectives, state, place=PLACE, constraints=constraints)


@pytest.fixture(scope="module")
def driven():
    """Up a slope, by the torque on a pendulum."""
    return climb(jaxball.Motor(0.0), [LEAN - SLOPE]).solve(MESH)


@pytest.mark.long
def test_a_pendulum_holds_a_disk_on_a_slope(driven):
    """The pendulum at the angle and with the torque m g l sin(lean) of its closed form."""
    robot = climber(jaxball.Motor(0.0))
    left = imbalance(robot.prepare(), jnp.asarray(0.0), jaxball.DiskState(theta=[LEAN - SLOPE], thetadot=[0.0]))
    np.testing.assert_allclose(left.torque, 0.0, atol=1e-15)
    np.testing.assert_allclose(left.beside, 0.0, atol=1e-15)
    torque = MASS * LENGTH * np.sin(LEAN)
    np.testing.assert_allclose(left.efforts, -torque, rtol=1e-14)
    np.testing.assert_allclose(driven.holding(), torque, rtol=1e-9)


def test_balanced_on_a_slope_is_on_the_vertical_through_the_contact_point():
    """At right angles to the plane, the pendulum leaves the centre of mass beside it by (r − m l / M) tan a."""
    states = jaxball.DiskState(
        phi=np.zeros(2), phidot=np.zeros(2), z=np.zeros(2), theta=[[LEAN - SLOPE], [0.0]], thetadot=np.zeros((2, 1))
    )
    beside = jax.jit(
        lambda k: design.Balanced()(
            Run(
                climber(jaxball.Motor(0.0)),
                jnp.zeros(1),
                jax.tree.map(lambda leaf: leaf[k][None], states),
                jnp.asarray(0),
            )
        )
    )
    away = (1.0 - MASS * LENGTH / (1.0 + MASS)) * np.tan(SLOPE)
    np.testing.assert_allclose([beside(0), beside(1)], [0.0, away**2], atol=1e-16)


@pytest.mark.slow
def test_a_guess_on_a_slope_begins_and_ends_at_rest():
    """The pendulum's lean and the torque that holds it are those of the closed forms, at both ends."""
    target = design.FollowTrajectory(design.Through([[0.0, 0.0], [PLACE, 0.0]]), rest_to_rest=True)
    state = jaxball.DiskState(theta=[LEAN - SLOPE], thetadot=[0.0])
    slow = 20 * END
    problem = optimal_control.Rolling(climber(jaxball.Motor(0.0)), (0.0, slow), {"target": target}, state, place=PLACE)
    path = problem.rolling_along(np.linspace(0.0, slow, 41))
    ends = jax.vmap(problem.packing.unpack)(jnp.asarray([0.0, slow]), jnp.asarray(path.knots[[0, -1]]))
    np.testing.assert_allclose(ends.z, [0.0, PLACE], atol=1e-12)
    np.testing.assert_allclose(ends.theta[:, 0] - ends.phi, LEAN - SLOPE, atol=1e-6)
    torque = MASS * LENGTH * np.sin(LEAN)
    np.testing.assert_allclose(path.controls[[0, -1], [0, -1], 0], torque, rtol=1e-3)


@pytest.mark.long
def test_motors_take_it_there_and_it_stays(driven):
    """By a simulation that knows of torques and not of controls, for twice as long."""
    scenario = driven.scenario()
    times = np.linspace(0.0, 2 * END, 201)
    run = jaxball.simulate(scenario.system, times, scenario.state, rtol=1e-11, atol=1e-11, throw=True)
    rest = times >= END
    np.testing.assert_allclose(run.state.z[rest], PLACE, atol=1e-5)
    np.testing.assert_allclose(run.state.theta[rest, 0], LEAN - SLOPE + run.state.phi[rest], atol=1e-5)
    found = driven.places(times[~rest])
    np.testing.assert_allclose(run.state.z[~rest], found, atol=1e-5)
    seen = driven.resimulate()
    assert max(seen.apart, seen.speed, seen.away, seen.missed) < 1e-5


@pytest.mark.slow
def test_a_joint_that_is_accelerated_finds_the_same_torque(driven):
    """The same optimum by another control, θ̈ of a joint that has a schedule, and its effort."""
    other = climb(jaxball.ConstantRate(LEAN - SLOPE), []).solve(MESH)
    times = np.linspace(0.0, END, 41)
    np.testing.assert_allclose(other.places(times), driven.places(times), atol=1e-5)
    np.testing.assert_allclose(other.means()["effort"], driven.means()["effort"], rtol=1e-6)
    run = other.scenario().simulate(rtol=1e-11, atol=1e-11, throw=True)
    torque = jax.vmap(driven.signals()[0])(run.times[:-1])
    np.testing.assert_allclose(run.observables.joint_efforts[:-1, 0], torque, atol=1e-4)


@pytest.mark.slow
def test_a_rotor_rolls_a_disk_as_a_double_integrator_does():
    """(D − C + M r²) z̈ = −r Q, with D − C the shell's inertia: Q = −6 (D − C + M r²) z (1 − 2 t/T) / (r T²).

    The rotor stops when the disk does, and the centre of mass is never beside the centre: conditions at the end
    repeat each other, and are regular with some softness.
    """
    m, size, inertia = 0.5, 0.6, 0.7
    rotor = jaxball.ring_rotor(m, size, axis=(0.0, 1.0, 0.0), drive=jaxball.Motor(0.0))
    disk = jaxball.Disk(mass=1.0, inertia=inertia, mechanisms=[rotor])
    start = jaxball.DiskState(theta=[0.0], thetadot=[0.0])
    problem = optimal_control.Rolling(disk, (0.0, END), {"effort": design.JointEffort()}, start, PLACE, softness=1e-7)
    found = problem.solve(MESH)
    times = np.linspace(0.0, END, 21)[:-1]
    torque = -6 * (inertia + (1.0 + m)) * PLACE * (1 - 2 * times / END) / END**2
    np.testing.assert_allclose(jax.vmap(found.signals()[0])(times), torque, atol=1e-8)


@pytest.mark.slow
def test_a_limit_holds_and_is_kept(driven):
    """A motor has its limit again in the scenario, which cuts off next to nothing: the simulation is the solution."""
    free = np.max(np.abs(driven.path.controls))
    limit = 0.95 * free
    problem = climb(jaxball.Motor(0.0, limit=limit) + jaxball.Damper(0.0), [LEAN - SLOPE])
    found = problem.solve(MESH).sharpen()
    largest = np.max(np.abs(found.scenario().system.mechanisms[0].drives[0].terms[0].signal(jnp.asarray(0.0))))
    unit, allowed = 1.0 + MASS, 1e-5  # a tenth of what constraints may be violated by
    assert limit * (1 - 1e-5) < largest < limit + allowed * unit
    seen = found.resimulate()
    assert seen.violations["motor-limits"] < allowed
    assert max(seen.apart, seen.speed, seen.away, seen.missed) < 1e-5


@pytest.mark.slow
def test_a_rotor_with_a_limit_has_the_least_effort_that_the_limit_allows():
    """Of ẍ = u over lengths and times of 1, |u| ≤ U: u is U, falls linearly to −U within 2 σ, and stays, with
    σ² = 3 (1/4 − 1/U) and ∫ u² = U² (1 − 4 σ/3). Here Q = −(D − C + M r²) z u / (r T²), in units of M g r.
    """
    m, size, inertia, U = 0.5, 0.6, 0.7, 4.5
    scale = (inertia + (1.0 + m)) / END**2
    rotor = jaxball.ring_rotor(m, size, axis=(0.0, 1.0, 0.0), drive=jaxball.Motor(0.0, limit=U * scale))
    disk = jaxball.Disk(mass=1.0, inertia=inertia, mechanisms=[rotor])
    start = jaxball.DiskState(theta=[0.0], thetadot=[0.0])
    problem = optimal_control.Rolling(disk, (0.0, END), {"effort": design.JointEffort()}, start, PLACE, softness=1e-7)
    found = problem.solve(MESH).sharpen()
    least = U**2 * (1 - 4 * np.sqrt(3 * (1 / 4 - 1 / U)) / 3) * (scale / (1.0 + m)) ** 2
    # The barrier adds at most 1e-8 of each inequality to an effort of 0.027, and its slack is 1e-8 over its multiplier.
    assert found.means()["effort"] == pytest.approx(least, rel=1e-6)
    assert np.max(np.abs(found.path.controls)) == pytest.approx(U * scale, rel=1e-6)
    seen = found.resimulate()
    assert seen.violations["motor-limits"] < 1e-5
    assert max(seen.apart, seen.speed, seen.away, seen.missed) < 1e-5


def test_limits_of_motors_are_constraints():
    limited = climb(jaxball.Motor(0.3, limit=0.5) + jaxball.Damper(0.1), [0.0])
    assert list(limited.constraints) == ["motor-limits"]
    given = limited.with_schedules(signals=[jaxball.Motor(0.2).signal]).mechanisms[0].drives[0]
    assert [type(term).__name__ for term in given.terms] == ["Motor", "Damper"]
    np.testing.assert_array_equal([given.terms[0].signal.value, given.terms[0].limit], [0.2, 0.5])
    off = limited.system.mechanisms[0].drives[0].terms[0]
    assert float(off.signal.value) == 0.0
    assert off.limit is None


def test_what_cannot_be_controlled():
    hinge = jaxball.planar_pendulum(0.5, 0.5, drive=jaxball.Motor(0.0) + jaxball.Motor(1.0))
    twice = jaxball.Disk(mass=1.0, inertia=0.5, mechanisms=[hinge])
    state = jaxball.DiskState(theta=[0.0], thetadot=[0.0])
    with refuses(design.DesignError, "system"):
        optimal_control.Rolling(twice, (0.0, 1.0), {}, state)
    with refuses(ValueError, "state"):
        optimal_control.Rolling(climber(jaxball.Motor(0.0)), (0.0, 1.0), {})
    table = jaxball.Ground(turntable=jaxball.Turntable(jaxball.ConstantRate(0.0, rate=1.0)))
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=table, mechanisms=[jaxball.planar_pendulum(0.5, 0.5)])
    with refuses(design.DesignError, "system"):
        optimal_control.Rolling(ball, (0.0, 1.0), {}, jaxball.BallState(theta=[0.0], thetadot=[0.0]))
