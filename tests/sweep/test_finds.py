"""What a study finds of each run while it is computed."""

import numpy as np
import pandas
import pytest
import xarray

from jaxball import ScenarioError
from tests.scenario.documents import DISK
from tests.support.sentences import refuses
from tests.sweep.studies import study


def height(system, t, state):
    """φ, as a function that a study can name."""
    return state.phi


OWN = '{ name = "furthest", maximum = "tests.sweep.test_finds:height" }'


@pytest.mark.long
def test_what_is_found_stands_in_the_store_and_the_table(tmp_path):
    found = study(tmp_path, settings=f'save = "times"\nfind = ["distance", {OWN}]')
    found.run(tmp_path / "s.zarr")
    data = xarray.open_zarr(tmp_path / "s.zarr")
    assert (data["furthest_time"].attrs["units"], data["distance"].attrs["units"]) == ("time", "length")
    phi, z = data["phi"].values, data["z"].values
    assert np.all(data["furthest"].values >= phi.max(axis=1) - 1e-9)
    assert np.all(data["distance"].values >= np.abs(z - z[:, :1]).max(axis=1) - 1e-9)
    table = pandas.read_parquet(tmp_path / "s.parquet")
    np.testing.assert_array_equal(table["distance"], data["distance"])


@pytest.mark.slow
def test_every_method_of_a_scenario_finds_the_same(tmp_path):
    """Each at a tolerance of 1e-10 for the states, which a distance over two units of time inherits."""
    found = {}
    for solve in ('solver = "dopri8"', 'solver = "radau9"', "max_step = 0.1", "step_to_times = true"):
        whole = study(tmp_path, settings='contact = true\nfind = ["distance"]', scenario=f"{DISK}[solve]\n{solve}\n")
        whole.run(tmp_path / f"{len(found)}.zarr")
        found[solve] = xarray.open_zarr(tmp_path / f"{len(found)}.zarr").load()
    wanted = found['solver = "dopri8"']
    for data in found.values():
        for name in ("distance", "least_normal_force", "friction_needed"):
            np.testing.assert_allclose(data[name], wanted[name], rtol=1e-7)


@pytest.mark.slow
def test_the_distance_of_a_run_that_never_turns_is_how_far_it_came(tmp_path):
    found = study(tmp_path, settings='find = ["distance"]', scenario=DISK)
    found.run(tmp_path / "s.zarr")
    data = xarray.open_zarr(tmp_path / "s.zarr")
    assert np.all(data["distance"].values >= np.abs(data["z"].values) - 1e-9)


@pytest.mark.parametrize(
    ("settings", "scenario", "named"),
    [
        ('find = ["distanse"]', DISK, "find[0]"),
        ('find = "distance"', DISK, "find"),
        ('find = ["distance", "distance"]', DISK, "find"),
        ('find = [{ name = "x", maximum = "no_such_module:f" }]', DISK, "find"),
        ('find = [{ name = "x", maximum = "math" }]', DISK, "cannot"),
    ],
)
def test_what_cannot_be_found_is_named(tmp_path, settings, scenario, named):
    with refuses(ScenarioError, named):
        study(tmp_path, settings=settings, scenario=scenario)


def test_a_study_that_finds_something_else_is_another_study(tmp_path):
    one, other = study(tmp_path), study(tmp_path, settings='find = ["distance"]')
    assert one.identity() != other.identity()
