"""``jaxball simulate``: a scenario simulated, saved and drawn."""

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ...interface.output import check_destination
from ...physics.body import AbstractBody
from ...results import SUFFIXES, save
from ...results.provenance import attributes
from ...scenario import Scenario, ScenarioError
from ...scenario.shell import message_in_keys
from ...scenario.solve import SOLVERS, check_dae
from ...simulation.events import AbstractEvent, Detachment, Slip
from ...simulation.extremes import contact_extremes
from ...simulation.trajectory import Trajectory
from ..animation import add_animation, check_animation, write_animation
from ..input import add_scenario, scenario_of
from ..options import FAILED_SOLVE, number, positive
from ..output import (
    add_formats,
    add_output,
    check_figures_folder,
    check_json,
    draw_figures,
    say,
    write_json,
    written_line,
)


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser("simulate")
    add_scenario(parser)
    parser.add_argument("--end", type=number, metavar="T", help="end at this time, instead of the scenario's")
    parser.add_argument("--out", type=Path, metavar="FILE", help="save the trajectory: .nc, .npz or .csv")
    parser.add_argument("--plot", type=Path, metavar="FOLDER", help="draw the figures into this folder")
    add_formats(parser, "--plot-format")
    add_animation(parser)
    parser.add_argument(
        "--solver", choices=SOLVERS, metavar="SOLVER", help=f"instead of the scenario's: {', '.join(SOLVERS)}"
    )
    parser.add_argument("--rtol", type=positive, help="relative tolerance, instead of the scenario's")
    parser.add_argument("--atol", type=positive, help="absolute tolerance, instead of the scenario's")
    parser.add_argument("--friction", type=positive, metavar="MU", help="end where more friction than this is needed")
    parser.add_argument("--detachment", action="store_true", help="end where the ball would leave the plane")
    add_output(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    _check_destinations(options)
    changes = {name: getattr(options, name) for name in ("solver", "rtol", "atol")}
    changes = {name: value for name, value in changes.items() if value is not None}
    scenario = dataclasses.replace(scenario_of(options, options.end), **changes)
    if options.solver is not None:
        check_dae(scenario.system, options.solver, scenario.dae, "Argument `--solver`")
    check_animation(options, scenario)
    touches = isinstance(scenario.system, AbstractBody)
    trajectory = scenario.simulate(dense=touches, events=_events(options, scenario))
    if options.out is not None:
        save(trajectory, options.out, scenario)
    if not trajectory.ok:
        write_json(options, _content(scenario, trajectory))
        saved = "" if options.out is None else f' What was computed is in "{options.out}", marked as failed.'
        print(f"jaxball: {message_in_keys(trajectory)}{saved}", file=sys.stderr)
        return FAILED_SOLVE
    written = [] if options.out is None else [str(options.out)]
    written += _draw(options, scenario, trajectory)
    write_json(options, _content(scenario, trajectory))
    checks = _contact(trajectory) if isinstance(scenario.system, AbstractBody) else _conservation(trajectory)
    say(options, scenario.title, trajectory, *checks, written_line(written))
    return 0


def _check_destinations(options: argparse.Namespace) -> None:
    check_json(options)
    if options.out is not None:
        check_destination(options.out, SUFFIXES, "--out")
    check_figures_folder(options, "plot", "plot_format")


def _draw(options: argparse.Namespace, scenario: Scenario, trajectory: Trajectory) -> list[str]:
    written = []
    if options.plot is not None:
        written.append(draw_figures(trajectory, options.plot, options.plot_format, scenario.title))
    if options.animate is not None:
        write_animation(options, scenario)
        written.append(str(options.animate))
    return written


def _content(scenario: Scenario, trajectory: Trajectory[Any, Any]) -> dict[str, Any]:
    """The summary as JSON: the attributes of a result file, and the state at the end."""
    about = {name: value for name, value in attributes(trajectory, scenario).items() if name != "format"}
    end = {name: np.asarray(leaf)[-1] for name, leaf in vars(trajectory.state).items()}
    content = {**about, "ok": trajectory.ok, "time": float(trajectory.times[-1]), "state": end}
    if not isinstance(scenario.system, AbstractBody):
        content["law_changes"] = _law_changes(trajectory)
    return content


def _events(options: argparse.Namespace, scenario: Scenario) -> dict[str, AbstractEvent]:
    events: dict[str, AbstractEvent] = {}
    if options.friction is not None:
        events["slip"] = Slip(options.friction)
    if options.detachment:
        events["detachment"] = Detachment()
    if events and not isinstance(scenario.system, AbstractBody):
        raise ScenarioError(
            "Arguments `--friction` and `--detachment` must be left out for a system that touches no plane, such as "
            f"the {scenario.system.title} of this scenario."
        )
    return events


def _contact(trajectory: Trajectory) -> list[str]:
    return [f"  {line}" for line in str(contact_extremes(trajectory)).splitlines()]


def _conservation(trajectory: Trajectory[Any, Any]) -> list[str]:
    changes = (f"{name} {change:.1e}" for name, change in _law_changes(trajectory).items())
    return ["  change of conserved quantities: " + ", ".join(changes)]


def _law_changes(trajectory: Trajectory[Any, Any]) -> dict[str, float]:
    """The largest change of each conserved quantity since the start."""
    laws = {name: np.asarray(values) for name, values in trajectory.laws._asdict().items()}
    return {name: float(np.max(np.abs(values - values[0]))) for name, values in laws.items()}
