"""``jaxball periodic``, against quadrature, Hill's equation and the balance of a motor and the resistance."""

import csv
import json

import numpy as np
import pytest
import xarray
from scipy.integrate import quad, solve_ivp

from jaxball.cli import main
from tests.support.commands import refuses_command
from tests.support.sentences import said

LOW, MOMENT = 0.2, 0.36
DISK = f"""
format = 1
title = "A disk that is heavier below"
kind = "disk"
body = {{ mass = 1.0, radius = 1.0, gravity = 1.0, inertia = {MOMENT}, offset = [0.0, 0.0, -{LOW}] }}
initial = {{ phidot = 1.2 }}
time = {{ start = 0.0, end = 20.0, saves = 2 }}
"""
SHAKEN = (
    DISK.replace("phidot = 1.2", "phi = 0.01")
    + """
[ground.motion.free]
constant = [0.0, 0.0, 0.0]
amplitude = [[0.0, 0.0, 0.3]]
frequency = [0.9]
"""
)
STALL, FREE_SPEED, ROLLING, COMMAND = 3.0, 4.0, 1.0, -1.0
ROBOT = f"""
format = 1
kind = "ball"
body = {{ mass = 1.0, radius = 1.0, gravity = 10.0, inertia = [0.6, 0.6, 0.6] }}
resistance = {{ rolling = {ROLLING} }}
time = {{ start = 0.0, end = 20.0, saves = 2 }}
[[mechanisms]]
[[mechanisms.joints]]
kind = "hinge"
axis = [0.0, 1.0, 0.0]
force = {{ kind = "speed-limited-motor", command = {COMMAND}, stall = {STALL}, free_speed = {FREE_SPEED} }}
[[mechanisms.masses]]
mass = 0.8
place = [0.0, 0.0, -0.5]
"""
FREQUENCY = "ground.motion.free.frequency[0]"
AMPLITUDE = "ground.motion.free.amplitude[0][2]"


@pytest.fixture(autouse=True)
def folder(command_folder):
    for name, text in (("disk", DISK), ("shaken", SHAKEN), ("robot", ROBOT)):
        (command_folder / f"{name}.toml").write_text(text)
    return command_folder


def time_of_a_turn(phi, phidot):
    """∫ dφ / φ˙ at the energy ½ J(φ) φ˙² − m g c cos φ of a state."""

    def inertia(phi):
        return MOMENT + 1 + LOW**2 - 2 * LOW * np.cos(phi)

    energy = 0.5 * inertia(phi) * phidot**2 - LOW * np.cos(phi)
    return quad(lambda phi: np.sqrt(inertia(phi) / (2 * (energy + LOW * np.cos(phi)))), 0, 2 * np.pi)[0]


@pytest.mark.long
def test_a_disk_that_rolls_round_comes_back_after_the_time_of_a_quadrature(folder, capsys):
    assert main(["periodic", "disk.toml", "--period", "5.5", "--out", "motion.csv", "--plot", "motion.pdf"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("A disk that is heavier below\nphi = ")
    assert "  The motion is spectrally stable, a centre: its multipliers are all of size 1." in text
    assert "(turns: phi 1), closed to " in text
    assert "written: motion.csv, motion.pdf" in text
    with (folder / "motion.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["turns[0]"], row["stable"], row["ok"]) == ("1", "True", "True")
    # Of the family of all energies any member may be found.
    wanted = time_of_a_turn(float(row["phi"]), float(row["phidot"]))
    assert float(row["period"]) == pytest.approx(wanted, rel=1e-8)
    assert float(row["multiplier[0].real"]) == pytest.approx(1, abs=1e-7)
    assert (folder / "motion.pdf").read_bytes().startswith(b"%PDF")


def multipliers_of_hill(amplitude, frequency):
    """Of φ¨ + ω₀² (1 − A ν² sin νt) φ = 0 over a period, by SciPy."""
    squared = LOW / (MOMENT + (1 - LOW) ** 2)

    def rate(t, y):
        return [y[1], -squared * (1 - amplitude * frequency**2 * np.sin(frequency * t)) * y[0]]

    span = (0, 2 * np.pi / frequency)
    columns = [solve_ivp(rate, span, y, rtol=1e-12, atol=1e-13, method="DOP853").y[:, -1] for y in np.eye(2)]
    values = np.linalg.eigvals(np.array(columns).T)
    return values[np.argsort(-np.abs(values))]


@pytest.mark.thorough
@pytest.mark.parametrize("period", [["--frequency", "0.9"], ["--frequency", FREQUENCY]])
def test_a_shaken_disk_grows_as_hills_equation_says(capsys, period):
    assert main(["periodic", "shaken.toml", *period, "--json", "-", "--quiet"]) == 0
    (motion,) = json.loads(capsys.readouterr().out)["motions"]
    wanted = multipliers_of_hill(0.3, 0.9)
    found = [one["real"] + 1j * one["imaginary"] for one in motion["multipliers"]]
    np.testing.assert_allclose(found, wanted, atol=1e-8)
    assert motion["period"] == 2 * np.pi / 0.9
    assert motion["growth"] == pytest.approx(np.log(abs(wanted[0])) / motion["period"], abs=1e-9)
    assert (motion["kind"], motion["stable"]) == ("saddle", False)
    assert motion["message"].endswith("changing sign each period.")


@pytest.mark.long
def test_a_chart_has_each_cells_own_period(folder, capsys):
    axes = [f"{FREQUENCY}=0.8:1.0:3", f"{AMPLITUDE}=0.1:0.3:2"]
    files = ["--out", "chart.nc", "--plot", "chart.png"]
    assert main(["periodic", "shaken.toml", "--frequency", FREQUENCY, "--chart", *axes, *files]) == 0
    captured = capsys.readouterr()
    assert "The growth rate of deviations from periodic motions at 6 pairs of" in captured.out
    said(captured.err)
    with xarray.open_dataset(folder / "chart.nc") as data:
        assert data["growth"].dims == (FREQUENCY, AMPLITUDE)
        for frequency in data[FREQUENCY].values:
            for amplitude in data[AMPLITUDE].values:
                wanted = multipliers_of_hill(amplitude, frequency)[0]
                cell = data.sel({FREQUENCY: frequency, AMPLITUDE: amplitude})
                assert float(cell["period"]) == pytest.approx(2 * np.pi / frequency, rel=1e-14)
                assert float(cell["multiplier"]) == pytest.approx(abs(wanted), abs=1e-8)
    assert (folder / "chart.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
def test_a_chart_tells_bodies_that_cannot_be(capsys):
    axes = ["body.mass=-1:1:2", f"{AMPLITUDE}=0.1:0.3:2"]
    assert main(["periodic", "shaken.toml", "--frequency", "0.9", "--chart", *axes, "--json", "-", "--quiet"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert [value is None for value in content["growth"][0]] == [True, True]
    assert content["closed"] == [[False, False], [True, True]]
    assert content["status"][0] == [3, 3]


@pytest.mark.slow
def test_a_robot_that_has_settled_comes_back_once_in_a_turn(capsys):
    """Where the motor's torque, stall (|command| − v / free speed), is the resistance's, rolling v."""
    speed = STALL * abs(COMMAND) / (ROLLING + STALL / FREE_SPEED)
    assert main(["periodic", "robot.toml", "--after", "15", "--period", "3.5", "--json", "-"]) == 0
    captured = capsys.readouterr()
    (motion,) = json.loads(captured.out)["motions"]
    assert motion["period"] == pytest.approx(2 * np.pi / speed, rel=1e-9)
    assert (motion["turns"], motion["kind"]) == ([-1], "sink")
    said(captured.err)


@pytest.mark.thorough
def test_what_is_not_found_fails_and_says_so(folder, capsys):
    arguments = ["--period", "5.5", "--turns", "2", "--iterations", "2", "--out", "motion.csv", "--json", "motion.json"]
    assert main(["periodic", "disk.toml", *arguments]) == 3
    captured = capsys.readouterr()
    assert captured.out == ""
    said(captured.err)
    (motion,) = json.loads((folder / "motion.json").read_text())["motions"]
    assert (motion["ok"], motion["kind"], motion["multipliers"][0]["real"]) == (False, "unknown", None)
    assert not (folder / "motion.csv").exists()
    assert main(["periodic", "disk.toml", "--set", "solve.max_steps=3", "--after", "5", "--period", "5.5"]) == 3
    said(capsys.readouterr().err, "max_steps")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["shaken.toml", "--period", "5"], "--period"),
        (["disk.toml", "--period", "5", "--turns", "1", "2"], "--turns"),
        (["disk.toml", "--period", "5", "--after", "0"], "--after"),
        (["disk.toml", "--frequency", "body.mas"], "body.mas"),
        (["disk.toml", "--period", "5", "--out", "motion.nc"], "--out"),
        (["disk.toml", "--period", "5", "--chart", "a=1:2:2", "a=1:2:2"], "a"),
        (["disk.toml", "--period", "5", "--after", "3", "--chart", "a=1:2:2", "b=1:2:2"], "--after"),
    ],
)
def test_bad_arguments(folder, capsys, arguments, named):
    refuses_command(capsys, ["periodic", *arguments], named)


@pytest.mark.parametrize(
    ("scenario", "named"),
    [
        ("robot.toml", "mechanisms[0].joints[0]"),
        ("shaken.toml", "Steady motions"),
        ("vibrating-plane", "ground"),
        ("heavy-top", "Steady motions"),
    ],
)
def test_the_command_for_steady_motions_points_to_this_one(capsys, scenario, named):
    assert main(["stability", scenario]) == 2
    error = capsys.readouterr().err
    said(error, named)
    assert "--ball" not in error


def test_a_body_that_is_not_of_revolution_is_called_as_the_scenario_has_it(capsys):
    refuses_command(capsys, ["stability", "chaplygin-top", "--rolling", "0.5", "1"], "The scenario's ball")
