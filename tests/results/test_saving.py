"""Saved trajectories are read again by the libraries for their formats, and a failure harms no file."""

import csv
import json

import numpy as np
import pandas
import pytest
import xarray

from jaxball import Status, read_scenario, save, simulate, write_scenario
from jaxball.files.results import OutputError
from jaxball.files.scenario.paths import check_number, entries
from jaxball.numerics.arrays import arrays_of
from jaxball.physics import ReducedState
from jaxball.plot.sweeps.rows import label_of, result_names
from jaxball.studies.sweep import open_store, read_study
from tests.scenario.documents import BALL, DISK
from tests.support.sentences import refuses

INTEGRATED = BALL + '[force]\nconstant = [0.1, 0.0, 0.0]\n[actuation]\nform = "integrated"\n'


@pytest.fixture(scope="module")
def ball():
    scenario = read_scenario(INTEGRATED)
    return scenario, scenario.simulate()


@pytest.fixture(scope="module")
def stopped():
    """A run whose steps end before its last times."""
    scenario = read_scenario(INTEGRATED)
    return scenario, scenario.simulate(max_steps=4)


@pytest.mark.thorough
def test_netcdf(ball, tmp_path):
    scenario, trajectory = ball
    path = save(trajectory, tmp_path / "run.nc", scenario)
    with xarray.open_dataset(path) as data:
        sizes = {"time": 5, "component": 4, "axis": 3, "direction": 2, "driven": 1, "mass": 1, "rail": 1}
        assert dict(data.sizes) == sizes
        for name in ("q", "Omega", "z", "theta", "thetadot"):
            np.testing.assert_array_equal(data[name], getattr(trajectory.state, name))
        for name in ("normal_force", "energy", "mass_positions_space", "friction"):
            np.testing.assert_array_equal(data[name], getattr(trajectory.observables, name))
        for name in ("axis", "direction", "component", "mass", "driven"):
            assert data[name].dtype == np.int64
            assert data[name].values.tolist() == list(range(data.sizes[name]))
        np.testing.assert_array_equal(data["Omega"].sel(axis=1), trajectory.state.Omega[:, 1])
        assert data["normal_force"].attrs["units"] == "force"
        assert data.attrs["scenario"] == write_scenario(scenario)
        assert (data.attrs["ok"], data.attrs["status"]) == (1, "SUCCESS")
        assert data.attrs["message"] == trajectory.message
        assert data.attrs["jaxball_version"]


@pytest.mark.thorough
def test_npz(ball, tmp_path):
    scenario, trajectory = ball
    with np.load(save(trajectory, tmp_path / "run.npz", scenario)) as data:
        np.testing.assert_array_equal(data["q"], trajectory.state.q)
        np.testing.assert_array_equal(data["power"], trajectory.observables.power)
        assert str(data["scenario"]) == write_scenario(scenario)
        assert int(data["ok"]) == 1


@pytest.mark.thorough
def test_csv(ball, tmp_path):
    _, trajectory = ball
    path = save(trajectory, tmp_path / "run.csv")
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["time"]) for row in rows] == np.asarray(trajectory.times).tolist()
    assert [float(row["Omega[1]"]) for row in rows] == np.asarray(trajectory.state.Omega[:, 1]).tolist()
    assert [float(row["q[0]"]) for row in rows] == np.asarray(trajectory.state.q[:, 0]).tolist()
    place = trajectory.observables.mass_positions_body[:, 0, 2]
    assert [float(row["mass_positions_body[0][2]"]) for row in rows] == np.asarray(place).tolist()
    assert {row["status"] for row in rows} == {"0"}
    assert np.genfromtxt(path, delimiter=",", names=True)["time"].shape == (5,)


@pytest.mark.thorough
def test_runs_and_studies_count_alike(ball, tmp_path):
    """A store of one row, filled with the states of a run, has that run's coordinates, entries and columns."""
    scenario, trajectory = ball
    run, state = trajectory.to_dataset(), {k: np.asarray(leaf) for k, leaf in arrays_of(trajectory.state).items()}

    def engine(batch, wanted):
        counts = np.zeros(batch.rows, dtype=int)
        results = {"status": counts, "steps": counts, "rejected": counts, "reached": batch.times[:, -1]}
        return results | {name: leaf[None] for name, leaf in state.items()}

    (tmp_path / "ball.toml").write_text(write_scenario(scenario))
    text = 'format = 1\nscenario = "ball.toml"\nsave = "times"\n[[axes]]\npath = "body.mass"\nvalues = [1.0]\n'
    outcome = read_study(text, tmp_path).run(tmp_path / "s.zarr", engine=engine)
    data = open_store(outcome.store).dataset()
    for name in ("axis", "direction", "component", "driven"):
        xarray.testing.assert_identical(data[name].variable, run[name].variable)
    np.testing.assert_array_equal(data["Omega"].sel(axis=1)[0], run["Omega"].sel(axis=1))
    numbers = {entry for name, leaf in state.items() for entry in entries(name, leaf.shape[1:])}
    assert {"q[0]", "Omega[1]", "z[1]", "theta[0]"} < numbers
    columns = save(trajectory, tmp_path / "run.csv").read_text().splitlines()[0].split(",")
    for names in (columns, pandas.read_parquet(outcome.table).columns, result_names(data)):
        assert numbers <= set(names)
    check_number({"initial": {"Omega": [0.0, 0.0, 0.1]}}, "initial.Omega[1]")


ROBOT = (
    BALL
    + """
[[mechanisms]]
[[mechanisms.joints]]
kind = "hinge"
axis = [0.0, 1.0, 0.0]
schedule = { kind = "constant-rate", theta = 0.1, rate = 0.2 }
[[mechanisms.joints]]
kind = "hinge"
axis = [1.0, 0.0, 0.0]
[[mechanisms.masses]]
mass = 0.2
place = [0.0, 0.0, -0.5]
"""
)


@pytest.mark.long
def test_joints_have_one_name_in_runs_and_in_stores(tmp_path, recwarn):
    """Along `driven` and along `joint`; in Zarr as an attribute, because not every library reads texts from it."""
    scenario = read_scenario(ROBOT)
    run = scenario.simulate()
    with xarray.open_dataset(run.save(tmp_path / "run.nc")) as data:
        assert data["joint"].values.tolist() == ["mechanisms[0].joints[0]", "mechanisms[0].joints[1]"]
        assert data["driven"].values.tolist() == ["mechanisms[0].joints[1]"]
        free = data["joint_angles"].sel(joint="mechanisms[0].joints[1]")
        np.testing.assert_array_equal(free, data["theta"].sel(driven="mechanisms[0].joints[1]"))
    state = {name: np.asarray(leaf)[None] for name, leaf in vars(run.state).items()}

    def engine(batch, wanted):
        counts = np.zeros(1, dtype=int)
        return {"status": counts, "steps": counts, "rejected": counts, "reached": np.ones(1), **state}

    (tmp_path / "robot.toml").write_text(ROBOT)
    text = 'format = 1\nscenario = "robot.toml"\nsave = "times"\n[[axes]]\npath = "body.mass"\nvalues = [1.0]\n'
    recwarn.clear()
    outcome = read_study(text, tmp_path).run(tmp_path / "s.zarr", engine=engine)
    assert [str(item.message) for item in recwarn] == []
    for data in (open_store(outcome.store).dataset(), open_store(outcome.store).grid()):
        np.testing.assert_array_equal(np.ravel(data["theta"].sel(driven="mechanisms[0].joints[1]")), free)
    assert label_of(open_store(outcome.store).dataset(), "theta[0]") == r"$\theta_{1}$ at the end (rad or length)"
    metadata = json.loads((outcome.store / "driven" / "zarr.json").read_text())
    assert metadata["data_type"] == "int64"
    assert metadata["attributes"]["names"] == ["mechanisms[0].joints[1]"]


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", [".nc", ".npz", ".csv"])
def test_failed_solve_is_marked(stopped, tmp_path, suffix):
    scenario, trajectory = stopped
    path = save(trajectory, tmp_path / f"run{suffix}", scenario)
    if suffix == ".csv":
        data = pandas.read_csv(path)
        assert set(data["status"]) == {int(Status.MAX_STEPS)}
        z, ratio = data["z[0]"].to_numpy(), data["friction_ratio"].to_numpy()
    elif suffix == ".npz":
        with np.load(path) as data:
            assert (int(data["ok"]), str(data["status"])) == (0, "MAX_STEPS")
            z, ratio = data["z"][:, 0], data["friction_ratio"]
    else:
        with xarray.open_dataset(path) as data:
            assert (data.attrs["ok"], data.attrs["status"]) == (0, "MAX_STEPS")
            assert "max_steps" in data.attrs["message"]
            z, ratio = data["z"].values[:, 0], data["friction_ratio"].values
    assert np.isfinite(z[0])
    assert np.isnan(z[-1])
    np.testing.assert_array_equal(np.isnan(ratio), np.isnan(z))


@pytest.mark.thorough
def test_disk():
    data = read_scenario(DISK).simulate().to_dataset()
    assert data["phi"].dims == data["z"].dims == ("time",)
    assert "theta" not in data


@pytest.mark.thorough
def test_reduced_trajectory_has_its_state_only():
    scenario = read_scenario(BALL)
    data = simulate(scenario.system, scenario.times, ReducedState()).to_dataset()
    assert set(data.data_vars) == {"Omega", "Gamma"}


@pytest.mark.thorough
def test_failure_leaves_the_file_as_it_was(ball, tmp_path, monkeypatch):
    _, trajectory = ball
    path = tmp_path / "run.csv"
    path.write_text("precious")

    def fails(path, *_, **__):
        path.write_text("half of it")
        raise OSError("the disk is full")

    monkeypatch.setattr(np, "savetxt", fails)
    with refuses(OutputError, "run.csv"):
        save(trajectory, path)
    assert path.read_text() == "precious"
    assert [item.name for item in tmp_path.iterdir()] == ["run.csv"]


@pytest.mark.thorough
def test_sentences_of_destinations(ball, tmp_path):
    _, trajectory = ball
    for name in ("run.xlsx", "none/run.nc"):
        with refuses(OutputError, "path"):
            save(trajectory, tmp_path / name)
    (tmp_path / "folder.nc").mkdir()
    with refuses(OutputError, "path"):
        save(trajectory, tmp_path / "folder.nc")
