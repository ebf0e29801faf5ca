"""Feedback in a scenario file: the closed loop that it describes, its saved runs, and what is wrong in words."""

import re
import tomllib

import jax
import numpy as np
import pytest

import jaxball
from jaxball import ScenarioError, read_scenario, write_scenario
from jaxball.analysis.verify import check_laws
from jaxball.control import Push, tvlqr
from jaxball.control.estimation import OutputFeedback
from jaxball.files.scenario import read_document
from jaxball.files.scenario.closed_loop import model_of
from jaxball.files.scenario.sources import builtin_text
from jaxball.physics.sensors import Gyroscope, Position, SensorErrors
from jaxball.plot.over_time import modes_of
from tests.support.sentences import refuses
from tests.support.under_feedback import FEEDFORWARD, OF_STATE, PREDICTIVE, UNDER_FEEDBACK

WEIGHTS = {"phi": 1.0, "theta": 1.0}


@pytest.fixture(scope="module")
def scenario():
    return read_scenario(UNDER_FEEDBACK)


@pytest.fixture(scope="module")
def run(scenario):
    return scenario.simulate(throw=True)


def robot(mass):
    pendulum = jaxball.planar_pendulum(0.5, 0.6, drive=jaxball.Motor(0.0))
    return jaxball.Disk(mass=mass, inertia=0.5, gravity=2.0, mechanisms=[pendulum])


@pytest.mark.long
def test_a_run_is_the_closed_loop_that_the_file_describes(run):
    """The regulator and the filter know another mass; both solve with the same tolerances, in another program."""
    motion = jaxball.simulate(robot(0.9), np.linspace(0.0, 1.0, 21))
    track = tvlqr(motion, Q=WEIGHTS, R=1.0, Qf=1.0, sample=0.05)
    sensors = {
        "camera": Position(errors=SensorErrors(noise=0.01, missing=0.2)),
        "gyro": Gyroscope(errors=SensorErrors(noise=0.02, bias=0.05, random_walk=0.01)),
    }
    push = Push((0.2, 0.0, 0.0), start=0.21, duration=0.1, torque=(0.0, 0.1, 0.0))
    pushed = jaxball.Disk(**{**robot(1.0).arguments, "force": push})
    spread = {"phi": 0.2, "z": 0.2, "thetadot": 0.1}
    seeing = OutputFeedback.of(
        track, sensors, spread=spread, process={"phidot": 0.05}, biases={"gyro": 0.1}, system=pushed
    )
    loop = seeing.closed_loop({"phi": 0.2, "z": -0.2}, system=pushed, limits=0.5, delay=1)
    for name in ("phi", "phidot", "z", "theta", "thetadot"):
        np.testing.assert_allclose(getattr(run.state, name), getattr(loop.states, name), rtol=0, atol=1e-8)
    np.testing.assert_allclose(run.history.u[:-1], loop.u, rtol=0, atol=1e-8)
    estimated = run.history.estimate
    np.testing.assert_allclose(estimated.covariance[:-1], loop.memory.P, rtol=0, atol=1e-8)
    held = jax.vmap(lambda nominal, state: nominal.difference(state))(run.history.nominal, estimated.state)
    np.testing.assert_allclose(held[:-1], loop.memory.xi, rtol=0, atol=1e-8)


@pytest.mark.long
def test_what_its_filter_notes_is_what_its_sensors_read(run, scenario):
    """Seven numbers or four at each sample, as the camera sees the disk or not; χ² of these but for a wrong model."""
    estimate, camera = run.history.estimate, np.asarray(run.measured(scenario.sensors)["camera"])
    np.testing.assert_array_equal(estimate.read[:-1], np.where(np.isnan(camera[:-1, 0]), 3, 6))
    assert int(estimate.read[-1]) == 0
    assert np.isnan(estimate.nis[-1])
    assert 2.0 < np.mean(estimate.nis[:-1]) < 12.0
    errors = run.history.estimate.errors(run.state)[:-1]
    assert np.all(np.abs(errors[:, 2]) < 4 * np.asarray(estimate.deviations["z"])[:-1] + 1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", ["nc", "npz"])
def test_a_saved_run_is_read_again(run, tmp_path, suffix):
    """States, motion, inputs and estimates bit for bit; observables are those of the inputs that acted."""
    again = jaxball.load_run(jaxball.save(run, tmp_path / f"run.{suffix}"))
    for one, other in zip(jax.tree.leaves(again.history), jax.tree.leaves(run.history), strict=True):
        np.testing.assert_array_equal(one, other)
    assert again.history.inputs == run.history.inputs
    assert again.history.estimate.biases == ("gyro[0]", "gyro[1]", "gyro[2]")
    np.testing.assert_allclose(again.observables.joint_efforts, run.observables.joint_efforts, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.observables.joint_efforts[:-1], run.history.u[:-1], rtol=0, atol=1e-12)
    assert str(again) == str(run)
    data = run.to_dataset()
    assert data.estimate_covariance.sel(error="z", error_beside="z").dims == ("time",)
    assert data.deviation.sel(coordinate="z")[0] == pytest.approx(-0.2)


ON_ICE = OF_STATE.replace("[time]", "[contact]\nfriction = 0.02\nrestitution = 0.3\n\n[time]")


@pytest.fixture(scope="module")
def slipping():
    return read_scenario(ON_ICE).simulate(throw=True)


@pytest.mark.slow
def test_a_run_with_a_law_of_contact_is_the_closed_loop_that_the_file_describes(slipping):
    """The robot slips, whereas the motion and the feedback are those of one that rolls."""
    track = tvlqr(jaxball.simulate(robot(0.9), np.linspace(0.0, 1.0, 21)), Q=WEIGHTS, R=1.0, Qf=1.0, sample=0.05)
    pushed = jaxball.Disk(**{**robot(1.0).arguments, "force": read_scenario(ON_ICE).feedback.pushes[0]})
    law = jaxball.Contact(0.02, restitution=0.3)
    loop = track.closed_loop({"phi": 0.2, "z": -0.2}, system=pushed, limits=0.5, delay=1, contact=law)
    np.testing.assert_allclose(slipping.state.z, loop.states.z, rtol=0, atol=1e-7)
    np.testing.assert_allclose(slipping.history.u[:-1], loop.u, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(np.asarray(slipping.contact.mode), np.asarray(loop.moving.mode))
    assert jaxball.physics.Mode.SLIDING in np.asarray(slipping.contact.mode)
    start = jax.tree.map(lambda leaf: leaf[0], loop.states)
    whole = jaxball.simulate(slipping.system, slipping.times, start, contact=law)
    np.testing.assert_allclose(slipping.contact.V, whole.contact.V, rtol=0, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["nc", "npz"])
def test_a_saved_run_with_a_law_of_contact_has_modes_beside_feedback(slipping, tmp_path, suffix):
    again = jaxball.load_run(jaxball.save(slipping, tmp_path / f"run.{suffix}"))
    for one, other in zip(jax.tree.leaves(again.history), jax.tree.leaves(slipping.history), strict=True):
        np.testing.assert_array_equal(one, other)
    assert str(again) == str(slipping)
    np.testing.assert_allclose(again.observables.friction, slipping.observables.friction, rtol=0, atol=1e-12)
    written = tomllib.loads(write_scenario(again.scenario))
    assert written["contact"] == {"friction": 0.02, "static_friction": 0.02, "restitution": 0.3}
    bands = [modes_of(run).spells for run in (again, slipping)]
    assert bands[0] == bands[1]
    assert len(bands[0]) > 1


@pytest.mark.slow
def test_feedforward_is_the_motion_with_pushes_and_another_start():
    """Whose inputs are 0, the robot at the start of the file; a run of it with that push, at tolerances of 1e-10."""
    known = read_scenario(FEEDFORWARD)
    run = known.simulate(throw=True)
    start = jaxball.DiskState(phi=0.2, z=-0.2, theta=[0.0], thetadot=[0.0])
    pushed = jaxball.Disk(**{**robot(1.0).arguments, "force": known.feedback.pushes[0]})
    free = jaxball.simulate(pushed, known.times, start)
    np.testing.assert_allclose(run.state.z, free.state.z, rtol=0, atol=1e-8)
    assert run.history.estimate is None


@pytest.mark.slow
def test_predictive_control_plans_with_the_limits_of_the_file():
    """Programs for its plans are solved to 1e-9 of their cost, which leaves some 1e-5 of the inputs."""
    track = tvlqr(jaxball.simulate(robot(0.9), np.linspace(0.0, 1.0, 21)), Q=WEIGHTS, R=1.0, Qf=1.0, sample=0.05)
    control = track.mpc(4, limits=0.5, friction=0.3, penalty=100.0)
    known = read_scenario(PREDICTIVE)
    pushed = jaxball.Disk(**{**robot(1.0).arguments, "force": known.feedback.pushes[0]})
    loop = control.closed_loop({"phi": 0.2, "z": -0.2}, system=pushed, limits=0.5, delay=1)
    run = known.simulate(throw=True)
    assert np.max(np.abs(loop.u)) > 0.1
    np.testing.assert_allclose(run.history.u[:-1], loop.u, rtol=0, atol=1e-4)
    np.testing.assert_allclose(run.state.z, loop.states.z, rtol=0, atol=1e-5)


@pytest.mark.parametrize("text", [UNDER_FEEDBACK, PREDICTIVE, FEEDFORWARD])
def test_a_written_scenario_is_read_again(text):
    written = write_scenario(read_scenario(text))
    assert write_scenario(read_scenario(written)) == written
    for table in ("feedback", "estimator"):
        assert tomllib.loads(written).get(table) == tomllib.loads(text).get(table)


def test_a_model_may_differ_in_what_has_its_default_in_the_robot():
    """As long as the file has the number."""
    document = tomllib.loads(PREDICTIVE)
    document["body"]["offset"] = [0.0, 0.0, 0.0]
    document["feedback"]["model"] = {"body.offset[2]": -0.1, "mechanisms[0].masses[0].mass": 0.4}
    model = model_of(read_document(document))
    np.testing.assert_array_equal(model.system.offset, [0.0, 0.0, -0.1])
    assert float(model.system.mechanisms[0].mass[0]) == 0.4
    assert model.feedback is None


def changed(old, new):
    assert old in UNDER_FEEDBACK
    return UNDER_FEEDBACK.replace(old, new)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("text", "named"),
    [
        (changed('"tvlqr"', '"tvlq"'), "feedback.kind"),
        (changed("{ phi = 1.0, theta", "{ pih = 1.0, theta"), "feedback.Q"),
        (changed("R = 1.0", "R = 0.0"), "feedback.R"),
        (changed("R = 1.0", "R = [[1.0, 2.0], [3.0]]"), "feedback.R"),
        (changed("R = 1.0", ""), "feedback.R"),
        (changed('inputs = ["mech', 'inputs = ["mach'), "mechanisms[0].joints[0]"),
        (changed("delay = 1", "delay = -1"), "feedback.delay"),
        (changed("z = -0.2 }", "y = -0.2 }"), "feedback.start"),
        (changed("duration = 0.1", "duration = 0.0"), "feedback.pushes[0].duration"),
        (changed('"body.mass" = 0.9', '"body.mas" = 0.9'), "feedback.model"),
        (changed('"body.mass" = 0.9', '"time.end" = 0.9'), "feedback.model"),
        (changed('"body.mass" = 0.9', '"body.mass" = -0.9'), "body.mass"),
        (changed("z = 0.2, thetadot", "x = 0.2, thetadot"), "estimator.spread"),
        (changed("gyro = 0.1", "gyr = 0.1"), "estimator.biases"),
        (changed('["camera", "gyro"]', '["radar"]'), "estimator.sensors"),
        (changed("noise = 0.01, ", ""), "sensors.camera"),
        (changed("missing = 0.2", "delay = 0.07"), "sensors.camera.errors.delay"),
        (changed("start = 0.0\nend = 1.0\nstep = 0.05", "at = [0.0, 0.1, 1.0]"), "time.at"),
        (changed("[time]", '[solve]\nsolver = "gauss16"\n\n[time]'), "solve.solver"),
        (changed("[time]", "[contact]\nfriction = 0.2\n\n[initial]\nheight = 0.1\n\n[time]"), "initial.height"),
        (
            changed(', force = { kind = "motor", signal = 0.0 }', "").replace(
                'inputs = ["mechanisms[0].joints[0]"]', ""
            ),
            "feedback",
        ),
        (re.sub(r"\[feedback\].*(?=\[estimator\])", "", UNDER_FEEDBACK, flags=re.DOTALL), "estimator"),
    ],
)
def test_what_is_wrong_gets_a_sentence(text, named):
    with refuses(ScenarioError, named):
        read_scenario(text)


def test_what_cannot_be_done_with_feedback_gets_a_sentence(scenario):
    with refuses(ScenarioError, "feedback"):
        check_laws(scenario)
    with refuses(ScenarioError, "feedback"):
        scenario.simulate(dense=True)
    with refuses(ScenarioError, "feedback"):
        scenario.simulate(solver="tsit5")
    with refuses(ScenarioError, 'feedback = { kind = "tvlqr", Q = 1.0, R = 1.0 }'):
        model_of(scenario).closed_loop()


@pytest.mark.thorough
def test_predictive_control_in_place_of_a_law_that_tilts_a_plate(tmp_path):
    """The ball comes to where the law has it, within limits, and the saved run has the angles and the inputs."""
    text = builtin_text("ball-and-plate").replace("end = 6.0\nstep = 0.05", "end = 4.0\nstep = 0.1")
    text += '[feedback]\nkind = "mpc"\nhorizon = 10\nQ = { z = 10.0, theta = 1.0 }\nR = 0.01\nlimits = 0.8\n'
    scenario = read_scenario(text + 'start = { "z[0]" = 0.05 }\n')
    assert write_scenario(read_scenario(write_scenario(scenario))) == write_scenario(scenario)
    run = scenario.simulate(throw=True)
    left = np.linalg.norm(np.asarray(run.state.z - run.history.nominal.z), axis=1)
    np.testing.assert_allclose(left[0], 0.05)
    assert np.max(left[-5:]) < 0.01 * left[0]
    np.testing.assert_allclose(np.nanmax(np.abs(run.history.u)), 0.8)
    again = jaxball.load_run(run.save(tmp_path / "run.nc"))
    np.testing.assert_array_equal(again.state.theta, run.state.theta)
    np.testing.assert_array_equal(again.history.u, run.history.u)
    assert again.history.inputs == ("ground.about_e1", "ground.about_e2")
