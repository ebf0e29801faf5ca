"""``jaxball simulate``: a scenario simulated, saved and drawn."""

import argparse
import dataclasses
import math
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..classical import AbstractClassicalSystem
from ..events import AbstractEvent, Detachment, Slip
from ..extremes import contact_extremes
from ..results import OutputError, check_destination, replacing, save
from ..scenario import Scenario, ScenarioError, load_scenario
from ..scenario.shell import message_in_keys
from ..scenario.solve import SOLVERS
from ..trajectory import Trajectory
from .options import FAILED_SOLVE, positive

ANIMATIONS = (".mp4", ".gif")
FRAMES = 30


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser("simulate", help="simulate a scenario")
    parser.add_argument("scenario", metavar="FILE|NAME", help="a scenario file, or a built-in scenario")
    parser.add_argument("--out", type=Path, metavar="FILE", help="save the trajectory: .nc, .npz or .csv")
    parser.add_argument("--plot", type=Path, metavar="FOLDER", help="draw the figures into this folder")
    parser.add_argument("--animate", type=Path, metavar="FILE", help="make an animation: .mp4 or .gif")
    parser.add_argument("--solver", choices=SOLVERS, help="instead of the scenario's")
    parser.add_argument("--rtol", type=positive, help="relative tolerance, instead of the scenario's")
    parser.add_argument("--atol", type=positive, help="absolute tolerance, instead of the scenario's")
    parser.add_argument("--friction", type=positive, metavar="MU", help="end where more friction than this is needed")
    parser.add_argument("--detachment", action="store_true", help="end where the ball would leave the plane")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    _check_destinations(options)
    changes = {name: getattr(options, name) for name in ("solver", "rtol", "atol")}
    changes = {name: value for name, value in changes.items() if value is not None}
    scenario = dataclasses.replace(load_scenario(options.scenario), **changes)
    _check_animation(options, scenario)
    touches = not isinstance(scenario.system, AbstractClassicalSystem)
    trajectory = scenario.simulate(dense=touches, events=_events(options, scenario))
    if options.out is not None:
        save(trajectory, options.out, scenario)
    if not trajectory.ok:
        print(f"jaxball: {message_in_keys(trajectory)}{_kept(options.out)}", file=sys.stderr)
        return FAILED_SOLVE
    written = [] if options.out is None else [str(options.out)]
    written += _draw(options, scenario, trajectory)
    print(_summary(scenario, trajectory, written))
    return 0


def _kept(out: Path | None) -> str:
    return "" if out is None else f' What was computed is in "{out}", marked as failed.'


def _check_destinations(options: argparse.Namespace) -> None:
    if options.out is not None:
        check_destination(options.out)
    if options.plot is not None and options.plot.exists() and not options.plot.is_dir():
        raise OutputError(f'Argument `--plot` must be a folder, but "{options.plot}" is a file.')
    if options.animate is not None:
        check_destination(options.animate, ANIMATIONS)
        if options.animate.suffix == ".mp4" and shutil.which("ffmpeg") is None:
            raise OutputError(
                f'Argument `--animate` must end in .gif where ffmpeg is not installed, but it is "{options.animate}".'
            )


def _check_animation(options: argparse.Namespace, scenario: Scenario) -> None:
    if options.animate is not None and isinstance(scenario.system, AbstractClassicalSystem):
        raise OutputError(
            f"Argument `--animate` must be left out for a {scenario.system.title}, which has no shell to draw, but it "
            f'is "{options.animate}"; use --plot or --out.'
        )


def _draw(options: argparse.Namespace, scenario: Scenario, trajectory: Trajectory) -> list[str]:
    if options.plot is None and options.animate is None:
        return []
    from .. import plot

    written = []
    if options.plot is not None:
        paths = plot.figures(trajectory, options.plot)
        written.append(f"{len(paths)} figures in {options.plot}")
    if options.animate is not None:
        with replacing(options.animate) as beside:
            plot.animate(_for_film(scenario), beside, fps=FRAMES)
        written.append(str(options.animate))
    return written


def _for_film(scenario: Scenario) -> Trajectory:
    """The run again, saved as often as a film has frames."""
    start, end = float(scenario.times[0]), float(scenario.times[-1])
    times = np.linspace(start, end, math.ceil(FRAMES * (end - start)) + 1)
    return dataclasses.replace(scenario, times=times).simulate()


def _summary(scenario: Scenario, trajectory: Trajectory, written: Sequence[str]) -> str:
    lines = [str(trajectory)]
    if scenario.title:
        lines.insert(0, scenario.title)
    lines += _laws(trajectory) if isinstance(scenario.system, AbstractClassicalSystem) else _contact(trajectory)
    if written:
        lines.append("  written: " + ", ".join(written))
    return "\n".join(lines)


def _events(options: argparse.Namespace, scenario: Scenario) -> dict[str, AbstractEvent]:
    found: dict[str, AbstractEvent] = {}
    if options.friction is not None:
        found["slip"] = Slip(options.friction)
    if options.detachment:
        found["detachment"] = Detachment()
    if found and isinstance(scenario.system, AbstractClassicalSystem):
        raise ScenarioError(
            "Arguments `--friction` and `--detachment` must be left out for what touches no plane, such as the "
            f"{scenario.system.title} of this scenario."
        )
    return found


def _contact(trajectory: Trajectory) -> list[str]:
    return [f"  {line}" for line in str(contact_extremes(trajectory)).splitlines()]


def _laws(trajectory: Trajectory[Any, Any]) -> list[str]:
    found = {name: np.asarray(values) for name, values in trajectory.laws._asdict().items()}
    drifts = (f"{name} {np.max(np.abs(values - values[0])):.1e}" for name, values in found.items())
    return ["  change of the laws: " + ", ".join(drifts)]
