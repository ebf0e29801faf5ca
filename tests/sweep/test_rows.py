"""Each row of a store is the single run of its scenario, whatever became of its neighbours."""

import numpy as np
import pandas
import pytest
import xarray

import jaxball
from jaxball import Status
from jaxball.studies.sweep import open_store
from tests.scenario.documents import BALL, DISK
from tests.sweep.studies import study

AXES = """
[[axes]]
path = "body.mass"
values = [0.5, -1.0, 1.5]

[[axes]]
path = "masses[0].schedule.rate"
values = [0.2, 300.0]

[[axes]]
path = "masses[0].rail.radius"
values = [0.6, 1.1]
"""
SETTINGS = 'save = "times"\ntitle = "Disks"\nchunk = 8'


@pytest.fixture(scope="module")
def disks(tmp_path_factory):
    """Twelve disks in two chunks: shells of negative mass, rails outside the shell and fast masses are among them."""
    folder = tmp_path_factory.mktemp("disks")
    found = study(folder, AXES, SETTINGS, DISK + "[solve]\nmax_steps = 40\n")
    outcome = found.run(folder / "disks.zarr")
    assert outcome.finished
    return found, outcome


@pytest.fixture(scope="module")
def data(disks):
    with xarray.open_zarr(disks[1].store) as found:
        yield found.load()


def possible(data):
    return np.flatnonzero((data["body.mass"] > 0) & (data["masses[0].rail.radius"] < 1))


@pytest.mark.long
def test_rows_are_single_runs(disks, data):
    assert list(possible(data)) == [0, 2, 8, 10]
    for row in possible(data):
        single = disks[0].scenario(int(row)).simulate()
        assert single.ok == (row in (0, 8))
        for name in ("phi", "phidot", "z"):
            np.testing.assert_allclose(data[name][row], getattr(single.state, name), rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(data["time"][row], single.times)
        assert (int(data["steps"][row]), int(data["rejected"][row])) == (int(single.steps), int(single.rejected))
        assert int(data["status"][row]) == int(single.status)
        # Steps are as long as estimates of errors near rounding make them.
        np.testing.assert_allclose(data["reached"][row], single.reached, rtol=3e-7)


@pytest.mark.slow
def test_extremes_of_the_contact_force_are_those_of_single_runs(tmp_path):
    axes = AXES.replace("[0.2, 300.0]", "[0.2, 3.0]")
    found = study(tmp_path, axes, "contact = true")
    outcome = found.run(tmp_path / "disks.zarr")
    frame = pandas.read_parquet(outcome.table)
    for row in np.flatnonzero(frame["status"] == 0):
        extremes = jaxball.contact_extremes(found.scenario(int(row)).simulate(dense=True))
        for name in ("friction_needed", "least_normal_force", "largest_friction"):
            np.testing.assert_allclose(frame[name][row], getattr(extremes, name), rtol=1e-7)
    assert np.all(np.isnan(frame["friction_needed"][frame["status"] != 0]))


@pytest.mark.thorough
def test_a_row_that_no_body_can_have_is_a_status_and_no_number(disks, data):
    bad = np.setdiff1d(np.arange(12), possible(data))
    assert np.all(data["status"][bad] == Status.IMPOSSIBLE)
    assert np.all(data["steps"][bad] == 0)
    for name in ("phi", "reached", "z"):
        assert np.all(np.isnan(data[name][bad]))
    lines = open_store(disks[1].store).describe()
    assert "12 of 12 rows are done (100.0 %)\n  2 SUCCESS\n  2 MAX_STEPS\n  8 IMPOSSIBLE" in lines
    assert "the first failed row is 1, IMPOSSIBLE, with body.mass = 0.5" in lines
    assert "Key `masses[0].rail` must be a curve inside the shell of radius 1" in lines


@pytest.mark.thorough
def test_the_data_set_describes_itself(disks, data):
    assert dict(data.sizes) == {"row": 12, "save": 5}
    assert list(data["row"]) == list(range(12))
    assert {"body.mass", "masses[0].schedule.rate", "time"} <= set(data.coords)
    assert data["phidot"].attrs["units"] == "rad/time"
    assert data.attrs["title"] == "Disks"
    assert (data.attrs["rtol"], data.attrs["solver"]) == (1e-10, "dopri8")
    assert "rate = 0.2" in data.attrs["scenario"]
    assert data.attrs["jaxball_version"]
    assert "3 IMPOSSIBLE" in data.attrs["statuses"]


@pytest.mark.thorough
def test_the_table_has_the_ends_of_the_runs(disks, data):
    frame = pandas.read_parquet(disks[1].table)
    assert len(frame) == 12
    np.testing.assert_array_equal(frame["phi"], data["phi"][:, -1])
    np.testing.assert_array_equal(frame["body.mass"], data["body.mass"])
    np.testing.assert_array_equal(frame["status"], data["status"])
    assert "time" not in frame


@pytest.mark.slow
def test_solves_that_give_up_are_rows_with_a_status(tmp_path):
    axes = '[[axes]]\npath = "masses[0].schedule.rate"\nvalues = [0.0, 300.0]\n'
    text = BALL + "[solve]\nmax_steps = 40\n"
    outcome = study(tmp_path, axes, scenario=text).run(tmp_path / "balls.zarr")
    with xarray.open_zarr(outcome.store) as data:
        assert list(data["status"].values) == [Status.SUCCESS, Status.MAX_STEPS]
        assert data["q"].dims == ("row", "component")
        np.testing.assert_allclose(np.sum(data["q"][0] ** 2), 1.0, rtol=1e-9)
        assert np.all(np.isnan(data["q"][1]))
        assert 0 < data["reached"][1] < 2
    columns = set(pandas.read_parquet(outcome.table).columns)
    assert {"q[0]", "q[3]", "Omega[0]", "Omega[2]", "z[1]"} <= columns


@pytest.mark.slow
def test_driven_masses_that_leave_the_shell_are_seen(tmp_path):
    text = DISK.replace('{ kind = "circle", radius = 0.9 }', '{ kind = "tube", direction = [1, 0, 0] }')
    text = text.replace("end = 2.0", "end = 1.0") + '[actuation]\nform = "integrated"\n'
    axes = '[[axes]]\npath = "masses[0].schedule.rate"\nvalues = [0.1, 0.5]\n'
    outcome = study(tmp_path, axes, scenario=text).run(tmp_path / "tubes.zarr")
    with xarray.open_zarr(outcome.store) as data:
        assert list(data["status"].values) == [Status.SUCCESS, Status.LEFT_SHELL]
        np.testing.assert_allclose(data["theta"].values[:, 0], [0.8, 1.2], rtol=1e-9)
        assert float(data["reached"][1]) == 0.75  # 0.7 + 0.5 t > 1 after t = 0.6
