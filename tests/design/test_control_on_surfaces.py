"""Optimal control on surfaces: slopes as on planes, plates in closed form, and solves of another kind.

The equations of collocation are those of a simulation, so that a comparison with it checks the polynomials alone.
"""

import functools
import tomllib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.studies import design
from jaxball.studies.design import optimal_control
from jaxball.studies.design.files import read_control
from jaxball.studies.design.problem.run import Run
from tests.support.differences import slope
from tests.support.sentences import refuses

END, PLACE, DOWN = 8.0, 1.0, -np.pi / 2
MESH = np.linspace(0.0, END, 9)
ONCE = 1.0  # a tolerance with which the first mesh is not refined


def disk(ground, angles=(DOWN, DOWN)):
    rails = zip((0.9, 0.6), angles, strict=True)
    masses = [jaxball.PointMass(1.0, jaxball.OnRail(jaxball.Circle(r), jaxball.ConstantRate(a))) for r, a in rails]
    return jaxball.Disk(mass=1.0, inertia=1.0, masses=masses, ground=ground)


def problem(system, start=0.0, end=PLACE, weight=0.01, state=None, **constraints):
    """From rest to rest, with the centre led from one place to another."""
    curve = design.Through([[start, 0.0], [end, 0.0]])
    tracking = design.FollowTrajectory(curve, rest_to_rest=True, weight=weight)
    effort = design.AccelerationEffort(weight=0.01)
    objectives = {"follow-trajectory": tracking, "acceleration-effort": effort}
    return optimal_control.Rolling(system, (0.0, END), objectives, state, place=end, constraints=constraints)


def steep(t, x, y, slope):
    return -slope * x


def hill(t, x, y, height):
    return height * jnp.exp(-((x - 1.0) ** 2) - y**2)


def sinking(t, x, y, rate):
    return -rate * t + 0.0 * x


def stopping(t, x, y, height):
    """Rises to ``height`` and is at rest from t = 4 on."""
    s = jnp.minimum(t / 4.0, 1.0)
    return height * s**3 * (10 - 15 * s + 6 * s**2) + 0.05 * x**2


def ball(ground, **others):
    arguments = {"mass": 1.0, "radius": 0.5, "inertia": (0.1, 0.1, 0.1), "gravity": 9.81} | others
    return jaxball.Ball(**arguments, ground=ground)


def climber(ground):
    """A ball with a pendulum in a yoke, both moved by motors."""
    joints = [jaxball.Hinge(axis, drive=jaxball.Motor(0.0)) for axis in ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0))]
    yoke = jaxball.Mechanism(joints, masses=[jaxball.CarriedMass(0.8, (0.0, 0.0, -0.5))])
    return ball(ground, mass=1.0, radius=1.0, inertia=(0.4, 0.4, 0.4), gravity=10.0, mechanisms=[yoke])


def climb(ground, theta, places, weight=0.1, **state):
    tracking = design.FollowTrajectory(design.Through(places), rest_to_rest=True, weight=weight)
    objectives = {"effort": design.JointEffort(), "tracking": tracking}
    start = jaxball.BallState(theta=theta, thetadot=(0.0, 0.0), **state)
    return optimal_control.Rolling(climber(ground), (0.0, 4.0), objectives, start, place=places[-1])


@pytest.mark.parametrize(
    "ground",
    [
        jaxball.HeightField(sinking, 0.1),
        jaxball.physics.TiltingPlane(
            displacement=jaxball.Oscillating(jaxball.HarmonicSeries((0, 0, 0), [(0, 0, 1)], [1.0]))
        ),
        jaxball.Bowl(
            5.0,
            motion=jaxball.physics.MovingFrame([jaxball.physics.Turn((0, 1, 0), jaxball.ConstantRate(0.0, rate=0.1))]),
        ),
    ],
)
def test_nothing_can_rest_on_a_ground_that_moves_at_the_end(ground):
    with refuses(design.DesignError, "system"):
        problem(disk(ground))


def test_a_ground_may_move_before_the_end():
    assert problem(disk(jaxball.HeightField(stopping, 0.3))).controls == 2


def test_a_wheel_on_a_plate_without_masses_is_controlled_by_the_plate():
    plate = jaxball.physics.TiltingPlane(about_e2=jaxball.ConstantRate(0.2, rate=0.1), pivot=(0.0, 0.0, 1.0))
    system = jaxball.Disk(mass=1.0, inertia=0.5, ground=plate)
    wheel = optimal_control.Rolling(system, (0.0, END), {})
    assert wheel.system.coordinates == ("ground.about_e2",)
    np.testing.assert_allclose([wheel.state.theta, wheel.state.thetadot], [[0.2], [0.1]])
    again = wheel.with_schedules([jaxball.ConstantRate(0.7)])
    assert isinstance(again.ground, jaxball.physics.TiltingPlane)
    assert isinstance(again.ground.about_e2, jaxball.ConstantRate)
    np.testing.assert_array_equal(again.ground.about_e2.theta, 0.7)
    np.testing.assert_array_equal(again.ground.pivot, plate.pivot)
    assert again.ground.about_e1 is None


def run_at(system, z):
    """A run of one time, at rest."""
    state = jaxball.BallState(z=z) if isinstance(system, jaxball.Ball) else jaxball.DiskState(z=z)
    batch = jax.tree.map(lambda leaf: leaf[None], state)
    return Run(system, jnp.zeros(1), batch, jnp.asarray(0))


def test_what_keeps_a_ball_on_its_ground():
    """1 − r κ at the lowest point of a paraboloid, and the stereographic reach of a bowl; nothing on a plane."""
    bent = run_at(ball(jaxball.physics.Paraboloid((1.2, 0.4))), (0.0, 0.0))
    keeps = design.OnGround(fit=0.3, reach=0.25)
    violations, margins = jax.jit(lambda run: (keeps(run), keeps.margins(run)))(bent)
    np.testing.assert_allclose(violations, [[0.3 - 0.4, 0.25 - 1.0]], atol=1e-14)
    np.testing.assert_allclose(margins, [[0.1 * 0.5 / 0.6, 0.75]], atol=1e-14)
    flat = run_at(ball(None), (0.0, 0.0))
    found = jax.jit(lambda run: (keeps(run), keeps.margins(run)))(flat)
    np.testing.assert_allclose(found, [[[-0.7, -0.75]], [[0.7, 0.75]]], atol=1e-15)


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_margins_change_sign_where_the_ground_is_too_curved(share):
    """As the violation does, and by as much, to first order: on a valley k x² / 2, κ = k / (1 + (k x)²)^(3/2)."""
    k, r = 1.2, 0.5
    x = jnp.asarray(0.3)
    fit = 1 - r * k / (1 + (k * x) ** 2) ** 1.5
    keeps = design.OnGround(fit=share * fit)
    for system, z in ((ball(jaxball.physics.Paraboloid((k, 0.0))), (0.3, 0.0)), (wheel(k, r), 0.3)):
        violations, margins = jax.jit(lambda run: (keeps(run), keeps.margins(run)))(run_at(system, z))
        np.testing.assert_allclose(violations[0, 0], (share - 1) * fit, atol=1e-12)
        np.testing.assert_allclose(margins[0, 0], (1 - share) * fit, rtol=5e-3)


def wheel(k, r):
    return jaxball.Disk(mass=1.0, radius=r, inertia=0.1, ground=jaxball.physics.Paraboloid((k, 0.0)))


GROUNDS = {
    "bowl": (jaxball.Bowl(6.0), 0.8),
    "sphere": (jaxball.physics.SphereOutside(6.0), 0.8),
    "washboard": (jaxball.physics.Washboard(0.05, 4.0), 0.6),
    "hill": (jaxball.HeightField(hill, 0.1), 0.5),
    "pipe": (jaxball.physics.Cylinder(5.0, axis=(0.0, 1.0, 0.0), centre=(0.0, 0.0, 5.0)), -0.8),
    "rising valley": (jaxball.HeightField(stopping, 0.3), 0.0),
}


@eqx.filter_jit
def conditions_at_rest(resting):
    return resting.conditions(resting.initial)


@pytest.mark.long
@pytest.mark.parametrize("name", ["bowl", "hill"])
def test_a_balanced_disk_is_at_its_end(name):
    """The angles that ``balance`` finds are those at which the conditions at the end vanish, at rest and only there."""
    ground, z = GROUNDS[name]
    state = jaxball.DiskState(phi=0.3, z=z)
    found = jaxball.balance(disk(ground), [0, 1], state=state, above=False)
    assert found.ok
    place = float(run_at(disk(ground), z).z[0, 0])
    for angles, rests in ((found.theta, True), (found.theta + jnp.asarray([0.01, 0.0]), False)):
        resting = problem(disk(ground, angles), end=place, state=state)
        assert (float(jnp.max(jnp.abs(conditions_at_rest(resting)))) < 1e-9) == rests


@pytest.mark.long
def test_a_slope_as_a_surface_is_that_as_a_plane():
    """Places along a slope are shorter in the horizontal, and the centre is beside the foot by r sin a."""
    a, length = 0.1, 1.0
    plane, surface = jaxball.Ground(angle=a), jaxball.HeightField(steep, jnp.tan(a))
    angles = jaxball.balance(disk(plane), [0, 1], guess=[DOWN, DOWN], above=False).theta
    on_plane = problem(disk(plane, angles), end=length)
    start = float(np.sin(a))
    on_surface = problem(
        disk(surface, angles),
        start,
        start + length * float(np.cos(a)),
        weight=0.01 / float(np.cos(a)) ** 2,
        state=jaxball.DiskState(phi=-a),  # axes of space, not of the plane
    )
    first, second = (one.solve(MESH, tolerance=ONCE) for one in (on_plane, on_surface))
    times = np.linspace(0.0, END, 41)
    along = (second.places(times) - start) / np.cos(a)
    np.testing.assert_allclose(along, first.places(times), atol=1e-8)
    np.testing.assert_allclose(second.path.controls, first.path.controls, atol=1e-8)
    assert np.max(np.abs(first.path.controls)) > 0.01
    for name, mean in first.means().items():
        scale = np.cos(a) ** 2 if name == "follow-trajectory" else 1.0
        np.testing.assert_allclose(second.means()[name], mean * scale, rtol=1e-8)


@pytest.mark.long
def test_derivatives_of_the_equations_on_a_surface():
    """The Jacobian along a direction against differences of the residual."""
    resting = problem(disk(jaxball.Bowl(6.0)))
    collocation = optimal_control.Collocation(resting, MESH[:4])
    random = np.random.default_rng(0)
    start = resting.at_rest(MESH[:4])
    y = np.concatenate([np.ravel(part) for part in start[1:]])
    y = np.concatenate([y, np.zeros(collocation.size - y.size)]) + 0.1 * random.standard_normal(collocation.size)
    direction = random.standard_normal(collocation.size)
    expected = slope(lambda s: collocation.residual(y + s * direction, 0.0), 0.0, 1e-3)
    found = collocation.jacobian(y, 0.0)[0] @ direction
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.max(np.abs(expected)))


@pytest.mark.long
def test_a_path_to_start_from_rolls_over_a_sphere():
    """Its centre is where it is wanted, and the disk turns by (R + r) / r of the angle at the middle of a circle."""
    R = 6.0
    over = problem(disk(jaxball.physics.SphereOutside(R)))
    times = np.linspace(0.0, END, 21)
    path = over.rolling_along(np.linspace(0.0, END, 21))
    states = jax.vmap(over.packing.unpack)(jnp.asarray(times), jnp.asarray(path.states(times)))
    u = times / END
    x = u**3 * (10 - 15 * u + 6 * u**2)
    middle = np.arcsin(x / (R + 1.0))
    np.testing.assert_allclose(states.z, 2 * R * np.tan(middle / 2), atol=1e-5)
    np.testing.assert_allclose(states.phi, -(R + 1.0) * middle, atol=1e-5)
    # Slow, so that it is nearly balanced everywhere: the moment about the contact point vanishes.
    aside = 0.9 * np.cos(states.theta[:, 0] + states.phi) + 0.6 * np.cos(states.theta[:, 1] + states.phi)
    np.testing.assert_allclose(aside[[0, -1]], -3.0 * np.sin(middle[[0, -1]]), atol=1e-3)


@functools.cache
def solved(name):
    """From rest on the level to rest on a slope, with friction and N as constrained."""
    ground, _ = GROUNDS[name]
    limits = {"contact": design.NormalForce(0.5), "friction": design.Friction(0.5), "on-ground": design.OnGround()}
    angles = (DOWN, DOWN)
    if name == "hill":
        angles = jaxball.balance(disk(ground), [0, 1], guess=angles, above=False).theta
    return problem(disk(ground, angles), **limits).solve(MESH).sharpen()


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    [
        "rising valley",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("washboard", "pipe", "sphere", "hill")),
    ],
)
def test_a_simulation_does_what_the_solution_says(name):
    """By Gauss's method of order 16."""
    solution = solved(name)
    seen = solution.resimulate()
    assert max(seen.apart, seen.speed, seen.away, seen.missed) < 1e-5
    assert max(seen.violations.values()) < 1e-4
    assert solution.least_curvature() > 0
    assert seen.below > 0


@pytest.mark.slow
def test_a_pendulum_climbs_a_slope_as_on_a_plane():
    """The pendulum leans by asin(M r sin a / (m l)) at the start.

    Both are solved on the same mesh, whose versors are of length 1 to its error, 5e-5; it matters to the power of two.
    """
    a, mesh = 0.08, np.linspace(0.0, 4.0, 49)
    sine, cosine = float(np.sin(a)), float(np.cos(a))
    lean = float(np.arcsin(1.8 * sine / (0.8 * 0.5)))
    on_plane = climb(jaxball.Ground(angle=a), (lean - a, 0.0), [[0.0, 0.0], [-1.0, 0.0]])
    on_surface = climb(
        jaxball.HeightField(steep, jnp.tan(a)),
        (lean - a, 0.0),
        [[sine, 0.0], [sine - cosine, 0.0]],
        weight=0.1 / cosine**2,
        q=(np.cos(a / 2), 0.0, np.sin(a / 2), 0.0),
    )
    first, second = (one.solve(mesh, tolerance=ONCE, guess=one.rolling_along(mesh)) for one in (on_plane, on_surface))
    np.testing.assert_allclose(second.path.controls, first.path.controls, atol=1e-7)
    assert np.max(np.abs(first.path.controls)) > 1.0
    along = (second.places(mesh)[:, 0] - sine) / cosine
    np.testing.assert_allclose(along, first.places(mesh)[:, 0], atol=1e-9)
    np.testing.assert_allclose(second.holding(), first.holding(), atol=1e-8)


@pytest.mark.slow
def test_a_pendulum_crosses_a_saddle():
    """From its middle to rest on its flank, where both motors hold it."""
    crossing = climb(jaxball.physics.Paraboloid((0.03, -0.03)), (0.0, 0.0), [[0.0, 0.0], [1.0, 0.5]])
    mesh = np.linspace(0.0, 4.0, 13)
    solution = crossing.solve(mesh, guess=crossing.rolling_along(mesh))
    seen = solution.resimulate()
    assert max(seen.apart, seen.speed, seen.away, seen.missed) < 1e-5
    assert np.all(np.abs(solution.holding()) > 0.1)


@pytest.mark.long
def test_a_ground_that_lifts_a_disk_and_stops():
    """The disk crosses a valley that rises meanwhile, and rests on its flank."""
    run = solved("rising valley").scenario().simulate(throw=True)
    np.testing.assert_allclose(
        run.observables.geometric_centre[-1, 2] - run.observables.contact_point[-1, 2],
        1 / np.hypot(1, 0.1 * float(run.state.z[-1])),
        rtol=1e-9,
    )


T, FAR, R, G = 2.0, 1e-4, 0.05, 9.81


@pytest.mark.long
def test_a_plate_moves_a_ball_with_the_least_effort():
    """For small angles y = x + r α has y⁗ = k g α̈ and y = 35 s⁴ − 84 s⁵ + 70 s⁶ − 20 s⁷, k = 5/7."""
    level, k, place = jaxball.ConstantRate(0.0), 5 / 7, (0.6 * FAR, 0.8 * FAR)
    plate = jaxball.physics.TiltingPlane(level, level)
    system = jaxball.Ball(mass=1.0, radius=R, inertia=[0.4 * R**2] * 3, gravity=G, ground=plate)
    objectives = {"effort": design.AccelerationEffort(weight=1e3)}
    moving = optimal_control.Rolling(system, (0.0, T), objectives, place=place, softness=1e-7)
    solution = moving.solve(np.linspace(0.0, T, 17), tolerance=ONCE)
    times = np.ravel(solution.collocation.times)
    s = times / T
    u = FAR * (840 - 10080 * s + 25200 * s**2 - 16800 * s**3) / (k * G * T**4)
    found = solution.path.controls.reshape(len(times), -1)
    wanted = u[:, None] * np.array([-0.8, 0.6])
    np.testing.assert_allclose(found, wanted, atol=2e-4 * np.max(np.abs(u)))
    seen = solution.resimulate()
    assert max(seen.speed, seen.away, seen.missed) < 1e-7


@pytest.mark.long
def test_a_path_to_start_from_tilts_a_plate():
    """By ẍ = (2/3) g α where it is slow, with the centre where it is wanted while the plate tilts about a pivot."""
    far, end = 0.2, 20.0
    plate = jaxball.physics.TiltingPlane(about_e2=jaxball.ConstantRate(0.0), pivot=(0.3, 0.0, -1.0))
    system = jaxball.Disk(mass=1.0, radius=R, inertia=0.5 * R**2, gravity=G, ground=plate)
    tracking = design.FollowTrajectory(design.Through([[0.0, 0.0], [far, 0.0]]), rest_to_rest=True)
    moving = optimal_control.Rolling(system, (0.0, end), {"tracking": tracking}, place=far)
    path = moving.rolling_along(np.linspace(0.0, end, 21))
    states = jax.vmap(moving.packing.unpack)(jnp.asarray(path.mesh), jnp.asarray(path.knots))
    u = path.mesh / end
    alpha = np.asarray(states.theta[:, 0])
    acceleration = far * (60 * u - 180 * u**2 + 120 * u**3) / end**2
    np.testing.assert_allclose(alpha, 1.5 * acceleration / G, atol=0.02 * np.max(np.abs(alpha)))
    # In the axes of the plate, from the pivot: (z − 0.3, r + 1) turned by α.
    x = 0.3 + np.cos(alpha) * (states.z - 0.3) + np.sin(alpha) * (R + 1.0)
    np.testing.assert_allclose(x, far * u**3 * (10 - 15 * u + 6 * u**2), atol=1e-9)


FILE = """
format = 1
title = "Over a hill"

[scenario]
format = 1
kind = "disk"
body = { mass = 1.0, radius = 1.0, inertia = 1.0, gravity = 1.0 }
initial = { phi = 0.0 }
time = { start = 0.0, end = 8.0, saves = 41 }
ground = { kind = "sphere", radius = 6.0 }

[[scenario.masses]]
mass = 1.0
rail = { kind = "circle", radius = 0.9 }
schedule = { kind = "constant-rate", theta = -1.5707963267948966, rate = 0.0 }

[[scenario.masses]]
mass = 1.0
rail = { kind = "circle", radius = 0.6 }
schedule = { kind = "constant-rate", theta = -1.5707963267948966, rate = 0.0 }

[[objectives]]
kind = "follow-trajectory"
curve = { kind = "through", points = [0.0, 1.0] }
rest_to_rest = true
weight = 0.01

[[objectives]]
kind = "acceleration-effort"
weight = 0.01

[[constraints]]
kind = "on-ground"
fit = 0.1

[control]
place = 1.0
intervals = 8
"""


def test_a_file_says_what_python_says():
    found = read_control(tomllib.loads(FILE)).problem
    wanted = problem(disk(jaxball.physics.SphereOutside(6.0)), **{"on-ground": design.OnGround(fit=0.1)})
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_array_equal(a, b)
    assert list(found.constraints) == ["on-ground"]
