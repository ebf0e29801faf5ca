"""What a command writes: JSON for programs, tables and figures."""

import argparse
import csv
import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from ...interface.output import replacing
from ...interface.printing import json_types
from ...interface.wording import counted
from ...scenario import Scenario
from ...simulation.trajectory import Trajectory
from ..output import STDOUT, working, written_line


def write_json(options: argparse.Namespace, content: dict[str, Any]) -> None:
    """Writes ``content`` to the file of --json."""
    if options.json is None:
        return
    text = json.dumps(json_types(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    text = text.encode(errors="backslashreplace").decode()  # a file's name that is no text, in JSON's own way
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
        from ... import plot
        from ...plot.report import write_figure

        with working(options, "drawing"):
            write_figure(draw(plot), options.plot, scenario.system, scenario.title)
        written.append(options.plot)
    return written_line(written)


def draw_figures(trajectory: Trajectory[Any, Any], folder: Path, formats: list[str] | None, scenario: Scenario) -> str:
    """Draws the standard figures of a run of a scenario, and returns how many there are and where."""
    # Imported here, because matplotlib takes longer to import than many a run.
    from ... import plot

    suffixes = tuple(dict.fromkeys(formats or ("png",)))
    paths = plot.figures(trajectory, folder, scenario.title, formats=suffixes, sensors=scenario.sensors)
    return f"{counted(len(paths), 'figure')} in {folder}"


def write_csv(path: Path, header: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Writes a table as CSV."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
