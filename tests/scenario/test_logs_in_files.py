"""Logs in scenario files: the numbers of the file, bit for bit, and sentences that name the file and the row."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import (
    BallState,
    LogError,
    RecordedSchedule,
    RecordedSignal,
    ScenarioError,
    load_log,
    load_scenario,
    read_scenario,
    write_scenario,
)

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
    ("csv", "clause"),
    [("t,U\n0,0\n1,1\n", 'has no column "u"; did you mean "U"?'), ("t,v\n0,0\n1,1\n", "its columns are t, v.")],
)
def test_the_sentence_about_a_log_has_one_end(tmp_path, csv, clause):
    written(tmp_path, of_motor(""), csv)
    with pytest.raises(LogError) as error:
        load_log(tmp_path / "motor.csv", time="t", column="u")
    assert str(error.value).endswith(clause)


@pytest.mark.parametrize(
    ("csv", "clause"),
    [
        ("t,v\n0,0\n1,1\n", 'has no column "u"; its columns are t, v'),
        ("t,u,u\n0,0,0\n1,1,1\n", 'has 2 columns "u"'),
        ("", 'has no column "t"; it is empty'),
        ("t,u\n0,0\n", "has fewer than two rows"),
        ("t,u\n0,0\n\n1,\n", 'row 4 of "{file}" has "" in column "u", which is not a finite number'),
        ("t,u\n0,0\n1\n", 'row 3 of "{file}" has "" in column "u"'),
        ("t,u\n0,0\n1,nan\n", 'row 3 of "{file}" has "nan" in column "u"'),
        ("t,u\n0,0\ninf,1\n", 'row 3 of "{file}" has "inf" in column "t"'),
        ("t,u\n0,0\n1,1\n1,2\n", 'row 4 of "{file}" has the time 1.0 after 1.0; sort the rows'),
        ("t;u\n0,5;1,5\n1;2\n", 'row 2 of "{file}" has "0,5" in column "t", a number with a decimal comma; write'),
        ("t;u\n0;1\n1;-2,5e3\n", 'row 3 of "{file}" has "-2,5e3" in column "u", a number with a decimal comma'),
        ("t,u\n0,5,1,5\n1,0,2,0\n", 'row 2 of "{file}" has 4 entries for 2 columns; where commas separate them'),
        ("t,u\n0,0\n1,1\n0.5,2\n", 'row 4 of "{file}" has the time 0.5 after 1.0'),
    ],
)
def test_what_is_wrong_with_a_log_is_said_with_its_file_and_row(tmp_path, csv, clause):
    file = written(tmp_path, of_motor(""), csv)
    log = tmp_path / "motor.csv"
    with pytest.raises(LogError) as error:
        load_log(log, time="t", column="u")
    assert str(error.value).startswith("Argument `path` must be a log, but ")
    assert clause.format(file=log) in str(error.value)
    with pytest.raises(ScenarioError) as error:
        load_scenario(file)
    key = "Key `mechanisms[0].joints[0].force.signal.file` must be a log, but "
    assert str(error.value).startswith(f"{file}: {key}")
    assert clause.format(file=log) in str(error.value)


def test_a_missing_log_is_named(tmp_path):
    file = written(tmp_path, of_motor(""))
    (tmp_path / "motor.csv").unlink()
    with pytest.raises(ScenarioError, match=r'motor\.csv" cannot be read: No such file or directory'):
        load_scenario(file)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            of_schedule(', interpolation = "linear"'),
            'Key `mechanisms[0].joints[0].schedule.interpolation` must be "spline", because a schedule has a rate and '
            'an acceleration, but it is "linear"; "previous" and "linear" are for signals, such as torques.',
        ),
        (
            of_motor(', csv = "t,u"'),
            "Key `mechanisms[0].joints[0].force.signal` must have exactly one of the keys `file` and `csv`, but it has "
            "both.",
        ),
        (
            of_motor("").replace("end = 2.0", "end = 3.0"),
            "Key `mechanisms[0].joints[0].force.signal` must be a log that lasts as long as the run, from t = 0 to "
            "t = 3, but it lasts from t = 0 to t = 2; change the times of the run, or give `outside`, one of "
            '"hold", "zero".',
        ),
        (
            of_schedule("").replace("end = 2.0", "end = 3.0"),
            "Key `mechanisms[0].joints[0].schedule` must be a log that lasts as long as the run, from t = 0 to "
            't = 3, but it lasts from t = 0 to t = 2; change the times of the run, or give `outside`, "continue".',
        ),
    ],
)
def test_keys_that_do_not_fit_are_named(tmp_path, text, message):
    file = written(tmp_path, text)
    with pytest.raises(ScenarioError) as error:
        load_scenario(file)
    assert str(error.value) == f"{file}: {message}"


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
    ("rest", "message"),
    [
        (', outside = "continue"', '`mechanisms[0].joints[0].force.signal.outside` must be "refuse", "hold" or "zero"'),
        (', schedule = true, outside = "hold"', "`mechanisms[0].joints[0].force.signal.outside` must be"),
        (', schedule = true, interpolation = "linear"', 'signal.interpolation` must be "spline"'),
        (", schedule = 1", "`mechanisms[0].joints[0].force.signal.schedule` must be true or false"),
    ],
)
def test_what_a_motor_of_a_log_may_not_be(tmp_path, rest, message):
    with pytest.raises(ScenarioError) as error:
        load_scenario(written(tmp_path, of_motor(rest)))
    assert message in str(error.value)
