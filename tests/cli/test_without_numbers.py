"""What needs no numbers is answered without JAX: help, lists, and refusals, each in a sentence."""

import json

import pytest

from jaxball.cli.dispatch import COMMANDS
from jaxball.files.scenario import builtin_scenarios
from jaxball.files.scenario.sources import builtin_text
from tests.support.scripts import printed_by
from tests.support.sentences import said

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
    "simulte ball": "simulate",
    "reproduce --to x": "--to",
    "reproduce --solvers ode45": "ode45",
    "simulate ball --solver dopri9": "dopri8",
    "simulate ball --rtol -1": "--rtol",
    "scenarios bal": "bal",
    "simulate bal": "bal",
    "simulate none.toml": "none.toml",
    "simulate text.toml": "text.toml",
    "simulate ball --set body.mass": "A change",
    "simulate ball --set masses[7].mass=1": "masses",
    "simulate ball --out run.pdf": "--out",
    "simulate ball --out none/run.nc": "--out",
    "simulate ball --json run.txt": "--json",
    "simulate ball --plot text.toml": "--plot",
    "simulate ball --animate film.avi": "--animate",
    "simulate ball --fps 20": "--fps",
    "chaos none.toml": "none.toml",
    "chaos ball --out run.nc": "--out",
    "chaos ball --direction both": "--direction",
    "chaos ball --poincare Omega": "--poincare",
    "chaos ball --chart body.mass=1 body.radius=1:2:3": "--chart",
    "stability ball --turning 1": "--turning",
    "stability none.toml": "none.toml",
    "periodic none.toml --period 1": "none.toml",
    "periodic ball --frequency masses[0].rad": "masses[0].rad",
    "periodic ball --period 1 --chart body.mass=1 body.radius=1:2:3": "--chart",
    "track none.toml": "none.toml",
    "track ball --within 1": "--within",
    "track ball --basin Omega[0]=1 Omega[1]=1:2:3": "--basin",
    "track ball --Q z": "--Q",
    "track ball --delay -1": "--delay",
    "track ball --out run.csv": "--out",
    "verify ball none.toml": "none.toml",
    "verify ball none.nc": "none.nc",
    "plot none.nc --out figures": "none.nc",
    "plot run.csv --out figures": "run.csv",
    "view none.nc --out run.html": "none.nc",
    "view run.nc --out run.pdf": "--out",
    "simulate ball --view none/run.html": "--view",
    "validate none.toml text.toml": "text.toml",
    "sweep none.toml --out s.zarr": "none.toml",
    "sweep text.toml --dry-run": "text.toml",
    "sweep s.toml --shard 3/2": "--shard",
    "design none.toml --out found": "none.toml",
    "design text.toml --out found": "text.toml",
    "reproduce --out text.toml": "--out",
}
ANSWERED = [
    "--help",
    "--version",
    "scenarios",
    "scenarios ball",
    "schema study",
    *(f"{name} --help" for name in COMMANDS),
]


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """The exit code, what was printed, and the heavy modules there are after it, of each command line."""
    folder = tmp_path_factory.mktemp("folder")
    (folder / "text.toml").write_text("no TOML")
    commands = [*ANSWERED, *REFUSED]
    asked = json.dumps([[command.split() for command in commands], HEAVY])
    answered = json.loads(printed_by("-c", PROGRAM, asked, cwd=folder))
    assert [path.name for path in folder.iterdir()] == ["text.toml"]
    return dict(zip(commands, answered, strict=True))


@pytest.mark.parametrize("command", ANSWERED)
def test_answered_without_numbers(answers, command):
    code, output, errors, heavy = answers[command]
    assert (code, errors, heavy) == (0, "", [])
    assert output.startswith("usage: jaxball") or "--help" not in command


@pytest.mark.parametrize("command", REFUSED)
def test_refused_without_numbers(answers, command):
    code, output, errors, heavy = answers[command]
    assert (code, output, heavy) == (2, "", [])
    assert "trapezoidal" not in errors  # one of many solvers, of which only the nearest are named
    said(errors.splitlines()[-1], REFUSED[command])


def test_scenarios_are_those_that_python_shows(answers):
    assert [line.split()[0] for line in answers["scenarios"][1].splitlines()] == list(builtin_scenarios())
    assert answers["scenarios ball"][1].partition("\n")[2] == builtin_text("ball")


@pytest.mark.thorough
def test_reading_a_scenario_does_need_them():
    """The negative control."""
    asked = json.dumps([[["validate", "ball"]], HEAVY])
    ((code, output, errors, heavy),) = json.loads(printed_by("-c", PROGRAM, asked))
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
        for code, _, errors, heavy in json.loads(printed_by("-c", PROGRAM, asked)):
            assert (code, errors, bool(heavy)) == (0, "", solves)
