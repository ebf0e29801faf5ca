"""Rows of a study whose scenario has a law of contact: their coefficients and starts are numbers like any other."""

import numpy as np
import pytest
import xarray

from jaxball import ScenarioError
from jaxball.physics import Mode
from jaxball.studies.sweep import open_store, read_study
from tests.scenario.documents import DISK
from tests.support.sentences import refuses

SHELL, TIMES = DISK[: DISK.index("[[masses]]")].replace("inertia = 1.0", "inertia = 0.5"), DISK[DISK.index("[time]") :]
THROWN = f"{SHELL}{TIMES}[contact]\nfriction = 0.25\n[initial]\nvelocity = [1.0, 0.0, 0.0]\n"
AXES = """
[[axes]]
path = "contact.friction"
values = [0.1, 0.25]

[[axes]]
path = "initial.velocity[0]"
values = [0.5, 1.0]
"""


def study(folder, settings=""):
    (folder / "thrown.toml").write_text(THROWN)
    return read_study(f'format = 1\nscenario = "thrown.toml"\n{settings}\n{AXES}', folder)


@pytest.mark.long
def test_rows_slide_as_far_as_their_friction_says(tmp_path):
    """A disk with J = m r²/2 loses μ g of its speed until it has lost a third, and friction takes V²/6 then."""
    study(tmp_path).run(tmp_path / "s.zarr")
    data = xarray.open_zarr(tmp_path / "s.zarr").load()
    mu, V = np.repeat([0.1, 0.25], 2), np.tile([0.5, 1.0], 2)
    stops = V / (3 * mu) < 2.0
    assert 0 < np.sum(stops) < 4
    np.testing.assert_allclose(data["V"][:, 0], np.where(stops, 2 / 3 * V, V - 2 * mu), rtol=1e-8)
    np.testing.assert_array_equal(data["mode"], np.where(stops, Mode.ROLLING, Mode.SLIDING))
    np.testing.assert_array_equal(data["switches"], stops)
    np.testing.assert_allclose(data["first_switch"], np.where(stops, V / (3 * mu), np.nan), rtol=1e-9)
    np.testing.assert_array_equal(data["modes"], np.where(stops, 1 + 2, 2))
    np.testing.assert_allclose(data["friction_loss"][stops], V[stops] ** 2 / 6, rtol=1e-8)
    (scenario,) = open_store(tmp_path / "s.zarr").scenarios([1])
    assert [float(scenario.contact.static_friction), float(scenario.state.V[0])] == [0.1, 1.0]


@pytest.mark.slow
def test_what_is_found_of_rows_knows_how_they_slide(tmp_path):
    """N is that of the weight, and the energy with what friction took stays; the disk goes as far as its slip says."""
    finds = 'find = ["distance", "energy_drift", "least_normal_force", "largest_friction"]'
    study(tmp_path, finds).run(tmp_path / "s.zarr")
    data = xarray.open_zarr(tmp_path / "s.zarr").load()
    mu, V = np.repeat([0.1, 0.25], 2), np.tile([0.5, 1.0], 2)
    t = np.minimum(V / (3 * mu), 2.0)
    np.testing.assert_allclose(data["distance"], V * t - mu * t**2 / 2 + (2.0 - t) * 2 / 3 * V, rtol=1e-8)
    np.testing.assert_allclose(data["least_normal_force"], 1.0, rtol=1e-12)
    np.testing.assert_allclose(data["largest_friction"], mu, rtol=1e-12)
    assert np.all(np.abs(data["energy_drift"]) < 1e-9)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ("contact = true", "contact"),
        ("detachment = true", "detachment"),
    ],
)
def test_what_is_of_bodies_that_roll_is_refused(tmp_path, settings, named):
    with refuses(ScenarioError, named):
        study(tmp_path, settings)
