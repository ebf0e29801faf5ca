"""``jaxball view``: a saved run, a design or rows of a sweep as one HTML file."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...files.results.files import READ_BACK, RunError, check_saved
from ...interface.output import MOST_BODIES, check_view
from ...interface.wording import number_of
from ..input import refuse_document
from ..jax_setup import compile_for, set_up_jax
from ..options import BadInputError, add_quiet, name_files, positive, refuse, say, working
from .sweep import require_packages

if TYPE_CHECKING:
    from ...files.scenario.scenario import Scenario
    from ...simulation.events import AbstractEvent
    from ...simulation.trajectory import Trajectory

DESIGN, SWEEP = "design.toml", "zarr.json"  # by which folders are recognised


def add(parser: argparse.ArgumentParser) -> None:
    parser.usage = (
        "jaxball view RUN --out FILE [--friction MU] [--all-times]\n"
        "       jaxball view DESIGN --out FILE [--friction MU] [--all-times]\n"
        "       jaxball view STORE --rows K,K,... [--colour NUMBER] --out FILE [--friction MU] [--all-times]"
    )
    parser.description = (
        "Writes a saved run as one HTML file, as `jaxball simulate --view` does: the body in "
        "three dimensions, played or stepped through, with graphs over time. For the folder of a design, it shows "
        "the runs before and after; for the store of a sweep, the rows given by --rows. The file needs no network."
    )
    parser.add_argument("saved", type=Path, metavar="RUN", help="a saved run, or the folder of a design or a sweep")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the file to write: .html")
    parser.add_argument("--friction", type=positive, metavar="MU", help="draw the cone of this coefficient of friction")
    parser.add_argument("--rows", type=_rows, metavar="K,K,...", help="the rows of a sweep, as in 3,17,40")
    parser.add_argument("--colour", metavar="NUMBER", help="number that colours them, such as body.mass or z[0]")
    parser.add_argument("--all-times", action="store_true", help="show all saved times of a long run, in a large file")
    add_quiet(parser)


def run(options: argparse.Namespace) -> int:
    check_view(options.out, "--out")
    kind = _kind(options.saved)
    if kind == SWEEP:
        if options.rows is None:
            raise BadInputError(f'Argument `--rows` must say which rows of "{options.saved}" to show, as in 3,17,40.')
        require_packages(("zarr", "google_crc32c"))
    else:
        refuse(options, ("rows", "colour"), f'is for the store of a sweep, which "{options.saved}" is not.')
    set_up_jax()
    lines = {DESIGN: _of_design, SWEEP: _of_sweep}.get(kind, _of_run)(options)
    say(options, *lines, name_files([options.out]))
    return 0


def _kind(path: Path) -> str:
    """Returns what there is to show: the name of the file that identifies a folder, empty for a file."""
    if not path.is_dir():
        refuse_document(path)
        check_saved(path)
        return ""
    for name in (DESIGN, SWEEP):
        if (path / name).is_file():
            return name
    raise RunError(
        f"What is shown must be a run in a {' or '.join(READ_BACK)} file, or the folder of a design or of a sweep, but "
        f'"{path}" is a folder without a {DESIGN} or a {SWEEP}.'
    )


def _rows(text: str) -> tuple[int, ...]:
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdecimal() and part.isascii() for part in parts):
        raise argparse.ArgumentTypeError(f"it must be row numbers separated by commas, but it is {text}")
    rows = tuple(int(part) for part in parts)
    if len(set(rows)) < len(rows) or len(rows) > MOST_BODIES:
        number = number_of(len(rows), "row") + " with one twice" * (len(set(rows)) < len(rows))
        raise argparse.ArgumentTypeError(f"it must be up to {MOST_BODIES} different rows, but it is {number}")
    return rows


def _of_run(options: argparse.Namespace) -> list[object]:
    """Writes the view of a saved run, and prints a summary of the run."""
    from ... import plot
    from ...files.results import saved_scenario
    from ...files.results.loading import load_run
    from ...programs.program import compile_quickly

    with working(options, "writing the view"), compile_quickly():
        run = load_run(options.saved)
        _check(options, run, f'The run "{options.saved}"')
        title = saved_scenario(options.saved).title
        plot.write_view(run, options.out, title, friction=options.friction, all_times=options.all_times)
    return [run]


def _of_design(options: argparse.Namespace) -> list[object]:
    """Writes the view of a design, before and after."""
    from ...studies.design import load_result

    result = load_result(options.saved)
    runs = _simulate(options, {"before": result.before, "after": result.after})
    _write(options, runs, result.title, wanted=result.wanted, discs=result.discs)
    return [f"{name}: {run}" for name, run in runs.items()]


def _of_sweep(options: argparse.Namespace) -> list[object]:
    """Writes the view of some rows of a sweep."""
    from ... import plot
    from ...plot.sweeps.axes import title_of
    from ...plot.sweeps.rows import sweep_scale
    from ...studies import sweep

    store = sweep.open_store(options.saved)
    scenarios, data = store.scenarios(options.rows), store.dataset()
    try:
        scale = sweep_scale(data, options.rows, options.colour)
    except plot.PictureError as error:
        raise BadInputError(f"Argument `--colour`: {error}") from None
    named = {f"row {row}": scenario for row, scenario in zip(options.rows, scenarios, strict=True)}
    runs = _simulate(options, named, store.events())
    title = ", ".join([title_of(data), *(named if len(named) == 1 else ())])
    _write(options, runs, title, scale=scale)
    return [title, *(f"  {name}: {run.message}" for name, run in runs.items())]


def _check(options: argparse.Namespace, trajectory: "Trajectory[Any, Any]", what: str) -> None:
    from ...physics.body import AbstractBody
    from ...plot.record import finite_rows
    from ..files import check_shown

    check_shown(trajectory.system, "What is shown")
    if not finite_rows(trajectory).size:
        raise RunError(f"{what} has no finite state to show. {trajectory.message}")
    if options.friction is not None and not isinstance(trajectory.system, AbstractBody):
        raise BadInputError(
            "Argument `--friction` must be left out for a system that is no ball or disk, such as a "
            f"{trajectory.system.title}, but it is {options.friction:g}."
        )


def _simulate(
    options: argparse.Namespace,
    scenarios: Mapping[str, "Scenario"],
    events: "Mapping[str, AbstractEvent] | None" = None,
) -> "dict[str, Trajectory[Any, Any]]":
    """Simulates scenarios, and returns their runs by name."""
    runs = {}
    for name, scenario in scenarios.items():
        with working(options, f"simulating {name}"), compile_for(scenario):
            runs[name] = scenario.simulate(events=events)
        _check(options, runs[name], f'The run "{name}"')
    return runs


def _write(options: argparse.Namespace, runs: "Mapping[str, Trajectory[Any, Any]]", title: str, **more: Any) -> None:
    """Writes several runs, with ``more`` of :func:`~jaxball.plot.write_view`; bodies that roll share one ground."""
    from ... import plot
    from ...physics.body import System
    from ...plot.view.rolling import other_ground

    rolling = [run.system for run in runs.values() if isinstance(run.system, System)]
    # Here and not only in `write_view`, which would name its own argument instead of the files.
    other = other_ground(rolling)
    if other is not None:
        names = list(runs)
        raise RunError(
            f'The runs of "{options.saved}" must be on the same ground to be shown together, but the ground of '
            f'"{names[other]}" differs from that of "{names[0]}".'
        )
    with working(options, "writing the view"):
        plot.write_view(runs, options.out, title, friction=options.friction, all_times=options.all_times, **more)
