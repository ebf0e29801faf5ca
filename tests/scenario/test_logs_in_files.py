"""Logs in scenario files: the numbers of the file, bit for bit, and sentences that name the file and the row."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import (
    BallState,
    RecordedSchedule,
    RecordedSignal,
    ScenarioError,
    load_scenario,
    read_scenario,
    write_scenario,
)
from jaxball.files.scenario import LogError, load_log
from tests.support.sentences import refuses

SCENARIO = """
format = 1
kind = "ball"
body = { mass = 1.0, inertia = [0.9, 1.0, 1.1], radius = 1.0, gravity = 1.0, offset = [0.0, 0.0, 0.0] }
time = { start = 0.0, end = 2.0, step = 1.0 }

[[mechanisms]]

[[mechanisms.joints]]
kind = "hinge"
axis = [0.0, 1.0, 0.0]
DRIVE

[[mechanisms.masses]]
mass = 0.5
place = [0.0, 0.0, -0.5]
"""
TIMES, VALUES = [0.0, 0.1 + 0.2, 2.0], [1 / 3, -1e-17, 2.0]
ROWS = "".join(f"{t!r}, {u!r}, note\n" for t, u in zip(TIMES, VALUES, strict=True))
CSV = "t, u, what\n" + ROWS


def of_motor(rest):
    signal = f'{{ kind = "log", file = "motor.csv", time = "t", column = "u"{rest} }}'
    return SCENARIO.replace("DRIVE", f'force = {{ kind = "motor", signal = {signal} }}')


def of_schedule(rest):
    return SCENARIO.replace(
        "DRIVE", f'schedule = {{ kind = "log", file = "motor.csv", time = "t", column = "u"{rest} }}'
    )


def written(folder, text, csv=CSV):
    (folder / "motor.csv").write_text(csv)
    (folder / "robot.toml").write_text(text)
    return folder / "robot.toml"


def drive_of(scenario):
    return scenario.system.mechanisms[0].drives[0]


def require_numbers(log):
    np.testing.assert_array_equal(log.times, TIMES)
    np.testing.assert_array_equal(log.values, VALUES)


def test_a_scenario_has_the_numbers_of_its_log_and_keeps_them_without_it(tmp_path):
    file = written(tmp_path, of_motor(', interpolation = "previous", outside = "hold"'))
    scenario = load_scenario(file)
    (tmp_path / "motor.csv").unlink()
    for signal in (drive_of(scenario).signal, drive_of(read_scenario(write_scenario(scenario))).signal):
        assert type(signal) is RecordedSignal
        assert (signal.interpolation, signal.outside) == ("previous", "hold")
        require_numbers(signal)


def test_a_schedule_has_the_numbers_of_its_log(tmp_path):
    scenario = load_scenario(written(tmp_path, of_schedule("")))
    for schedule in (drive_of(scenario), drive_of(read_scenario(write_scenario(scenario)))):
        assert type(schedule) is RecordedSchedule
        require_numbers(schedule)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_columns_are_read_whatever_separates_them(tmp_path, delimiter):
    (tmp_path / "motor.csv").write_text("\ufeff" + CSV.replace(",", delimiter), encoding="utf-8")
    require_numbers(RecordedSignal(*load_log(tmp_path / "motor.csv", time="t", column="u")))


@pytest.mark.parametrize(
    ("csv", "named"),
    [("t,U\n0,0\n1,1\n", "path"), ("t,v\n0,0\n1,1\n", "path")],
)
def test_the_sentence_about_a_log_has_one_end(tmp_path, csv, named):
    written(tmp_path, of_motor(""), csv)
    with refuses(LogError, named):
        load_log(tmp_path / "motor.csv", time="t", column="u")


@pytest.mark.parametrize(
    ("csv", "row"),
    [
        ("t,v\n0,0\n1,1\n", "column"),
        ("t,u,u\n0,0,0\n1,1,1\n", "2 columns"),
        ("", "column"),
        ("t,u\n0,0\n", "rows"),
        ("t,u\n0,0\n\n1,\n", "row 4"),
        ("t,u\n0,0\n1\n", "row 3"),
        ("t,u\n0,0\n1,nan\n", "row 3"),
        ("t,u\n0,0\ninf,1\n", "row 3"),
        ("t,u\n0,0\n1,1\n1,2\n", "row 4"),
        ("t;u\n0,5;1,5\n1;2\n", "row 2"),
        ("t;u\n0;1\n1;-2,5e3\n", "row 3"),
        ("t,u\n0,5,1,5\n1,0,2,0\n", "row 2"),
        ("t,u\n0,0\n1,1\n0.5,2\n", "row 4"),
    ],
)
def test_what_is_wrong_with_a_log_is_said_with_its_file_and_row(tmp_path, csv, row):
    file = written(tmp_path, of_motor(""), csv)
    log = tmp_path / "motor.csv"
    with refuses(LogError, "path", log, row):
        load_log(log, time="t", column="u")
    with refuses(ScenarioError, file, "mechanisms[0].joints[0].force.signal.file", log, row):
        load_scenario(file)


def test_a_missing_log_is_named(tmp_path):
    file = written(tmp_path, of_motor(""))
    (tmp_path / "motor.csv").unlink()
    with refuses(ScenarioError, "mechanisms[0].joints[0].force.signal.file"):
        load_scenario(file)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (of_schedule(', interpolation = "linear"'), "mechanisms[0].joints[0].schedule.interpolation"),
        (of_motor(', csv = "t,u"'), "mechanisms[0].joints[0].force.signal"),
        (of_motor("").replace("end = 2.0", "end = 3.0"), "mechanisms[0].joints[0].force.signal"),
        (of_schedule("").replace("end = 2.0", "end = 3.0"), "mechanisms[0].joints[0].schedule"),
    ],
)
def test_keys_that_do_not_fit_are_named(tmp_path, text, named):
    file = written(tmp_path, text)
    with refuses(ScenarioError, named):
        load_scenario(file)


def test_a_motor_along_a_recorded_schedule(tmp_path):
    """Its torque is the spline through the log, and goes on at its rate beyond it."""
    file = written(tmp_path, of_motor(', schedule = true, outside = "continue"'))
    scenario = load_scenario(file)
    for motor in (drive_of(scenario), drive_of(read_scenario(write_scenario(scenario)))):
        assert type(motor.signal) is RecordedSchedule
        assert motor.signal.outside == "continue"
        require_numbers(motor.signal)
    parabola = np.polyfit(TIMES, VALUES, 2)
    torque = drive_of(scenario)(jnp.array(1.5), jnp.array(0.0), jnp.array(0.0), BallState())
    np.testing.assert_allclose(torque, np.polyval(parabola, 1.5), rtol=1e-12)
    beyond = drive_of(scenario)(jnp.array(3.0), jnp.array(0.0), jnp.array(0.0), BallState())
    np.testing.assert_allclose(beyond, VALUES[-1] + np.polyval(np.polyder(parabola), 2.0), rtol=1e-12)


@pytest.mark.parametrize(
    ("rest", "named"),
    [
        (', outside = "continue"', "mechanisms[0].joints[0].force.signal.outside"),
        (', schedule = true, outside = "hold"', "mechanisms[0].joints[0].force.signal.outside"),
        (', schedule = true, interpolation = "linear"', "mechanisms[0].joints[0].force.signal.interpolation"),
        (", schedule = 1", "mechanisms[0].joints[0].force.signal.schedule"),
    ],
)
def test_what_a_motor_of_a_log_may_not_be(tmp_path, rest, named):
    with refuses(ScenarioError, named):
        load_scenario(written(tmp_path, of_motor(rest)))
