"""Recordings are read back by the library of the format, and hold the numbers of the run, frames in its conventions."""

import json
import tomllib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxball import Ball, Status, load_run, load_scenario, read_scenario, save, simulate
from jaxball.files.results import OutputError, RunError
from tests.scenario.documents import BALL, DISK
from tests.support.sentences import refuses

PENDULUM = (
    BALL
    + """
[[mechanisms]]
joints = [{ kind = "hinge", axis = [0.0, 1.0, 0.0], force = { kind = "damper", coefficient = 0.1 } }]
masses = [{ mass = 0.5, place = [0.0, 0.0, -0.4] }]
"""
)


@pytest.fixture(scope="module")
def reader():
    return pytest.importorskip("mcap.reader", reason="mcap, of the extra `mcap`, is not installed")


@pytest.fixture
def read(reader, tmp_path):
    """What a function of a run that is saved reads of each topic: times in ns and messages; and the file's reader."""

    def of(run):
        topics = {}
        with save(run, tmp_path / "run.mcap").open("rb") as file:
            opened = reader.make_reader(file, validate_crcs=True)
            for schema, channel, message in opened.iter_messages():
                assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
                told, sent = json.loads(schema.data), json.loads(message.data)
                assert told["title"] == schema.name
                check(told, sent)
                topics.setdefault(channel.topic, []).append((message.log_time, sent))
            about = {item.name: item.metadata for item in opened.iter_metadata()}
            attached = {item.name: item.data.decode() for item in opened.iter_attachments()}
        return topics, about, attached

    return of


def check(schema, value):
    """Raises unless a message has exactly the properties of its schema, of their types; null stands for no number."""
    types = {"number": (int, float, type(None)), "integer": int, "string": str, "boolean": bool, "array": list}
    if schema["type"] != "object":
        assert isinstance(value, types[schema["type"]])
        for item in value if schema["type"] == "array" else ():
            check(schema["items"], item)
        return
    assert isinstance(value, dict)
    if "properties" in schema:
        assert set(value) == set(schema["properties"])
        for name, inner in schema["properties"].items():
            check(inner, value[name])


def xyz(vectors):
    return np.array([[v["x"], v["y"], v["z"]] for v in vectors])


@pytest.mark.thorough
def test_a_ball_with_a_pendulum(read):
    run = read_scenario(PENDULUM).simulate(throw=True)
    topics, about, attached = read(run)
    times = np.asarray(run.times)
    assert set(topics) == {"/tf", "/scene", "/contact_force", "/joint_states", "/run"}
    bodies = [(when, sent) for when, sent in topics["/tf"] if sent["child_frame_id"] == "body"]
    np.testing.assert_allclose([when for when, _ in bodies], (times - times[0]) * 1e9, rtol=0, atol=1)
    stamps = [sent["timestamp"] for _, sent in bodies]
    assert [stamp["sec"] * 10**9 + stamp["nsec"] for stamp in stamps] == [when for when, _ in bodies]
    assert {sent["parent_frame_id"] for _, sent in bodies} == {"world"}
    seen = run.observables
    np.testing.assert_array_equal(xyz([sent["translation"] for _, sent in bodies]), seen.geometric_centre)
    # A mass in the world is where both frames take it.
    turn = Rotation.from_quat([[sent["rotation"][axis] for axis in "xyzw"] for _, sent in bodies])
    for k in range(seen.mass_positions_body.shape[1]):
        own = [sent for _, sent in topics["/tf"] if sent["child_frame_id"] == f"mass[{k}]"]
        assert {sent["parent_frame_id"] for sent in own} == {"body"}
        placed = turn.apply(xyz([sent["translation"] for sent in own]))
        np.testing.assert_allclose(placed, seen.mass_positions_space[:, k], rtol=0, atol=1e-14)
    forces = [sent for _, sent in topics["/contact_force"]]
    np.testing.assert_array_equal(xyz([sent["force"] for sent in forces]), seen.contact_force)
    np.testing.assert_array_equal(xyz([sent["point"] for sent in forces]), seen.contact_point)
    np.testing.assert_array_equal([sent["normal_force"] for sent in forces], seen.normal_force)
    joints = [sent for _, sent in topics["/joint_states"]]
    assert joints[0]["name"] == ["mechanisms[0].joints[0]"]
    np.testing.assert_array_equal([sent["position"] for sent in joints], run.state.theta)
    np.testing.assert_array_equal([sent["velocity"] for sent in joints], run.state.thetadot)
    np.testing.assert_array_equal([sent["effort"] for sent in joints], seen.joint_efforts)
    numbers = [sent for _, sent in topics["/run"]]
    np.testing.assert_array_equal([sent["time"] for sent in numbers], times)
    np.testing.assert_array_equal([sent["Omega"] for sent in numbers], run.state.Omega)
    np.testing.assert_array_equal([sent["energy"] for sent in numbers], seen.energy)
    ((when, scene),) = topics["/scene"]
    assert when == 0
    assert [entity["frame_id"] for entity in scene["entities"]] == ["body", "mass[0]", "mass[1]"]
    assert scene["entities"][0]["spheres"][0]["size"] == dict.fromkeys("xyz", 2 * float(run.system.radius))
    assert about["run"]["status"] == "SUCCESS"
    assert float(about["run"]["start"]) == times[0]
    assert tomllib.loads(attached["scenario.toml"])["kind"] == "ball"


@pytest.mark.thorough
def test_a_disk_turns_about_e2_and_its_rim_touches_the_plane(read):
    """Whatever the time, the point of the cylinder that the frame has lowest is at the contact point."""
    run = read_scenario(DISK).simulate(throw=True)
    topics, *_ = read(run)
    bodies = [sent for _, sent in topics["/tf"] if sent["child_frame_id"] == "body"]
    turn = Rotation.from_quat([[sent["rotation"][axis] for axis in "xyzw"] for sent in bodies])
    np.testing.assert_allclose(turn.apply([0.0, 1.0, 0.0]), np.tile([0.0, 1.0, 0.0], (len(bodies), 1)), atol=1e-15)
    phi = np.asarray(run.state.phi)
    along = np.stack([np.cos(phi), 0 * phi, np.sin(phi)], axis=1)  # φ is counted from e1 to E1, anticlockwise
    np.testing.assert_allclose(turn.apply([1.0, 0.0, 0.0]), along, rtol=0, atol=1e-14)
    (cylinder,) = topics["/scene"][0][1]["entities"][0]["cylinders"]
    own = Rotation.from_quat([cylinder["pose"]["orientation"][axis] for axis in "xyzw"])
    np.testing.assert_allclose(np.abs(own.apply([0.0, 0.0, 1.0])), [0.0, 1.0, 0.0], rtol=0, atol=1e-15)
    assert "/joint_states" not in topics


@pytest.mark.thorough
def test_a_failed_solve_has_the_times_that_it_reached(read):
    run = read_scenario(PENDULUM).simulate(max_steps=4)
    reached = np.flatnonzero(np.isfinite(run.state.Omega[:, 0]))
    assert 0 < len(reached) < len(run.times)
    topics, about, _ = read(run)
    assert [sent["time"] for _, sent in topics["/run"]] == np.asarray(run.times)[reached].tolist()
    assert (about["run"]["ok"], about["run"]["status"]) == ("0", "MAX_STEPS")


@pytest.mark.thorough
def test_a_solve_that_did_not_start_has_its_status_and_no_messages(read):
    run = simulate(Ball(mass=-1.0, inertia=(0.4, 0.4, 0.4)), (0.0, 0.1))
    assert run.status == Status.IMPOSSIBLE
    topics, about, _ = read(run)
    assert topics == {}
    assert (about["run"]["ok"], about["run"]["status"]) == ("0", "IMPOSSIBLE")


@pytest.mark.thorough
def test_a_clock_starts_at_zero_and_a_classical_system_has_numbers_alone(read):
    scenario = load_scenario("chaplygin-sleigh")
    times = np.linspace(-2.0, 1.0, 4)
    run = simulate(scenario.system, times, scenario.state, throw=True)
    topics, about, _ = read(run)
    assert set(topics) == {"/run"}
    assert [when for when, _ in topics["/run"]] == [0, 10**9, 2 * 10**9, 3 * 10**9]
    np.testing.assert_array_equal([sent["q"] for _, sent in topics["/run"]], run.state.q)
    assert about["run"]["start"] == "-2.0"


def test_what_is_not_installed_is_said_before_anything_is_written(monkeypatch, tmp_path):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    run = simulate(load_scenario("ball").system, (0.0, 0.1))
    (tmp_path / "run.mcap").write_text("precious")
    with refuses(OutputError, "path"):
        save(run, tmp_path / "run.mcap")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("run.mcap", "precious")]


def test_a_recording_is_not_read_back(tmp_path):
    with refuses(RunError, "run.mcap"):
        load_run(tmp_path / "run.mcap")
