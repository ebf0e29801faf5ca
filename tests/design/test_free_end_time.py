"""Motions in the least time, in closed form: a disk with a wheel is a double integrator with a limited force."""

import os
import tomllib

import equinox as eqx
import jax
import numpy as np
import pytest
import tomli_w

import jaxball
from jaxball import cli
from jaxball.studies import design
from jaxball.studies.design import optimal_control
from jaxball.studies.design.files import read_control
from jaxball.studies.design.optimal_control.collocation import BARRIER
from jaxball.studies.design.optimal_control.solve import (
    BARRIER_OF_TIME,
    FreeEndTime,
    fix_end,
    solve_from_guess,
)
from tests.support.sentences import refuses

LIMIT, PLACE, SOFTNESS = 0.5, 1.0, 1e-7
MESH = np.linspace(0.0, 5.0, 9)
WHEEL, INERTIA = 0.3, 0.5
# A torque u between disk and wheel accelerates the disk by u / (M r² + d), with M = 1.3 and r = 1: for one half of the
# way, and as long against it.
ACCELERATION = LIMIT / (1.0 + WHEEL + INERTIA)
LEAST_TIME = 2 * np.sqrt(PLACE / ACCELERATION)


FILE = f"""
format = 1
title = "As fast as its motor allows"

[scenario]
format = 1
kind = "disk"
body = {{ mass = 1.0, radius = 1.0, inertia = {INERTIA}, gravity = 2.0 }}
initial = {{ theta = [0.0], thetadot = [0.0] }}
time = {{ start = 0.0, end = 5.0, saves = 11 }}

[[scenario.mechanisms]]

[[scenario.mechanisms.joints]]
kind = "hinge"
axis = [0.0, 1.0, 0.0]
force = {{ kind = "motor", signal = 0.0, limit = {LIMIT} }}

[[scenario.mechanisms.masses]]
mass = {WHEEL / 2}
place = [0.4, 0.0, 0.0]

[[scenario.mechanisms.masses]]
mass = {WHEEL / 2}
place = [-0.4, 0.0, 0.0]

[control]
place = {PLACE}
intervals = 8
softness = {SOFTNESS}
free_end_time = [1.0, 20.0]
"""


def rolling(limit: float | None = LIMIT, **objectives):
    wheel = jaxball.Mechanism(
        [jaxball.Hinge((0.0, 1.0, 0.0), drive=jaxball.Motor(0.0, limit=limit))],
        [jaxball.CarriedMass(WHEEL / 2, (x, 0.0, 0.0)) for x in (0.4, -0.4)],
    )
    disk = jaxball.Disk(mass=1.0, inertia=INERTIA, gravity=2.0, mechanisms=[wheel])
    start = jaxball.DiskState(theta=(0.0,), thetadot=(0.0,))
    # The wheel stops when the disk does.
    return optimal_control.Rolling(disk, (0.0, 5.0), objectives, start, place=PLACE, softness=SOFTNESS)


@pytest.mark.long
def test_the_least_time_from_rest_to_rest():
    """Full force, and from the middle on, which is a knot of the mesh, full force against it.

    The end is soft: it is missed by the softness times the multiplier, dT/d(place) = T/2 to a few times that.
    """
    solution = rolling().solve(MESH, free_end_time=(1.0, 20.0))
    assert solution.path.mesh[-1] == pytest.approx(LEAST_TIME, rel=1e-6)
    torque, half = solution.path.controls[..., 0], len(solution.path.mesh) // 2
    np.testing.assert_allclose(np.abs(torque), LIMIT, atol=1e-4)
    assert abs(np.sum(np.sign(torque[:half])) + np.sum(np.sign(torque[half:]))) == 0
    seen = solution.resimulate()
    assert max(seen.apart, seen.speed, seen.away, seen.missed) < 1e-5
    assert float(solution.scenario().times[-1]) == pytest.approx(LEAST_TIME, rel=1e-6)


@pytest.mark.long
def test_the_shortest_time_allowed_is_taken_where_the_motor_could_be_faster():
    solution = rolling().solve(MESH, free_end_time=(4.5, 20.0))
    assert solution.path.mesh[-1] == pytest.approx(4.5, rel=1e-5)
    assert np.max(np.abs(solution.path.controls)) < LIMIT


@pytest.mark.parametrize("ends", [(0.0, 20.0), (1.0, 5.0), (6.0, 20.0)])
def test_bounds_that_do_not_hold_the_guess_are_refused(ends):
    with refuses(design.DesignError, "free_end_time"):
        rolling().solve(MESH, free_end_time=ends)


@pytest.mark.long
def test_the_least_curvature_is_by_the_end_time_as_well():
    """Q = q (1 − 2 s) takes the disk there within T, with q = 6 D (M r² + d) / T² and the mean effort c² q²/3, which
    falls with T⁻⁴: with the weight 4 c² q²/3 of σ the end is at T. A change δσ of it changes Q by −2 q (1 − 2 s) δσ, so
    that the second derivative is 20 c² q²/3 over 4 q²/3 + 1; all other changes, at right angles, have 2 c².
    """
    T, c = 5.0, 1 / (2.0 * (1.0 + WHEEL))
    q = 6 * PLACE * (1.0 + WHEEL + INERTIA) / T**2
    free = FreeEndTime(1.0, 20.0, 4 * c**2 * q**2 / 3)
    problem = rolling(None, effort=design.JointEffort())
    rough = solve_from_guess(problem, MESH, 3, 1e-6, optimal_control.Rolling.at_rest, BARRIER_OF_TIME, free)
    found = rough.sharpen()
    assert fix_end(found).path.mesh[-1] == pytest.approx(T, rel=1e-6)
    assert found.least_curvature() == pytest.approx(20 * c**2 * q**2 / (4 * q**2 + 3), rel=1e-5)
    assert fix_end(found).least_curvature() == pytest.approx(2 * c**2, rel=1e-5)


def test_a_file_says_what_python_says():
    found = read_control(tomllib.loads(FILE))
    assert (found.free_end_time, found.barrier) == (FreeEndTime(1.0, 20.0, 1.0), BARRIER_OF_TIME)
    assert eqx.tree_equal(*(jax.tree.map(np.asarray, one) for one in (found.problem, rolling())))
    weighed = tomllib.loads(FILE + "time_weight = 3\nbarrier = 0.1")
    weighed["objectives"] = [{"kind": "joint-effort"}]
    found = read_control(weighed)
    assert (found.free_end_time, found.barrier) == (FreeEndTime(1.0, 20.0, 3.0), 0.1)
    assert list(found.problem.objectives) == ["joint-effort"]
    del weighed["control"]["free_end_time"], weighed["control"]["time_weight"], weighed["control"]["barrier"]
    fixed = read_control(weighed)
    assert (fixed.free_end_time, fixed.barrier) == (None, BARRIER)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"free_end_time": [6.0, 20.0]}, "control.free_end_time"),
        ({"free_end_time": [1.0]}, "control.free_end_time"),
        ({"time_weight": -1.0}, "control.time_weight"),
        ({"first_weights": {"joint-effort": 1.0}}, "control.first_weights"),
        ({"free_end_time": None, "time_weight": 1.0}, "control.time_weight"),
        ({"free_end_time": None}, "objectives"),
    ],
)
def test_a_file_with_an_end_time_that_does_not_fit_is_refused(changes, named):
    document = tomllib.loads(FILE)
    document["control"] |= changes
    document["control"] = {name: value for name, value in document["control"].items() if value is not None}
    with refuses(jaxball.ScenarioError, named):
        read_control(tomllib.loads(tomli_w.dumps(document)))


@pytest.mark.slow
def test_the_command_finds_the_least_time(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))
    (tmp_path / "problem.toml").write_text(FILE)
    assert cli.main(["design", str(tmp_path / "problem.toml"), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr()
    assert f"end time: {LEAST_TIME:.6g}\n" in told.out
    assert f"end {LEAST_TIME:.5g}" in told.err
    report = (tmp_path / "out" / "report.md").read_text()
    assert f"The end is at the time {LEAST_TIME:.6f}" in report
    assert "found between 1 and 20." in report
    run = jaxball.load_scenario(tmp_path / "out" / "design.toml").simulate()
    assert float(run.times[-1]) == pytest.approx(LEAST_TIME, rel=1e-6)
    np.testing.assert_allclose([run.state.z[-1], run.state.phidot[-1]], [PLACE, 0.0], atol=1e-5)
