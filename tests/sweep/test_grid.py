"""A store opened along the axes of its study."""

import shutil

import numpy as np
import pytest
import xarray

from jaxball.plot.sweeps.rows import label_of
from jaxball.studies.sweep import open_store
from tests.sweep.studies import pretend, study

SMALL = 'save = "times"\nchunk = 4'
m, g = np.linspace(0.5, 2.0, 5), np.array([0.5, 1.0, 2.0])
SCATTERED = """
[[axes]]
zip = [{ path = "body.mass", values = [2.0, 1.0] }, { path = "body.radius", values = [3.0, 4.0] }]

[[axes]]
design = "latin-hypercube"
count = 3
numbers = { "body.gravity" = { uniform = [0.5, 2.0] }, "body.inertia" = { uniform = [1.0, 2.0] } }

[[axes]]
design = "random"
count = 2
numbers = { "time.end" = { uniform = [1.0, 2.0] } }
"""


@pytest.fixture(scope="module")
def unfinished(tmp_path_factory):
    """The first, third and fourth of four chunks, each of four rows but the last."""
    folder = tmp_path_factory.mktemp("grid")
    for part in (1, 3, 4):
        store = study(folder, settings=SMALL).run(folder / "s.zarr", engine=pretend, shard=(part, 4)).store
    return store


def test_a_grid_has_the_values_of_its_axes_as_coordinates(unfinished):
    grid = open_store(unfinished).grid()
    assert dict(grid.sizes) == {"body.mass": 5, "body.gravity": 3, "save": 5}
    assert grid["phi"].dims == grid["time"].dims == ("body.mass", "body.gravity", "save")
    np.testing.assert_array_equal(grid["body.mass"], m)
    expected, rows = m[:, None] * g, np.arange(15).reshape(5, 3)
    expected[np.isin(rows, range(4, 8))] = np.nan
    np.testing.assert_allclose(grid["phi"][..., -1], expected, rtol=1e-15)
    np.testing.assert_allclose(grid["phi"].sel({"body.mass": 1.25, "save": 0}), expected[2], rtol=1e-15)
    np.testing.assert_allclose(grid["phi"].isel({"body.gravity": [2, 0], "save": 1}), expected[:, [2, 0]], rtol=1e-15)
    near = grid["phi"].sel({"body.mass": 1.6, "body.gravity": 1.1}, method="nearest")
    assert near.dims == ("save",)
    np.testing.assert_allclose(near, 1.625, rtol=1e-15)
    assert grid["status"].values.ravel().tolist() == [0] * 4 + [-1] * 4 + [0] * 7
    np.testing.assert_array_equal(grid["row"], np.where(np.isnan(expected), -1, rows))
    assert grid.attrs == open_store(unfinished).dataset().attrs


def test_a_grid_reads_what_is_asked_for(unfinished, tmp_path):
    store = tmp_path / "s.zarr"
    shutil.copytree(unfinished, store)
    grid = open_store(store).grid()
    (store / "phi" / "c" / "3" / "0").write_bytes(b"short")
    np.testing.assert_allclose(grid["phi"].sel({"body.mass": 0.5, "save": 0}), 0.5 * g, rtol=1e-15)
    with pytest.raises(ValueError, match="checksum"):
        grid["phi"].sel({"body.mass": 2.0}).load()


def test_numbers_that_change_together_lie_along_one_axis(tmp_path):
    found = study(tmp_path, SCATTERED, SMALL)
    grid = open_store(found.run(tmp_path / "s.zarr", engine=pretend).store).grid()
    assert grid["z"].dims == ("axes[0]", "axes[1]", "time.end", "save")
    for k, size in enumerate((2, 3)):
        assert grid[f"axes[{k}]"].values.tolist() == list(range(size))
    assert grid["body.mass"].dims == grid["body.radius"].dims == ("axes[0]",)
    assert grid["body.radius"].values.tolist() == [3.0, 4.0]
    assert grid["body.gravity"].dims == ("axes[1]",)
    np.testing.assert_array_equal(grid["body.gravity"], found.values(np.arange(0, 6, 2))[:, 2])
    expected = -grid["body.mass"] * grid["body.gravity"]
    np.testing.assert_allclose(grid["z"].isel({"time.end": 0, "save": 0}), expected, rtol=1e-15)
    swapped = grid.swap_dims({"axes[0]": "body.mass"})
    assert float(swapped["body.radius"].sel({"body.mass": 1.0})) == 4.0


def test_symbols_of_driven_masses_have_the_numbers_of_the_paper():
    data = xarray.Dataset({"theta": (("row", "driven"), [[0.1, 0.2]])}, {"row": [0], "driven": [0, 2]})
    assert label_of(data, "theta[1]", at_the_end=False) == r"$\theta_{3}$"
