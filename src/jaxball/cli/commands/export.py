"""``jaxball export``: writes a scenario's robot as a file of MuJoCo."""

import argparse
from pathlib import Path

from ...interface.output import replacing
from ..input import SETTINGS, add_scenario, read_scenario, refuse_settings
from ..options import STDOUT, BadInputError, add_force, add_quiet, check_file, name_files, positive, say, write_new


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Writes the robot of a scenario as MJCF, for MuJoCo, with the same equations of motion in free flight. What "
        "MJCF cannot express is refused; what MuJoCo does in another way, such as contact, is printed."
    )
    add_scenario(parser)
    parser.add_argument("--to", choices=["mjcf"], required=True, help="the format")
    parser.add_argument("--out", type=Path, default=STDOUT, metavar="FILE", help=".xml; default: standard output")
    parser.add_argument(
        "--controls",
        type=Path,
        metavar="FILE",
        help="save the controls of the actuators at the scenario's times: .csv",
    )
    parser.add_argument("--timestep", type=positive, metavar="TIME", help="of MuJoCo; default: its own, 0.002")
    parser.add_argument(
        "--any-units", action="store_true", help="write numbers in units other than those of SI as they are"
    )
    parser.add_argument(
        "--extent",
        type=positive,
        metavar="LENGTH",
        help="half the side of the height field that a curved ground is written as; default: 10 radii of the body",
    )
    add_force(parser, "a file that no export wrote")
    add_quiet(parser)


def run(options: argparse.Namespace) -> int:
    check_file(options, "out", (".xml",), also=STDOUT)
    check_file(options, "controls", (".csv",))
    refuse_settings(options, "export", SETTINGS)
    scenario = read_scenario(options)
    from ...files.mjcf import to_mjcf
    from ...files.mjcf.drives import TIMES
    from ..files import write_csv

    timestep = {} if options.timestep is None else {"timestep": options.timestep}
    exported = to_mjcf(scenario, any_units=options.any_units, extent=options.extent, **timestep)
    if options.controls is not None and not exported.controls:
        raise BadInputError("Argument `--controls` must be left out, because nothing in this robot is controlled.")
    written = write_new(options, exported.text, mark=TIMES)
    if options.controls is not None:
        rows = ((t, *row) for t, row in zip(scenario.times, exported.controls_at(scenario.times), strict=True))
        with replacing(options.controls) as temporary:
            # By `repr`, which keeps all digits.
            write_csv(temporary, ["t", *exported.controls], (map(repr, map(float, row)) for row in rows))
        written.append(options.controls)
    say(options, *exported.notes, name_files(written))
    return 0
