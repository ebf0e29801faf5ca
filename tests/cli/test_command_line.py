"""The command line, as a process of its own."""

import json
import subprocess
import sys

import jax
import numpy as np
import pytest
import xarray

from jaxball import Scenario, ScenarioError, __version__
from jaxball.cli import main
from jaxball.files.scenario import builtin_scenarios
from jaxball.files.scenario.sources import builtin_text
from tests.scenario.documents import DISK
from tests.support.commands import refuses_command
from tests.support.sentences import said

pytestmark = pytest.mark.usefixtures("command_line")

ESCAPING = DISK.replace('{ kind = "circle", radius = 0.9 }', '{ kind = "tube", direction = [1, 0, 0] }').replace(
    "end = 2.0", "end = 4.0"
)


def jaxball(*arguments, folder):
    program = "import sys; from jaxball.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "good.toml").write_text(DISK)
    (tmp_path / "bad.toml").write_text(DISK.replace("gravity", "gravty"))
    (tmp_path / "fails.toml").write_text(DISK + "[solve]\nmax_steps = 3\n")
    return tmp_path


@pytest.mark.long
def test_simulate(folder):
    done = jaxball("simulate", "good.toml", "--out", "run.nc", "--rtol", "1e-8", folder=folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert "The solve reached t = 2." in done.stdout
    assert "least normal force" in done.stdout
    assert "written: run.nc" in done.stdout
    with xarray.open_dataset(folder / "run.nc") as data:
        assert data["phi"].shape == (5,)
        assert data["phi"].dtype == np.float64
        assert "rtol = 1e-08" in data.attrs["scenario"]


def test_only_a_run_that_may_be_long_is_optimised(folder, monkeypatch):
    name, seen = "jax_disable_most_optimizations", []

    def simulate(*_, **__):
        seen.append(jax.config.values[name])
        raise ScenarioError("This is as far as it goes.")

    monkeypatch.setattr(Scenario, "simulate", simulate)
    before = jax.config.values[name]
    try:
        jax.config.update(name, False)
        for steps in (16384, 16385):
            (folder / "run.toml").write_text(f"{DISK}[solve]\nmax_steps = {steps}\n")
            assert main(["simulate", str(folder / "run.toml")]) == 2
        assert jax.config.values[name] is False
    finally:
        jax.config.update(name, before)
    assert seen == [True, False]


@pytest.mark.thorough
def test_bad_input_leaves_the_output_as_it_was(folder):
    (folder / "run.csv").write_text("precious")
    done = jaxball("simulate", "bad.toml", "--out", "run.csv", folder=folder)
    assert done.returncode == 2
    said(done.stderr, "body.gravty")
    assert done.stdout == ""
    assert (folder / "run.csv").read_text() == "precious"


@pytest.mark.long
def test_failed_solve_is_kept_and_marked(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(["simulate", "fails.toml", "--out", "run.npz"]) == 3
    captured = capsys.readouterr()
    assert captured.out == ""
    said(captured.err, "max_steps")
    with np.load(folder / "run.npz") as data:
        assert (int(data["ok"]), str(data["status"])) == (0, "MAX_STEPS")
        assert np.isfinite(data["phi"][0])
        assert np.isnan(data["phi"][-1])


def test_what_no_body_can_have_is_told_by_its_key(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    (folder / "heavy.toml").write_text(DISK.replace("mass = 1.0", "mass = 1e300"))
    assert main(["simulate", "heavy.toml"]) == 2
    told = capsys.readouterr().err
    said(told, "body.mass")


def test_list_of_scenarios(capsys):
    assert main(["scenarios"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(builtin_scenarios())


def test_print_a_scenario(capsys):
    assert main(["scenarios", "ball"]) == 0
    assert capsys.readouterr().out.partition("\n")[2] == builtin_text("ball")


def test_version(capsys):
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out.startswith("jaxball 0.")


def test_what_a_report_needs(capsys, monkeypatch):
    monkeypatch.setenv("JAXBALL_COMPILER", "xla")
    with pytest.raises(SystemExit) as caught:
        main(["--version", "--json"])
    assert caught.value.code == 0
    about = json.loads(capsys.readouterr().out)
    assert about["jaxball"] == __version__
    assert about["packages"]["jax"] == jax.__version__
    assert about["compiler"] == about["settings"]["JAXBALL_COMPILER"] == "xla"
    assert about["devices"] == [device.device_kind for device in jax.devices()]


def test_film_without_ffmpeg(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    monkeypatch.setattr("shutil.which", lambda name: None)
    assert main(["simulate", "ball", "--animate", "film.mp4"]) == 2
    said(capsys.readouterr().err, "--animate")


@pytest.mark.slow
def test_figures_and_film(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    (folder / "short.toml").write_text(DISK.replace("end = 2.0", "end = 0.2"))
    assert main(["simulate", "short.toml", "--plot", "figures", "--animate", "film.gif"]) == 0
    assert "film.gif" in capsys.readouterr().out
    assert (folder / "film.gif").read_bytes().startswith(b"GIF89a")
    assert (folder / "figures" / "disk_energies.png").stat().st_size > 0


@pytest.mark.long
def test_law_that_carries_a_mass_out(folder, monkeypatch, capsys):
    """A mass is inside up to θ = 0.7 + 0.2 t = 1 + √ε, at t = 1.5 + 5 √ε; the first saved time after it is 2."""
    monkeypatch.chdir(folder)
    (folder / "out.toml").write_text(ESCAPING + '[actuation]\nform = "integrated"\n')
    assert main(["simulate", "out.toml", "--out", "run.csv"]) == 3
    said(capsys.readouterr().err, "actuation")
    assert set(np.genfromtxt(folder / "run.csv", delimiter=",", names=True)["status"]) == {5}


@pytest.mark.slow
def test_a_run_ends_where_more_friction_is_needed_than_there_is(folder, monkeypatch, capsys):
    """The paper's disk needs 0.295097 at t = 19.397."""
    monkeypatch.chdir(folder)
    assert main(["simulate", "disk", "--friction", "0.29", "--detachment", "--out", "run.nc"]) == 3
    said(capsys.readouterr().err, "run.nc")
    with xarray.open_dataset(folder / "run.nc") as data:
        assert data.attrs["status"] == "SLIPPED"
        np.testing.assert_allclose(data.attrs["friction_needed"], 0.29, atol=1e-6)
        assert 18.0 < data.attrs["reached"] < 19.397
    assert main(["simulate", "disk", "--friction", "0.3"]) == 0
    assert "friction needed, max |f|/N, 0.295097" in capsys.readouterr().out


def test_friction_of_what_touches_no_plane(capsys):
    refuses_command(capsys, ["simulate", "heavy-top", "--friction", "0.3"], "--friction")
