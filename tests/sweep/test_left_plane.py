"""Rows of a study whose runs go on where the body would leave the plane: they are counted and have a flag."""

import io

import numpy as np
import pandas
import pytest

from jaxball import ScenarioError, Status
from jaxball.files.scenario.sources import builtin_text
from jaxball.studies.sweep import open_store
from tests.support.sentences import refuses
from tests.sweep.studies import pretend, study
from tests.sweep.test_detachment import DETACHED, SPEEDS, WHEEL, normal_force

STONE = builtin_text("rattleback").replace("angle = 0.008726646259971648", "angle = 0.17453292519943295")
SPINS = """
[[axes]]
path = "initial.Omega[2]"
values = [-12.0, 0.0, -1.0]

[[axes]]
path = "time.end"
values = [1.0]
"""


def alternating(batch, request):
    """An engine in which every other disk leaves the plane, and the last one fails."""
    results = pretend(batch, request)
    least = np.where(np.arange(len(results["status"])) % 2 == 0, 1.0, -7.0)
    results["status"][-1] = Status.MAX_STEPS
    return results | {"least_normal_force": least}


def store_of(folder, settings="contact = true", **given):
    """A store whose rows have forces that an engine pretends."""
    whole = study(folder, settings=f"{settings}\nchunk = 4", **given)
    whole.run(folder / "s.zarr", engine=alternating)
    return whole, folder / "s.zarr"


@pytest.mark.thorough
def test_wheels_that_leave_the_plane_have_the_flag(tmp_path):
    """Where N of the closed form is negative somewhere in the first turn; their statuses still say SUCCESS."""
    whole = study(tmp_path, axes=SPEEDS, settings="contact = true", scenario=WHEEL)
    shown = io.StringIO()
    whole.run(tmp_path / "s.zarr", stream=shown)
    data = open_store(tmp_path / "s.zarr").dataset().load()
    fast = [start for start, left in zip((0.5, 4.0, 1.0, 5.0), DETACHED, strict=True) if left]
    assert all(min(normal_force(start, phi) for phi in np.linspace(0, np.pi, 50)) < 0 for start in fast)
    np.testing.assert_array_equal(data["left_plane"], DETACHED.astype(int))
    np.testing.assert_array_equal(data["status"], int(Status.SUCCESS))
    assert "0 failed, 2 left the plane" in shown.getvalue()
    assert (
        "2 rows with a least normal force that is not positive (`left_plane`)"
        in open_store(tmp_path / "s.zarr").describe()
    )


@pytest.mark.thorough
def test_rows_that_end_there_have_the_flag_and_are_not_counted_again(tmp_path):
    whole = study(tmp_path, axes=SPEEDS, settings="contact = true\ndetachment = true", scenario=WHEEL)
    whole.run(tmp_path / "s.zarr")
    data = open_store(tmp_path / "s.zarr").dataset().load()
    np.testing.assert_array_equal(data["status"], np.where(DETACHED, Status.DETACHED, Status.SUCCESS))
    np.testing.assert_array_equal(data["left_plane"], DETACHED.astype(int))
    assert "2 DETACHED" in open_store(tmp_path / "s.zarr").describe()
    assert "left_plane" not in open_store(tmp_path / "s.zarr").describe()


@pytest.mark.long
def test_rows_of_a_rattleback_have_the_flag(tmp_path):
    """Thrown from ten degrees at a high spin; at rest or slow it only rocks."""
    whole = study(tmp_path, axes=SPINS, settings="contact = true", scenario=STONE.replace("step = 0.02", "saves = 2"))
    whole.run(tmp_path / "s.zarr")
    data = open_store(tmp_path / "s.zarr").dataset().load()
    np.testing.assert_array_equal(data["left_plane"], [1, 0, 0])
    np.testing.assert_array_equal(data["left_plane"], (data["least_normal_force"] <= 0).astype(int))


@pytest.mark.thorough
def test_the_flag_is_in_the_store_the_table_and_the_grid(tmp_path):
    """In chunks of four rows, of which the last of each fails after it has left the plane."""
    whole, store = store_of(tmp_path)
    expected = np.concatenate([np.arange(len(whole.rows_of(k))) % 2 for k in range(whole.chunks)])
    data = open_store(store).dataset()
    np.testing.assert_array_equal(data["left_plane"], expected)
    assert "would have left the plane" in data["left_plane"].attrs["long_name"]
    np.testing.assert_array_equal(pandas.read_parquet(store.with_suffix(".parquet"))["left_plane"], expected)
    np.testing.assert_array_equal(open_store(store).grid()["left_plane"].values.ravel(), expected)
    assert f"  {expected.sum()} rows with a least normal force that is not positive" in open_store(store).describe()


def test_it_is_there_where_the_least_force_is_found_alone(tmp_path):
    _, store = store_of(tmp_path, 'find = ["least_normal_force"]')
    assert open_store(store).dataset()["left_plane"].values.max() == 1
    other = tmp_path / "other"
    other.mkdir()
    study(other).run(other / "s.zarr", engine=pretend)
    assert "left_plane" not in open_store(other / "s.zarr").dataset()
    assert "left_plane" not in open_store(other / "s.zarr").describe()


def test_an_impossible_row_has_no_flag(tmp_path):
    masses = '[[axes]]\npath = "body.mass"\nvalues = [1.0, 2.0, -1.0]\n'
    _, store = store_of(tmp_path, axes=masses)
    assert open_store(store).dataset()["left_plane"].values.tolist() == [0, 1, -1]


def test_what_does_not_roll_on_a_plane_has_no_contact(tmp_path):
    top = builtin_text("heavy-top")
    with refuses(ScenarioError, "contact"):
        study(tmp_path, settings="contact = true", scenario=top)
    with refuses(ScenarioError, "find[0]"):
        study(tmp_path, settings='find = ["least_normal_force"]', scenario=top)


def test_a_rattleback_has_the_reductions_of_the_contact_alone(tmp_path):
    found = study(tmp_path, axes=SPINS, settings='find = ["friction_needed"]', scenario=STONE)
    assert [find.name for find in found.finds] == ["friction_needed"]
    with refuses(ScenarioError, "find[0]"):
        study(tmp_path, axes=SPINS, settings='find = ["distance"]', scenario=STONE)
