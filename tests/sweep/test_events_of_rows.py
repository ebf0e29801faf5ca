"""Studies of a scenario with events: how often they happened in each row, and when first, against closed forms."""

import numpy as np
import pytest

from jaxball import ScenarioError, Status
from jaxball.plot.sweeps.axes import NOT_FINITE, outcomes
from jaxball.studies.sweep import StudyError, open_store
from tests.scenario.documents import BALL
from tests.support.sentences import refuses
from tests.sweep.studies import study

ROLLING = """
format = 1
kind = "disk"
body = { mass = 1.0, radius = 1.0, inertia = 0.5, gravity = 1.0 }
initial = { phidot = -1.0 }
time = { start = 0.0, end = 2.0, saves = 5 }

[events.post]
of = "z"
level = 1.0
terminal = true

[events.near]
of = "z"
level = 0.25
direction = "rising"
"""
LEVELS, SPEEDS = np.array([0.3, 0.9, 5.0]), np.array([-1.0, -2.0])
AXES = f"""
[[axes]]
path = "events.post.level"
values = {LEVELS.tolist()}
[[axes]]
path = "initial.phidot"
values = {SPEEDS.tolist()}
"""
LEVEL, SPEED = (values.ravel() for values in np.meshgrid(LEVELS, -SPEEDS, indexing="ij"))
WHEN = LEVEL / SPEED
ENDS = WHEN < 2.0


def solved(folder, settings="", axes=AXES, scenario=ROLLING):
    whole = study(folder, axes=axes, settings=settings, scenario=scenario)
    whole.run(folder / "s.zarr")
    return whole, open_store(folder / "s.zarr").dataset().load()


@pytest.mark.long
def test_rows_have_the_counts_and_first_times_of_their_events(tmp_path):
    _, data = solved(tmp_path, 'find = ["distance"]')
    np.testing.assert_array_equal(data["status"], np.where(ENDS, Status.EVENT, Status.SUCCESS))
    np.testing.assert_array_equal(data["post_count"], ENDS)
    np.testing.assert_allclose(data["post_time"], np.where(ENDS, WHEN, np.nan), rtol=1e-10)
    np.testing.assert_allclose(data["reached"], np.minimum(WHEN, 2.0), rtol=1e-10)
    np.testing.assert_array_equal(data["near_count"], 1)
    np.testing.assert_allclose(data["near_time"], 0.25 / SPEED, rtol=1e-10)
    # Of the run up to the event, not up to the end of its step.
    np.testing.assert_allclose(data["distance"], np.minimum(LEVEL, 2.0 * SPEED), rtol=1e-9)
    assert data["post_count"].dtype == np.int32
    assert data["post_time"].attrs == {"units": "time", "long_name": "time of the first post; NaN if there is none"}
    store = tmp_path / "s.zarr"
    assert "first failed" not in open_store(store).describe()
    (again,) = open_store(store).scenarios([1])
    run = again.simulate(events=open_store(store).events())
    np.testing.assert_allclose(run.events["post"].times[0], data["post_time"][1], rtol=1e-12)


@pytest.mark.thorough
def test_a_row_without_an_event_of_its_own_is_the_same_run(tmp_path):
    """Levels that are the same in all rows, and rows that are impossible."""
    axes = '[[axes]]\npath = "initial.phidot"\nvalues = [-1.0, -2.0]\n[[axes]]\npath = "time.end"\nvalues = [2.0, -1.0]'
    _, data = solved(tmp_path, "save = 'times'", axes)
    np.testing.assert_array_equal(data["status"], [Status.EVENT, Status.IMPOSSIBLE] * 2)
    np.testing.assert_array_equal(data["post_count"], [1, -1, 1, -1])
    np.testing.assert_allclose(data["post_time"], [1.0, np.nan, 0.5, np.nan], rtol=1e-10)
    np.testing.assert_array_equal(np.isnan(data["z"][0]), [False, False, False, True, True])


@pytest.mark.long
def test_events_and_detachment_end_rows_together(tmp_path):
    thrown = """
[events.half]
of = "phi"
level = 0.5
"""
    from tests.sweep.test_detachment import SPEEDS as OF_THE_WHEEL, WHEEL, detachment

    _, data = solved(tmp_path, "detachment = true\ncontact = true", OF_THE_WHEEL, WHEEL + thrown)
    np.testing.assert_allclose(data["reached"][1], detachment(4.0), rtol=1e-6)
    assert "detachment_count" not in data
    assert data["half_count"][1] == 1
    assert data["half_time"][1] < data["reached"][1]


def test_rooms_and_names_that_do_not_fit_are_refused(tmp_path):
    axes = '[[axes]]\npath = "events.near.capacity"\nvalues = [1, 2]'
    with refuses(ScenarioError, "events.near.capacity"):
        study(tmp_path, axes, scenario=ROLLING + "capacity = 4\n")
    named = ROLLING.replace("events.near", "events.detachment")
    with refuses(StudyError, "detachment"):
        study(tmp_path, settings="detachment = true", scenario=named)
    taken = study(
        tmp_path, settings="contact = true", scenario=ROLLING.replace("events.near", "events.friction_needed")
    )
    with refuses(StudyError, "scenario.events"):
        taken.run(tmp_path / "taken.zarr")


@pytest.mark.long
def test_rows_that_are_read_one_by_one_have_their_levels(tmp_path):
    """Those where angles of `balance` may change, which cannot be traced."""
    event = '[events.late]\nof = "tests.sweep.test_events_of_rows:clock"\nlevel = 0.1\n'
    axes = """
    [[axes]]
    zip = [{ path = "body.mass", values = [1.0, 2.0] }, { path = "events.late.level", values = [0.5, 1.5] }]
    """
    _, data = solved(tmp_path, "", axes, BALL + "[initial]\nbalance = { masses = [0] }\n" + event)
    np.testing.assert_allclose(data["late_time"], [0.5, 1.5], rtol=1e-12)


def clock(system, t, state):
    """An event at a time."""
    return t


def test_figures_show_what_is_known_of_rows_that_an_event_ended():
    status = np.array([Status.EVENT, Status.EVENT, Status.SUCCESS, Status.SUCCESS, Status.MAX_STEPS])
    values = np.array([1.0, np.nan, 1.0, np.nan, 1.0])
    expected = [Status.SUCCESS, Status.EVENT, Status.SUCCESS, NOT_FINITE, Status.MAX_STEPS]
    np.testing.assert_array_equal(outcomes(status, values), expected)
