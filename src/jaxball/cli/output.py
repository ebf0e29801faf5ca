"""The options for what a command writes and where, their checks, and what it prints."""

import argparse
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from ..interface.activity import Line, activity
from ..interface.output import OutputError, check_destination, check_folder

STDOUT = Path("-")
FORMATS = ("png", "pdf", "svg")
FIGURE_SUFFIXES = tuple(f".{name}" for name in FORMATS)


def add_output(parser: argparse.ArgumentParser) -> None:
    """Adds --quiet and --json."""
    add_quiet(parser)
    add_json(parser, "the summary")


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """Adds --quiet."""
    parser.add_argument("--quiet", action="store_true", help="print errors only")


def add_json(parser: argparse.ArgumentParser, what: str) -> None:
    """Adds --json."""
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help=f"write {what} as JSON: .json, or - for standard output"
    )


def check_json(options: argparse.Namespace) -> None:
    """Raises an :class:`~jaxball.results.OutputError` where the file of --json cannot be written."""
    if options.json is not None and options.json != STDOUT:
        check_destination(options.json, (".json",), "--json")


def check_outputs(options: argparse.Namespace, suffixes: Sequence[str]) -> None:
    """Raises an :class:`~jaxball.results.OutputError` where the file of --json, --plot or --out cannot be written."""
    check_json(options)
    if options.plot is not None:
        check_destination(options.plot, FIGURE_SUFFIXES, "--plot")
    if options.out is not None:
        check_destination(options.out, suffixes, "--out")


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


def check_figures_folder(options: argparse.Namespace, folder: str, formats: str) -> None:
    """Raises an :class:`~jaxball.results.OutputError` where figures cannot be written into the folder of an option."""
    path, option = getattr(options, folder), formats.replace("_", "-")
    if path is None:
        if getattr(options, formats) is not None:
            raise OutputError(f"Argument `--{option}` is for figures; give --{folder} FOLDER with it.")
        return
    if path.suffix in FIGURE_SUFFIXES and not path.exists():
        raise OutputError(
            f'Argument `--{folder}` must be a folder, because there are several figures, but it is "{path}"; '
            f"give --{folder} {path.with_suffix('')} --{option} {path.suffix[1:]}."
        )
    check_folder(path, f"--{folder}")


def written_line(written: Sequence[str | Path]) -> str:
    """The line that names the files that were written; empty where there are none."""
    return f"  written: {', '.join(map(str, written))}" if written else ""


def working(options: argparse.Namespace, text: str) -> AbstractContextManager[Line]:
    """:func:`~jaxball.interface.activity.activity`, unless --quiet."""
    return activity(text, quiet=getattr(options, "quiet", False))


def say(options: argparse.Namespace, *lines: object) -> None:
    """Prints the nonempty lines: none with --quiet, and to standard error where JSON goes to standard output."""
    if not getattr(options, "quiet", False):
        text = "\n".join(filter(None, map(str, lines)))
        print(text, file=sys.stderr if options.json == STDOUT else sys.stdout, flush=True)
