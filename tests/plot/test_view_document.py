"""The dictionary of a view: what is in it, against states, closed forms and energies; and how precise it is."""

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxball
from jaxball import ConstantRate, Ground, HarmonicSeries, Oscillating, Turntable, load_scenario
from jaxball.plot import write_view
from jaxball.plot.style import ColourScale
from jaxball.plot.view.page import in_element, view_document
from jaxball.plot.view.scene import pack, thin_curve
from tests.plot.test_data_drawn import travelled
from tests.support.pages import arrays_of, unpacked
from tests.support.paper import BALL_ANGLES, BALL_RADII
from tests.support.sentences import refuses

ANGLE = 0.4


@pytest.fixture(scope="module")
def disk_on_a_slope():
    disk = jaxball.Disk(mass=2.0, inertia=1.0, gravity=0.5, ground=Ground(ANGLE))
    return jaxball.simulate(disk, np.linspace(0.0, 4.0, 21), jaxball.DiskState(), rtol=1e-6, atol=1e-6)


@pytest.fixture(scope="module")
def ball_document(ball_trajectory):
    return view_document(ball_trajectory, "the paper's ball", 0.3)


def test_the_pose_is_that_of_the_observables(ball_trajectory, ball_document):
    arrays, seen = arrays_of(ball_document), ball_trajectory.observables
    np.testing.assert_array_equal(arrays["time"], ball_trajectory.times)
    turn = Rotation.from_quat(arrays["quaternion"])
    for i in range(3):
        found = arrays["centre"] + turn.apply(arrays["masses"][:, i])
        expected = seen.geometric_centre + seen.mass_positions_space[:, i]
        np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(turn.apply(arrays["angular_velocity"]), seen.angular_velocity_space, atol=1e-6)
    assert np.all(np.sum(arrays["quaternion"][1:] * arrays["quaternion"][:-1], axis=1) >= 0)


def test_masses_are_on_their_rails_at_the_angles_of_the_pulse(ball_document):
    arrays = arrays_of(ball_document)
    radii = np.linalg.norm(arrays["masses"], axis=-1)
    np.testing.assert_allclose(radii, np.broadcast_to(BALL_RADII, radii.shape), atol=1e-6)
    expected = travelled(arrays["time"])[:, None] + np.asarray(BALL_ANGLES)
    np.testing.assert_allclose(arrays["mass_angles"], expected, rtol=1e-6)
    for j, radius in enumerate(BALL_RADII):
        np.testing.assert_allclose(np.linalg.norm(arrays[f"rail_{j}"], axis=-1), radius, rtol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize(("run", "weight"), [("ball_trajectory", 4.0), ("disk_on_a_slope", 1.0)])
def test_heights_on_the_page_are_those_of_the_potential_energy(run, weight, request):
    """V = M g z of the centre of mass, of shell and masses: the third axis of the page points against gravity."""
    document = view_document(request.getfixturevalue(run))
    arrays, (body,) = arrays_of(document), document["bodies"]
    turn, shell = Rotation.from_quat(arrays["quaternion"]), body["shell"]
    moment = shell["mass"] * np.asarray(shell["centre_of_mass"]) + np.zeros_like(arrays["centre"])
    for k, mass in enumerate(body["masses"]):
        moment += mass["mass"] * arrays["masses"][:, k]
    height = (arrays["centre"] + turn.apply(moment / (shell["mass"] + sum(m["mass"] for m in body["masses"]))))[:, 2]
    V = arrays["energies"][:, 1]
    assert np.ptp(V) > 0.1
    np.testing.assert_allclose(V - V[0], weight * (height - height[0]), atol=1e-5)


def test_a_slope_is_a_wedge_under_the_path(disk_on_a_slope):
    document = view_document(disk_on_a_slope)
    floor, centre = document["floor"], arrays_of(document)["centre"]
    assert (document["bodies"][0]["body"], floor["tilted"]) == ("disk", True)
    normal = np.asarray(document["axes"])[:, 2]
    np.testing.assert_allclose(normal, [np.sin(ANGLE), 0.0, np.cos(ANGLE)], atol=1e-12)
    np.testing.assert_allclose((centre - floor["top"][0]) @ normal, 1.0, atol=1e-6)  # r above the plane


@pytest.mark.long
def test_a_pendulum_hangs_on_its_arm_above_a_turntable_that_is_shaken():
    """The pendulum of the scenario: 0.6 long, about E2, from 0.5 at the start; the ground in closed form."""
    shaken = Oscillating(HarmonicSeries((0.0, 0.0, 0.0), [(0.5, 0.0, 0.2)], [2.0]))
    ground = Ground(motion=shaken, turntable=Turntable(ConstantRate(0.2, rate=1.5)))
    pendulum = load_scenario("pendulum-on-a-slope").system.mechanisms
    ball = jaxball.Ball(mass=1.0, inertia=(0.5, 0.55, 0.6), mechanisms=pendulum, ground=ground)
    times = np.linspace(0.0, 2.0, 401)
    run = jaxball.simulate(ball, times, jaxball.BallState(theta=(0.5,), thetadot=(0.0,)), rtol=1e-6, atol=1e-6)
    document = view_document(run)
    arrays = arrays_of(document)
    check_momentum(arrays, (0.5, 0.55, 0.6), [0.5])
    theta = arrays["joint_angles"][:, 0]
    assert theta[0] == 0.5
    assert np.ptp(theta) > 0.05
    place = 0.6 * np.stack([-np.sin(theta), 0 * theta, -np.cos(theta)], axis=1)
    np.testing.assert_allclose(arrays["masses"][:, 0], place, atol=1e-6)
    np.testing.assert_allclose(arrays["arms_0"][:, 0, -1], place, atol=1e-6)
    np.testing.assert_allclose(arrays["moved"], np.outer(np.sin(2 * times), [0.5, 0.0, 0.2]), atol=1e-6)
    np.testing.assert_allclose(arrays["turned"], 0.2 + 1.5 * times, atol=1e-6)
    (body,) = document["bodies"]
    assert body["masses"] == [{"name": "M₁", "colour": body["arms"][0], "mass": 0.5}]
    assert document["plots"][-1]["series"][0]["name"] == "θ₁,₁"


def check_momentum(arrays, inertia, masses):
    """Λ𝕀Ω + Σ m s × ds/dt over the plane, with s from the contact point: by differences of the places on the page."""
    turn, over_plane = Rotation.from_quat(arrays["quaternion"]), arrays["centre"] - arrays["moved"]
    momentum = turn.apply(arrays["angular_velocity"] * np.asarray(inertia))
    for m, place in zip([1.0, *masses], [0.0, *np.moveaxis(arrays["masses"], 1, 0)], strict=True):
        point = over_plane + turn.apply(place + np.zeros_like(over_plane))
        velocity = np.gradient(point, arrays["time"], axis=0)
        momentum += m * np.cross(point - over_plane + [0.0, 0.0, 1.0], velocity)
    assert np.all(np.ptp(momentum, axis=0) > 0.05)
    np.testing.assert_allclose(turn.apply(arrays["angular_momentum"])[1:-1], momentum[1:-1], atol=1e-4)


def test_graphs_name_columns_that_there_are(ball_trajectory, ball_document):
    titles = [plot["title"] for plot in ball_document["plots"]]
    assert titles == ["Energies", "Angular velocity", "Normal force", "Friction needed", "Angles of the masses (rad)"]
    three = view_document(dict.fromkeys("abc", ball_trajectory))
    assert [plot["title"] for plot in three["plots"]] == ["Energy", "Angular speed", "Normal force", "Friction needed"]
    for document in (ball_document, three):
        arrays = arrays_of(document)
        for plot in document["plots"]:
            for one in plot["series"]:
                assert max(one["columns"]) < np.prod(arrays[one["array"]].shape[1:], dtype=int)
    assert [one["name"] for one in ball_document["plots"][-1]["series"]] == ["θ₁", "θ₂", "θ₃"]
    assert ball_document["friction"] == 0.3
    assert ball_document["units"] == "dimensionless, m₀ = r = g = 1"


@pytest.mark.long
def test_positions_along_tubes_are_no_angles_and_a_disk_turns_at_one_rate(disk_trajectory):
    in_tube = jaxball.PointMass(0.1, jaxball.OnRail(jaxball.Tube((1.0, 0.0, 0.0)), ConstantRate(0.1)))
    disk = jaxball.Disk(mass=1.0, inertia=0.5, masses=[in_tube])
    run = jaxball.simulate(disk, [0.0, 0.1], jaxball.DiskState(), rtol=1e-6, atol=1e-6)
    titles = [plot["title"] for plot in view_document(run)["plots"]]
    assert "Positions of the masses" in titles
    assert not [title for title in titles if title.startswith("Angles")]
    document = view_document(disk_trajectory)
    (turning,) = (plot for plot in document["plots"] if plot["title"] == "Angular velocity")
    assert [one["name"] for one in turning["series"]] == ["φ̇"]
    np.testing.assert_allclose(arrays_of(document)["turning"], disk_trajectory.state.phidot, rtol=1e-6, atol=1e-7)


@pytest.mark.thorough
def test_bodies_are_on_one_plane_and_equal_arrays_are_once(ball_trajectory, ball_document):
    """A ball of half the radius is half a radius lower; two runs of one ball take hardly more room than one."""
    same = view_document({"before": ball_trajectory, "after": ball_trajectory})
    assert same["arrays"] == ball_document["arrays"]
    assert [(body["name"], body["dashed"]) for body in same["bodies"]] == [("before", True), ("after", False)]
    assert same["bodies"][0]["arrays"] == same["bodies"][1]["arrays"]
    small = jaxball.Ball(mass=1.0, inertia=(0.1, 0.1, 0.1), radius=0.5)
    run = jaxball.simulate(small, [0.0, 1.0], jaxball.BallState(Omega=(0.0, 1.0, 0.0)), rtol=1e-6, atol=1e-6)
    document = view_document({"large": ball_trajectory, "small": run})
    np.testing.assert_allclose(arrays_of(document, 0)["centre"][:, 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(arrays_of(document, 1)["centre"], [[0.0, 0.0, -0.5], [0.5, 0.0, -0.5]], atol=1e-6)
    assert document["floor"]["height"] == -1.0


def test_a_scale_colours_bodies_by_their_values(ball_trajectory):
    values = [1.0, 10.0, 100.0, np.nan]
    runs = dict.fromkeys("abcd", ball_trajectory)
    linear, logarithmic = (
        view_document(runs, scale=ColourScale("gravity", values, logarithmic=spaced)) for spaced in (False, True)
    )
    assert {name: linear["scale"][name] for name in ("name", "low", "high")} == {
        "name": "gravity",
        "low": 1,
        "high": 100,
    }
    for document, share in ((linear, 1 / 11), (logarithmic, 0.5)):
        colours = [body["colour"] for body in document["bodies"]]
        assert colours[:3] == [matplotlib.colors.to_hex(matplotlib.colormaps["viridis"](x)) for x in (0.0, share, 1.0)]
        assert [body["value"] for body in document["bodies"]] == [1.0, 10.0, 100.0, None]
        assert document["scale"]["stops"][::4] == [colours[0], logarithmic["bodies"][1]["colour"], colours[2]]


def test_the_wanted_path_is_on_the_plane(ball_trajectory, disk_on_a_slope):
    points = np.array([[0.0, 0.0], [3.0, 4.0]])
    document = view_document(ball_trajectory, wanted=points)
    np.testing.assert_allclose(unpacked(document["arrays"][document["wanted"]]), [[0, 0, -1], [3, 4, -1]], atol=1e-6)
    assert document["floor"]["high"][1] > 4.0
    slope = view_document(disk_on_a_slope, wanted=np.array([[0.0, 0.0], [2.0, 0.0]]))
    start, end = unpacked(slope["arrays"][slope["wanted"]])
    np.testing.assert_allclose(end - start, [2 * np.cos(ANGLE), 0.0, -2 * np.sin(ANGLE)], atol=1e-6)


def test_obstacles_are_on_a_floor_that_has_room_for_them(ball_trajectory, disk_on_a_slope):
    """In the plane's own axes, so that a slope tilts them, too."""
    discs = ((np.array([30.0, -20.0]), 2.5), (np.array([1.0, 2.0]), 0.5))
    document = view_document(ball_trajectory, discs=discs)
    assert document["obstacles"] == [[30.0, -20.0, 2.5], [1.0, 2.0, 0.5]]
    assert document["floor"]["high"][0] >= 32.5
    assert document["floor"]["low"][1] <= -22.5
    assert view_document(ball_trajectory)["obstacles"] == []
    slope = view_document(disk_on_a_slope, discs=[(np.array([9.0, 0.0]), 1.0)])
    assert slope["obstacles"] == [[9.0, 0.0, 1.0]]
    assert slope["floor"]["high"][0] >= 10.0


def test_numbers_are_in_float64_where_float32_would_show_a_point_elsewhere():
    near, far = np.array([1 / 3]), np.array([100 + 1 / 3])  # float32 is off by 1e-8 and by 2e-6
    assert [pack(near, 1.0)["type"], pack(far, 1.0)["type"]] == ["float32", "float64"]
    assert [pack(far)["type"], pack(far, 10.0)["type"], pack(near, 1e-3)["type"]] == [
        "float32",
        "float32",
        "float64",
    ]
    assert unpacked(pack(far, 1.0))[0] == far[0]
    assert pack(np.array([1e300]), 1.0)["type"] == "float64"
    assert pack(np.zeros((3, 0, 3)), 1.0)["shape"] == [3, 0, 3]


@pytest.mark.thorough
def test_2000_frames_of_the_papers_ball_are_less_than_a_megabyte(ball_trajectory):
    """All of them, also far away, where the path must be in float64."""
    leaves = jax.tree.map(lambda leaf: jnp.asarray(np.resize(leaf, (2000, *leaf.shape[1:]))), ball_trajectory.state)
    far = eqx.tree_at(lambda state: state.z, leaves, leaves.z + 100.0 / 3.0)
    times = jnp.linspace(0.0, 20.0, 2000)
    run = eqx.tree_at(lambda run: (run.times, run.state), ball_trajectory, (times, far))
    view = run.view(friction=0.3)
    body = view.document["bodies"][0]
    kinds = {name: view.document["arrays"][place]["type"] for name, place in body["arrays"].items()}
    assert (kinds["time"], kinds["centre"], kinds["masses"]) == ("float64", "float64", "float32")
    assert view.document["note"] == ""
    assert arrays_of(view.document)["time"].shape == (2000,)
    assert 2000 * 31 * 4 * 4 / 3 < len(view.html.encode()) < 900_000


def test_a_run_without_room_is_thinned_evenly_and_says_so(ball_trajectory):
    whole = view_document(ball_trajectory)
    room = 0.92 * len(in_element(whole))
    document = view_document(ball_trajectory, room=room)
    assert len(in_element(document)) <= room
    times = arrays_of(document)["time"]
    rows = np.searchsorted(ball_trajectory.times, times)
    assert 3 < len(times) < 21
    assert (rows[0], rows[-1]) == (0, 20)
    assert np.ptp(np.diff(rows)) <= 1
    for name, values in arrays_of(document).items():
        all_values = arrays_of(whole)[name]
        np.testing.assert_array_equal(values, all_values if name.startswith("rail") else all_values[rows])
    assert document["note"].startswith(f"Shown are {len(times)} of the 21 saved times, evenly spaced,")
    assert whole["note"] == ""
    assert arrays_of(view_document(ball_trajectory, room=0.0))["time"].tolist() == [0.0, 20.0]


def test_rails_are_sampled_no_more_closely_than_can_be_seen():
    angle = np.linspace(0.0, 2 * np.pi, 241)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    few = thin_curve(circle, 1e-3)
    assert len(few) == 81  # every third point: 1 − cos(π / 80) = 8e-4, and with every fourth it would be 1.4e-3
    np.testing.assert_array_equal(few, circle[::3])
    assert thin_curve(circle[:2], 1e-3).tolist() == circle[:2].tolist()
    assert len(thin_curve(circle, 1e-9)) == 241


def test_a_failed_run_is_shown_as_far_as_it_came(failed_trajectory):
    document = view_document(failed_trajectory)
    np.testing.assert_array_equal(arrays_of(document)["time"], np.arange(7.0))
    assert document["ok"] is False
    assert document["message"] == failed_trajectory.message


def test_of_several_runs_those_that_failed_are_named(ball_trajectory, failed_trajectory):
    document = view_document({"row 3": ball_trajectory, "row 7": failed_trajectory})
    assert (document["ok"], document["message"]) == (False, f"row 7: {failed_trajectory.message}")
    assert arrays_of(document, 1)["time"].shape == (7,)
    fine = view_document({"a": ball_trajectory, "b": ball_trajectory})
    assert (fine["ok"], fine["message"]) == (True, "Every solve reached its end.")


@pytest.mark.thorough
def test_what_cannot_be_shown_is_refused_in_a_sentence(
    ball_trajectory, reduced_trajectory, hopeless_trajectory, tmp_path
):
    batch = eqx.tree_at(lambda run: run.status, ball_trajectory, jnp.zeros((2,), dtype=int))
    for trajectory, named in (
        (reduced_trajectory, "trajectory"),
        (batch, "A picture"),
        (hopeless_trajectory, "trajectory"),
    ):
        with refuses(ValueError, named):
            trajectory.view(tmp_path / "run.html")
    for friction in (0.0, -1.0, np.nan, np.inf):
        with refuses(ValueError, "friction"):
            ball_trajectory.view(friction=friction)
    slope = eqx.tree_at(lambda run: run.system.ground, ball_trajectory, Ground(0.1), is_leaf=lambda leaf: leaf is None)
    for runs, scale, named in (
        ({}, None, "trajectories"),
        ({str(k): ball_trajectory for k in range(25)}, None, "trajectories"),
        ({"a": ball_trajectory, "<b>": slope}, None, "trajectories"),
        (ball_trajectory, ColourScale("g", [1.0, 2.0]), "scale"),
    ):
        with refuses(ValueError, named):
            write_view(runs, tmp_path / "run.html", scale=scale)
    assert list(tmp_path.iterdir()) == []
