"""The mechanisms of rolling robots, where they put their masses: against SciPy's rotations and inertias of bodies."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxball
from tests.support.sentences import refuses

E1, E2, E3 = np.eye(3)
PIVOT, DIRECTION, AXIS = np.array([0.1, -0.2, 0.05]), np.array([0.3, -0.4, -2.0]), np.array([0.2, 1.0, -0.3])
DOWN = DIRECTION / np.linalg.norm(DIRECTION)


def turn(axis, angle):
    return Rotation.from_rotvec(angle * np.asarray(axis) / np.linalg.norm(axis))


def placed(mechanism, *theta):
    return np.asarray(mechanism.places(jnp.asarray(theta)).chi)


def inertia(masses, centre):
    """The tensor of inertia of point masses about a point."""
    return sum(
        item.mass * (jnp.dot(x, x) * jnp.eye(3) - jnp.outer(x, x))
        for item, x in ((item, item.place - jnp.asarray(centre)) for item in masses)
    )


def assert_close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def test_planar_pendulum():
    robot = jaxball.planar_pendulum(0.5, 0.6, axis=AXIS, direction=DIRECTION, pivot=PIVOT)
    assert_close(placed(robot, 0.7), [PIVOT + turn(AXIS, 0.7).apply(0.6 * DOWN)])


def test_spherical_pendulum_turns_about_the_second_axis_and_then_about_the_first():
    robot = jaxball.spherical_pendulum(0.5, 0.6, axes=(AXIS, E1), direction=DIRECTION, pivot=PIVOT)
    assert_close(placed(robot, 0.7, -0.4), [PIVOT + (turn(AXIS, 0.7) * turn(E1, -0.4)).apply(0.6 * DOWN)])


def test_double_pendulum_has_its_second_angle_from_the_first_rod():
    robot = jaxball.physics.double_pendulum((0.5, 0.2), (0.4, 0.3), axis=AXIS, direction=DIRECTION, pivot=PIVOT)
    inner = PIVOT + turn(AXIS, 0.7).apply(0.4 * DOWN)
    assert_close(placed(robot, 0.7, -0.4), [inner, inner + turn(AXIS, 0.3).apply(0.3 * DOWN)])
    assert_close(robot.mass, (0.5, 0.2))


def test_mass_in_tube_moves_by_lengths():
    robot = jaxball.physics.mass_in_tube(0.1, DIRECTION, centre=PIVOT)
    assert_close(placed(robot, 0.3), [PIVOT + 0.3 * DOWN])


@pytest.mark.thorough
def test_turning_rail_carries_its_mass():
    rail = jaxball.Circle(0.5, centre=(0.1, 0.0, 0.2))
    robot = jaxball.physics.turning_rail(0.6, rail, axis=AXIS, pivot=PIVOT)
    on_rail = np.asarray(rail(jnp.asarray(-0.4)))
    assert_close(placed(robot, 0.7, -0.4), [PIVOT + turn(AXIS, 0.7).apply(on_rail - PIVOT)])


@pytest.mark.thorough
@pytest.mark.parametrize("axis", [E3, -E3, E1, DIRECTION])
@pytest.mark.parametrize("count", [3, 4, 7])
def test_ring_rotor_has_the_moments_of_a_ring(axis, count):
    """m R² about its axis and half of that across it, with the centre of mass on it."""
    m, radius = 0.3, 0.4
    robot = jaxball.ring_rotor(m, radius, axis=axis, centre=PIVOT, count=count)
    n = axis / np.linalg.norm(axis)
    assert_close(jnp.sum(robot.mass), m)
    assert_close(robot.mass @ robot.place / m, PIVOT)
    assert_close(inertia(robot.masses, PIVOT), m * radius**2 / 2 * (np.eye(3) + np.outer(n, n)))
    assert_close(placed(robot, 0.3), PIVOT + turn(n, 0.3).apply(np.asarray(robot.place) - PIVOT))


@pytest.mark.parametrize("axis", [E3, -E3, DOWN])
def test_a_ring_turns_with_its_axis(axis):
    """The derivative of its moments, which no choice of the first mass's place may break."""
    slope = np.cross(axis, AXIS)

    def moments(axis):
        return inertia(jaxball.ring_rotor(2.0, 1.0, axis=axis).masses, np.zeros(3))

    found = jax.jvp(moments, (jnp.asarray(axis),), (jnp.asarray(slope),))[1]
    assert_close(found, np.outer(slope, axis) + np.outer(axis, slope))


def test_gyroscopic_pendulum_is_a_ring_about_its_rod():
    robot = jaxball.physics.gyroscopic_pendulum(
        0.5, 0.6, 0.3, axes=(AXIS, E1), direction=DIRECTION, pivot=PIVOT, count=4
    )
    centre = PIVOT + 0.6 * DOWN
    assert_close(inertia(robot.masses, centre), 0.5 * 0.3**2 / 2 * (np.eye(3) + np.outer(DOWN, DOWN)))
    swung, spun = turn(AXIS, 0.7) * turn(E1, -0.4), turn(DOWN, 2.0)
    expected = PIVOT + swung.apply(0.6 * DOWN + spun.apply(np.asarray(robot.place) - centre))
    assert_close(placed(robot, 0.7, -0.4, 2.0), expected)


BODIES = {"solid": (0.3, 0.4, 0.5), "disk": (0.2, 0.2, 0.4), "rod": (0.1, 0.0, 0.1), "point": (0.0, 0.0, 0.0)}


@pytest.mark.parametrize("moments", BODIES.values(), ids=BODIES)
def test_a_rigid_body_has_its_moments(moments):
    q = (0.9, 0.2, -0.1, 0.3)
    masses = jaxball.rigid_body_masses(0.7, moments, centre=PIVOT, frame=jaxball.physics.VersorFrame(q), joint=1)
    axes = Rotation.from_quat(np.roll(q, -1)).as_matrix()
    assert_close(sum(item.mass for item in masses), 0.7)
    assert_close(sum(item.mass * item.place for item in masses) / 0.7, PIVOT)
    assert_close(inertia(masses, PIVOT), axes @ np.diag(moments) @ axes.T)
    assert {item.joint for item in masses} == {1}


@pytest.mark.parametrize("moments", BODIES.values(), ids=BODIES)
def test_flat_bodies_have_derivatives(moments):
    """Where a_k is 0, it has none by d_k; by the mass, the sums of the places alone must be numbers."""

    def spread(mass):
        return sum(jnp.dot(item.place, item.place) for item in jaxball.rigid_body_masses(mass, moments))

    assert_close(jax.grad(spread)(jnp.asarray(2.0)), -3 * sum(moments) / 4)


def test_moments_that_no_body_has():
    with refuses(ValueError, "inertia"):
        jaxball.rigid_body_masses(0.7, (0.1, 0.1, 0.3))
    traced = jax.jit(lambda d: jaxball.rigid_body_masses(0.7, d)[0].place)(jnp.asarray([0.1, 0.1, 0.3]))
    assert np.all(np.isnan(traced))


def test_what_a_robot_cannot_be_made_of(no_type_checks):
    with refuses(ValueError, "drives"):
        jaxball.spherical_pendulum(0.5, 0.6, drives=(None, None, None))
    with refuses(TypeError, "drives"):
        jaxball.physics.gyroscopic_pendulum(0.5, 0.6, 0.3, drives=None)  # pyright: ignore
    with refuses(ValueError, "count"):
        jaxball.ring_rotor(0.3, 0.4, count=2)
    with refuses(TypeError, "rail"):
        jaxball.physics.turning_rail(0.6, jaxball.ConstantRate(0.0))  # pyright: ignore
