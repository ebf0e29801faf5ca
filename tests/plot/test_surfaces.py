"""Surfaces in animations and views: meshes, trails, forces and poses against the forms and motions they are of."""

import jax.numpy as jnp
import numpy as np
import pytest
from mpl_toolkits.mplot3d import proj3d
from scipy.spatial.transform import Rotation

from jaxball import Ball, BallState, Bowl, Contact, Disk, DiskState, FunctionSchedule, HeightField, simulate
from jaxball.physics import Cylinder, Mode, MovingFrame, SignedDistance, SphereOutside, TiltingPlane, Turn, Washboard
from jaxball.plot.palette import TRAIL
from jaxball.plot.record import record
from jaxball.plot.scene import scene
from jaxball.plot.shapes import place
from jaxball.plot.surface import curve_under, mesh_under
from jaxball.plot.view.page import view_document
from tests.plot.geometry import overlaps
from tests.support.pages import arrays_of, unpacked
from tests.support.sentences import refuses
from tests.support.signed_distances import inside_ellipsoid, inside_sphere

r, R = 0.1, 1.0
FACET = 0.04 * r  # twice what a line of a mesh may be off the surface: along a diagonal of a cell
TIMES = np.linspace(0.0, 1.0, 31)


def marble(ground):
    return Ball(mass=1.0, radius=r, inertia=(0.004, 0.004, 0.004), gravity=9.81, ground=ground)


def swing(t, _):
    return 0.3 * jnp.sin(2.0 * t)


def waves(t, x, y, height):
    return height * jnp.sin(3.0 * x - 2.0 * t) * jnp.cos(2.0 * y)


EGG = (1.0, 1.2, 1.5)
RUNS = {
    "bowl": (Bowl(R), BallState(z=(1.0, 0.0), Omega=(8.0, 0.0, 0.0))),
    "hill": (SphereOutside(R), BallState(z=(0.3, 0.1))),
    "well": (Cylinder(R, axis=(0.0, 0.0, 1.0), start=(1.0, 0.0, 0.0)), BallState(Omega=(0.0, 0.0, 80.0))),
    "plate": (TiltingPlane(about_e1=FunctionSchedule(swing)), BallState(z=(0.2, 0.1))),
    "waves": (HeightField(waves, 0.1), BallState(Omega=(0.0, 10.0, 0.0))),
    "egg": (
        SignedDistance(inside_ellipsoid, np.array(EGG), centre=(0.0, 0.0, 0.0), guess=1.0),
        BallState(z=(1.0, 0.0), Omega=(8.0, 0.0, 0.0)),
    ),
    "rim": (SignedDistance(inside_sphere, R, guess=0.1), BallState(z=(0.9, 0.0), Omega=(8.0, 0.0, 0.0))),
}
# How far points are from each surface at a time.
DISTANCES = {
    "bowl": lambda t, p: np.linalg.norm(p - [0.0, 0.0, R], axis=-1) - R,
    "hill": lambda t, p: np.linalg.norm(p - [0.0, 0.0, -R], axis=-1) - R,
    "well": lambda t, p: np.linalg.norm(p[..., :2], axis=-1) - R,
    "plate": lambda t, p: Rotation.from_rotvec([0.3 * np.sin(2 * t), 0.0, 0.0]).inv().apply(p.reshape(-1, 3))[:, 2],
    "waves": lambda t, p: p[..., 2] - 0.1 * np.sin(3 * p[..., 0] - 2 * t) * np.cos(2 * p[..., 1]),
    "egg": lambda t, p: np.linalg.norm(p / EGG, axis=-1) - 1.0,
    "rim": lambda t, p: np.linalg.norm(p - [0.0, 0.0, R], axis=-1) - R,
}


@pytest.fixture(scope="module")
def runs():
    made = {}

    def run(name):
        if name not in made:
            ground, start = RUNS[name]
            made[name] = simulate(marble(ground), TIMES, start, rtol=1e-8, atol=1e-8)
        return made[name]

    return run


@pytest.mark.thorough
@pytest.mark.parametrize("name", RUNS)
def test_the_mesh_and_the_trail_of_a_scene_are_on_the_surface(runs, name):
    run = runs(name)
    figure, show = scene(run, record(run))
    contacts = place(run, record(run)).setting.contacts
    mesh = mesh_under(run.system.ground, TIMES, contacts, r)
    for k in (0, 11, 30):
        show(k)
        off = DISTANCES[name](TIMES[k], mesh.at(k))
        np.testing.assert_allclose(off, 0.0, atol=1e-12)
        trail = next(line for line in figure.axes[0].lines if line.get_linewidth() == 1.8)
        points = np.column_stack(trail.get_data_3d())
        assert len(points) == k + 1
        np.testing.assert_allclose(DISTANCES[name](TIMES[k], points), 0.0, atol=FACET if name == "waves" else 1e-8)
        seen = record(run).observables
        np.testing.assert_allclose(points[-1], seen.contact_point[k], atol=FACET if name == "waves" else 1e-8)
    assert overlaps(figure) == []


@pytest.mark.thorough
@pytest.mark.parametrize("name", RUNS)
def test_the_numbers_of_a_view_are_those_of_the_run(runs, name):
    """N n + f in the axes of the surface is the contact force; cells are close to the surface, and face the ball."""
    run = runs(name)
    document = view_document(run)
    arrays, seen = arrays_of(document), record(run).observables
    np.testing.assert_allclose(arrays["centre"], seen.geometric_centre, atol=1e-6)
    n, first = arrays["normal"], arrays["tangent"]
    f = arrays["friction"][:, :1] * first + arrays["friction"][:, 1:] * np.cross(n, first)
    np.testing.assert_allclose(arrays["normal_force"][:, None] * n + f, seen.contact_force, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(arrays["centre"] - r * n, seen.contact_point, atol=1e-6)
    rows, columns = document["floor"]["mesh"]
    assert arrays["mesh"].shape == (31 if name == "waves" else 1, rows * columns, 3)
    for k in (0, 17):
        mesh = arrays["mesh"][k if name == "waves" else 0].astype(float)
        if "carried" in arrays:
            mesh = Rotation.from_quat(arrays["carried"][k]).apply(mesh)
        mesh = mesh.reshape(rows, columns, 3)
        middles = (mesh[1:, 1:] + mesh[:-1, :-1]) / 2
        np.testing.assert_allclose(DISTANCES[name](TIMES[k], middles), 0.0, atol=FACET)
        facing = np.cross(mesh[1:, 1:] - mesh[:-1, :-1], mesh[:-1, 1:] - mesh[1:, :-1])
        nearest = np.argmin(np.linalg.norm(middles - seen.contact_point[k], axis=-1))
        assert facing.reshape(-1, 3)[nearest] @ n[k] > 0
        reach = np.linalg.norm(mesh.reshape(-1, 3) - np.asarray(seen.contact_point[k]), axis=1)
        assert reach.min() < 0.3  # the mesh is where the ball is


@pytest.mark.thorough
def test_a_ball_that_goes_round_and_round_is_in_one_cylinder(runs):
    """The arc of the path is longer than the circumference, and the mesh goes around once."""
    run = runs("well")
    assert np.ptp(run.state.z[:, 1]) > 2 * np.pi * R
    document = view_document(run)
    rows, columns = document["floor"]["mesh"]
    mesh = arrays_of(document)["mesh"].reshape(rows, columns, 3)
    around = np.unwrap(np.arctan2(mesh[0, :, 1], mesh[0, :, 0]))
    np.testing.assert_allclose(np.ptp(around), 2 * np.pi, rtol=1e-5)


@pytest.mark.thorough
def test_several_balls_on_one_surface_and_what_is_marked_on_it(runs):
    other = simulate(marble(Bowl(R)), TIMES, BallState(z=(0.2, 0.3)), rtol=1e-8, atol=1e-8)
    wanted, disc = np.array([[0.0, 0.0], [1.2, 0.0]]), (np.array([0.0, -1.0]), 0.2)
    document = view_document({"a": runs("bowl"), "b": other}, wanted=wanted, discs=[disc])
    assert document["bodies"][0]["arrays"]["mesh"] == document["bodies"][1]["arrays"]["mesh"]
    # u = 2 R tan(φ/2) along e1 is R (sin φ, 0, 1 − cos φ).
    phi = 2 * np.arctan(0.6)
    expected = [[0.0, 0.0, 0.0], [np.sin(phi), 0.0, 1 - np.cos(phi)]]
    np.testing.assert_allclose(unpacked(document["arrays"][document["wanted"]]), expected, atol=1e-6)
    (edge,) = (np.reshape(ring, (-1, 3)) for ring in document["obstacles"])
    np.testing.assert_allclose(DISTANCES["bowl"](0.0, edge), 0.0, atol=1e-12)
    # Where the edge is farthest from the lowest point, it is at 1.2 too.
    np.testing.assert_allclose(edge[:, 2].max(), 1 - np.cos(phi), atol=1e-3)
    with refuses(ValueError, "b"):
        view_document({"a": runs("bowl"), "b": runs("hill")})


@pytest.mark.thorough
def test_an_animation_of_a_moving_surface_is_written(runs, tmp_path):
    path = runs("plate").animate(tmp_path / "plate.gif", 5, size=(200, 150)).path
    assert path.stat().st_size > 1000


CURVES = {
    "pipe": (
        Cylinder(R, axis=(0.0, 1.0, 0.0), centre=(0.0, 0.0, R)),
        lambda t, p: np.hypot(p[..., 0], p[..., 2] - R) - R,
    ),
    "waves": (
        HeightField(lambda t, x, y, _: 0.1 * jnp.sin(3.0 * x - 2.0 * t)),
        lambda t, p: p[..., 2] - 0.1 * np.sin(3 * p[..., 0] - 2 * t),
    ),
    "plate": (
        TiltingPlane(about_e2=FunctionSchedule(swing)),
        lambda t, p: p[..., 2] * np.cos(0.3 * np.sin(2 * t)) + p[..., 0] * np.sin(0.3 * np.sin(2 * t)),
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", CURVES)
def test_a_disk_is_drawn_on_its_curve(name):
    """The curve and the trail of a scene are on the ground at each time, and the rim touches the end of the trail."""
    ground, distance = CURVES[name]
    disk = Disk(mass=1.0, radius=r, inertia=0.005, gravity=9.81, ground=ground)
    run = simulate(disk, TIMES, DiskState(z=0.3, phidot=-10.0), rtol=1e-8, atol=1e-8)
    setting = place(run, record(run)).setting
    curve = curve_under(ground, TIMES, np.asarray(run.state.z), setting.contacts, r)
    seen = run.observables
    for k in (0, 7, 30):
        assert np.max(np.abs(distance(TIMES[k], curve.at(k)))) < FACET
        trail = curve.trail(k)
        assert np.max(np.abs(distance(TIMES[k], trail))) < FACET
        np.testing.assert_allclose(trail[-1], seen.contact_point[k], atol=FACET)
        np.testing.assert_allclose(np.linalg.norm(trail[-1] - seen.geometric_centre[k]), r, atol=FACET)
    figure, show = scene(run, record(run))
    (ax,), drawn = figure.axes, curve.at(30)
    show(30)
    assert any(
        line.get_xdata().shape == (len(drawn),) and np.allclose(line.get_ydata(), drawn[:, 2]) for line in ax.lines
    )
    arrays = arrays_of(view_document(run))
    n, first = arrays["normal"], arrays["tangent"]
    f = arrays["friction"][:, :1] * first
    np.testing.assert_allclose(arrays["normal_force"][:, None] * n + f, seen.contact_force, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(arrays["centre"] - r * n, seen.contact_point, atol=1e-6)


@pytest.fixture(scope="module")
def jump():
    """A marble that comes off a hill that moves and tilts, and lands on a part of it."""
    tilts = MovingFrame([Turn((0.0, 1.0, 0.0), FunctionSchedule(swing))])
    ground, start = Washboard(0.1, wavelength=1.5, motion=tilts), BallState(Omega=(0.0, 45.0, 3.0))
    times = np.linspace(0.0, 0.8, 41)
    return simulate(marble(ground), times, start, contact=Contact(0.4, restitution=0.5), rtol=1e-8, atol=1e-8)


def in_axes_of_hill(t, points):
    return Rotation.from_rotvec([0.0, float(swing(t, None)), 0.0]).inv().apply(np.array(points))


@pytest.mark.thorough
def test_the_trail_of_a_ball_that_flies_is_over_the_surface(jump):
    """Where it touches, the trail is on the ground; in flight one radius from the centre, in the ground's axes."""
    modes, seen = np.asarray(jump.contact.mode), jump.observables
    assert {Mode.ROLLING, Mode.FLIGHT} <= {Mode(int(mode)) for mode in modes}
    figure, show = scene(jump, record(jump))
    k = 40
    show(k)
    ax = figure.axes[0]
    rolled, _, flew = (line for line in ax.lines if line.get_color() == TRAIL)  # in the order of modes
    flown = np.column_stack(flew.get_data_3d())
    flown = in_axes_of_hill(jump.times[k], flown[np.isfinite(flown[:, 0])])
    centres = [in_axes_of_hill(jump.times[i], seen.geometric_centre[i]) for i in np.flatnonzero(modes == Mode.FLIGHT)]
    for centre in centres:
        assert np.min(np.abs(np.linalg.norm(flown - centre, axis=1) - r)) < 1e-6
    height = flown[:, 2] - 0.1 * np.sin(2 * np.pi * flown[:, 0] / 1.5)
    assert np.max(height) > 0.5 * r
    np.testing.assert_array_less(-1e-6, height)
    touched = np.column_stack(rolled.get_data_3d())
    touched = in_axes_of_hill(jump.times[k], touched[np.isfinite(touched[:, 0])])
    np.testing.assert_allclose(touched[:, 2], 0.1 * np.sin(2 * np.pi * touched[:, 0] / 1.5), atol=1e-6)
    shadow = next(one for one in ax.collections if one.get_zorder() == 1.5)
    ax.M = ax.get_proj()
    shadow.do_3d_projection()
    corners = shadow.get_paths()[0].vertices
    below = proj3d.proj_transform(*seen.contact_point[k], ax.get_proj())[:2]
    np.testing.assert_allclose((corners.min(axis=0) + corners.max(axis=0)) / 2, below, atol=1e-6)


@pytest.mark.thorough
def test_the_view_of_a_ball_that_flies_has_its_height_and_its_modes(jump):
    document = view_document(jump)
    arrays = arrays_of(document)
    feet = arrays["centre"] - (r + arrays["height"].reshape(-1, 1)) * arrays["normal"]
    feet = np.stack([in_axes_of_hill(float(t), foot) for t, foot in zip(arrays["time"].ravel(), feet, strict=True)])
    np.testing.assert_allclose(feet[:, 2], 0.1 * np.sin(2 * np.pi * feet[:, 0] / 1.5), atol=1e-6)
    assert np.max(arrays["height"]) > 0.5 * r
    assert [spell[0] for spell in document["bodies"][0]["spells"]][:3] == ["rolling", "sliding", "flight"]
