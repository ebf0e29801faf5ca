"""Runs as one HTML file."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...numerics.programs import compiled_quickly
from ...physics.body import AbstractBody, System
from ...results import load_run, saved_scenario
from ...results.files import RunError
from ...scenario import Scenario
from ...simulation.events import AbstractEvent
from ...simulation.trajectory import Trajectory
from ..jax_setup import compiled_for
from ..options import BadInputError
from ..output import working, written_line

if TYPE_CHECKING:
    from ...plot import ColourScale


def run(options: argparse.Namespace) -> int:
    """Writes the view of a saved run, and prints a summary of the run."""
    with working(options, "writing the view"), compiled_quickly():
        run = load_run(options.saved)
        _check(options, run, f'The run "{options.saved}"')
        title = saved_scenario(options.saved).title
        write_view(run, options.out, title, options.friction, all_times=options.all_times)
    return _say(options, run)


def of_design(options: argparse.Namespace) -> int:
    """Writes the view of a design, before and after."""
    from ...design import load_result

    result = load_result(options.saved)
    runs = _simulated(options, {"before": result.before, "after": result.after})
    with working(options, "writing the view"):
        _write(options, runs, result.title, wanted=result.wanted, discs=result.discs)
    return _say(options, *(f"{name}: {run}" for name, run in runs.items()))


def of_sweep(options: argparse.Namespace) -> int:
    """Writes the view of some rows of a sweep."""
    from ... import plot, sweep
    from ...plot.sweeps.axes import title_of

    scenarios = sweep.row_scenarios(options.saved, options.rows)
    data = sweep.open_dataset(options.saved)
    try:
        scale = plot.sweep_scale(data, options.rows, options.colour)
    except plot.PictureError as error:
        raise BadInputError(f"Argument `--colour`: {error}") from None
    named = {f"row {row}": scenario for row, scenario in zip(options.rows, scenarios, strict=True)}
    runs = _simulated(options, named, sweep.row_events(options.saved))
    title = ", ".join([title_of(data), *(named if len(named) == 1 else ())])
    with working(options, "writing the view"):
        _write(options, runs, title, scale=scale)
    return _say(options, title, *(f"  {name}: {run.message}" for name, run in runs.items()))


def is_known(trajectory: Trajectory[Any, Any]) -> bool:
    """Whether there is a saved time at which the state is known."""
    from ...plot.record import finite_rows  # here, as below

    return finite_rows(trajectory).size > 0


def write_view(
    trajectory: Trajectory[Any, Any], path: Path, title: str, friction: float | None, *, all_times: bool = False
) -> None:
    """Writes the view of a run."""
    # Imported here, because importing matplotlib takes longer than many runs.
    from ... import plot

    plot.write_view(trajectory, path, title, friction=friction, all_times=all_times)


def _check(options: argparse.Namespace, trajectory: Trajectory[Any, Any], what: str) -> None:
    if not is_known(trajectory):
        raise RunError(f"{what} has no finite state to show. {trajectory.message}")
    if options.friction is not None and not isinstance(trajectory.system, AbstractBody):
        raise BadInputError(
            "Argument `--friction` must be left out for a system that touches no plane, such as a "
            f"{trajectory.system.title}, but it is {options.friction:g}."
        )


def _simulated(
    options: argparse.Namespace, scenarios: Mapping[str, Scenario], events: Mapping[str, AbstractEvent] | None = None
) -> dict[str, Trajectory[Any, Any]]:
    """The runs of scenarios by their names."""
    runs = {}
    for name, scenario in scenarios.items():
        with working(options, f"simulating {name}"), compiled_for(scenario):
            runs[name] = scenario.simulate(events=events)
        _check(options, runs[name], f'The run "{name}"')
    return runs


def _write(
    options: argparse.Namespace,
    runs: Mapping[str, Trajectory[Any, Any]],
    title: str,
    *,
    wanted: Any = None,
    discs: Any = (),
    scale: "ColourScale | None" = None,
) -> None:
    """Writes several runs; those of bodies that roll must be on one plane."""
    from ... import plot
    from ...plot.view.rolling import other_ground

    rolling = [run.system for run in runs.values() if isinstance(run.system, System)]
    other = other_ground(rolling)
    if other is not None:
        names = list(runs)
        raise RunError(
            f'The runs of "{options.saved}" must be on the same plane to be shown together, but the plane of '
            f'"{names[other]}" differs from that of "{names[0]}".'
        )
    plot.write_view(
        runs,
        options.out,
        title,
        friction=options.friction,
        wanted=wanted,
        discs=discs,
        scale=scale,
        all_times=options.all_times,
    )


def _say(options: argparse.Namespace, *lines: object) -> int:
    if not options.quiet:
        print("\n".join([*map(str, lines), written_line([options.out])]))
    return 0
