"""Robots in general engines: the motions against closed forms, what is said of convergence, tables and selections."""

import importlib
import json
import re
import sys
import tomllib
from pathlib import Path

import diffrax
import numpy as np
import pytest
from comparison.engines import CASES, DRAKE, ENGINES, MUJOCO, PYBULLET, gradients, report
from comparison.engines.contract import Motion
from comparison.engines.inside import angles_by_schedule, in_space, masses_on_hinges
from comparison.engines.run import Row, listing, measure, plan
from comparison.run import SelectionError

from jaxball.files.mjcf import to_mjcf
from jaxball.interface.wording import pip_install
from tests.support.sentences import refuses

ROOT = Path(__file__).parents[2]
SAVED, SAVED_GRADIENTS = (ROOT / "benchmarks" / f"{name}.json" for name in ("engines", "engine_gradients"))
PAGE = ROOT / "docs" / "theory" / "engines.md"


def on_slope(times):
    """A solid ball that rolls sideways on a slope of 0.2 rad: 5/7 g sin a down it, and its own speed across."""
    times = np.asarray(times)
    return np.stack([5 / 14 * 9.81 * np.sin(0.2) * times**2, 1.0 * times], axis=-1)


def path_error(motion, times):
    return np.max(np.linalg.norm(motion.centre[:, :2] - on_slope(times), axis=-1)) / 0.2


@pytest.fixture(scope="module")
def slope():
    """The errors of the path on the slope by MuJoCo, by setting and time step."""
    from comparison.engines import mujoco_

    settings = {setting.name: setting for setting in MUJOCO.settings}
    times = CASES["slope"].scenario().times

    def error(name, timestep):
        return path_error(mujoco_.run(CASES["slope"], settings[name], timestep), times)

    return error


def test_a_rolling_sphere_of_mujoco_converges_as_step_and_softness_vanish_together(slope):
    """With springs whose time constant is two steps, by a Runge–Kutta method: of second order."""
    coarse, fine = slope("RK4, stiff", 0.004), slope("RK4, stiff", 0.001)
    assert fine < 5e-5
    assert 1.5 < np.log(coarse / fine) / np.log(4) < 2.5


def test_it_does_not_converge_as_the_step_alone_vanishes(slope):
    """Then the sphere sinks into the plane, and rolls on a smaller radius."""
    coarse, fine = slope("RK4", 0.004), slope("RK4", 0.001)
    assert fine > 1e-2
    assert 0.95 < coarse / fine < 1.05  # A method of first order would have 4, MuJoCo 3.17 has 1.015.


def test_with_the_implicit_method_it_converges_of_first_order(slope):
    coarse, fine = slope("implicitfast, stiff", 0.004), slope("implicitfast, stiff", 0.001)
    assert 0.8 < np.log(coarse / fine) / np.log(4) < 1.2


@pytest.mark.thorough
def test_a_rolling_sphere_of_drake_converges_of_first_order():
    pytest.importorskip("pydrake", reason="Drake, of the extra `engines`, is not installed")
    from comparison.engines import drake_

    times = CASES["slope"].scenario().times
    tamsi = next(setting for setting in DRAKE.settings if setting.name == "TAMSI")
    coarse, fine = (path_error(drake_.run(CASES["slope"], tamsi, timestep), times) for timestep in (0.01, 0.0025))
    assert 0.8 < np.log(coarse / fine) / np.log(4) < 1.2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("engine", "setting", "package"),
    [("drake_", DRAKE.settings[0], "pydrake"), ("pybullet_", PYBULLET.settings[0], "pybullet")],
    ids=["Drake", "PyBullet"],
)
def test_the_papers_disk_moves_in_other_engines(engine, setting, package):
    """Four prescribed masses in a ball that rolls as the disk, to half of a hundredth of a radius at 5 ms."""
    pytest.importorskip(package, reason=f"{package}, of the extras `engines` and `pybullet`, is not installed")
    from comparison.engines.errors import errors, exact

    module = importlib.import_module(f"comparison.engines.{engine}")
    case = CASES["disk"]
    found = errors(case.scenario(), module.run(case, setting, 0.005), exact(case.scenario()))
    assert found.path < 5e-3


@pytest.mark.thorough
def test_the_masses_of_the_disk_are_on_hinges_of_a_ball():
    """With the radii of its circles, about an axis across its plane."""
    links = masses_on_hinges(to_mjcf(in_space(CASES["disk"].scenario())))
    assert [link.name for link in links] == [f"masses[{k}]" for k in range(4)]
    np.testing.assert_allclose([np.linalg.norm(link.place) for link in links], [0.9, 19 / 30, 11 / 30, 0.1])
    assert all(np.array_equal(np.abs(link.axis), [0.0, 1.0, 0.0]) and np.all(link.point == 0) for link in links)
    angles = angles_by_schedule(CASES["disk"].scenario().system, np.array([0.0, 1.0]))
    assert [values[0][0] for values in angles.values()] == [-np.pi / 2] * 4


@pytest.mark.slow
def test_derivatives_by_differences_of_mujoco_are_those_of_the_exact_motion():
    """Of second order in the time step, as its path is."""
    from comparison.engines import mujoco_

    exact = gradients.own(diffrax.ForwardMode(), 1e-9).value
    models = [gradients.model_with_controls(mujoco_, timestep) for timestep in (0.01, 0.005)]
    found = [gradients.difference(mujoco_, *one).value for one in models]
    coarse, fine = (np.linalg.norm(value - exact) / np.linalg.norm(exact) for value in found)
    assert fine < 1e-4
    assert 1.5 < np.log2(coarse / fine) < 2.7


@pytest.mark.thorough
def test_the_exact_motion_has_no_error():
    """The closed form of the ball on the slope, against the run that stands for the exact motion."""
    from comparison.engines.errors import errors, exact

    scenario = CASES["slope"].scenario()
    t, n = scenario.times, len(scenario.times)
    path, a = on_slope(t), 5 / 7 * 9.81 * np.sin(0.2)
    V = np.stack([a * t, np.ones(n), np.zeros(n)], axis=-1)
    turning = np.stack([-V[:, 1] / 0.2, V[:, 0] / 0.2, np.ones(n)], axis=-1)  # ω of rolling, and the spin
    q = orientations(turning, t)
    Omega = np.stack([rotation(one).T @ omega for one, omega in zip(q, turning, strict=True)])
    none = np.zeros((n, 0))
    motion = Motion(q, Omega, np.column_stack([path, np.full(n, 0.2)]), V, none, none, 0.0)
    found = errors(scenario, motion, exact(scenario))
    assert max(found) < 1e-9  # of a solve at 1e-12


def orientations(omega, times):
    """Versors of any attitude, because a homogeneous ball's energy and slip do not depend on it."""
    return np.tile([0.6, 0.0, 0.8, 0.0], (len(times), 1))


def rotation(q):
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


ROWS = [
    Row("slope", "jaxball", "Dopri8", 1e-9, 1e-8, 0.0, 0.0, 1e-4),
    Row("slope", "MuJoCo", "RK4", 0.01, 1e-2, 0.0, 0.0, 5e-3),
    Row("slope", "MuJoCo", "RK4", 0.001, 1e-4, 0.0, 0.0, 5e-2),
    Row("slope", "Drake", "SAP", 0.01, failure="It cannot."),
]


def test_the_table_has_the_smallest_error_within_each_time():
    table = report.within(ROWS).splitlines()
    assert table[3].split(" | ")[1:] == ["–", "1.0e-2 (RK4, 0.01)", "1.0e-4 (RK4, 0.001) |"]
    assert table[2].count("1.0e-8 (Dopri8, 1e-09)") == 3
    assert table[4].count("–") == 3


def test_the_order_is_that_between_steps_ten_times_apart():
    assert report.order(ROWS[1:3]) == "2.0"
    assert report.order(ROWS[1:2]) == "–"
    assert "| Drake, SAP | 0.01 | It cannot. |" in report.every(ROWS)


def test_names_select_robots_and_engines():
    chosen = plan(["slope"], ["mujoco"])
    assert [case.name for case in chosen.cases] == ["slope"]
    assert chosen.engines == [MUJOCO]
    assert len(plan().cases) == len(CASES)
    with refuses(SelectionError, "engines"):
        plan(["slop"])


def test_engines_that_are_not_installed_are_left_out_with_a_sentence(monkeypatch, tmp_path):
    for engine in ENGINES.values():
        for package in engine.family.packages:
            monkeypatch.setitem(sys.modules, package, None)
    lines = []
    chosen = plan(["slope"])._replace(cases=[])
    assert measure(chosen, tmp_path, lines.append) == []
    assert lines[0] == f"Left out: MuJoCo, because mujoco is not installed; {pip_install('engines')}."
    assert "left out because mujoco is not installed" in listing()


def test_every_engine_is_installed_by_its_own_extra():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    distributions = {"pydrake": "drake"}
    for engine in ENGINES.values():
        installed = {re.split("[<>=]", item)[0] for item in extras[engine.family.extra]}
        assert {distributions.get(package, package) for package in engine.family.packages} <= installed


def test_the_page_has_the_tables_of_the_saved_run():
    rows = [Row(**row) for row in json.loads(SAVED.read_text())["rows"]]
    page = PAGE.read_text()
    for case in CASES.values():
        own = [row for row in rows if row.case == case.name]
        assert report.within(own) in page, case.name
    assert report.every([row for row in rows if row.case == "slope"]) in page
    derivatives = [gradients.Row(**row) for row in json.loads(SAVED_GRADIENTS.read_text())["rows"]]
    assert gradients.table(derivatives) in page
