"""What is mistyped on the command line, told by the command that it was given to; and what the machine cannot do."""

import argparse
import os
import subprocess
import sys

import pytest

from jaxball.cli import main
from jaxball.cli.commands import simulate

pytestmark = pytest.mark.usefixtures("command_line")


@pytest.mark.parametrize(
    ("typed", "usage", "told"),
    [
        ("simulate ball --st mass=2", "simulate [-h]", "there is no --st here; did you mean --set?"),
        ("simulate ball --rtoll=1e-3", "simulate [-h]", "there is no --rtoll here; did you mean --rtol?"),
        ("verify ball --knob x", "verify [-h]", "there is no --knob here; jaxball verify --help shows what there is."),
        ("sweep plot x --oot y", "sweep STUDY", "there is no --oot here; did you mean --out?"),
        ("reproduce all", "reproduce [-h]", "there is no all here; jaxball reproduce --help shows what there is."),
    ],
)
def test_an_option_that_a_command_does_not_have(capsys, typed, usage, told):
    with pytest.raises(SystemExit) as caught:
        main(typed.split())
    assert caught.value.code == 2
    *_, last = lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith(f"usage: jaxball {usage}")
    assert last == f"jaxball {typed.split()[0]}: error: {told}"


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
    assert "Key `time` asks for 5,000,001 times, which need about 13 GB of memory, but 3 GB are free" in told


def test_many_times_are_said_to_take_long(capsys, monkeypatch):
    monkeypatch.setattr(simulate, "free_memory", lambda: 3e9)
    options = argparse.Namespace(out=None, plot=None, view=None, quiet=False)
    simulate.check_memory(options, 1_000_000)
    assert capsys.readouterr().err == ""
    simulate.check_memory(options, 2_500_000)
    assert capsys.readouterr().err == "jaxball: 2,500,000 times take minutes and about 2 GB of memory.\n"


def test_the_free_memory_is_less_than_what_the_machine_has():
    free = simulate.free_memory()
    assert free > 0
    if sys.platform == "linux":
        assert free <= os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
