"""What needs no numbers is answered without JAX: help, lists, and refusals, each with its sentence."""

import json
import subprocess
import sys

import pytest

from jaxball.cli.dispatch import COMMANDS
from jaxball.scenario import builtin_scenarios, builtin_text

HEAVY = ["jax", "numpy", "equinox", "diffrax", "matplotlib", "xarray", "pandas", "scipy", "tomli_w"]
# All in one process, because what one command line has imported is there for the next.
PROGRAM = """
import contextlib, io, json, sys
from jaxball.cli import main

commands, heavy = json.loads(sys.argv[1])
answers = []
for arguments in commands:
    out, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        try:
            code = main(arguments)
        except SystemExit as end:
            code = end.code
    answers.append([code, out.getvalue(), errors.getvalue(), [name for name in heavy if name in sys.modules]])
print(json.dumps(answers))
"""
REFUSED = {
    "simulte ball": 'there is no "simulte"; did you mean "simulate"?',
    "reproduce --to x": "there is no --to here; did you mean --out?",
    "reproduce --solvers ode45": "there is no ode45 here",
    "simulate ball --solver dopri9": 'argument --solver: there is no "dopri9"; did you mean "dopri8"?',
    "simulate ball --rtol -1": "argument --rtol: it must be a positive number, but it is -1",
    "scenarios bal": 'NAME must be the name of a built-in scenario, but it is "bal"; did you mean "ball"?',
    "simulate bal": 'but it is "bal" (No such file or directory); did you mean "ball"?',
    "simulate none.toml": "(No such file or directory); `jaxball scenarios` lists them.",
    "simulate text.toml": "text.toml: A scenario must be a TOML document, but it is not: ",
    "simulate ball --set body.mass": "A change must be PATH=VALUE, such as body.mass=2 or masses[0].mass=0.3, but",
    "simulate ball --set masses[7].mass=1": "`masses` has 3 entries, counted from 0.",
    "simulate ball --out run.pdf": 'Argument `--out` must end in one of .nc, .npz, .csv, .mcap, but it is "run.pdf".',
    "simulate ball --out none/run.nc": 'a folder that exists, but "none" does not; make it first.',
    "simulate ball --json run.txt": 'Argument `--json` must end in .json, but it is "run.txt".',
    "simulate ball --plot text.toml": 'Argument `--plot` must be a folder, but "text.toml" is a file.',
    "simulate ball --animate film.avi": 'Argument `--animate` must end in one of .mp4, .gif, but it is "film.avi".',
    "simulate ball --fps 20": "Argument `--fps` is for an animation; give --animate FILE with it.",
    "chaos none.toml": "(No such file or directory)",
    "chaos ball --out run.nc": 'Argument `--out` must end in .csv, but it is "run.nc".',
    "chaos ball --direction both": "Argument `--direction` is for a Poincaré map;",
    "chaos ball --poincare Omega": "Argument `--poincare` must be COMPONENT=VALUE,",
    "chaos ball --chart body.mass=1 body.radius=1:2:3": "Argument `--chart` must be PATH=FROM:TO:COUNT,",
    "stability ball --turning 1": "Argument `--turning` is for the scenario's initial state;",
    "stability none.toml": "(No such file or directory)",
    "periodic none.toml --period 1": "(No such file or directory)",
    "periodic ball --frequency masses[0].rad": "Key `masses[0].rad` must name a number written in the scenario",
    "periodic ball --period 1 --chart body.mass=1 body.radius=1:2:3": "Argument `--chart` must be PATH=FROM:TO:COUNT,",
    "track none.toml": "(No such file or directory)",
    "track ball --within 1": "Argument `--within` is for a grid of starts; give --basin with it.",
    "track ball --basin Omega[0]=1 Omega[1]=1:2:3": "Argument `--basin` must be PATH=FROM:TO:COUNT,",
    "track ball --Q z": "argument --Q: it must be NAME=NUMBER,..., as in z=0.1,Omega[0]=0.3, but it is z",
    "track ball --delay -1": "argument --delay",
    "track ball --out run.csv": 'Argument `--out` must end in one of .nc, .npz, but it is "run.csv".',
    "verify ball none.toml": "(No such file or directory)",
    "verify ball none.nc": 'A run can be loaded from a file, but "none.nc" does not exist.',
    "plot none.nc --out figures": 'A run can be loaded from a file, but "none.nc" does not exist.',
    "plot run.csv --out figures": 'A run can be loaded from a .nc or .npz file, but this is "run.csv"; a .csv holds',
    "view none.nc --out run.html": 'A run can be loaded from a file, but "none.nc" does not exist.',
    "view run.nc --out run.pdf": 'Argument `--out` must end in .html, but it is "run.pdf".',
    "simulate ball --view none/run.html": 'a folder that exists, but "none" does not; make it first.',
    "validate none.toml text.toml": "(No such file or directory).\ntext.toml: A scenario, study or problem must be",
    "sweep none.toml --out s.zarr": 'FILE must be a study file, but it is "none.toml" (No such file or directory).',
    "sweep text.toml --dry-run": "text.toml: A study must be a TOML document, but it is not: ",
    "sweep s.toml --shard 3/2": "argument --shard: it must be K/N with K from 1 to N, but it is 3/2",
    "design none.toml --out found": 'FILE must be a problem file, but it is "none.toml" (No such file or directory).',
    "design text.toml --out found": "text.toml: A problem must be a TOML document, but it is not: ",
    "reproduce --out text.toml": 'Argument `--out` must be a folder, but "text.toml" is a file.',
}
ANSWERED = ["--help", "--version", "scenarios", "scenarios ball", *(f"{name} --help" for name in COMMANDS)]


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """The exit code, what was printed, and the heavy modules there are after it, of each command line."""
    folder = tmp_path_factory.mktemp("folder")
    (folder / "text.toml").write_text("no TOML")
    commands = [*ANSWERED, *REFUSED]
    asked = json.dumps([[command.split() for command in commands], HEAVY])
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, asked], cwd=folder, capture_output=True, text=True, check=True
    )
    assert [path.name for path in folder.iterdir()] == ["text.toml"]
    return dict(zip(commands, json.loads(done.stdout), strict=True))


@pytest.mark.parametrize("command", ANSWERED)
def test_answered_without_numbers(answers, command):
    code, output, errors, heavy = answers[command]
    assert (code, errors, heavy) == (0, "", [])
    assert output.startswith("usage: jaxball") or "--help" not in command


@pytest.mark.parametrize("command", REFUSED)
def test_refused_without_numbers(answers, command):
    code, output, errors, heavy = answers[command]
    assert (code, output, heavy) == (2, "", [])
    assert REFUSED[command] in errors


def test_scenarios_are_those_that_python_shows(answers):
    assert [line.split()[0] for line in answers["scenarios"][1].splitlines()] == list(builtin_scenarios())
    assert answers["scenarios ball"][1] == builtin_text("ball")


@pytest.mark.thorough
def test_reading_a_scenario_does_need_them():
    """The negative control."""
    asked = json.dumps([[["validate", "ball"]], HEAVY])
    done = subprocess.run([sys.executable, "-c", PROGRAM, asked], capture_output=True, text=True, check=True)
    ((code, output, errors, heavy),) = json.loads(done.stdout)
    assert (code, errors) == (0, "")
    assert output.startswith("ball is valid: a scenario, ")
    assert {"jax", "numpy", "equinox"} <= set(heavy)
    assert not {"diffrax", "matplotlib", "xarray", "pandas"} & set(heavy)


@pytest.mark.slow
def test_a_saved_run_is_drawn_without_solvers(tmp_path):
    made = [["simulate", "disk", "--end", "0.1", "--quiet", "--out", str(tmp_path / "run.npz")]]
    drawn = [
        ["plot", str(tmp_path / "run.npz"), "--quiet", "--out", str(tmp_path / "figures")],
        ["view", str(tmp_path / "run.npz"), "--quiet", "--out", str(tmp_path / "run.html")],
    ]
    for commands, solves in ((made, True), (drawn, False)):
        asked = json.dumps([commands, ["diffrax"]])
        done = subprocess.run([sys.executable, "-c", PROGRAM, asked], capture_output=True, text=True, check=True)
        for code, _, errors, heavy in json.loads(done.stdout):
            assert (code, errors, bool(heavy)) == (0, "", solves)
