"""Runs in which dry friction or hard stops hold something are saved with their modes and switches, and read back."""

import functools

import numpy as np
import pytest
import xarray

from jaxball import (
    Ball,
    BallState,
    Contact,
    Disk,
    DiskState,
    HardStops,
    JointFriction,
    Motor,
    Resistance,
    Sinusoids,
    load_run,
    planar_pendulum,
    save,
    simulate,
)
from jaxball.control import tvlqr
from jaxball.files.results.variables import history_summary
from jaxball.physics import JointForces
from tests.results.same import assert_same

DRY, RUBS, STOPS = Resistance(dry=0.02, exact=True), JointFriction(0.1), HardStops(-0.3, 0.3, 0.4)
TIMES = np.linspace(0.0, 3.0, 31)


def disk(*forces, torque=1.2, **others):
    pendulum = planar_pendulum(0.6, 0.7, drive=JointForces((Motor(Sinusoids(0.0, [torque], [2.0])), *forces)))
    start = DiskState(phidot=0.5, theta=(0.1,), thetadot=(0.3,))
    return Disk(mass=1.0, inertia=0.5, mechanisms=[pendulum], **others), start


def ball():
    """One whose rolling and spinning friction holds, each by itself."""
    resistance = Resistance(dry=0.3, dry_spinning=0.2, exact=True)
    return Ball(mass=1.0, inertia=(0.4, 0.4, 0.5), resistance=resistance), BallState(Omega=(0.2, 0.4, 0.3))


# Bodies and their starts, and the laws of contact, by what holds.
HELD = {
    "rests": lambda: (*disk(resistance=DRY), {}),
    "a ball rests": lambda: (*ball(), {}),
    "sticks": lambda: (*disk(RUBS), {}),
    "stops": lambda: (*disk(STOPS), {}),
    "all": lambda: (*disk(RUBS, STOPS, resistance=DRY), {}),
    "all, with a law of contact": lambda: (
        *disk(RUBS, STOPS, torque=0.6, resistance=DRY),
        {"contact": Contact(0.05)},
    ),
}


STOPPED = ("stops", "all", "all, with a law of contact")


@functools.cache
def run_of(name):
    body, start, law = HELD[name]()
    return simulate(body, TIMES, start, **law, throw=True)


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    ["a ball rests", "all"]
    + [
        pytest.param(name, marks=pytest.mark.slow)
        for name in ("rests", "sticks", "stops", "all, with a law of contact")
    ],
)
def test_a_run_comes_back_with_what_held_it(name, tmp_path):
    run = run_of(name)
    assert int(run.switches.count) > 0
    for suffix in (".nc", ".npz"):
        again = load_run(save(run, tmp_path / f"run{suffix}"), run.system)
        assert_same(again.history, run.history)
        assert str(again) == str(run)
        assert ("strikes on stops dissipated" in str(again)) == (name in STOPPED)
        for seen in ("contact_force", "dissipation", "angular_acceleration_body"):
            np.testing.assert_array_equal(*(getattr(one.observables, seen) for one in (again, run)))


@pytest.mark.slow
def test_figures_of_a_run_that_comes_back_are_the_same(tmp_path):
    run = run_of("all, with a law of contact")
    again = load_run(save(run, tmp_path / "run.nc"), run.system)
    curves = []
    for one in (run, again):
        ax = one.plot("contact_force")
        drawn = [line.get_xydata() for line in ax.lines]
        curves.append([*drawn, *(patch.get_xy() for patch in ax.patches if patch.get_label() in ("sliding", "flight"))])
    assert len(curves[0]) == len(curves[1]) > 2
    for mine, theirs in zip(*curves, strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.slow
def test_a_data_set_says_what_held_and_what_changed(tmp_path):
    run = run_of("all")
    history, switches = run.history, run.switches
    count = int(switches.count)
    with xarray.open_dataset(save(run, tmp_path / "run.nc")) as data:
        assert data["sticking"].values.tolist() == ["mechanisms[0].joints[0]"]
        assert data["directions"].dims == data["stops"].dims == ("time", "sticking")
        np.testing.assert_array_equal(data["rests"], history.rests)
        np.testing.assert_array_equal(data["stops"], history.stops)
        np.testing.assert_allclose(data["stop_loss"], history.stop_loss)
        np.testing.assert_array_equal(data["switch_times"], switches.times[:count])
        assert data["switch_after_directions"].dims == ("switch", "sticking")
        assert data["switch_before_thetadot"].dims == ("switch", "driven")
        assert "joint_strikes" in data["switch_cause"].attrs["flag_meanings"]
        assert data.attrs["switches"] == count
        assert "switch_source" not in data  # without a law of contact a body always rolls
        # A joint that sticks has no rate: what the file says of its sides agrees with the states there.
        for side in ("before", "after"):
            sticks = data[f"switch_{side}_directions"].values == 0
            assert np.all(data[f"switch_{side}_thetadot"].values[sticks] == 0)
            rests = data[f"switch_{side}_rolls"].values == 0
            assert np.all(data[f"switch_{side}_phidot"].values[rests] == 0)
    table = np.genfromtxt(save(run, tmp_path / "run.csv"), delimiter=",", names=True, deletechars="")
    np.testing.assert_array_equal(table["rests"], history.rests)
    np.testing.assert_array_equal(table["directions[0]"], history.directions[:, 0])
    summary = history_summary(history)["held"]
    assert summary["count"] == len(summary["switches"]) == count
    assert [switch["changed"] for switch in summary["switches"]] == [switches.words(k) for k in range(count)]


@pytest.mark.slow
def test_a_closed_loop_comes_back_with_what_held_it(tmp_path):
    """Beside the motion and the inputs."""
    body = Disk(mass=1.0, inertia=0.5, mechanisms=[planar_pendulum(0.5, 0.6, drive=Motor(0.0))])
    track = tvlqr(simulate(body, [0.0, 2.0]), Q={"phi": 1.0, "theta": 1.0}, R=1.0, sample=0.1)
    held = Disk(**body.arguments | {"resistance": Resistance(dry=0.3, exact=True)})
    run = track.feedforward().closed_loop({"phidot": -0.3}, system=held).run
    assert int(run.switches.count) > 0
    again = load_run(save(run, tmp_path / "run.npz"), run.system)
    assert_same(again.history, run.history)


@pytest.mark.slow
def test_a_run_that_failed_says_what_held_it_until_then(tmp_path):
    body, start, _ = HELD["all"]()
    failed = simulate(body, TIMES, start, max_steps=40)
    assert not failed.ok
    assert_same(load_run(save(failed, tmp_path / "run.nc"), body).history, failed.history)
