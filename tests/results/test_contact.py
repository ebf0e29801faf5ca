"""A run with a law of contact is saved with its modes and switches, and read back with all of them."""

import dataclasses
import functools

import jax
import numpy as np
import pytest
import xarray

from jaxball import Contact, Disk, DiskState, Fixed, PointMass, load_run, save, simulate
from jaxball.files.results import saved_scenario
from jaxball.physics import Mode, ReleasedState
from jaxball.simulation.variables import HISTORY
from tests.results.same import assert_same

LAW = Contact(friction=0.3, static_friction=0.35, restitution=0.4, slowest=0.05, capacity=8)


@pytest.fixture(scope="module")
def disk():
    """A disk that is thrown, bounces, slides and rolls."""
    body = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.1, Fixed((0.2, 0.0, 0.0)))])
    thrown = ReleasedState(DiskState(phidot=-3.0), V=(1.0, 0.0, 0.0), height=0.3)
    return simulate(body, np.linspace(0.0, 6.0, 61), thrown, contact=LAW, rtol=1e-6, atol=1e-6)


@functools.cache
def without_a_law():
    return simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0], DiskState(phidot=-1.0), rtol=1e-6, atol=1e-6)


def assert_same_run(run, trajectory):
    assert_same((run.state, run.contact), (trajectory.state, trajectory.contact))


@pytest.mark.long
@pytest.mark.parametrize("suffix", [".nc", ".npz"])
def test_a_run_comes_back_with_its_modes_and_switches(disk, tmp_path, suffix):
    assert set(np.asarray(disk.contact.mode)) == {*Mode} - {Mode.REST}
    assert 3 < disk.contact.switches.count < LAW.capacity
    run = load_run(disk.save(tmp_path / f"run{suffix}"))
    assert_same_run(run, disk)
    scenario = saved_scenario(tmp_path / f"run{suffix}")
    assert_same((scenario.state, scenario.contact), (disk.start, LAW))
    assert str(run.contact.switches) == str(disk.contact.switches)
    np.testing.assert_array_equal(run.observables.normal_force, disk.observables.normal_force)
    np.testing.assert_array_equal(run.observables.geometric_centre, disk.observables.geometric_centre)


@pytest.mark.thorough
def test_a_data_set_says_what_its_numbers_stand_for(disk, tmp_path):
    history, switches = disk.contact, disk.contact.switches
    count = int(switches.count)
    with xarray.open_dataset(disk.save(tmp_path / "run.nc")) as data:
        assert data.sizes["switch"] == count
        assert data["switch"].values.tolist() == list(range(count))
        assert data["mode"].dims == ("time",)
        assert data["mode"].attrs["flag_values"].tolist() == [0, 1, 2, 3]
        assert data["mode"].attrs["flag_meanings"] == "rolling sliding flight rest"
        causes = data["switch_cause"].attrs
        assert causes["flag_meanings"].split()[causes["flag_values"].tolist().index(4)] == "lands"
        assert (data["slip"].dims, data["slip"].attrs["units"]) == (("time", "axis"), "length/time")
        assert data["switch_before_V"].dims == ("switch", "axis")
        assert data["switch_after_z"].dims == data["switch_after_phi"].dims == ("switch",)
        np.testing.assert_array_equal(data["switch_times"], switches.times[:count])
        np.testing.assert_array_equal(data["impact_loss"], history.impact_loss)
        # What the impacts took is what all of them together have taken at the end.
        np.testing.assert_allclose(data["switch_lost"].sum(), history.impact_loss[-1], rtol=1e-12)
        law = {
            name: data.attrs[f"contact_{name}"]
            for name in ("friction", "static_friction", "restitution", "slowest", "capacity")
        }
        assert law == {"friction": 0.3, "static_friction": 0.35, "restitution": 0.4, "slowest": 0.05, "capacity": 8}
        assert data.attrs["contact_switches"] == count


@pytest.mark.thorough
def test_every_quantity_of_a_history_is_described(disk):
    """And nothing else is; a run without modes has none."""
    assert disk.history.over_time.keys() == HISTORY.keys()
    assert disk.history.coefficients == {"friction": 0.3, "static_friction": 0.35}
    assert (without_a_law().history.over_time, without_a_law().history.coefficients) == ({}, {})


@pytest.mark.thorough
def test_a_table_has_the_modes(disk, tmp_path):
    data = np.genfromtxt(disk.save(tmp_path / "run.csv"), delimiter=",", names=True, deletechars="")
    np.testing.assert_array_equal(data["mode"], disk.contact.mode)
    np.testing.assert_array_equal(data["slip[0]"], disk.contact.slip[:, 0])
    assert not [name for name in data.dtype.names if name.startswith("switch")]


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", [".nc", ".npz"])
def test_a_run_without_a_switch_and_one_with_too_many(disk, tmp_path, suffix):
    """A disk that rolls all the time has none, and a law may keep fewer than there were."""
    start = ReleasedState(DiskState(phidot=-1.0), V=(1.0, 0.0, 0.0))
    rolls = simulate(disk.system, disk.times, start, contact=LAW, rtol=1e-6, atol=1e-6)
    assert rolls.contact.switches.count == 0
    assert_same_run(load_run(save(rolls, tmp_path / f"rolls{suffix}")), rolls)
    few = Contact(LAW.friction, LAW.static_friction, LAW.restitution, LAW.slowest, capacity=2)
    kept = jax.tree.map(lambda leaf: leaf[:2] if leaf.ndim else leaf, disk.contact.switches)
    short = dataclasses.replace(disk, history=dataclasses.replace(disk.contact, law=few, switches=kept))
    assert short.contact.switches.count == disk.contact.switches.count > 2
    run = load_run(save(short, tmp_path / f"short{suffix}"))
    assert_same_run(run, short)
    assert run.contact.switches.lines[-1].endswith("which a larger `capacity` of the Contact would keep")


@pytest.mark.thorough
def test_a_run_that_failed_has_no_mode_where_it_did_not_come(disk, tmp_path):
    failed = simulate(disk.system, disk.times, disk.start, contact=LAW, rtol=1e-6, atol=1e-6, max_steps=6)
    assert not failed.ok
    run = load_run(failed.save(tmp_path / "run.nc"))
    assert run.contact.mode[-1] == -1
    assert_same_run(run, failed)


@pytest.mark.thorough
def test_a_run_without_a_law_has_no_contact(tmp_path):
    run = without_a_law()
    assert load_run(run.save(tmp_path / "run.npz")).contact is None
    assert "mode" not in run.to_dataset()
