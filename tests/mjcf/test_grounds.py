"""Grounds that are no planes as MuJoCo has them: heights by its rays, contact where the body starts, and refusals."""

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxball import (
    Ball,
    BallState,
    Belt,
    Bowl,
    ConstantRate,
    ConvexBody,
    Disk,
    DiskState,
    Ground,
    HeightField,
    Scenario,
    Turntable,
    observe,
)
from jaxball.files.mjcf import MJCFError, to_mjcf
from jaxball.physics import (
    Ellipsoid,
    MovingFrame,
    Paraboloid,
    ReleasedState,
    SignedDistance,
    SphereOutside,
    TiltingPlane,
    Turn,
)
from tests.support.sentences import refuses

TIMES = np.array([0.0, 1.0])
RADIUS = 0.5
WAVE = 0.1  # of the height, whose second derivatives are at most these times WAVE
BEND_X, BEND_Y = 0.8**2, 0.6**2


def waves(t, x, y, height):
    return height * jnp.sin(0.8 * x) * jnp.cos(0.6 * y)


def normal_of_waves(x, y):
    by_x, by_y = 0.8 * np.cos(0.8 * x) * np.cos(0.6 * y), -0.6 * np.sin(0.8 * x) * np.sin(0.6 * y)
    upwards = np.array([-WAVE * by_x, -WAVE * by_y, 1.0])
    return upwards / np.linalg.norm(upwards)


def above_waves(t, x, y, z, height):
    return z - waves(t, x, y, height)


def swell(t, x, y, height):
    return height * jnp.sin(t) ** 2 + 0.0 * x


def ball(ground):
    return Ball(mass=1.0, inertia=(0.1, 0.1, 0.1), radius=RADIUS, gravity=9.81, ground=ground)


def loaded(scenario, **options):
    exported = to_mjcf(scenario, **options)
    model = mujoco.MjModel.from_xml_string(exported.text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return exported, model, data


def height_by_ray(model, data, x, y):
    """Where a ray from above meets the ground."""
    ground, shell = model.geom("ground").id, model.body("shell").id
    met = np.array([-1], dtype=np.int32)
    away = mujoco.mj_ray(model, data, np.array([x, y, 50.0]), np.array([0.0, 0.0, -1.0]), None, 1, shell, met)
    assert met[0] == ground
    return 50.0 - away


@pytest.mark.parametrize("kind", [HeightField, SignedDistance])
def test_a_height_field_has_the_heights_of_the_ground(kind):
    """To what a chord may be off between two points, h² max|f″| / 8 along each direction."""
    ground = kind(waves if kind is HeightField else above_waves, WAVE)
    start = BallState(z=(-1.3, -0.4), Omega=(0.2, 1.0, 0.0))  # in a valley, where chords are above the ground
    exported, model, data = loaded(Scenario("on waves", ball(ground), start, TIMES))
    spacing = 2 * 10 * RADIUS / 100
    sag = spacing**2 * WAVE * (BEND_X + BEND_Y) / 8
    for x, y in np.random.default_rng(0).uniform(-4.9, 4.9, (20, 2)) + np.asarray(start.z):
        assert abs(height_by_ray(model, data, x, y) - waves(0.0, x, y, WAVE)) < sag + 1e-6  # heights are float32
    seen = observe(ball(ground), jnp.array(0.0), start)
    np.testing.assert_allclose(data.qpos[:3], seen.geometric_centre, rtol=0, atol=1e-14)
    np.testing.assert_allclose(
        data.qvel[:3], RADIUS * np.cross(start.Omega, normal_of_waves(*np.asarray(start.z))), atol=1e-14
    )
    assert -sag - 1e-6 < min(data.contact.dist) < 0
    assert exported.notes[-1] == (
        "The ground is a height field of flat triangles with sides of 0.1, over whose edges a ball bumps, and ends 5 "
        "from the start."
    )


def test_a_disk_in_flight_over_a_paraboloid():
    disk = Disk(mass=1.0, inertia=0.1, radius=RADIUS, gravity=9.81, ground=Paraboloid((0.25, 0.25)))
    state = ReleasedState(DiskState(z=0.6, phi=0.3), V=(1.0, 0.0, 0.2), height=0.25)
    _, model, data = loaded(Scenario("above a bowl", disk, state, TIMES), extent=2.0)
    centre = data.body("shell").xpos
    foot = np.asarray(disk.ground.place(*map(jnp.asarray, (0.0, 0.6, 0.0))))
    assert np.linalg.norm(centre - foot) == pytest.approx(RADIUS + 0.25, abs=1e-12)
    assert height_by_ray(model, data, 0.6, 0.0) == pytest.approx(foot[2], abs=1e-3)


def test_the_outside_of_a_sphere_is_that_of_mujoco():
    """Without a note, because nothing about its form is another."""
    start = BallState(z=(0.8, 0.3))
    exported, _, data = loaded(Scenario("on a sphere", ball(SphereOutside(3.0)), start, TIMES))
    np.testing.assert_allclose(data.contact.dist, [0.0], atol=1e-12)
    assert not any("ground" in note for note in exported.notes)


@pytest.mark.parametrize(
    ("ground", "named"),
    [
        (Bowl(2.0), "ground"),
        (HeightField(swell, 0.1), "ground"),
        (TiltingPlane(ConstantRate(0.1, 0.0)), "ground"),
        (SphereOutside(3.0, motion=MovingFrame(turns=(Turn((0.0, 0.0, 1.0), ConstantRate(0.0, 1.0)),))), "ground"),
        (SphereOutside(3.0, turntable=Turntable(ConstantRate(0.0, 1.0))), "ground"),
        (Ground(belt=Belt(ConstantRate(0.0, 1.0))), "ground.belt"),
    ],
)
def test_grounds_that_mujoco_has_not(ground, named):
    with refuses(MJCFError, named):
        to_mjcf(Scenario("elsewhere", ball(ground), BallState(z=(0.2, 0.1)), TIMES))


def test_an_extent_beyond_the_end_of_the_ground():
    ground = SignedDistance(lambda t, x, y, z, p: z - jnp.sqrt(1 - x**2 / 25), None)
    with refuses(MJCFError, "extent"):
        to_mjcf(Scenario("a ridge", ball(ground), BallState(), TIMES), extent=6.0)


@pytest.mark.parametrize("extent", [0.0, -1.0, 50.1, np.nan])
def test_an_extent_that_is_none(extent):
    with refuses(MJCFError, "extent"):
        to_mjcf(Scenario("on waves", ball(HeightField(waves, WAVE)), BallState(), TIMES), extent=extent)


def test_a_convex_body_is_not_written_as_a_sphere():
    egg = ConvexBody(mass=1.0, inertia=(0.4, 0.4, 0.3), shape=Ellipsoid((1.0, 1.0, 1.3)))
    with refuses(MJCFError, "kind"):
        to_mjcf(Scenario("an egg", egg, BallState(), TIMES))
