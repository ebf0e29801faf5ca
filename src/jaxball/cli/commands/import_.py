"""``jaxball import``: reads a robot from a file of MuJoCo or ROS, and writes it as a scenario."""

import argparse
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ...files.scenario.errors import ScenarioError
from ...files.scenario.sources import text_of
from ..input import STDIN, refuse_document
from ..jax_setup import set_up_jax
from ..options import STDOUT, BadInputError, add_force, add_quiet, check_file, name_files, positive, say, write_new

if TYPE_CHECKING:
    from ...files.scenario.scenario import Scenario

ROUNDING = 1e-9  # of a span, by which a whole number of steps may miss it
DEFAULT_END, DEFAULT_STEP = 10.0, 0.1


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Reads an MJCF file, of MuJoCo, with a ball or a disk that carries mechanisms, or a URDF file, of ROS, with a "
        "ball that does, and writes it as a scenario. Anything else is refused, with the name of the element."
    )
    parser.add_argument("file", metavar="FILE", help="an MJCF or a URDF file, or - for standard input")
    parser.add_argument("--out", type=Path, default=STDOUT, metavar="FILE", help=".toml; default: standard output")
    parser.add_argument(
        "--end",
        type=positive,
        metavar="TIME",
        help=f"of the run; default: that of a file of `jaxball export`, {DEFAULT_END:g} after the start of others",
    )
    parser.add_argument(
        "--step",
        type=positive,
        metavar="TIME",
        help=f"between saves; default: as for --end, {DEFAULT_STEP:g} for others",
    )
    parser.add_argument(
        "--contact", action="store_true", help="let it slip and fly, with MuJoCo's coefficient of friction; MJCF alone"
    )
    parser.add_argument("--shell", metavar="LINK", help="which link rolls, where several have a sphere; URDF alone")
    add_force(parser, "a file with other content")
    add_quiet(parser)


def run(options: argparse.Namespace) -> int:
    check_file(options, "out", (".toml",), also=STDOUT)
    # A scenario would be refused as XML that it is not; its own command is the better advice.
    if options.file != STDIN:
        refuse_document(Path(options.file))
    text = sys.stdin.read() if options.file == STDIN else text_of(options.file, "file of MuJoCo or ROS", ScenarioError)
    if "<" not in text:
        raise BadInputError("The file must be XML, but it is not: it has no element.")
    urdf = _is_urdf(text)
    if urdf and options.contact:
        raise BadInputError(
            "Argument `--contact` must be left out for a URDF file, which states no friction; add `contact` to the "
            "scenario."
        )
    if options.shell is not None and not urdf:
        raise BadInputError("Argument `--shell` must be left out for a file that is no URDF, where one body rolls.")
    set_up_jax()
    from ...files.mjcf import read_mjcf
    from ...files.scenario.files import write_scenario
    from ...files.scenario.sources import with_schema
    from ...files.urdf import read_urdf

    robot = read_urdf(text, shell=options.shell) if urdf else read_mjcf(text, contact=options.contact)
    scenario = _with_times(robot.scenario, options.end, options.step)
    written = write_new(options, with_schema(write_scenario(scenario)))
    say(options, *robot.notes, *_problems(scenario), name_files(written))
    return 0


def _with_times(scenario: "Scenario", end: float | None, step: float | None) -> "Scenario":
    """Returns a scenario with other save times, if there is an end or a step of them."""
    if end is None and step is None:
        return scenario
    import dataclasses

    import numpy as np

    start, last = float(scenario.times[0]), float(scenario.times[-1])
    step = DEFAULT_STEP if step is None else step
    length = (last if end is None else end) - start
    if length <= 0:
        raise BadInputError(f"Argument `--end` must be later than the start of the file, {start:g}, but it is {end:g}.")
    count = max(round(length / step), 1)
    if step <= 0 or abs(count * step - length) > ROUNDING * length:
        raise BadInputError(
            f"Argument `--step` must be positive and divide the span from {start:g} to {start + length:g}, but it is "
            f"{step:g}."
        )
    return dataclasses.replace(scenario, times=start + step * np.arange(count + 1))


def _problems(scenario: "Scenario") -> list[str]:
    """Says why a scenario cannot be simulated as it is; its file is written all the same, to be mended."""
    from ...files.scenario.files import read_scenario, write_scenario
    from ...physics.contact.released import ReleasedState
    from ...physics.validity import find_problems

    state = scenario.state.body if isinstance(scenario.state, ReleasedState) else scenario.state
    sentences = [problem.sentence("Key") for problem in find_problems(scenario.system, state, scenario.times[:1])]
    if not sentences:  # then of what a file is asked besides, such as a height above the ground
        try:
            read_scenario(write_scenario(scenario))
        except ScenarioError as error:
            sentences = str(error).splitlines()
    return [f"This must be mended before it can be simulated: {sentence}" for sentence in sentences]


def _is_urdf(text: str) -> bool:
    """Returns whether the first element of a text shows it to be a URDF file."""
    # Comments may have elements in them.
    first = re.search(r"<([A-Za-z_][\w:.-]*)", re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL))
    return first is not None and first[1] == "robot"
