"""Balls and disks on grounds that are where a function is zero, against the same grounds in closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import (
    Ball,
    BallState,
    Bowl,
    Circle,
    Disk,
    DiskState,
    Event,
    HeightField,
    OnRail,
    PointMass,
    Sinusoids,
    Status,
    problems,
    simulate,
)
from jaxball.physics import Cylinder, MovingFrame, SignedDistance, SphereOutside, TiltingPlane, Turn
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.sentences import refuses, said
from tests.support.signed_distances import inside_ellipsoid, inside_sphere, outside_sphere, outside_torus

G = 9.81
SHELL = {"mass": 1.0, "radius": 0.1, "inertia": (0.004, 0.005, 0.006), "gravity": G, "offset": (0.01, -0.02, 0.015)}
FINE = {"rtol": 1e-11, "atol": 1e-12}
CLOSE = 1e-10
SPUN = (0.5, -2.0, 1.0)
UP = (0.0, 0.0, 1.0)


def above_slope(t, x, y, z, slope):
    """Twice the distance from a plane that falls along e1."""
    return 2.0 * (z + slope * x) / jnp.sqrt(1 + slope**2)


def inside_pipe(t, x, y, z, R):
    """Within a level cylinder along e1, whose axis is at the height R, times 1 + x²: no distance."""
    return (R**2 - y**2 - (z - R) ** 2) * (1 + x**2)


BOWL, DOME = ({"centre": (0.0, 0.0, z), "guess": 1.0} for z in (1.0, -1.0))
SLOPE = 0.3  # rad
# Each ground twice, with the coordinates of the same start.
PAIRS = {
    "bowl": ((Bowl(1.0), (0.3, 0.1)), (SignedDistance(inside_sphere, 1.0, **BOWL), (0.3, 0.1))),
    "bowl from above": (
        (Bowl(1.0), (0.3, 0.1)),
        (SignedDistance(inside_sphere, 1.0, guess=0.1), tuple(np.array([0.3, 0.1]) / (1 + 0.1 / 4))),
    ),
    "sphere": ((SphereOutside(1.0), (0.3, 0.1)), (SignedDistance(outside_sphere, 1.0, **DOME), (0.3, 0.1))),
    "slope": (
        (TiltingPlane(about_e2=jaxball.ConstantRate(SLOPE)), (0.2, 0.1)),
        (SignedDistance(above_slope, np.tan(SLOPE)), (0.2 * np.cos(SLOPE), 0.1)),
    ),
    # At x = 0 a ray is at the angle of the arc.
    "pipe": (
        (Cylinder(1.0, centre=(0.0, 0.0, 1.0)), (0.0, 0.4)),
        (SignedDistance(inside_pipe, 1.0, **BOWL), (0.0, 2 * np.tan(0.2))),
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", PAIRS)
def test_runs_are_those_on_the_closed_form(name):
    times, seen = np.linspace(0.0, 1.0, 6), []
    for ground, z in PAIRS[name]:
        run = simulate(Ball(**SHELL, ground=ground), times, BallState(z=z, Omega=SPUN), **FINE)
        assert run.ok
        seen.append(run.observables)
    assert np.ptp(seen[0].geometric_centre[:, 0]) > 0.05
    for field in ("geometric_centre", "contact_point", "contact_force", "normal_force", "angular_velocity_body"):
        ours, theirs = (np.asarray(getattr(x, field)) for x in seen)
        np.testing.assert_allclose(ours, theirs, atol=CLOSE * max(1.0, np.abs(ours).max()), err_msg=field)


def test_derivatives_of_a_place_are_those_of_a_bowl():
    """Of p by both coordinates and by the radius, up to the third, in both modes and in jaxball's programs."""
    t, x = jnp.array(0.0), jnp.array([0.4, -0.7, 1.3])

    def signed(R):
        return SignedDistance(inside_sphere, R, centre=jnp.stack([0 * R, 0 * R, R]), guess=R)

    ours, theirs = (lambda x, kind=kind: kind(x[2]).place(t, x[0], x[1]) for kind in (signed, Bowl))
    for mode in (jax.jacfwd, jax.jacrev, jax.jacfwd):
        ours, theirs = mode(ours), mode(theirs)
        np.testing.assert_allclose(jaxball.jit(ours)(x), theirs(x), atol=1e-13)


@pytest.mark.parametrize("inside", [True, False])
def test_the_nearest_piece_of_an_ellipsoid(inside):
    """From points that are nearer to it than its curvature allows, it is the best of many, and x − p is normal."""
    axes, rng = np.array([1.0, 1.3, 0.8]), np.random.default_rng(2)
    function = inside_ellipsoid if inside else lambda *given: -inside_ellipsoid(*given)
    ground = SignedDistance(function, axes, centre=(0.1, 0.0, 0.0), guess=1.1)
    theta, phi = np.meshgrid(np.linspace(0, np.pi, 400), np.linspace(0, 2 * np.pi, 800), indexing="ij")
    e = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(-1, 3)
    foot = jaxball.jit(lambda x: ground.place(0.0 * x[0], *ground.foot(0.0 * x[0], x, jnp.zeros(2))))
    for direction in rng.normal(size=(8, 3)):
        direction = direction / np.linalg.norm(direction)
        x = direction * axes * rng.uniform(*((0.75, 0.98) if inside else (1.02, 2.0)))
        p = np.asarray(foot(jnp.asarray(x)))
        normal = p / axes**2
        np.testing.assert_allclose((p / axes) @ (p / axes), 1.0, atol=1e-13)
        np.testing.assert_allclose(np.cross(x - p, normal), 0.0, atol=1e-12)
        np.testing.assert_allclose(foot(jnp.asarray(p)), p, atol=1e-14)
        best = np.linalg.norm(x - e * axes, axis=1).min()
        assert best - 2e-3 < np.linalg.norm(x - p) < best + 1e-12


@pytest.mark.thorough
def test_energy_and_momentum_on_a_torus():
    """On a ring about e3: the energy, and the equation of the ring, of no chart of it."""
    ball = Ball(**SHELL, ground=SignedDistance(outside_torus, jnp.array([2.0, 0.7]), guess=0.7))
    start = BallState(z=(2.1, 0.2), Omega=(-8.0, 4.0, -3.0))
    run = simulate(ball, np.linspace(0.0, 0.6, 7), start, **FINE)
    assert run.ok
    seen = run.observables
    np.testing.assert_allclose(seen.energy, seen.energy[0], rtol=1e-10)
    p, c = np.asarray(seen.contact_point), np.asarray(seen.geometric_centre)
    assert np.ptp(p[:, 2]) > 0.4
    for points, tube in ((p, 0.7), (c, 0.8)):
        off = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 2.0, points[:, 2])
        np.testing.assert_allclose(off, tube, atol=1e-13)


@pytest.mark.long
def test_a_ground_that_moves_and_swells_is_the_same_height_field():
    """With a mass on a rail, under a motion as a rigid body."""

    def height(t, x, y, size):
        return size * jnp.sin(0.8 * x + 0.3 * t) * jnp.cos(0.6 * y) + 0.02 * x**2 * jnp.cos(t)

    frame = MovingFrame([Turn((0.0, 1.0, 0.5), Sinusoids(0.0, amplitude=[0.2], frequency=[1.3]))], pivot=(0.4, 0, 0.2))
    mass = PointMass(0.3, OnRail(Circle(0.05), Sinusoids(0.0, amplitude=[2.0], frequency=[3.0])))
    seen = []
    for kind, function in (
        (HeightField, height),
        (SignedDistance, lambda t, x, y, z, size: jnp.sinh(3.0 * (z - height(t, x, y, size)))),
    ):
        ball = Ball(**SHELL, masses=[mass], ground=kind(function, 0.15, motion=frame))
        run = simulate(ball, np.linspace(0.0, 1.0, 5), BallState(z=(0.3, -0.2), Omega=SPUN), **FINE)
        seen.append((run.state.z, run.observables.contact_force, run.observables.power))
    for ours, theirs in zip(*seen, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=CLOSE)


@pytest.mark.thorough
def test_derivatives_by_a_radius():
    """Of the end of a run by the radius of a bowl, from the same angle; the chart stays the same."""

    def end(kind):
        def centre(R):
            if kind is Bowl:
                ground, scale = Bowl(R), R
            else:
                ground, scale = SignedDistance(inside_sphere, R, centre=jnp.stack([0 * R, 0 * R, R]), guess=1.0), 1.0
            state = BallState(z=jnp.stack([2 * scale * jnp.tan(0.2), 0.1 * scale]), Omega=jnp.array(SPUN))
            run = simulate(Ball(**SHELL, ground=ground), [0.0, 0.7], state, **FINE)
            return run.observables.geometric_centre[-1]

        return centre

    R = jnp.array(1.2)
    expected = jaxball.jit(jax.jacfwd(end(Bowl)))(R)
    np.testing.assert_allclose(jaxball.jit(jax.jacrev(end(SignedDistance)))(R), expected, rtol=1e-8)


@pytest.mark.thorough
def test_rows_of_an_ensemble_are_runs():
    """Ellipsoids side by side."""
    start = BallState(z=(0.3, 0.1), Omega=SPUN)

    def ball(height):
        axes = jnp.stack([1.0 + 0 * height, 1.3 + 0 * height, height])
        return Ball(**SHELL, ground=SignedDistance(inside_ellipsoid, axes, centre=(0.0, 0.0, 0.0), guess=1.0))

    heights = jnp.array([0.7, 1.0, 1.5])
    balls, starts = jax.vmap(lambda h: (ball(h), start))(heights)
    many = simulate_ensemble(balls, [0.0, 1.0], starts)
    for k, height in enumerate(heights):
        run = simulate(ball(height), [0.0, 1.0], start)
        np.testing.assert_allclose(many.state.z[k, -1], run.state.z[-1], atol=1e-9)


@pytest.mark.thorough
def test_a_disk_in_an_ellipse():
    """Its energy, and the period of small swings: I = 3/2 m r², and the centre moves along a curve of radius ρ − r.

    The ellipse has ρ = a²/b at its lowest point.
    """
    a, b, r = 1.0, 0.7, 0.1
    ground = SignedDistance(inside_ellipsoid, jnp.array([a, 2.0, b]), centre=(0.0, 0.0, 0.0), guess=b)
    disk = Disk(mass=2.0, radius=r, inertia=0.01, gravity=G, ground=ground)
    run = simulate(disk, np.linspace(0.0, 4.0, 41), DiskState(z=0.002), events={"bottom": Event("z")}, **FINE)
    crossings = run.events["bottom"].times
    np.testing.assert_allclose(crossings[2] - crossings[0], 2 * np.pi * np.sqrt(1.5 * (a**2 / b - r) / G), rtol=1e-5)
    np.testing.assert_allclose(run.observables.energy, run.observables.energy[0], rtol=1e-10)
    aside = SignedDistance(inside_ellipsoid, ground.parameters, centre=(0.0, 0.1, 0.0), guess=b)
    (sentence,) = problems(Disk(mass=2.0, radius=r, inertia=0.01, ground=aside), DiskState(z=0.002))
    said(sentence, "ground")


@pytest.mark.thorough
def test_a_run_ends_where_the_ground_is_along_the_line():
    """In the lower half of a sphere, met from above, as over the height of the same half."""
    ends = []
    for ground in (
        HeightField(lambda t, x, y, R: R - jnp.sqrt(R**2 - x**2 - y**2), 1.0),
        SignedDistance(inside_sphere, 1.0, guess=0.1),
    ):
        run = simulate(Ball(**SHELL, ground=ground), [0.0, 0.1, 3.0], BallState(Omega=(0.0, 70.0, 0.0)), **FINE)
        assert run.status == Status.LEFT_SURFACE
        ends.append(float(run.reached))
    np.testing.assert_allclose(*ends, atol=1e-7)


def test_what_is_refused():
    solid = {"mass": 1.0, "radius": 0.1, "inertia": (0.004, 0.004, 0.004)}
    with refuses(TypeError, "function"):
        SignedDistance(lambda t, x, y: x)
    for ground, named in [
        (SignedDistance(inside_sphere, 1.0, centre=(0.0, 0.0, 1.0)), "ground.guess"),
        (SignedDistance(inside_sphere, 1.0, centre=(0, 0, np.inf), guess=1.0), "ground.centre"),
        # Beside a sphere there is none below, and a function with the wrong sign falls through zero.
        (SignedDistance(inside_sphere, 0.05), "ground.function"),
        (SignedDistance(lambda t, x, y, z, _: -z), "ground.function"),
    ]:
        said("\n".join(problems(Ball(**solid, ground=ground), BallState(z=(0.2, 0.0)))), named)
