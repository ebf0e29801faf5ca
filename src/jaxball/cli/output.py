"""What a command writes: messages, JSON for programs, tables and figures."""

import argparse
import csv
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from ..interface.output import OutputError, check_destination, check_folder, replacing
from ..interface.printing import json_types
from ..interface.wording import counted
from ..scenario import Scenario
from ..simulation.trajectory import Trajectory

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


def write_json(options: argparse.Namespace, content: dict[str, Any]) -> None:
    """Writes ``content`` to the file of --json."""
    if options.json is None:
        return
    text = json.dumps(json_types(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    if options.json == STDOUT:
        sys.stdout.write(text)
        return
    with replacing(options.json) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_outputs(
    options: argparse.Namespace, scenario: Scenario, save: Callable[[Path], None], draw: Callable[[Any], Any]
) -> str:
    """Writes the files of --out and --plot, and returns the line that names them.

    - ``save``: writes the numbers to a path that has the suffix of --out.
    - ``draw``: makes the Axes, given :mod:`jaxball.plot`.
    """
    written = []
    if options.out is not None:
        with replacing(options.out) as temporary:
            save(temporary)
        written.append(options.out)
    if options.plot is not None:
        # Imported here, because matplotlib takes longer to import than many a command runs.
        from .. import plot
        from ..plot.report import write_figure

        write_figure(draw(plot), options.plot, scenario.system, scenario.title)
        written.append(options.plot)
    return written_line(written)


def add_formats(parser: argparse.ArgumentParser, option: str) -> None:
    """Adds the option that names the formats of figures."""
    parser.add_argument(
        option, nargs="+", choices=FORMATS, metavar="FORMAT", help="of the figures: png, pdf or svg (default: png)"
    )


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


def draw_figures(trajectory: Trajectory[Any, Any], folder: Path, formats: list[str] | None, title: str) -> str:
    """Draws the standard figures, and returns how many there are and where."""
    # Imported here, because matplotlib takes longer to import than many a run.
    from .. import plot

    paths = plot.figures(trajectory, folder, title, formats=tuple(dict.fromkeys(formats or ("png",))))
    return f"{counted(len(paths), 'figure')} in {folder}"


def written_line(written: Sequence[str | Path]) -> str:
    """The line that names the files that were written; empty where there are none."""
    return f"  written: {', '.join(map(str, written))}" if written else ""


def write_csv(path: Path, header: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Writes a table as CSV."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def say(options: argparse.Namespace, *lines: object) -> None:
    """Prints the lines that are not empty: none with --quiet, and to standard error where JSON has standard output."""
    if not getattr(options, "quiet", False):
        text = "\n".join(filter(None, map(str, lines)))
        print(text, file=sys.stderr if options.json == STDOUT else sys.stdout, flush=True)
