"""Runs that were saved once are read, and their numbers are those of closed forms: the format has not changed."""

from pathlib import Path

import numpy as np
import pytest

from jaxball import load_run
from jaxball.files.scenario import Units
from jaxball.physics import Mode

STORED = sorted((Path(__file__).parent / "stored").glob("draw-shot-*.*"))
RADIUS, MASS, FRICTION, GRAVITY = 0.028575, 0.17, 0.2, 9.81
SPEED, RATE = 0.2, -120.0  # at the start
SLIP = SPEED - RADIUS * RATE
ROLLS = 2 * SLIP / (7 * FRICTION * GRAVITY)  # from then on (Coriolis, 1835)


@pytest.fixture(params=STORED, ids=lambda path: path.name)
def run(request):
    return load_run(request.param)


def test_there_are_runs_of_both_formats():
    assert {path.suffix for path in STORED} == {".nc", ".npz"}


def test_states_are_those_of_a_draw_shot(run):
    """It slides with -μ g, and then rolls with v - 2/7 u."""
    t = np.asarray(run.times)
    np.testing.assert_array_equal(t, np.linspace(0.0, 1.0, 6))
    slides = np.minimum(t, ROLLS)
    velocity = SPEED - FRICTION * GRAVITY * slides
    place = SPEED * slides - FRICTION * GRAVITY * slides**2 / 2 + (SPEED - 2 / 7 * SLIP) * (t - slides)
    np.testing.assert_allclose(run.state.z[:, 0], place, atol=1e-9)
    np.testing.assert_allclose(run.contact.V[:, 0], velocity, atol=1e-9)
    about = RATE + 2.5 * FRICTION * GRAVITY * slides / RADIUS
    speed = np.linalg.norm(np.asarray(run.state.Omega), axis=1)
    np.testing.assert_allclose(speed, np.abs(about), rtol=1e-9)
    modes = np.where(t < ROLLS, int(Mode.SLIDING), int(Mode.ROLLING))
    np.testing.assert_array_equal(run.contact.mode, modes)


def test_its_switch_and_its_observables_are_those_of_the_closed_form(run):
    """Observables are computed anew: the weight, and the energy, of which friction takes m u²/7."""
    switches = run.contact.switches
    assert int(switches.count) == 1
    np.testing.assert_allclose(switches.times[0], ROLLS, rtol=1e-9)
    np.testing.assert_allclose(run.observables.normal_force, MASS * GRAVITY, rtol=1e-12)
    energy = np.asarray(run.observables.energy)
    np.testing.assert_allclose(energy[0] - energy[-1], MASS * SLIP**2 / 7, rtol=1e-9)


def test_its_scenario_is_solved_again(run):
    assert run.scenario.title == "A draw shot: the cue ball stops, and rolls back"
    assert run.scenario.units == Units("m", "kg", "s")
    again = run.scenario.simulate()
    np.testing.assert_allclose(again.state.z, run.state.z, atol=1e-9)
    assert run.ok
