"""Rows of a study whose scenario has feedback: each is the run of its own scenario; and what its sensors read."""

import tomllib

import numpy as np
import pytest
import tomli_w

from jaxball import ScenarioError
from jaxball.control.weights import weight_matrix
from jaxball.studies.sweep import open_store, read_study
from tests.scenario.documents import DISK
from tests.support.sentences import refuses
from tests.support.under_feedback import FEEDFORWARD, OF_STATE, PREDICTIVE, UNDER_FEEDBACK

JOINT = "mechanisms[0].joints[0]"
WEIGHTS = {"phi": 1.0, "theta": 1.0}


def study(text, axes, **settings):
    document = {"format": 1, "scenario": tomllib.loads(text), "axes": axes} | settings
    return read_study(tomli_w.dumps(document))


def together(**values):
    """An axis along which numbers change together."""
    return [{"zip": [{"path": path, "values": list(map(float, of))} for path, of in values.items()]}]


def agree(store, rows, data):
    """The rows are the runs of their scenarios; lanes, whose programs differ, round in the tenth digit.

    In inputs of predictive control, whose programs are solved to 1e-9 of their cost, in the fifth.
    """
    for row, scenario in zip(rows, open_store(store).scenarios(rows), strict=True):
        run, own = scenario.simulate(throw=True), data.isel(row=row)
        predictive = hasattr(scenario.feedback, "horizon")
        tolerance = 1e-4 if predictive else 1e-8
        for name in ("phi", "phidot", "z", "theta"):
            np.testing.assert_allclose(own[name], getattr(run.state, name)[-1], rtol=0, atol=tolerance)
        xi = np.asarray(run.history.deviations(run.state))
        weights = WEIGHTS if hasattr(scenario.feedback, "Q") else 1.0  # of the study, also where rows have others
        Q = weight_matrix("Q", weights, run.history.directions)
        along = np.sqrt(np.einsum("ki,ij,kj->k", xi, Q, xi) / np.trace(Q))
        assert float(own["largest_deviation"]) == pytest.approx(along.max(), abs=tolerance)
        assert float(own["final_deviation"]) == pytest.approx(along[-1], abs=tolerance)
        assert bool(own["returned"]) == (along[-1] < 0.12)
        u = np.abs(np.asarray(run.history.u)[:-1])
        assert float(own["largest_input"]) == pytest.approx(u.max(), abs=tolerance)
        estimate = run.history.estimate
        if estimate is not None:
            read = np.asarray(estimate.read)
            expected = np.nansum(estimate.nis) / read.sum()
            assert float(own["nis_per_reading"]) == pytest.approx(expected, rel=1e-6)
            nees = np.asarray(estimate.nees(run.state))[:-1].sum() / np.asarray(estimate.uncertain)[:-1].sum()
            assert float(own["nees_per_direction"]) == pytest.approx(nees, rel=1e-5)


@pytest.mark.long
@pytest.mark.parametrize(
    "text",
    [pytest.param(FEEDFORWARD, marks=pytest.mark.thorough), pytest.param(OF_STATE, marks=pytest.mark.slow)],
    ids=["feedforward", "tvlqr"],
)
def test_rows_with_one_feedback_are_the_runs_of_their_scenarios(text, tmp_path):
    """Robots and starts that the feedback does not know differ, so that all rows share it."""
    axes = together(**{"body.mass": [0.9, 1.1, -1.0], "feedback.start.phi": [0.1, 0.3, 0.2]})
    study(text, axes, within=0.12, contact=True).run(tmp_path / "s.zarr")
    data = open_store(tmp_path / "s.zarr").dataset().load()
    assert data["status"].values.tolist() == [0, 0, 3]
    assert np.isnan(data["largest_deviation"][2])
    assert data["theta"].dims == ("row", "driven")
    agree(tmp_path / "s.zarr", [0, 1], data)
    assert data["returned"][:2].values.tolist() == [1, 0]
    assert data["friction_needed"].attrs["long_name"] == "friction needed at the samples"


@pytest.mark.slow
def test_rows_with_a_law_of_contact_have_the_modes_of_their_runs(tmp_path):
    """Each with a friction of its own: the first slips, and comes to roll, the other rolls."""
    text = OF_STATE.replace("[time]", "[contact]\nfriction = 0.02\n\n[time]")
    study(text, together(**{"contact.friction": [0.02, 0.3]}), within=0.12).run(tmp_path / "s.zarr")
    data = open_store(tmp_path / "s.zarr").dataset().load()
    agree(tmp_path / "s.zarr", [0, 1], data)
    assert data["modes"].values.tolist() == [3, 1]
    for row, scenario in enumerate(open_store(tmp_path / "s.zarr").scenarios([0, 1])):
        run = scenario.simulate()
        np.testing.assert_allclose(data["V"][row], run.contact.V[-1], rtol=0, atol=1e-7)
        assert int(data["mode"][row]) == int(run.contact.mode[-1])
        assert int(data["switches"][row]) == int(run.switches.count)


OF_LOOP = {
    "feedback.R": [1.0, 0.5],
    "feedback.Q.theta": [1.0, 3.0],
    f"feedback.limits.'{JOINT}'": [0.5, 0.05],
    "feedback.delay": [0, 2],
    "feedback.model.'body.mass'": [0.9, 1.1],
    "feedback.pushes[0].force[0]": [0.2, -0.3],
    "mechanisms[0].masses[0].place[2]": [-0.6, -0.5],
}
OF_SENSORS = {
    "sensors.camera.errors.noise": [0.01, 0.03],
    "sensors.camera.errors.missing": [0.2, 0.5],
    "sensors.gyro.errors.bias[0]": [0.05, 0.3],
    "sensors.gyro.errors.random_walk": [0.01, 0.02],
    "sensors.camera.errors.seed": [0, 7],
    "sensors.camera.at[0]": [0.0, 0.2],
    "estimator.spread.phi": [0.2, 0.1],
    "estimator.process.phidot": [0.05, 0.2],
    "estimator.biases.gyro": [0.1, 0.4],
}


@pytest.mark.slow
def test_rows_differ_in_every_number_of_feedback_sensors_and_filter(tmp_path):
    late = "noise = 0.01, delay = 0.1, seed = 0"
    text = UNDER_FEEDBACK.replace("noise = 0.01", late).replace('"position"', '"position"\nat = [0.0, 0.0, 0.0]')
    made = study(text, together(**OF_LOOP, **OF_SENSORS), within=0.12, contact=True, find=["distance"], readings=True)
    made.run(tmp_path / "s.zarr")
    data = open_store(tmp_path / "s.zarr").dataset().load()
    agree(tmp_path / "s.zarr", [0, 1], data)
    (scenario,) = open_store(tmp_path / "s.zarr").scenarios([1])
    run = scenario.simulate()
    read = np.asarray(run.measured(scenario.sensors)["camera"])
    np.testing.assert_allclose(data["measured_camera_largest"][1], np.nanmax(read, axis=0), rtol=0, atol=1e-8)
    np.testing.assert_allclose(data["measured_camera_least"][1], np.nanmin(read, axis=0), rtol=0, atol=1e-8)
    seen = run.observables
    assert float(data["friction_needed"][1]) == pytest.approx(float(seen.friction_ratio.max()), abs=1e-8)
    path = np.trapezoid(np.abs(np.asarray(run.state.phidot)), run.times)  # ∫ |ż| dt with r = 1
    assert float(data["distance"][1]) == pytest.approx(path, abs=1e-8)


@pytest.mark.slow
def test_rows_of_predictive_control_have_limits_of_their_own(tmp_path):
    own = {"feedback.friction": [0.3, 0.02], "feedback.penalty": [100.0, 50.0]}
    study(PREDICTIVE, together(**OF_LOOP, **own), within=0.12).run(tmp_path / "s.zarr")
    agree(tmp_path / "s.zarr", [0, 1], open_store(tmp_path / "s.zarr").dataset().load())


SENSORS = """
[sensors.imu]
kind = "accelerometer"
at = [0.1, 0.0, 0.0]
errors = { noise = 0.01, missing = 0.3, seed = 1 }
"""


@pytest.mark.long
def test_rows_have_the_readings_of_their_runs(tmp_path):
    axes = together(**{"body.mass": [1.0, 2.0], "sensors.imu.at[0]": [0.1, 0.3], "sensors.imu.errors.seed": [1, 2]})
    study(DISK + SENSORS, axes, readings=True, save="times").run(tmp_path / "s.zarr")
    data = open_store(tmp_path / "s.zarr").dataset().load()
    (scenario,) = open_store(tmp_path / "s.zarr").scenarios([1])
    read = np.asarray(scenario.simulate().measured(scenario.sensors)["imu"])
    assert 0 < np.isnan(read).sum() < read.size
    np.testing.assert_allclose(data["measured_imu_largest"][1], np.nanmax(read, axis=0), rtol=0, atol=1e-8)
    assert data["measured_imu_least"].attrs["units"] == "length/time^2"
    np.testing.assert_allclose(data["measured_imu"][1], read, rtol=0, atol=1e-8)


WANDERS_NOT = UNDER_FEEDBACK.replace("random_walk = 0.01", "random_walk = 0.0")
AXIS = together(**{"body.mass": [1.0]})


@pytest.mark.parametrize(
    ("text", "axes", "settings", "named"),
    [
        (OF_STATE, together(**{"time.end": [1.0]}), {}, "time.end"),
        (PREDICTIVE, together(**{"feedback.horizon": [4]}), {}, "feedback.horizon"),
        (WANDERS_NOT, together(**{"sensors.gyro.errors.random_walk": [0.1]}), {}, "sensors.gyro.errors.random_walk"),
        (OF_STATE, together(**{"sensors.gyro.errors.noise": [0.1]}), {}, "sensors.gyro.errors.noise"),
        (OF_STATE, together(**{"feedback.start.ph": [0.1]}), {}, "feedback.start.phi"),
        (OF_STATE, AXIS, {"detachment": True}, "detachment"),
        (OF_STATE, AXIS, {"within": 0.0}, "within"),
        (DISK, AXIS, {"readings": True}, "readings"),
    ],
)
def test_what_is_wrong_gets_a_sentence(text, axes, settings, named):
    with refuses(ScenarioError, named):
        study(text, axes, **settings)
