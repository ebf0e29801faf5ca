"""What the command line does not take ends with 2 and the usage of the command that it was given to."""

import pytest

from jaxball import __version__
from jaxball.cli import main
from jaxball.cli.dispatch import COMMANDS, WITHOUT_CACHE, parser_of
from tests.support.sentences import said

pytestmark = pytest.mark.usefixtures("command_line")

ROWS = "view study.zarr --out rows.html --rows "


def last_line(capsys, typed):
    """What is wrong, after the usage of the command."""
    with pytest.raises(SystemExit) as caught:
        main(typed.split())
    errors = capsys.readouterr().err
    assert caught.value.code == 2
    command = typed.partition(" ")[0] if typed != "roll" else ""
    assert errors.startswith(f"usage: jaxball {command}".rstrip())
    return errors.splitlines()[-1]


@pytest.mark.parametrize(
    ("typed", "named"),
    [
        ("roll", "jaxball --help"),
        ("simulate ball --st mass=2", "--set"),
        ("simulate ball --rtoll=1e-3", "--rtol"),
        ("verify ball --knob x", "jaxball verify --help"),
        ("sweep plot x --oot y", "--out"),
        ("sweep study.toml --out s.zarr --quiet", "jaxball sweep --help"),
        ("reproduce all", "jaxball reproduce --help"),
        (ROWS + "1,x", "--rows"),
        (ROWS + "1,1", "--rows"),
        (ROWS + ",".join(map(str, range(25))), "--rows"),
        ("design mine/winding.toml", "jaxball design mine/winding.toml --out FOLDER"),
        ("plot run.nc", "jaxball plot run.nc --out FOLDER"),
        ("view run.nc", "jaxball view run.nc --out FILE"),
        ("view study.zarr --rows 3,17", "jaxball view study.zarr --rows 3,17 --out FILE"),
        ("sweep study.toml", "jaxball sweep study.toml --out STORE"),
        ("sweep plot s.zarr", "jaxball sweep plot s.zarr --out FOLDER"),
    ],
)
def test_what_is_mistyped_is_named(capsys, typed, named):
    said(last_line(capsys, typed), named)


@pytest.mark.parametrize(
    "typed",
    [
        "",
        "simulate",
        "simulate ball --max-step 0",
        "simulate disk.toml --plot-format bmp",
        "simulate disk.toml --size big",
        "simulate disk.toml --size 10x10",
        "simulate disk.toml --fps 2.5",
        "simulate disk.toml --end soon",
        "chaos",
        "chaos ball --interval 0",
        "chaos ball --end inf",
        "periodic disk.toml",
        "periodic disk.toml --period 0",
        "periodic disk.toml --frequency -1",
        "sweep status",
        "sweep plot",
        "design",
        "sweep study.toml s.zarr",
        "sweep study.toml --out s.zarr --workers 0",
        "sweep study.toml --out s.zarr --shard 2",
        "sweep study.toml --out s.zarr --measure",
        "sweep study.toml --out s.zarr --result phi",
    ],
)
def test_what_is_missing_or_no_value_of_an_option(capsys, typed):
    last_line(capsys, typed)


FULL = {
    "validate": "ball.toml",
    "simulate": "ball",
    "plot": "run.nc --out run",
    "view": "run.nc --out run.html",
    "chaos": "ball",
    "stability": "ball",
    "periodic": "ball --period 2",
    "track": "ball",
    "verify": "ball",
    "sweep": "study.toml --out study.zarr",
    "design": "problem.toml --out result",
    "export": "robot.toml --to mjcf",
    "import": "robot.xml",
    "reproduce": "",
}
BEFORE = [(command, "--no-cache") for command in COMMANDS if command not in WITHOUT_CACHE] + [
    ("simulate", "--quiet --set body.mass=2 --json -"),
    ("plot", "--quiet --no-cache"),
    ("sweep", "--shard 1/2 --workers 2"),
]


@pytest.mark.parametrize(("command", "options"), BEFORE)
def test_an_option_before_its_command_is_that_of_the_command(command, options):
    before, behind = ([*options.split(), command], [command, *options.split()])
    parsed = [vars(parser_of(typed).parse_args([*typed, *FULL[command].split()])) for typed in (before, behind)]
    for one in parsed:  # which each has an object of its own
        one.pop("parser", None)
    assert parsed[0] == parsed[1]


@pytest.mark.parametrize("typed", ["--version design problem.toml", "--vers simulate", "--quiet --version sweep"])
def test_options_of_the_program_before_a_command_are_its_own(capsys, typed):
    with pytest.raises(SystemExit) as ended:
        main(typed.split())
    assert not ended.value.code
    assert capsys.readouterr().out == f"jaxball {__version__}\n"


def test_a_mistyped_command_behind_options_is_named(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--no-cache", "desing", "problem.toml"])
    assert ended.value.code == 2
    said(capsys.readouterr().err.splitlines()[-1], "desing", "design")
