"""What a command writes: messages, JSON for programs, and the files of --out and --plot."""

import argparse
import csv
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from ..interface.output import check_destination, replacing
from ..interface.printing import json_types
from ..scenario import Scenario
from .figures import SUFFIXES as FIGURE_SUFFIXES

STDOUT = Path("-")


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
