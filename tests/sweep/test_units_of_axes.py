"""The units of the numbers that a study changes: of torques, forces, stiffnesses and coefficients of signals."""

import numpy as np
import pytest

from jaxball import read_scenario
from jaxball.plot.sweeps.rows import number_label
from jaxball.studies.sweep import open_store, read_study
from jaxball.studies.sweep.outputs import outputs_of

STATED = 'units = { length = "m", mass = "kg", time = "s" }'
ROBOT = """
format = 1
kind = "ball"
%s
[body]
mass = 1.0
radius = 1.0
inertia = [0.4, 0.4, 0.4]
gravity = 9.81
[force]
constant = [0.1, 0.0, 0.0]
powers = [[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]
[resistance]
rolling = 0.1
drag = 0.1
[[mechanisms]]
[[mechanisms.joints]]
kind = "%s"
axis = [0.0, 1.0, 0.0]
force = [
    { kind = "motor", signal = { kind = "sinusoids", theta = 0, amplitude = [0.2], frequency = [1.0], phase = [0.0] } },
    { kind = "motor", signal = { kind = "piecewise", times = [0.0, 0.5], values = [[0.1, 0.2]] }, limit = 5.0 },
    { kind = "spring", stiffness = 2.0, rest = 0.1 },
    { kind = "damper", coefficient = 0.1 },
    { kind = "pd-servo", target = { kind = "constant-rate", theta = 0.0 }, stiffness = 1.0, damping = 0.1 },
    { kind = "end-stops", lower = -2.0, upper = 2.0, stiffness = 3.0, damping = 0.5 },
]
[[mechanisms.masses]]
mass = 0.5
place = [0.0, 0.0, -0.5]
[time]
start = 0.0
end = 0.1
step = 0.05
"""
FORCE = "mechanisms[0].joints[0].force"
# Newton's second law: a torque is mass length²/time², and a force mass length/time²; over an angle a torque stays one.
UNITS = {
    f"{FORCE}[0].signal.theta": ("kg m^2 s^-2", "kg m s^-2"),
    f"{FORCE}[0].signal.amplitude[0]": ("kg m^2 s^-2", "kg m s^-2"),
    f"{FORCE}[0].signal.frequency[0]": ("rad s^-1", "rad s^-1"),
    f"{FORCE}[0].signal.phase[0]": ("rad", "rad"),
    f"{FORCE}[1].signal.values[0][0]": ("kg m^2 s^-2", "kg m s^-2"),
    f"{FORCE}[1].signal.values[0][1]": ("kg m^2 s^-3", "kg m s^-3"),
    f"{FORCE}[1].signal.times[1]": ("s", "s"),
    f"{FORCE}[1].limit": ("kg m^2 s^-2", "kg m s^-2"),
    f"{FORCE}[2].stiffness": ("kg m^2 s^-2", "kg s^-2"),
    f"{FORCE}[2].rest": ("rad", "m"),
    f"{FORCE}[3].coefficient": ("kg m^2 s^-1", "kg s^-1"),
    f"{FORCE}[4].damping": ("kg m^2 s^-1", "kg s^-1"),
    f"{FORCE}[4].target.theta": ("rad", "m"),
    f"{FORCE}[5].upper": ("rad", "m"),
    f"{FORCE}[5].stiffness": ("kg m^2 s^-2", "kg s^-2"),
    f"{FORCE}[5].damping": ("s", "s m^-1"),
    "force.constant[0]": ("kg m s^-2",) * 2,
    "force.powers[0][0]": ("kg m s^-3",) * 2,
    "force.powers[1][0]": ("kg m s^-4",) * 2,
    "resistance.rolling": ("kg m^2 s^-1",) * 2,
    "resistance.drag": ("kg s^-1",) * 2,
}


def study_of(folder, joint, paths, stated=STATED):
    (folder / "robot.toml").write_text(ROBOT % (stated, joint))
    axes = "".join(f'[[axes]]\npath = "{path}"\nvalues = [0.2, 0.3]\n' for path in paths)
    return read_study(f'format = 1\nscenario = "robot.toml"\n{axes}', folder)


def units_of(folder, joint, stated=STATED):
    outputs = outputs_of(study_of(folder, joint, UNITS, stated), read_scenario(ROBOT % (stated, joint)))
    return {path: outputs[path].units for path in UNITS}


def in_any_order(unit):
    return sorted(unit.split())


@pytest.mark.parametrize(("joint", "place"), [("hinge", 0), ("slider", 1)])
def test_numbers_of_a_joint_have_units_of_torques_about_it_or_of_forces_along_it(tmp_path, joint, place):
    units = units_of(tmp_path, joint)
    assert {path: in_any_order(unit) for path, unit in units.items()} == {
        path: in_any_order(both[place]) for path, both in UNITS.items()
    }


def test_without_stated_units_they_have_none(tmp_path):
    assert set(units_of(tmp_path, "hinge", "").values()) == {""}


@pytest.mark.parametrize("joint", ["hinge", "slider"])
def test_units_are_read_by_pint(tmp_path, joint):
    pint = pytest.importorskip("pint", reason="pint is not installed")
    units = units_of(tmp_path, joint)
    registry = pint.UnitRegistry()
    effort = "[energy] / [length]" if joint == "slider" else "[energy]"
    assert registry(units[f"{FORCE}[0].signal.theta"]).check(effort)
    stiffness = "[energy] / [length] ** 2" if joint == "slider" else "[energy]"
    assert registry(units[f"{FORCE}[2].stiffness"]).check(stiffness)
    assert registry(units["force.constant[0]"]).to("N").magnitude == 1.0


@pytest.mark.thorough
def test_stores_and_figures_of_a_study_show_them(tmp_path):
    paths = [f"{FORCE}[0].signal.theta", f"{FORCE}[2].stiffness"]
    study_of(tmp_path, "hinge", paths).run(tmp_path / "s.zarr")
    with open_store(tmp_path / "s.zarr").dataset() as data:
        assert [in_any_order(data[path].attrs["units"]) for path in paths] == [["kg", "m^2", "s^-2"]] * 2
        assert np.all(data["status"].values == 0)
        assert number_label(paths[1], data=data) == f"{paths[1]} (kg m$^{{2}}$ s$^{{-2}}$)"
        assert number_label(paths[1], data=data, with_unit=False) == paths[1]
