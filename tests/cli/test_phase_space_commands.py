"""``jaxball stability``, and ``jaxball chaos`` for exponents, charts and Poincaré maps."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
import xarray

from jaxball.cli import main
from tests.scenario.documents import DISK
from tests.support.commands import refuses_command
from tests.support.sentences import said

BODY = """
format = 1
kind = "free-rigid-body"
body = { inertia = [1.0, 2.0, 2.5] }
initial = { Omega = [0.0, 1.5, 0.0] }
time = { start = 0.0, end = 20.0, saves = 2 }
solve = { rtol = 1e-8, atol = 1e-8 }
"""
TOP = """
format = 1
kind = "ball"
body = { mass = 1.0, radius = 1.0, gravity = 1.0, inertia = [0.4, 0.4, 0.5], offset = [0.0, 0.0, 0.2] }
time = { start = 0.0, end = 20.0, saves = 2 }
"""
CHART = ["chaos", "body.toml", "--chart"]


@pytest.fixture(autouse=True)
def folder(command_folder):
    (command_folder / "body.toml").write_text(BODY)
    (command_folder / "top.toml").write_text(TOP)
    return command_folder


@pytest.mark.slow
def test_the_table_of_a_disk_and_its_figure(folder, capsys):
    (folder / "disk.toml").write_text(DISK)
    assert main(["chaos", "disk.toml", "--end", "8", "--transient", "2", "--plot", "means.png"]) == 0
    text = capsys.readouterr().out
    values = [float(value) for value in re.findall(r"λ\d = +(\S+) ±", text)]
    assert len(values) == 3
    assert np.all(np.isfinite(values))
    assert "The solve reached t = 8." in text
    assert "least normal force" in text
    assert (folder / "means.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.thorough
def test_a_chart_of_a_body_that_spins_about_its_middle_axis(folder, capsys):
    """λ1 = Ω √( (d2 − d1)(d3 − d2) / (d1 d3) ); no body has one moment that is larger than the sum of the others."""
    ranges = ["body.inertia[2]=2.5:3.5:2", "initial.Omega[1]=1:1.5:3"]
    arguments = ["--end", "30", "--transient", "25", "--interval", "1", "--out", "chart.nc", "--plot", "chart.png"]
    assert main(["chaos", "body.toml", "--chart", *ranges, *arguments]) == 0
    captured = capsys.readouterr()
    assert "1 IMPOSSIBLE" not in captured.out
    assert "3 IMPOSSIBLE" in captured.out
    said(captured.err)
    with xarray.open_dataset(folder / "chart.nc") as data:
        np.testing.assert_array_equal(data["initial.Omega[1]"], [1.0, 1.25, 1.5])
        rates = np.array([1.0, 1.25, 1.5]) * np.sqrt((2.0 - 1.0) * (2.5 - 2.0) / (1.0 * 2.5))
        np.testing.assert_allclose(data["exponent"][0], rates, atol=1e-5)
        assert np.isnan(data["exponent"][1]).all()
    assert (folder / "chart.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.thorough
def test_a_poincare_map_lies_on_the_section_and_keeps_the_integrals(folder, capsys):
    """Of a free body: energy and momentum are the same at all crossings."""
    changes = ["--set", "initial.Omega=[1, 1, 1]"]
    section = ["--end", "40", "--poincare", "Omega[1]=0.1", "--direction", "both"]
    assert main(["chaos", "body.toml", *changes, *section, "--out", "points.csv", "--plot", "points.svg"]) == 0
    assert "crossings of Omega[1] = 0.1" in capsys.readouterr().out
    data = np.genfromtxt(folder / "points.csv", delimiter=",", names=True, deletechars="")
    Omega = np.stack([data[f"Omega[{k}]"] for k in range(3)], axis=1)
    assert len(Omega) > 3
    np.testing.assert_allclose(Omega[:, 1], 0.1, atol=1e-6)
    d, start = np.array([1.0, 2.0, 2.5]), np.ones(3)
    np.testing.assert_allclose(Omega**2 @ d, start**2 @ d, rtol=1e-6)
    np.testing.assert_allclose(Omega**2 @ d**2, start**2 @ d**2, rtol=1e-6)
    assert b"<svg" in (folder / "points.svg").read_bytes()


@pytest.mark.thorough
def test_exponents_as_json_and_their_means_as_a_table(folder, capsys):
    assert main(["chaos", "body.toml", "--json", "-", "--quiet", "--out", "means.csv"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["told_from_zero"] == [True, False, False, False, False, True]
    with (folder / "means.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[-1]["exponent[0]"]) == content["exponents"][0]
    assert len(rows) == 20


@pytest.mark.thorough
def test_permanent_rotations_of_a_top(folder, capsys):
    """At the bottom and on top; there only above |Ω₃| = 2 √( [d₁ + M (r + ℓ)²] M g ℓ ) / ( d₃ + M r (r + ℓ) )."""
    threshold = 2 * np.sqrt((0.4 + 1.2**2) * 0.2) / (0.5 + 1.2)
    assert main(["stability", "top.toml", "--out", "rest.csv", "--plot", "rest.pdf"]) == 0
    assert "The motion is unstable, a saddle" in capsys.readouterr().out
    with (folder / "rest.csv").open(newline="") as file:
        stable = {round(float(row["Gamma[2]"])): row["stable"] for row in csv.DictReader(file)}
    assert stable == {-1: "True", 1: "False"}
    for share, stable in ((0.99, False), (1.01, True)):
        spin = f"initial.Omega=[0, 0, {share * threshold}]"
        assert main(["stability", "top.toml", "--initial", "--set", spin, "--json", "-", "--quiet"]) == 0
        (motion,) = json.loads(capsys.readouterr().out)["motions"]
        assert (motion["ok"], motion["stable"]) == (True, stable)
    assert main(["stability", "top.toml", "--rolling", "0.5", "0.8"]) == 0
    assert "Gamma = (0.479426, 0, 0.877583)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["stability", "body.toml"], "Steady motions"),
        (["stability", "top.toml", "--turning", "1"], "--turning"),
        (["stability", "disk"], "Steady motions"),
        (["stability", "top.toml", "--rolling", "0.5", "0"], "PRECESSION"),
        (["stability", "top.toml", "--out", "rest.nc"], "--out"),
        (["chaos", "body.toml", "--direction", "both"], "--direction"),
        (["chaos", "body.toml", "--poincare", "Omega[0]"], "--poincare"),
        (["chaos", "body.toml", "--poincare", "Omega[3]=0"], "Omega[3]"),
        (["chaos", "body.toml", "--poincare", "Omega[0]=0", "--exponents", "2"], "--exponents"),
        ([*CHART, "a=1:2", "b=1:2:3"], "--chart"),
        ([*CHART, "body.inertia[0]=1:2:2", "body.inertia[0]=1:2:3"], "body.inertia[0]"),
        ([*CHART, "body.inerta[0]=1:2:2", "body.inertia[0]=1:2:3"], "body.inertia[0]"),
        (["chaos", "body.toml", "--plot", "means.txt"], "--plot"),
        (["chaos", "ball", "--transient", "50"], "--transient"),
        (["chaos", "ball", "--exponents", "6"], "--exponents"),
    ],
)
def test_bad_arguments(folder, capsys, arguments, named):
    refuses_command(capsys, arguments, named)


def test_where_masses_move_another_time_is_to_be_chosen(capsys):
    """The masses of the paper's ball rest until they are pushed at t = 0."""
    assert main(["stability", "ball"]) == 0
    assert "There is none at a time at which masses move in the ball: --time chooses another" in capsys.readouterr().out
    assert main(["stability", "ball", "--time", "-1"]) == 0
    assert "The motion is" in capsys.readouterr().out


def test_a_state_that_is_not_steady_is_one_for_another_command(capsys):
    """In the summary and in JSON, where Python names a function."""
    assert main(["stability", "rolling-robot", "--initial", "--json", "found.json"]) == 0
    summary = capsys.readouterr().out
    message = json.loads(Path("found.json").read_text())["motions"][0]["message"]
    for text in (summary, message):
        assert "is not steady" in text
        assert "use `jaxball periodic` for motions that repeat" in text
        assert "periodic_motion" not in text
