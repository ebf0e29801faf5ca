"""Objectives of motions that are known in closed form."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate

import jaxball
from jaxball.studies import design
from jaxball.studies.design.problem.run import Run
from tests.support.sentences import refuses

TIMES = np.linspace(0.0, 2.0, 201)
OMEGA = (0.3, 0.4, 0.0)
D, R, G = 0.4, 0.5, 2.0


def run(ball, state=None):
    trajectory = jaxball.simulate(ball, TIMES, state, rtol=1e-11, atol=1e-11)
    return Run(ball, jnp.asarray(TIMES), trajectory.state, trajectory.status)


@functools.cache
def rolling():
    """A uniform shell that rolls straight on: z = r t (Ω2, −Ω1)."""
    return run(jaxball.Ball(mass=1.0, inertia=(D, D, D), radius=R, gravity=G), jaxball.BallState(Omega=OMEGA))


@functools.cache
def driven():
    """A shell too heavy to be moved, in which a mass goes round a vertical circle of radius 0.3."""
    rail = jaxball.Circle(0.3)
    mass = jaxball.PointMass(1.0, jaxball.OnRail(rail, jaxball.Sinusoids(0.4, (0.5,), (3.0,))))
    return run(jaxball.Ball(mass=1e12, inertia=(1e12, 1e12, 1e12), radius=R, gravity=G, masses=[mass]))


def theta(t):
    """θ, θ̇ and θ̈ of the driven mass."""
    return 0.4 + 0.5 * np.sin(3 * t), 1.5 * np.cos(3 * t), -4.5 * np.sin(3 * t)


def force(t):
    """The force along the rail on the driven mass."""
    angle, _, acceleration = theta(t)
    return 0.3 * acceleration + G * np.cos(angle)


def mean(function):
    return scipy.integrate.quad(function, 0.0, TIMES[-1], epsabs=0.0, epsrel=1e-13)[0] / TIMES[-1]


VELOCITY = R * np.array([OMEGA[1], -OMEGA[0]])
END = VELOCITY * TIMES[-1]
SIDE = np.array([-VELOCITY[1], VELOCITY[0]]) / np.linalg.norm(VELOCITY)


def closed_forms():
    weight, second = (1e12 + 1) * G, np.sqrt(R / G)
    turn = np.linalg.norm(OMEGA) * TIMES[-1]
    post = VELOCITY * 1.0 + 0.3 * SIDE
    line = design.Through([[0.0, 0.0], END])
    beside = design.Through([0.2 * SIDE, END + 0.2 * SIDE])
    farther = design.Through([[0.0, 0.0], 2 * END])
    far = np.linalg.norm(END) / R
    return {
        "masses": (design.MassesNearCentre(), driven, (0.3 / R) ** 2),
        "place": (design.ReachPlace(END + 0.1), rolling, 0.02 / R**2),
        "pose": (design.ReachPose((2.0, 0.0, 0.0, 0.0)), rolling, np.sin(turn / 2) ** 2),
        "rest": (design.StopAtRest(), rolling, 0.5 * (D + R**2) * 0.25 / (G * R)),
        "far": (design.GoFar(), rolling, -far),
        "duration": (design.Duration(), rolling, 2.0 / np.sqrt(R / G)),
        "in time": (design.FollowTrajectory(line), rolling, 0.0),
        "beside in time": (design.FollowTrajectory(beside), rolling, 0.04 / R**2),
        "twice as fast": (design.FollowTrajectory(farther), rolling, far**2 / 3),
        "beside": (design.FollowCurve(beside), rolling, 2 * 0.04 / R**2),
        # Half of the curve is left out; its mean squared distance from the end of the path is far² / 3.
        "half": (design.FollowCurve(farther), rolling, far**2 / 6),
        "largest distance": (design.LargestDistance(beside), rolling, 0.2 / R),
        # Half of the curve is left out, up to its end.
        "largest distance of half": (design.LargestDistance(farther), rolling, far),
        "post": (
            design.AvoidObstacles([post], [0.2], 0.3),
            rolling,
            mean(lambda t: np.log1p(np.exp((0.2 - np.linalg.norm(VELOCITY * t - post)) / R / 0.3)) ** 2),
        ),
        "acceleration": (design.AccelerationEffort(), driven, mean(lambda t: theta(t)[2] ** 2) * second**4),
        "force": (design.ForceEffort(), driven, mean(lambda t: force(t) ** 2) / weight**2),
        "power": (
            design.PowerEffort(),
            driven,
            mean(lambda t: (force(t) * 0.3 * theta(t)[1]) ** 2) / (weight * R / second) ** 2,
        ),
    }


@functools.cache
def values(motion):
    """The objectives of a motion, computed together."""
    found = {name: objective for name, (objective, of, _) in closed_forms().items() if of is motion}
    return eqx.filter_jit(lambda run, found: {name: objective(run) for name, objective in found.items()})(
        motion(), found
    )


@pytest.mark.long
@pytest.mark.parametrize("name", closed_forms())
def test_objective_in_closed_form(name):
    _, motion, expected = closed_forms()[name]
    bound = 0.02 if name == "half" else 1e-9
    at_zero = 1e-15 if expected == 0 else 0.0
    np.testing.assert_allclose(float(values(motion)[name]), expected, rtol=bound, atol=at_zero)


@pytest.mark.thorough
def test_means_of_what_jumps_and_their_derivatives():
    """θ̈ of a tube is a, −b t from t = k on, and 0 from t = 1.3 on; its square has the mean (a² k + b² (1.3³ − k³)/3)/2.

    The knot is at a time that is saved, and at one that is not.
    """
    a, b, end = 0.05, 0.08, 1.3

    def effort(knot, a):
        path = jaxball.PiecewiseAcceleration(0.0, jnp.stack([0.0, knot, end]), [[a, 0.0], [-b * knot, -b]])
        mass = jaxball.PointMass(1.0, jaxball.OnRail(jaxball.Tube((1.0, 0.0, 0.0)), path))
        ball = jaxball.Ball(mass=1e12, inertia=(1e12, 1e12, 1e12), radius=R, gravity=G, masses=[mass])
        return design.AccelerationEffort()(run(ball)) * (G / R) ** 2

    for knot in (0.7, 0.70321):
        value, slopes = jax.jit(jax.value_and_grad(effort, (0, 1)))(jnp.asarray(knot), jnp.asarray(a))
        np.testing.assert_allclose(value, (a**2 * knot + b**2 * (end**3 - knot**3) / 3) / 2, rtol=1e-9)
        np.testing.assert_allclose(slopes, [(a**2 - b**2 * knot**2) / 2, a * knot], rtol=1e-9)


@pytest.mark.thorough
def test_largest_distance_in_time():
    beside = design.FollowTrajectory(design.Through([0.2 * SIDE, END + 0.2 * SIDE]))
    np.testing.assert_allclose(float(eqx.filter_jit(beside.farthest)(rolling())), 0.2 / R, rtol=1e-8)


def test_balance_is_where_the_moment_of_gravity_vanishes():
    hanging = jaxball.Ball(mass=1.0, inertia=(D, D, D), offset=(0.0, 0.0, -0.1))
    tilt = jnp.asarray([np.cos(0.2), np.sin(0.2), 0.0, 0.0])
    objective = eqx.filter_jit(design.Balanced())
    for q, expected in ((tilt, (0.1 * np.sin(0.4)) ** 2), ((1.0, 0.0, 0.0, 0.0), 0.0)):
        state = jax.tree.map(lambda x: x[None], jaxball.BallState(q))
        found = objective(Run(hanging, jnp.zeros(1), state, jnp.asarray(0)))
        np.testing.assert_allclose(float(found), expected, rtol=1e-12, atol=1e-30)


def test_curve_through_points_of_a_parabola_is_the_parabola():
    curve = design.Through([[s, s**2] for s in np.linspace(0.0, 1.0, 5)])
    s = jnp.linspace(0.0, 1.0, 23)
    np.testing.assert_allclose(curve.points(23), jnp.stack([s, s**2], axis=1), atol=1e-14)


def test_sigmoid_is_half_way_at_half_and_its_own_mirror_image():
    curve = design.Sigmoid(6.0, 2.0, 8.0, (1.0, -1.0))
    points = np.asarray(curve.points(41))
    np.testing.assert_allclose(points[[0, 20, 40]], [[1, -1], [4, 0], [7, 1]], atol=1e-14)
    np.testing.assert_allclose(points + points[::-1], np.broadcast_to([8.0, 0.0], points.shape), atol=1e-13)
    rate = 2.0 * 8.0 / 4 / np.tanh(2.0)
    slope = jax.jvp(curve, (jnp.asarray(0.5),), (jnp.asarray(1.0),))[1]
    np.testing.assert_allclose(slope, [6.0, rate], rtol=1e-12)


def test_the_figure_eight_fulfils_its_equation():
    """x⁴ = x² − y², Gerono's lemniscate, whose half axes are 1 and ½."""
    x, y = np.asarray(design.FigureEight(3.0, 1.5).points(41)).T / 1.5
    np.testing.assert_allclose(x**4, x**2 - y**2, atol=1e-14)
    assert np.max(y) <= 0.5


def test_points_that_make_no_curve_are_told():
    with refuses(design.DesignError, "through"):
        design.Through([[0.0, 0.0]])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("system", "start"),
    [
        (
            jaxball.Ball(mass=1.0, inertia=(D, D, D), radius=R, gravity=G, ground=jaxball.Bowl(3.0)),
            jaxball.BallState(z=(3.0, -1.0)),
        ),
        (jaxball.Disk(mass=1.0, inertia=D, radius=R, gravity=G, ground=jaxball.Bowl(3.0)), jaxball.DiskState(z=2.0)),
    ],
)
def test_places_on_a_surface_are_those_of_the_centre_in_space(system, start):
    """In a bowl of radius 3 the centre is at (3 − R) sin φ from its axis, where the coordinates are 6 tan(φ/2)."""
    along = run(system, start)
    z = np.asarray(along.state.z).reshape(len(TIMES), -1)
    size = np.linalg.norm(z, axis=1)
    centre = (3.0 - R) * np.sin(2 * np.arctan(size / 6))[:, None] * z / size[:, None]
    place = np.array([0.2, 0.0])
    expected = (centre[-1, 0] - 0.2) ** 2 + (centre[-1, 1] if z.shape[1] == 2 else 0.0) ** 2
    np.testing.assert_allclose(along.z[:, : z.shape[1]], centre, atol=1e-12)
    np.testing.assert_allclose(design.ReachPlace(place)(along), expected / R**2, rtol=1e-10)
