"""A run as one HTML file."""

import argparse
from pathlib import Path
from typing import Any

from ...interface.output import OutputError
from ...numerics.programs import compiled_quickly
from ...physics.body import AbstractBody
from ...results import load_run, saved_scenario
from ...results.files import RunError
from ...scenario import Scenario
from ...simulation.trajectory import Trajectory
from ..output import working, written_line


def run(options: argparse.Namespace) -> int:
    """Writes the view, and prints the run."""
    with working(options, "writing the view"), compiled_quickly():
        run = load_run(options.saved)
        if not isinstance(run.system, AbstractBody):
            raise RunError(
                f'The run "{options.saved}" is of a {run.system.title}, which has no shell to show; `jaxball plot` '
                "draws its motion."
            )
        if not is_known(run):
            raise RunError(f'The run "{options.saved}" has no finite state to show. {run.message}')
        write_view(run, options.out, saved_scenario(options.saved).title, options.friction)
    if not options.quiet:
        print(f"{run}\n{written_line([options.out])}")
    return 0


def check_against(options: argparse.Namespace, scenario: Scenario) -> None:
    """Raises an :class:`~jaxball.results.OutputError` for a view that cannot be made of this scenario's run."""
    if options.view is not None and not isinstance(scenario.system, AbstractBody):
        raise OutputError(
            f"Argument `--view` must be left out for a {scenario.system.title}, which has no shell to show, but it is "
            f'"{options.view}"; use --plot or --out.'
        )


def is_known(trajectory: Trajectory[Any, Any]) -> bool:
    """Whether there is a saved time at which the state is known."""
    from ...plot.record import finite_rows  # here, as below

    return finite_rows(trajectory).size > 0


def write_view(trajectory: Trajectory[Any, Any], path: Path, title: str, friction: float | None) -> None:
    """Writes the view of a run."""
    # Imported here, because matplotlib takes longer to import than many a run.
    from ... import plot

    plot.write_view(trajectory, path, title, friction=friction)
