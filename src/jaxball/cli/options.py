"""The options that commands share: their types and checks, what is written and where, and what is printed."""

import argparse
import math
import re
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from ..interface.activity import Line, activity
from ..interface.output import OutputError, check_destination, check_folder, write_text
from ..interface.wording import UserError, plain

BAD_INPUT = 2
FAILED_SOLVE = 3
BROKEN_PIPE = 141  # as a shell reports it for other programs
OUT_MISSING = "the following arguments are required: --out"  # as argparse says it
STDOUT = Path("-")
FORMATS = ("png", "pdf", "svg")
FIGURE_SUFFIXES = tuple(f".{name}" for name in FORMATS)
MOST_VALUES = 10_000  # of one number of a chart
CHART_AXIS = "PATH=FROM:TO:COUNT"
ChartAxis = tuple[str, float, float, int]  # the path of a number, its first and its last value, and how many
# What the command line calls arguments of Python functions that are not options of the same name.
POSITIONAL = {
    "source": "FILE",
    "name": "NAME",
    "problems": "PROBLEM",
    "data": "STORE",
    "ball": "The scenario's ball",
    "inclination": "INCLINATION",
    "precession": "PRECESSION",
}
# And Python functions that sentences recommend.
COMMANDS = {"`periodic_motion`": "`jaxball periodic`", "`steady_motion`": "`jaxball stability --initial`"}


class BadInputError(UserError):
    """The command line asks for something impossible; the message is one sentence that says what and why."""


def positive(text: str) -> float:
    """Parses a positive number, for argparse."""
    value = _parse_number(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"it must be a positive number, but it is {text}")
    return value


def number(text: str) -> float:
    """Parses a finite number, for argparse."""
    value = _parse_number(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"it must be a finite number, but it is {text}")
    return value


def count(text: str) -> int:
    """Parses a whole number, 1 or more, for argparse."""
    # Digits only: `int` alone would take 1_000 and spaces, too.
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"it must be a whole number, 1 or more, but it is {text}")
    return int(text)


def add_no_cache(parser: argparse.ArgumentParser) -> None:
    """Adds --no-cache."""
    parser.add_argument(
        "--no-cache",
        dest="cache",
        action="store_false",
        default=True,
        help="neither use nor keep compiled programs; see jaxball cache",
    )


def add_output(parser: argparse.ArgumentParser) -> None:
    """Adds --quiet and --json."""
    add_quiet(parser)
    add_json(parser, "the summary")


def add_results(parser: argparse.ArgumentParser, numbers: str, figure: str) -> None:
    """Adds --out, --plot, --quiet and --json."""
    parser.add_argument("--out", type=Path, metavar="FILE", help=f"save {numbers}")
    parser.add_argument("--plot", type=Path, metavar="FILE", help=f"draw {figure}: .png, .pdf or .svg")
    add_output(parser)


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """Adds --quiet."""
    parser.add_argument("--quiet", action="store_true", help="print errors only")


def add_json(parser: argparse.ArgumentParser, what: str) -> None:
    """Adds --json."""
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help=f"write {what} as JSON: .json, or - for standard output"
    )


def check_json(options: argparse.Namespace) -> None:
    """Raises an :class:`~jaxball.files.results.OutputError` where the file of --json cannot be written."""
    check_file(options, "json", (".json",), also=STDOUT)


def check_file(options: argparse.Namespace, name: str, suffixes: Sequence[str], *, also: Path | None = None) -> None:
    """Raises an :class:`~jaxball.files.results.OutputError` where the file of an option is given, and can neither be
    written nor is it ``also`` possible.
    """
    path = getattr(options, name)
    if path not in (None, also):
        check_destination(path, suffixes, f"--{name}")


def check_outputs(options: argparse.Namespace, suffixes: Sequence[str]) -> None:
    """Raises an :class:`~jaxball.files.results.OutputError` where the file of --json, --plot or --out cannot be
    written.
    """
    check_json(options)
    check_file(options, "plot", FIGURE_SUFFIXES)
    check_file(options, "out", suffixes)


def refuse(options: argparse.Namespace, names: Sequence[str], why: str) -> None:
    """Raises a :class:`BadInputError` where one of these options is given; ``why`` ends the sentence about it."""
    for name in names:
        if getattr(options, name) is not None:
            raise BadInputError(f"Argument `--{name}` {why}")


def add_formats(parser: argparse.ArgumentParser, option: str) -> None:
    """Adds the option that names the formats of figures."""
    parser.add_argument(
        option, nargs="+", choices=FORMATS, metavar="FORMAT", help="formats of figures: png, pdf or svg (default: png)"
    )


def add_replacing(parser: argparse.ArgumentParser) -> None:
    """Adds --svg-text and --force."""
    parser.add_argument(
        "--svg-text",
        action="store_true",
        help="keep text in SVG files as text, which can be edited but needs the fonts, instead of outlines",
    )
    parser.add_argument("--force", action="store_true", help="replace figures of another run as well")


def add_force(parser: argparse.ArgumentParser, what: str) -> None:
    """Adds --force, for a file of text that users also write themselves."""
    parser.add_argument("--force", action="store_true", help=f"replace {what} as well")


def write_new(options: argparse.Namespace, text: str, mark: str | None = None) -> list[Path]:
    """Writes the text to the file of --out, or prints it, and lists the files written.

    **Raises:** :class:`~jaxball.files.results.OutputError` where, without --force, another text is there, unless it has
    the ``mark`` of what the same command wrote.
    """
    path: Path = options.out
    if path != STDOUT and not options.force and path.exists():
        there = path.read_bytes().decode(errors="replace")
        if there not in ("", text) and (mark is None or mark not in there):
            raise OutputError(
                f'Argument `--out` must be a new file, but "{path}" is there and has other content; write elsewhere, '
                "or replace it with --force."
            )
    return print_or_write(path, text)


def check_figures_folder(options: argparse.Namespace, folder: str, formats: str) -> None:
    """Raises an :class:`~jaxball.files.results.OutputError` where figures cannot be written into the folder of an
    option.
    """
    path, option = getattr(options, folder), formats.replace("_", "-")
    if path is None:
        given = {option: getattr(options, formats) is not None, "svg-text": options.svg_text, "force": options.force}
        for name in (name for name, there in given.items() if there):
            raise OutputError(f"Argument `--{name}` is for figures; give --{folder} FOLDER with it.")
        return
    # A file's name in place of a folder's.
    if path.suffix in FIGURE_SUFFIXES and not path.exists():
        raise OutputError(
            f'Argument `--{folder}` must be a folder, because there are several figures, but it is "{path}"; '
            f"give --{folder} {path.with_suffix('')} --{option} {path.suffix[1:]}."
        )
    check_folder(path, f"--{folder}")


def name_files(written: Sequence[str | Path]) -> str:
    """Names the files that were written, in a line; empty where there are none."""
    return f"  written: {', '.join(map(str, written))}" if written else ""


def working(options: argparse.Namespace, text: str) -> AbstractContextManager[Line]:
    """Calls :func:`~jaxball.interface.activity.activity`, quiet with --quiet."""
    return activity(text, quiet=getattr(options, "quiet", False))


def say(options: argparse.Namespace, *lines: object) -> None:
    """Prints the nonempty lines: none with --quiet, and to standard error where a file goes to standard output."""
    text = plain("\n".join(filter(None, map(str, lines))))
    if text and not getattr(options, "quiet", False):
        has_file = STDOUT in (getattr(options, "json", None), getattr(options, "out", None))
        print(text, file=sys.stderr if has_file else sys.stdout, flush=True)


def print_or_write(path: Path, text: str) -> list[Path]:
    """Writes a file, or prints it to standard output and nothing else there, and lists the files written."""
    if path != STDOUT:
        return [write_text(path, text)]
    sys.stdout.write(text)
    return []


def sentence(error: Exception) -> str:
    """Returns the message of an error, with arguments and functions named as on the command line."""
    # An error without a file is one of standard output, such as a full disk.
    if isinstance(error, OSError) and error.strerror:
        place = "The output" if error.filename is None else f'"{error.filename}"'
        return f"{place} cannot be {'written' if error.filename is None else 'used'}: {error.strerror}."

    def on_command_line(match: re.Match[str]) -> str:
        return POSITIONAL.get(match[1]) or f"Argument `--{match[1].replace('_', '-')}`"

    return in_commands(re.sub(r"Argument `(\w+)`", on_command_line, str(error)).replace("replace=True", "--force"))


def in_commands(text: str) -> str:
    """Replaces each function that the text recommends by the command that does the same."""
    for function, command in COMMANDS.items():
        text = text.replace(function, command)
    return text


def chart_axes(
    options: argparse.Namespace, option: str = "chart", example: str = "initial.Omega[0]=0:3:30"
) -> tuple[ChartAxis, ChartAxis]:
    """Returns the two axes of --chart, or of another ``option``, with an ``example`` of one.

    **Raises:** :class:`BadInputError` for a malformed axis, and for the same number twice.
    """
    first, second = (_chart_axis(text, option, example) for text in getattr(options, option))
    if first[0] == second[0]:
        raise BadInputError(f"Argument `--{option}` must name two numbers, but it names `{first[0]}` twice.")
    return first, second


def _chart_axis(text: str, option: str, example: str) -> ChartAxis:
    path, _, values = text.partition("=")
    parts = values.split(":")
    try:
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
    except (ValueError, IndexError):
        low, high, count = math.nan, math.nan, 0
    # The sum is finite only if both are.
    if len(parts) != 3 or not math.isfinite(low + high) or low == high or not 2 <= count <= MOST_VALUES:
        raise BadInputError(
            f"Argument `--{option}` must be {CHART_AXIS}, with two different numbers and a count from 2 to "
            f"{MOST_VALUES:,}, such as '{example}', but it is \"{text}\"."
        )
    return path.strip(), low, high, count


def _parse_number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
