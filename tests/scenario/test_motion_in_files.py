"""What the keys of a scenario file do to a run."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from jaxball import SolveError, Status, load_scenario, read_scenario, write_scenario
from tests.support.sentences import refuses, said

from .documents import BALL, DISK, with_rail, with_schedule
from .test_round_trip import same_objects

DOCUMENTATION = Path(__file__).parents[2] / "docs" / "reference" / "scenario-files.md"
BLOCKS = re.findall(r"^```toml\n(.*?)^```", DOCUMENTATION.read_text(), flags=re.DOTALL | re.MULTILINE)
DOCUMENTED = [text for text in BLOCKS if "format = 1" in text]  # whole files; the others are tables of one


@pytest.mark.parametrize("text", DOCUMENTED)
def test_documented_files_are_read_and_written(text):
    scenario = read_scenario(text)
    assert same_objects(scenario, read_scenario(write_scenario(scenario)))


@pytest.mark.long
@pytest.mark.parametrize("text", DOCUMENTED)
def test_documented_files_run(text):
    assert read_scenario(text).simulate().ok


@pytest.mark.thorough
def test_balance_finds_the_papers_angles():
    """θ_a before the paper rounded it, as the root in 18 digits."""
    (text,) = (text for text in DOCUMENTED if "balance" in text)
    ball = read_scenario(text).system
    found = [float(item.motion.schedule.theta) for item in ball.point_masses]
    np.testing.assert_allclose(found, [0.0, 2.03688467177819188, 0.704424483412206587], rtol=0, atol=1e-10)


@pytest.mark.thorough
def test_integrated_angles_give_the_same_run():
    prescribed = read_scenario(DISK).simulate()
    integrated = read_scenario(DISK + '[actuation]\nform = "integrated"\n').simulate()
    np.testing.assert_allclose(integrated.state.theta[:, 0], 0.7 + 0.2 * np.asarray(prescribed.times), atol=1e-9)
    np.testing.assert_allclose(integrated.state.phi, prescribed.state.phi, rtol=0, atol=1e-8)


@pytest.mark.thorough
def test_servo_closes_the_gap():
    """With stiffness 4 and damping 4 a gap of 1 decays as (1 + 2t) exp(−2t)."""
    servo = '[actuation]\nform = "servo"\nstiffness = [4.0]\ndamping = [4.0]\n[initial]\ntheta = [1.7]\n'
    trajectory = read_scenario(DISK + servo).simulate()
    t = np.asarray(trajectory.times)
    target = 0.7 + 0.2 * t
    np.testing.assert_allclose(trajectory.state.theta[:, 0], target + (1 + 2 * t) * np.exp(-2 * t), atol=1e-8)


@pytest.mark.thorough
def test_a_law_that_carries_a_mass_out():
    """θ = 0.7 + 0.2 t passes the radius 1, to half of rounding, at t = 1.5; the first saved time after it is 12/7."""
    text = with_rail('{ kind = "tube", direction = [1, 0, 0] }', DISK) + '[actuation]\nform = "integrated"\n'
    text = text.replace("saves = 5", "saves = 8")
    scenario = read_scenario(text)
    trajectory = scenario.simulate()
    assert int(trajectory.status) == Status.LEFT_SHELL
    np.testing.assert_allclose(trajectory.reached, 1.5, rtol=0, atol=1e-7)
    said(trajectory.message)
    with refuses(SolveError):
        scenario.simulate(throw=True)


@pytest.mark.thorough
def test_settings_can_be_changed_for_one_run():
    scenario = read_scenario(DISK)
    assert int(scenario.simulate(max_steps=1).status) == Status.MAX_STEPS
    loose = scenario.simulate(rtol=1e-4, atol=1e-4)
    assert int(loose.steps) < int(scenario.simulate().steps)


def test_axis_and_angle_are_a_versor():
    text = BALL + "[initial]\naxis = [0.0, 0.0, 2.0]\nangle = 1.0471975511965976\n"
    np.testing.assert_allclose(read_scenario(text).state.q, [np.sqrt(3) / 2, 0, 0, 0.5], rtol=0, atol=1e-15)


def test_inside_for_the_whole_run_only():
    """The mass would leave the tube at t = 3, after the end."""
    text = with_rail('{ kind = "tube", direction = [1, 0, 0] }')
    text = with_schedule('{ kind = "constant-rate", theta = 0.4, rate = 0.2 }', text)
    assert read_scenario(text).times[-1] == 2.0


def test_file_by_its_path(tmp_path):
    scenario = load_scenario("pendulum")
    (tmp_path / "mine.toml").write_text(write_scenario(dataclasses.replace(scenario, title="Mine")), encoding="utf-8")
    assert load_scenario(tmp_path / "mine.toml").title == "Mine"
    assert load_scenario(str(tmp_path / "mine.toml")).title == "Mine"
