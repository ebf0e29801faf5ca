"""The files that commands write: JSON for other programs, tables, figures and charts. Needs JAX."""

import argparse
import contextlib
import csv
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files.results.saving import write_netcdf
from ..files.scenario import read_document
from ..files.scenario.errors import ScenarioError
from ..files.scenario.files import write_scenario
from ..files.scenario.paths import entries
from ..files.scenario.scenario import Scenario
from ..interface.arguments import a
from ..interface.output import OutputError, replacing
from ..interface.printing import json_types
from ..interface.status import Status
from ..interface.wording import heading, number_of
from ..numerics.arrays import arrays_of
from ..physics.classical.lagrangian import AbstractLagrangianSystem
from ..physics.system import AbstractSystem
from ..plot.files import check_others, figures_in, plain_name, scenario_mark
from ..simulation.trajectory import Trajectory
from .input import STDIN
from .options import FAILED_SOLVE, STDOUT, ChartAxis, in_commands, name_files, print_or_write, say, working

if TYPE_CHECKING:
    import xarray

    from ..analysis.stability.periodic import PeriodicMotion
    from ..analysis.stability.steady import SteadyMotion

    Motion = SteadyMotion | PeriodicMotion

Names = Sequence[str]  # of attributes
OUTPUTS = ("out", "view", "plot", "animate", "json")  # options that name a file, or the folder of figures


def find_places(options: argparse.Namespace) -> None:
    """Makes the folders of all outputs again that have been removed since the command began.

    Where that is impossible the output goes to the nearest folder above that can be written, or else to the current or
    to that of temporary files, and a line says so: what has been computed is not lost.
    """
    for name in OUTPUTS:
        path = getattr(options, name, None)
        if isinstance(path, Path) and path != STDOUT:
            setattr(options, name, _place_for(path))


def _place_for(path: Path) -> Path:
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
    if _can_be_written(path.parent):
        return path
    above = Path(os.path.abspath(path.parent)).parents[:-1] if path.is_absolute() else path.parent.parents
    folder = next(filter(_can_be_written, (*above, Path(), Path(tempfile.gettempdir()))), None)
    if folder is None:
        return path
    place = folder / path.name
    print(
        f'jaxball: The folder of "{path}" was removed meanwhile and cannot be made again; '
        f'"{place}" is written instead.',
        file=sys.stderr,
    )
    return place


def _can_be_written(folder: Path) -> bool:
    try:
        folder.resolve(strict=True)  # fails for the current folder where it has been removed
    except OSError:
        return False
    return folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)


def write_json(options: argparse.Namespace, content: dict[str, Any]) -> None:
    """Writes ``content`` to the file of --json."""
    if options.json is None:
        return
    find_places(options)
    text = json.dumps(json_types(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    text = text.encode(errors="backslashreplace").decode()  # escapes file names that are not valid text
    print_or_write(options.json, text)


def write_outputs(
    options: argparse.Namespace, scenario: Scenario, save: Callable[[Path], None], draw: Callable[[Any], Any]
) -> str:
    """Writes the files of --out and --plot, and returns the line that names them.

    - ``save``: writes the numbers to a path that has the suffix of --out.
    - ``draw``: makes the Axes, given :mod:`jaxball.plot`.
    """
    written = []
    find_places(options)
    if options.out is not None:
        with replacing(options.out) as temporary:
            save(temporary)
        written.append(options.out)
    if options.plot is not None:
        from .. import plot  # here, because importing matplotlib takes longer than many commands
        from ..plot.report import write_figure

        with working(options, "drawing"):
            write_figure(draw(plot), options.plot, scenario.system, scenario.title, scenario.units)
        written.append(options.plot)
    return name_files(written)


def report(
    options: argparse.Namespace,
    scenario: Scenario,
    content: dict[str, Any],
    lines: Iterable[object],
    save: Callable[[Path], None],
    draw: Callable[[Any], Any],
    failure: str = "",
) -> int:
    """Writes the ``content`` of --json and the files of --out and --plot, prints the lines, and returns the exit code.

    ``save`` and ``draw`` are as for :func:`write_outputs`. After a ``failure``, a sentence, there is only the JSON.
    """
    write_json(options, content)
    if failure:
        print(f"jaxball: {failure}", file=sys.stderr)
        return FAILED_SOLVE
    say(options, heading(scenario.title), *lines, write_outputs(options, scenario, save, draw))
    return 0


def draw_figures(
    options: argparse.Namespace,
    trajectory: Trajectory[Any, Any],
    folder: Path,
    formats: list[str] | None,
    scenario: Scenario,
    source: str | Path,
) -> str:
    """Draws the standard figures of a run of a scenario, named after ``source``, and returns how many and where."""
    paths = trajectory.save_figures(
        folder,
        scenario.title,
        name=figure_name(source, scenario),
        formats=suffixes(formats),
        sensors=scenario.sensors,
        svg_text=options.svg_text,
        replace=options.force,
    )
    return f"{number_of(len(paths), 'figure')} in {folder}"


def check_figures(options: argparse.Namespace, scenario: Scenario) -> None:
    """Raises an :class:`~jaxball.files.results.OutputError` where --plot would replace figures of another scenario's
    run.
    """
    if options.plot is None or options.force or not options.plot.is_dir():
        return
    # A scenario that cannot be written is marked by its states, which are not known yet; saving checks these.
    with contextlib.suppress(ScenarioError):
        mark = scenario_mark(write_scenario(scenario))
        name = figure_name(options.scenario, scenario)
        check_others(figures_in(options.plot, name, suffixes(options.plot_format)), mark, "--force")


def check_shown(system: AbstractSystem, what: str) -> None:
    """Raises an :class:`~jaxball.files.results.OutputError` where ``what`` would be a view that only a user's function
    can draw.
    """
    if isinstance(system, AbstractLagrangianSystem):
        raise OutputError(
            f"{what} must be of another system than {a(system.title)}, whose coordinates may mean anything; in Python, "
            "`run.view(path, picture=...)` draws it by a function of yours."
        )


def suffixes(formats: list[str] | None) -> tuple[str, ...]:
    """Returns the formats of figures, each once."""
    return tuple(dict.fromkeys(formats or ("png",)))


def figure_name(source: str | Path, scenario: Scenario) -> str:
    """Returns the prefix of figure names: the name of the scenario or run; for standard input, its title or
    its kind.
    """
    kind = scenario.system.title.lower().replace(" ", "_")
    return plain_name(scenario.title if str(source) == STDIN else Path(source).stem, kind)


def write_csv(path: Path, header: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Writes a table as CSV."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def write_chart(
    options: argparse.Namespace,
    document: dict[str, Any],
    axes: tuple[ChartAxis, ChartAxis],
    compute: Callable[..., "xarray.Dataset"],
    summary: Callable[["xarray.Dataset"], list[str]],
    draw: Callable[[Any], Callable[["xarray.Dataset"], Any]],
) -> int:
    """Computes a chart over two numbers of a document, saves and draws it, and prints its summary.

    - ``compute``: makes the chart, given its axes as those of a study, and what to call with the progress.
    - ``draw``: the function that draws it, given :mod:`jaxball.plot`.
    """
    from ..studies.sweep.axes import Ranged  # here, because other commands need no studies

    first, second = (Ranged(*axis, logarithmic=False) for axis in axes)
    with working(options, "computing the chart") as line:

        def report(done: int, cells: int) -> None:
            line.print(f"{done:,} of {cells:,} cells", sys.stderr)

        chart = compute((first, second), progress=None if options.quiet else report)
    chart.attrs["title"] = str(document.get("title", ""))
    written = write_outputs(
        options, read_document(document), lambda path: save_chart(chart, path), lambda plot: draw(plot)(chart)
    )
    write_json(options, {**chart.attrs, **{str(name): chart[name].values for name in chart.variables}})
    counts = ((status, int(np.sum(chart["status"].values == status))) for status in Status if status != Status.SUCCESS)
    failures = [f"  {count:,} {status.name}" for status, count in counts if count]
    say(options, heading(chart.attrs["title"]), *summary(chart), *failures, written)
    return 0


def extremes_of(chart: "xarray.Dataset", name: str) -> tuple[float, float, tuple[Any, ...], str]:
    """Finds the least and the largest value of a variable, the index of the largest, and the pair of numbers there."""
    values = chart[name].values
    largest = np.unravel_index(np.nanargmax(values), values.shape)
    pair = ", ".join(f"{axis} = {chart[axis].values[k]:g}" for axis, k in zip(chart[name].dims, largest, strict=True))
    return float(np.nanmin(values)), float(values[largest]), largest, pair


def save_chart(chart: "xarray.Dataset", path: Path) -> None:
    """Writes a chart as netCDF, or as a table with one row for each cell."""
    if path.suffix == ".nc":
        write_netcdf(chart, path)
        return
    names = [str(name) for name in chart.data_vars]
    up, right = chart[names[0]].dims
    grids = np.meshgrid(chart[up].values, chart[right].values, indexing="ij")
    columns = [*map(np.ravel, grids), *(chart[name].values.ravel() for name in names)]
    header = ",".join([str(up), str(right), *names])
    np.savetxt(path, np.column_stack(columns), fmt="%.17g", delimiter=",", header=header, comments="")


def state_line(motion: "Motion") -> str:
    """Formats the state of a motion."""
    return ", ".join(f"{name} = {_format(leaf)}" for name, leaf in _state(motion).items())


def complex_numbers(values: np.ndarray) -> str:
    """Formats complex numbers, without parts that are mere rounding."""
    return ", ".join(map(_complex, values))


def motion_content(motion: "Motion", names: Names, complex_names: Names) -> dict[str, Any]:
    """Describes a motion for JSON: its state and some of its attributes."""
    content = {name: getattr(motion, name) for name in (*names, *complex_names)}
    texts = {name: in_commands(value) for name, value in content.items() if isinstance(value, str)}
    return {"state": _state(motion), **content, **texts}


def save_motions(motions: "Sequence[Motion]", path: Path, names: Names, complex_names: Names) -> None:
    """Writes one row for each motion, its columns named by paths."""
    rows = [_row(motion, names, complex_names) for motion in motions]
    # The first row tells the columns, which are the same for all motions of a system.
    write_csv(path, rows[0] if rows else ["kind"], (row.values() for row in rows))


def _row(motion: "Motion", names: Names, complex_names: Names) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for name, values in _state(motion).items():
        row |= {entry: repr(float(values[index])) for entry, index in entries(name, values.shape).items()}  # all digits
    for name in names:
        values = np.asarray(getattr(motion, name))
        row |= {entry: values[index].item() for entry, index in entries(name, values.shape).items()}
    for name in complex_names:
        for k, value in enumerate(getattr(motion, name)):
            prefix = f"{name.removesuffix('s')}[{k}]"
            row |= {f"{prefix}.real": repr(float(value.real)), f"{prefix}.imaginary": repr(float(value.imag))}
    return row


def _state(motion: "Motion") -> dict[str, np.ndarray]:
    return {name: np.asarray(leaf) for name, leaf in numbers_of(motion.state).items() if np.size(leaf)}


def numbers_of(state: Any) -> dict[str, Any]:
    """Returns the arrays of a state by name, those of the body of a released one first, as its vector has them."""
    return arrays_of(getattr(state, "body", state)) | arrays_of(state)


def _format(values: np.ndarray) -> str:
    return _format_number(float(values)) if values.ndim == 0 else f"({', '.join(map(_format_number, values.tolist()))})"


def _format_number(x: float) -> str:
    return f"{x + 0.0:.6g}" if abs(x) > 1e-12 else "0"


def _complex(value: complex) -> str:
    real, imaginary = (0.0 if abs(part) < 1e-9 else part for part in (value.real, value.imag))
    if not imaginary:
        return f"{real:.6g}"
    return f"{real:.6g}{imaginary:+.6g}i" if real else f"{imaginary:.6g}i"
