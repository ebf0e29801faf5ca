"""The files that a command writes: JSON for programs, tables and figures."""

import argparse
import contextlib
import csv
import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from ...interface.output import OutputError, replacing
from ...interface.printing import json_types
from ...interface.wording import counted
from ...plot.files import check_others, figures_in, plain_name, scenario_mark
from ...scenario import Scenario, ScenarioError, write_scenario
from ...simulation.trajectory import Trajectory
from ..input import STDIN
from ..output import STDOUT, working, written_line


def write_json(options: argparse.Namespace, content: dict[str, Any]) -> None:
    """Writes ``content`` to the file of --json."""
    if options.json is None:
        return
    text = json.dumps(json_types(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    text = text.encode(errors="backslashreplace").decode()  # escapes file names that are not valid text
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
        # Imported here, because importing matplotlib takes longer than many commands.
        from ... import plot
        from ...plot.report import write_figure

        with working(options, "drawing"):
            write_figure(draw(plot), options.plot, scenario.system, scenario.title)
        written.append(options.plot)
    return written_line(written)


def draw_figures(
    options: argparse.Namespace,
    trajectory: Trajectory[Any, Any],
    folder: Path,
    formats: list[str] | None,
    scenario: Scenario,
    source: str | Path,
) -> str:
    """Draws the standard figures of a run of a scenario, named after ``source``, and returns how many and where."""
    # Imported here, because importing matplotlib takes longer than many runs.
    from ... import plot

    try:
        paths = plot.figures(
            trajectory,
            folder,
            scenario.title,
            name=figure_name(source, scenario),
            formats=suffixes(formats),
            sensors=scenario.sensors,
            svg_text=options.svg_text,
            replace=options.force,
        )
    except OutputError as error:
        raise OutputError(str(error).replace("replace=True", "--force")) from None
    return f"{counted(len(paths), 'figure')} in {folder}"


def check_figures(options: argparse.Namespace, scenario: Scenario) -> None:
    """Raises an :class:`~jaxball.results.OutputError` where --plot would replace figures of another scenario's run."""
    if options.plot is None or options.force or not options.plot.is_dir():
        return
    with contextlib.suppress(ScenarioError):
        mark = scenario_mark(write_scenario(scenario))
        name = figure_name(options.scenario, scenario)
        check_others(figures_in(options.plot, name, suffixes(options.plot_format)), mark, "--force")


def suffixes(formats: list[str] | None) -> tuple[str, ...]:
    """The formats of figures, each once."""
    return tuple(dict.fromkeys(formats or ("png",)))


def figure_name(source: str | Path, scenario: Scenario) -> str:
    """The prefix of figure names: the name of the scenario or run; for standard input, its title or its kind."""
    kind = scenario.system.title.lower().replace(" ", "_")
    return plain_name(scenario.title if str(source) == STDIN else Path(source).stem, kind)


def write_csv(path: Path, header: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Writes a table as CSV."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
