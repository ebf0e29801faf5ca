"""The dictionary of a view: what is in it, against states, closed forms and energies; and how precise it is."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxball
from jaxball import ConstantRate, Ground, HarmonicSeries, Oscillating, Turntable
from jaxball.classical import FreeRigidBody, RigidBodyState
from jaxball.plot import View
from jaxball.plot.view.document import packed, view_document
from jaxball.scenario import load_scenario
from tests.plot.test_data_drawn import travelled
from tests.support.pages import unpacked
from tests.support.paper import BALL_ANGLES, BALL_RADII

ANGLE = 0.4


@pytest.fixture(scope="module")
def disk_on_a_slope():
    disk = jaxball.Disk(mass=2.0, inertia=1.0, gravity=0.5, ground=Ground(ANGLE))
    return jaxball.simulate(disk, np.linspace(0.0, 4.0, 21), jaxball.DiskState(), rtol=1e-6, atol=1e-6)


@pytest.fixture(scope="module")
def ball_document(ball_trajectory):
    return view_document(ball_trajectory, "the paper's ball", 0.3)


def arrays_of(document):
    return {name: unpacked(array) for name, array in document["arrays"].items()}


def test_the_pose_is_that_of_the_observables(ball_trajectory, ball_document):
    arrays, seen = arrays_of(ball_document), ball_trajectory.observables
    np.testing.assert_array_equal(arrays["time"], ball_trajectory.times)
    turn = Rotation.from_quat(arrays["quaternion"])
    for i in range(3):
        found = arrays["centre"] + turn.apply(arrays["masses"][:, i])
        expected = seen.geometric_centre + seen.mass_positions_space[:, i]
        np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(turn.apply(arrays["centre_of_mass"]), seen.centre_of_mass_space, atol=1e-6)
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


@pytest.mark.parametrize(("run", "weight"), [("ball_trajectory", 4.0), ("disk_on_a_slope", 1.0)])
def test_heights_on_the_page_are_those_of_the_potential_energy(run, weight, request):
    """V = M g z: the third axis of the page points against gravity."""
    arrays = arrays_of(view_document(request.getfixturevalue(run)))
    turn = Rotation.from_quat(arrays["quaternion"])
    height = (arrays["centre"] + turn.apply(arrays["centre_of_mass"]))[:, 2]
    V = arrays["energies"][:, 1]
    assert np.ptp(V) > 0.1
    np.testing.assert_allclose(V - V[0], weight * (height - height[0]), atol=1e-5)


def test_a_slope_is_a_wedge_under_the_path(disk_on_a_slope):
    document = view_document(disk_on_a_slope)
    floor, centre = document["floor"], unpacked(document["arrays"]["centre"])
    assert (document["body"], floor["tilted"]) == ("disk", True)
    normal = np.asarray(document["axes"])[:, 2]
    np.testing.assert_allclose(normal, [np.sin(ANGLE), 0.0, np.cos(ANGLE)], atol=1e-12)
    np.testing.assert_allclose((centre - floor["top"][0]) @ normal, 1.0, atol=1e-6)  # r above the plane


def test_a_pendulum_hangs_on_its_arm_above_a_turntable_that_is_shaken():
    """The pendulum of the scenario: 0.6 long, about E2, from 0.5 at the start; the ground in closed form."""
    shaken = Oscillating(HarmonicSeries((0.0, 0.0, 0.0), [(0.5, 0.0, 0.2)], [2.0]))
    ground = Ground(motion=shaken, turntable=Turntable(ConstantRate(0.2, rate=1.5)))
    pendulum = load_scenario("pendulum-on-a-slope").system.mechanisms
    ball = jaxball.Ball(mass=1.0, inertia=(0.5, 0.55, 0.6), mechanisms=pendulum, ground=ground)
    times = np.linspace(0.0, 2.0, 5)
    run = jaxball.simulate(ball, times, jaxball.BallState(theta=(0.5,), thetadot=(0.0,)), rtol=1e-6, atol=1e-6)
    document = view_document(run)
    arrays = arrays_of(document)
    theta = arrays["joint_angles"][:, 0]
    assert theta[0] == 0.5
    assert np.ptp(theta) > 0.05
    place = 0.6 * np.stack([-np.sin(theta), 0 * theta, -np.cos(theta)], axis=1)
    np.testing.assert_allclose(arrays["masses"][:, 0], place, atol=1e-6)
    np.testing.assert_allclose(arrays["arms_0"][:, 0, -1], place, atol=1e-6)
    np.testing.assert_allclose(arrays["moved"], np.outer(np.sin(2 * times), [0.5, 0.0, 0.2]), atol=1e-6)
    np.testing.assert_allclose(arrays["turned"], 0.2 + 1.5 * times, atol=1e-6)
    assert document["masses"] == [{"name": "M₁", "colour": document["arms"][0], "mass": 0.5}]
    assert document["plots"][-1]["series"][0]["name"] == "θ₁,₁"


def test_graphs_name_columns_that_there_are(ball_document):
    arrays = ball_document["arrays"]
    titles = [plot["title"] for plot in ball_document["plots"]]
    assert titles == ["Energies", "Angular velocity", "Normal force", "Friction needed", "Angles of the masses"]
    for plot in ball_document["plots"]:
        for one in plot["series"]:
            assert max(one["columns"]) < np.prod(arrays[one["array"]]["shape"][1:], dtype=int)
    assert [one["name"] for one in ball_document["plots"][-1]["series"]] == ["θ₁", "θ₂", "θ₃"]
    assert ball_document["friction"] == 0.3
    assert ball_document["units"] == "dimensionless, m₀ = r = g = 1"


def test_numbers_are_in_float64_where_float32_would_show_a_point_elsewhere():
    near, far = np.array([1 / 3]), np.array([100 + 1 / 3])  # float32 is off by 1e-8 and by 2e-6
    assert [packed(near, 1.0)["type"], packed(far, 1.0)["type"]] == ["float32", "float64"]
    assert [packed(far)["type"], packed(far, 10.0)["type"], packed(near, 1e-3)["type"]] == [
        "float32",
        "float32",
        "float64",
    ]
    assert unpacked(packed(far, 1.0))[0] == far[0]
    assert packed(np.array([1e300]), 1.0)["type"] == "float64"
    assert packed(np.zeros((3, 0, 3)), 1.0)["shape"] == [3, 0, 3]


def test_2000_frames_of_the_papers_ball_are_less_than_a_megabyte(ball_document):
    """The rows over time repeated: the length of base64 depends on nothing but their number and type."""
    arrays = dict(ball_document["arrays"])
    over_time = [name for name, array in arrays.items() if array["shape"][0] == 21]
    for name in over_time:
        values, exact = unpacked(arrays[name]), arrays[name]["type"] == "float64"
        arrays[name] = packed(np.resize(values, (2000, *values.shape[1:])), 0.0 if exact else None)
    arrays["time"] = packed(np.linspace(0.0, 20.0, 2000), 0.0)
    text = View(ball_document | {"arrays": arrays}).html
    assert len(over_time) == 11
    assert arrays["time"]["type"] == "float64"
    assert 2000 * 31 * 4 * 4 / 3 < len(text.encode()) < 1_000_000


def test_a_failed_run_is_shown_as_far_as_it_came(failed_trajectory):
    document = view_document(failed_trajectory)
    np.testing.assert_array_equal(unpacked(document["arrays"]["time"]), np.arange(7.0))
    assert document["ok"] is False
    assert document["message"] == failed_trajectory.message


def test_what_cannot_be_shown_is_refused_in_a_sentence(
    ball_trajectory, reduced_trajectory, hopeless_trajectory, tmp_path
):
    top = jaxball.simulate(FreeRigidBody(inertia=(1.0, 2.0, 3.0)), [0.0, 1.0], RigidBodyState(), rtol=1e-6, atol=1e-6)
    batch = eqx.tree_at(lambda run: run.status, ball_trajectory, jnp.zeros((2,), dtype=int))
    for trajectory, sentence in (
        (top, r"must be of a ball or a disk, .* but it is of a FreeRigidBody; its method plot\(\) draws its motion\.$"),
        (reduced_trajectory, r"must know where the ball is, .* simulate with a BallState\.$"),
        (batch, r"must be one trajectory, but it is a batch of shape \(2,\); take one"),
        (hopeless_trajectory, r"must have a finite state to show, but it has none\."),
    ):
        with pytest.raises(ValueError, match="^Argument `trajectory` " + sentence):
            trajectory.view(tmp_path / "run.html")
    for friction in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match=r"^Argument `friction` must be a positive number, but it is"):
            ball_trajectory.view(friction=friction)
    assert list(tmp_path.iterdir()) == []
