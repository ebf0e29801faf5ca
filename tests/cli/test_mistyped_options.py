"""What the machine cannot do is told before anything is tried."""

import argparse
import os
import subprocess
import sys

import pytest

from jaxball.cli import main
from jaxball.cli.commands import simulate
from tests.support.sentences import said

pytestmark = pytest.mark.usefixtures("command_line")


@pytest.mark.thorough
def test_a_platform_that_is_not_there_is_a_sentence():
    program = "import sys; from jaxball.cli import main; sys.exit(main(['simulate', 'disk']))"
    wrong = {**os.environ, "JAX_PLATFORMS": "abacus"}
    done = subprocess.run([sys.executable, "-c", program], env=wrong, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (told,) = done.stderr.splitlines()
    assert told.startswith(
        'jaxball: Variable `JAX_PLATFORMS` must name a device that JAX can use here, but it is "abacus"'
    )
    assert told.endswith("leave it out, or set it to cpu.")


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "value", "must"),
    [
        ("JAX_PLATFORM_NAME", "abacus", "name a device that JAX can use here"),
        ("JAX_ENABLE_X64", "maybe", "have a value that JAX can read"),
        ("JAX_NUM_CPU_DEVICES", "many", "have a value that JAX can read"),
    ],
)
def test_other_variables_of_jax(name, value, must):
    wrong = {**os.environ, name: value}
    command = [sys.executable, "-m", "jaxball", "simulate", "disk"]
    done = subprocess.run(command, env=wrong, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (told,) = done.stderr.splitlines()
    assert told.startswith(f'jaxball: Variable `{name}` must {must}, but it is "{value}": ')


def test_more_times_than_there_is_memory_for_are_refused_before_anything_is_tried(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(simulate, "free_memory", lambda: 3e9)
    wanted = ["simulate", "disk", "--set", "time.step=4e-6", "--out", str(tmp_path / "run.nc")]
    assert main(wanted) == 2
    told = capsys.readouterr().err
    said(told, "time")


def test_many_times_are_said_to_take_long(capsys, monkeypatch):
    monkeypatch.setattr(simulate, "free_memory", lambda: 3e9)
    options = argparse.Namespace(out=None, plot=None, view=None, quiet=False)
    simulate.check_memory(options, 1_000_000)
    assert capsys.readouterr().err == ""
    simulate.check_memory(options, 2_500_000)
    said(capsys.readouterr().err)


def test_the_free_memory_is_less_than_what_the_machine_has():
    free = simulate.free_memory()
    assert free > 0
    if sys.platform == "linux":
        assert free <= os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["sweep", "status", "s.zarr", "--workers", "2"], "--workers"),
        (["sweep", "plot", "s.zarr", "--out", "figures", "--dry-run"], "--dry-run"),
        (["sweep", "study.toml", "--out", "s.zarr", "--result", "z"], "--result"),
        (["track", "disk", "--disturb", "phi=0.1,phi=0.2"], "--disturb"),
    ],
)
def test_options_that_would_do_nothing_are_refused_as_mistyped(capsys, arguments, named):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert named in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["simulate", "disk", "--svg-text"], "--svg-text"),
        (["simulate", "chaplygin-sleigh", "--view", "run.html"], "--view"),
        (["track", "disk", "--disturb", "phi=nan"], "phi"),
        (["track", "disk", "--sample", "0.03"], "--sample"),
        (["export", "ball", "--to", "mjcf", "--any-units", "--out", "ball.xml", "--extent", "3"], "extent"),
    ],
)
def test_options_that_would_do_nothing_are_refused(capsys, tmp_path, monkeypatch, arguments, named):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    said(capsys.readouterr().err, named)
    assert not any(tmp_path.iterdir())
