"""Sensors in scenario files, data sets, saved runs and figures: what is read is what the run has measured."""

import dataclasses

import numpy as np
import pytest
import xarray

import jaxball
from jaxball import ScenarioError, plot, read_scenario, write_scenario
from jaxball.files.results import saved_scenario
from jaxball.physics.sensors import Accelerometer, Encoder, Gyroscope, Position, SensorErrors, Tachometer
from tests.support.sentences import refuses

JOINT = "mechanisms[0].joints[0]"
ROBOT = f"""
format = 1
title = "robot"
kind = "disk"
body = {{ mass = 1.0, radius = 1.0, inertia = 0.5, gravity = 1.0 }}
ground = {{ angle = 0.1 }}
initial = {{ theta = [0.5], thetadot = [0.0] }}
time = {{ start = 0.0, end = 2.0, saves = 5 }}

[[mechanisms]]
joints = [{{ kind = "hinge", axis = [0.0, 1.0, 0.0], force = {{ kind = "damper", coefficient = 0.05 }} }}]
masses = [{{ mass = 0.5, place = [0.0, 0.0, -0.6] }}]

[sensors.turned]
kind = "gyroscope"
on = "{JOINT}"
frame = {{ versor = [1.0, 0.2, 0.0, 0.0] }}

[sensors.felt]
kind = "accelerometer"
at = [0.1, 0.0, 0.2]

[sensors.angle]
kind = "encoder"
on = "{JOINT}"

[sensors.rate]
kind = "tachometer"
on = "{JOINT}"

[sensors.seen]
kind = "position"
at = [0.0, 0.0, 0.5]
[sensors.seen.errors]
noise = 0.01
bias = [0.1, 0.0, 0.2]
random_walk = 0.02
rate = 1.0
delay = 0.5
missing = 0.1
seed = 3
"""
IN_PYTHON = {
    "turned": Gyroscope(on=JOINT, frame=jaxball.physics.VersorFrame((1.0, 0.2, 0.0, 0.0))),
    "felt": Accelerometer(at=(0.1, 0.0, 0.2)),
    "angle": Encoder(JOINT),
    "rate": Tachometer(JOINT),
    "seen": Position(
        at=(0.0, 0.0, 0.5),
        errors=SensorErrors(
            noise=0.01, bias=(0.1, 0.0, 0.2), random_walk=0.02, rate=1.0, delay=0.5, missing=0.1, seed=3
        ),
    ),
}


@pytest.fixture(scope="module")
def robot():
    scenario = read_scenario(ROBOT)
    return scenario, scenario.simulate(throw=True)


@pytest.mark.long
def test_a_file_has_the_sensors_that_python_has_and_is_written_with_them(robot):
    scenario, run = robot
    again = read_scenario(write_scenario(scenario))
    assert list(scenario.sensors) == list(again.sensors) == list(IN_PYTHON)
    expected = run.measured(IN_PYTHON)
    for sensors in (scenario.sensors, again.sensors):
        for name, values in run.measured(sensors).items():
            np.testing.assert_array_equal(values, expected[name])


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", [".nc", ".npz", ".csv"])
def test_saved_runs_have_what_was_read(robot, suffix, tmp_path):
    scenario, run = robot
    path = jaxball.save(run, tmp_path / f"run{suffix}", scenario)
    found = run.measured(scenario.sensors)
    if suffix == ".csv":
        table = np.genfromtxt(path, delimiter=",", names=True, deletechars="")
        np.testing.assert_array_equal(table["measured_turned[1]"], found["turned"][:, 1])
        np.testing.assert_array_equal(table["measured_rate"], found["rate"])
        return
    read = dict(np.load(path)) if suffix == ".npz" else xarray.load_dataset(path)
    for name, values in found.items():
        np.testing.assert_array_equal(read[f"measured_{name}"], values)
    assert list(saved_scenario(path).sensors) == list(IN_PYTHON)


@pytest.mark.thorough
def test_sensors_may_be_given_beside_a_run_without_a_scenario(robot, tmp_path):
    _, run = robot
    data = run.to_dataset(sensors={"felt": Accelerometer()})
    assert data.measured_felt.dims == ("time", "axis")
    assert data.measured_felt.attrs["units"] == "length/time^2"
    path = jaxball.save(run, tmp_path / "run.npz", sensors={"felt": Accelerometer()})
    assert repr(saved_scenario(path).sensors) == repr({"felt": Accelerometer()})


@pytest.mark.thorough
def test_each_sensor_has_a_panel_with_what_it_read(robot, tmp_path):
    scenario, run = robot
    figure = plot.measurements(run, scenario.sensors)
    assert [ax.get_ylabel() for ax in figure.axes] == list(IN_PYTHON)
    for ax, values in zip(figure.axes, run.measured(scenario.sensors).values(), strict=True):
        lines = [line for line in ax.lines if len(line.get_xdata()) == len(run.times)]
        columns = np.asarray(values).reshape(len(run.times), -1).T
        for line, column in zip(lines, columns, strict=True):
            np.testing.assert_array_equal(line.get_ydata(), column)
    with refuses(ValueError, "sensors"):
        plot.measurements(run, {})


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('kind = "encoder"', 'kind = "encodr"', "sensors.angle.kind"),
        ("joints[0]", "joint[0]", "sensors.turned.on"),
        ("at = [0.1, 0.0, 0.2]", "at = [0.1, 0.2]", "sensors.felt.at"),
        ("[sensors.felt]", '[sensors."a b"]', "sensors"),
        ('kind = "tachometer"\n', 'kind = "tachometer"\nat = [0.0, 0.0, 0.0]\n', "sensors.rate.at"),
        ("[sensors.felt]", "[sensors.felt]\nmass = 3", "sensors.felt.mass"),
        ("missing = 0.1", "missing = 2", "sensors.seen.errors.missing"),
        ("noise = 0.01", "nois = 0.01", "sensors.seen.errors.nois"),
    ],
)
def test_what_is_no_sensor_is_told(old, new, named):
    assert old in ROBOT
    with refuses(ScenarioError, named):
        read_scenario(ROBOT.replace(old, new, 1))


@pytest.mark.thorough
def test_a_scenario_may_get_sensors_in_python(robot):
    scenario, _ = robot
    other = dataclasses.replace(scenario, sensors={"gyro": Gyroscope()})
    assert list(read_scenario(write_scenario(other)).sensors) == ["gyro"]
