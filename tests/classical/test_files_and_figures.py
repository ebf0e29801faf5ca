"""Runs of classical systems are saved with their laws, drawn, and summed up on the command line."""

import equinox as eqx
import jax
import numpy as np
import pytest
import xarray

import jaxball
from jaxball import plot
from jaxball.cli import main
from jaxball.physics import classical
from tests.support.sentences import refuses, said

TIMES = np.linspace(0.0, 2.0, 41)


@pytest.fixture(scope="module")
def body():
    start = classical.RigidBodyState(Omega=[0.3, 1.0, -0.4])
    return jaxball.simulate(classical.FreeRigidBody(inertia=(1.0, 1.6, 2.1)), TIMES, start)


@pytest.mark.thorough
def test_netcdf_holds_the_state_and_the_laws(body, tmp_path):
    with xarray.open_dataset(jaxball.save(body, tmp_path / "run.nc")) as data:
        assert dict(data.sizes) == {"time": 41, "component": 4, "axis": 3}
        np.testing.assert_array_equal(data["Omega"], body.state.Omega)
        np.testing.assert_array_equal(data["spatial_momentum"], body.laws.spatial_momentum)
        assert data["energy"].attrs["units"] == "energy"
        assert data.attrs["ok"] == 1


@pytest.mark.thorough
def test_the_place_of_what_rolls_has_directions(tmp_path):
    """Unlike the coordinate z of a particle."""
    egg = classical.RollingEllipsoid(semiaxes=(1.0, 1.0, 1.5), inertia=(0.65, 0.65, 0.4))
    run = jaxball.simulate(egg, TIMES[:2], classical.EllipsoidState(Omega=(0.1, 0.2, 0.3)))
    with xarray.open_dataset(jaxball.save(run, tmp_path / "run.nc")) as data:
        assert data["z"].dims == ("time", "direction")
        np.testing.assert_array_equal(data["z"], run.state.z)


@pytest.mark.thorough
def test_csv_has_a_column_for_each_number(body, tmp_path):
    header = jaxball.save(body, tmp_path / "run.csv").read_text().splitlines()[0]
    laws = "energy,spatial_momentum[0],spatial_momentum[1],spatial_momentum[2],momentum_squared,versor_squared"
    assert header == f"time,q[0],q[1],q[2],q[3],Omega[0],Omega[1],Omega[2],{laws},status"


@pytest.mark.thorough
def test_figures_draw_the_numbers(body, tmp_path):
    ax = body.plot().axes[0]
    drawn = np.stack([line.get_ydata() for line in ax.get_lines()[:3]], axis=1)
    np.testing.assert_array_equal(drawn, body.state.Omega)
    check_laws(plot.law_errors(body), body.laws)
    names = [path.name for path in body.save_figures(tmp_path / "figures")]
    assert names == ["free_rigid_body_classical_motion.png", "free_rigid_body_law_errors.png"]


def check_laws(figure, laws):
    """A panel for each law, whose lines are its changes in units of the power of ten that its title says."""
    assert len(figure.axes) == len(laws)
    for ax, (name, values) in zip(figure.axes, laws._asdict().items(), strict=True):
        title = ax.get_title(loc="left")
        assert title.startswith(name.replace("_", " "))
        power = int(title.partition("10^{")[2].rstrip("}$"))
        changes = (np.asarray(values) - np.asarray(values)[0]).reshape(len(values), -1)
        drawn = np.stack([line.get_ydata() for line in ax.get_lines()[1:]], axis=1)
        np.testing.assert_allclose(drawn * 10.0**power, changes, rtol=1e-12)
        assert 1 <= np.max(np.abs(drawn)) < 10


@pytest.mark.thorough
def test_a_rate_has_the_colour_of_its_coordinate():
    """Also where the coordinate is none of x, y and z, and in panels by units: x and y, θ, their rates, and λ."""
    state = classical.LagrangianState([0.0] * 3, [0.5, 0.0, 1.0])
    figure = jaxball.simulate(classical.ChaplyginSleigh(inertia=0.4, ahead=0.5), TIMES[:2], state).plot()
    panels = [[line for line in ax.get_lines() if not line.get_label().startswith("_")] for ax in figure.axes]
    assert [len(lines) for lines in panels] == [2, 1, 2, 1, 1]
    coordinates, rates = panels[0] + panels[1], panels[2] + panels[3]
    for coordinate, rate in zip(coordinates, rates, strict=True):
        assert coordinate.get_color() == rate.get_color()
    assert len({line.get_color() for line in coordinates}) == 3


@pytest.mark.thorough
def test_a_law_that_did_not_change_says_so(body):
    still = eqx.tree_at(lambda run: run.state, body, jax.tree.map(lambda leaf: 0 * leaf + leaf[:1], body.state))
    for ax in plot.law_errors(still).axes:
        assert ax.get_title(loc="left").endswith(": no change")


@pytest.mark.thorough
def test_a_ball_is_drawn_by_other_functions(body):
    ball = jaxball.Ball(mass=1.0, inertia=(1.0, 1.0, 1.0))
    rolling = eqx.tree_at(lambda run: (run.system, run.state), body, (ball, jaxball.BallState()))
    with refuses(ValueError, "trajectory"):
        plot.law_errors(rolling)


@pytest.mark.thorough
def test_the_command_line(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "")
    assert main(["simulate", "vakonomic-particle", "--out", str(tmp_path / "run.npz")]) == 0
    out = capsys.readouterr().out
    assert "Trajectory of a vakonomic particle\n  101 times from 0 to 1" in out
    assert "change of conserved quantities: energy " in out
    with np.load(tmp_path / "run.npz") as data:
        np.testing.assert_allclose(data["p_x"], 2.0, rtol=1e-8)
    assert main(["simulate", "heavy-top", "--animate", str(tmp_path / "top.gif")]) == 2
    said(capsys.readouterr().err, "--animate")
