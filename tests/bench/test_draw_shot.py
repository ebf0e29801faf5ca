"""The draw shot in several programs: its closed form, rows of programs that are not here, and what the page shows."""

import dataclasses
import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from comparison.engines import DRAKE

from jaxball import load_scenario

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "theory" / "engines.md"
SAVED = ROOT / "benchmarks" / "draw_shot.json"
FRICTION, GRAVITY, RADIUS, SPEED, RATE = 0.2, 9.81, 0.028575, 0.2, -120.0  # of the scenario


@pytest.fixture
def script(benchmarks):
    return importlib.import_module("draw_shot")


@pytest.fixture
def shot():
    return dataclasses.replace(load_scenario("draw-shot"), times=np.array([0.0, 1.0]))


def test_the_closed_form_is_newtons_law_with_friction_until_the_slip_is_zero(script, shot):
    """By its differences: -μ g while the slip u - 7/2 μ g t is not zero, and then rolling with what is left of it."""
    slip = SPEED - RADIUS * RATE
    ends = slip / (3.5 * FRICTION * GRAVITY)
    left = SPEED - FRICTION * GRAVITY * ends
    np.testing.assert_allclose(left, RADIUS * (RATE + 2.5 * FRICTION * GRAVITY * ends / RADIUS), rtol=1e-12)
    h = 1e-3
    before = [script.closed_form(shot, ends - step * h) for step in (3, 2, 1)]
    assert np.diff(before, 2)[0] / h**2 == pytest.approx(-FRICTION * GRAVITY, rel=1e-8)
    after = [script.closed_form(shot, ends + step * h) for step in (0, 1, 2)]
    np.testing.assert_allclose(np.diff(after) / h, left, rtol=1e-10)
    assert script.closed_form(shot, 0.0) == 0.0


@pytest.mark.thorough
def test_programs_that_are_not_installed_have_a_row_that_says_what_installs_them(script, monkeypatch):
    for package in ("pydrake", "gradsolve", "mujoco"):
        monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setattr(script, "TOLERANCES", (1e-7,))
    *ours, drake, gradsolve, mujoco = script.measure(2)
    assert [row["setting"] for row in ours] == ["one shot", "2 shots"]
    assert all(row["error"] < 1e-9 for row in ours)
    assert drake == {"program": "Drake", "failure": "pydrake is not installed; pip install 'jaxball[engines]'"}
    assert gradsolve["failure"] == "gradsolve is not installed; pip install 'gradsolve[warp]'"
    assert mujoco["failure"] == "mujoco is not installed; pip install 'jaxball[engines]'"
    assert "| Drake | – | pydrake is not installed" in script.table([drake])


def test_a_solve_that_fails_costs_only_its_own_row(script, monkeypatch):
    def fail():
        raise RuntimeError("It cannot.\nAt all.")

    def solves(scenario, rows):
        yield "fails", 1e-3, fail
        yield "is lost", 1e-3, lambda: (np.nan, 1, 1.0)
        yield "is exact", 1e-3, lambda: (script.closed_form(scenario, 1.0), 7, 0.5)

    monkeypatch.setattr(script, "CONTENDERS", (("jaxball", (), solves),))
    fails, lost, exact = script.measure(1)
    assert fails["failure"] == "It cannot."
    assert lost["failure"] == "The place at the end is nan."
    assert exact["error"] == 0.0
    assert exact["steps"] == 7
    assert len(script.diagram([fails, lost, exact]).axes[0].lines) == 1


@pytest.mark.thorough
def test_cenic_converges_to_the_closed_form(script, shot):
    """Of first order in its steps, of which a hundredth of the accuracy needs some ten times as many."""
    pytest.importorskip("pydrake", reason="Drake, of the extra `engines`, is not installed")
    setting = next(setting for setting in DRAKE.settings if setting.name == "CENIC")
    exact = script.closed_form(shot, 1.0)
    (coarse, few, _), (fine, many, _) = (script._in_engine("drake_", shot, setting, each) for each in (1e-1, 1e-6))
    assert many > 30 * few
    assert abs(fine - exact) < min(abs(coarse - exact) / 5, 5e-3 * RADIUS)


@pytest.mark.thorough
def test_smoothed_friction_errs_by_the_speed_over_which_it_is_smoothed(script, shot, benchmarks):
    pytest.importorskip("gradsolve", reason="GRADSOLVE is not installed")
    pytest.importorskip("warp", reason="Warp, which GRADSOLVE makes its kernels by, is not installed")
    from peers.gradsolve_shot import shots

    exact = script.closed_form(shot, 1.0)
    coarse, fine = (abs(shots(shot, 2, speed, 1e-7)[0] - exact) / RADIUS for speed in (1e-2, 1e-4))
    assert coarse > 1e-4
    assert fine < 1e-6


def test_the_page_has_the_table_of_the_saved_run(script):
    saved = json.loads(SAVED.read_text())
    page = PAGE.read_text()
    assert script.table(saved["rows"]) in page
    assert saved["date"][:10] in page
    for package in ("drake", "gradsolve", "mujoco"):
        assert saved["versions"][package] in page
