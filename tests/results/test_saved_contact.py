"""A run with a law of contact is saved with its modes and switches, and read back as it was."""

import jax
import numpy as np
import pytest
import xarray

import jaxball
from jaxball import Contact, DiskState, ReleasedState
from jaxball.results import saved_scenario

DISK = jaxball.Disk(mass=1.0, inertia=0.5)


@pytest.fixture(scope="module")
def run():
    """A disk that bounces twice, with room for one switch fewer than there are."""
    start = ReleasedState(DiskState(phidot=1.0), V=(1.0, 0.0, 0.0), height=0.5)
    contact = Contact(sliding=0.3, restitution=0.5, room=4)
    return jaxball.simulate(DISK, np.linspace(0.0, 3.5, 8), start, contact=contact, throw=True)


def assert_same(one, other):
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("suffix", [".nc", ".npz"])
def test_the_contact_is_read_back_as_it_was(run, tmp_path, suffix):
    again = jaxball.load_run(run.save(tmp_path / f"run{suffix}"))
    assert int(run.contact.switches.count) > 4
    assert_same(again.contact, run.contact)
    assert_same(again.observables, run.observables)
    assert again.contact.switches.lines == run.contact.switches.lines


def test_its_scenario_starts_as_it_did(run, tmp_path):
    scenario = saved_scenario(run.save(tmp_path / "run.npz"))
    assert_same(scenario.state, run.start)
    assert_same(scenario.contact, run.contact.law)


def test_names_in_a_file(run, tmp_path):
    """A fall from 1/2 takes t = 1 where g = 1, and the next two flights half and a quarter of twice that."""
    with xarray.open_dataset(run.save(tmp_path / "run.nc")) as data:
        np.testing.assert_allclose(data["switch_times"], [1.0, 2.0, 2.5, 2.75], atol=1e-9)
        assert data["switch_before_V"].dims == ("switch", "axis")
        assert data["mode"].dtype.kind == "i"
        assert data.attrs["contact_restitution"] == 0.5
        assert data.attrs["contact_switches"] == int(run.contact.switches.count)
    header = run.save(tmp_path / "run.csv").read_text().splitlines()[0].split(",")
    assert {"mode", "height", "V[2]", "slip[0]", "rubbed", "struck"} <= set(header)
