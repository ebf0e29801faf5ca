"""The command line: ``jaxball scenarios``, ``simulate``, ``chaos``, ``verify``, ``sweep``, ``design``,
``reproduce``, ``bench``."""

import argparse
import dataclasses
import importlib.metadata
import math
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from . import cpu
from .classical import AbstractClassicalSystem
from .commands import chaos, design, sweep, verify
from .commands.options import BAD_INPUT, FAILED_SOLVE, INTERRUPTED, positive
from .events import AbstractEvent, Detachment, Slip
from .extremes import contact_extremes
from .results import OutputError, check_destination, replacing, save
from .scenario import (
    Scenario,
    ScenarioError,
    builtin_scenarios,
    builtin_text,
    builtin_title,
    load_scenario,
)
from .scenario.solve import SOLVERS
from .simulation import PrecisionError
from .trajectory import Trajectory

ANIMATIONS = (".mp4", ".gif")
FRAMES = 30


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command, and returns its exit code.

    0, 1 for a run that is not to be believed, 2 for bad input, 3 for a solve that failed, 130 for Ctrl-C.
    """
    options = _parser().parse_args(arguments)
    cpu.prepare(gradients=options.gradients)
    jax.config.update("jax_enable_x64", True)
    try:
        return options.run(options)
    except (ScenarioError, OutputError, PrecisionError, OSError) as error:
        print(f"jaxball: {error}", file=sys.stderr)
        return BAD_INPUT


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="jaxball",
        description="Simulates a rolling ball or disk driven by point masses moving inside it.",
    )
    parser.add_argument("--version", action="version", version=f"jaxball {importlib.metadata.version('jaxball')}")
    parser.set_defaults(gradients=False)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_scenarios(commands)
    _add_simulate(commands)
    chaos.add(commands)
    verify.add(commands)
    sweep.add(commands)
    design.add(commands)
    _add_reproduce(commands)
    _add_bench(commands)
    return parser


def _add_scenarios(commands) -> None:
    parser = commands.add_parser("scenarios", help="list the built-in scenarios, or print one as a file")
    parser.add_argument("name", nargs="?", help="the scenario to print")
    parser.set_defaults(run=_scenarios)


def _add_simulate(commands) -> None:
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
    parser.set_defaults(run=_simulate)


def _add_reproduce(commands) -> None:
    parser = commands.add_parser("reproduce", help="reproduce both runs of Putkaradze & Rogers (2018)")
    parser.add_argument("--out", type=Path, default=Path("out"), metavar="FOLDER", help="where to (default: out)")
    parser.set_defaults(run=_reproduce)


def _add_bench(commands) -> None:
    parser = commands.add_parser("bench", help="compare solvers at equal achieved error")
    parser.add_argument("problems", nargs="*", metavar="PROBLEM", help="which problems (default: all)")
    parser.add_argument("--solvers", nargs="+", default=[], metavar="NAME", help="a solver, a package, or words of one")
    parser.add_argument("--tolerances", nargs="+", type=positive, metavar="RTOL", help="default: 1e-4 to 1e-13")
    parser.add_argument("--budget", type=positive, metavar="SECONDS", help="of timed calls for each setting")
    parser.add_argument("--limit", type=positive, metavar="SECONDS", help="leave out what solves more slowly")
    parser.add_argument("--out", type=Path, default=Path("out/bench"), metavar="FOLDER", help="default: out/bench")
    parser.add_argument("--quick", action="store_true", help="two problems, a few solvers, two tolerances")
    parser.add_argument("--list", action="store_true", help="list problems and solvers")
    parser.set_defaults(run=_bench)


def _scenarios(options: argparse.Namespace) -> int:
    if options.name is not None:
        print(builtin_text(options.name), end="")
        return 0
    names = builtin_scenarios()
    width = max(len(name) for name in names)
    for name in names:
        print(f"{name:{width}}  {builtin_title(name)}")
    return 0


def _simulate(options: argparse.Namespace) -> int:
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
        print(f"jaxball: {trajectory.message}{_kept(options.out)}", file=sys.stderr)
        return FAILED_SOLVE
    written = [] if options.out is None else [str(options.out)]
    written += _draw(options, scenario, trajectory)
    print(_summary(scenario, trajectory, written))
    return 0


def _kept(out: Path | None) -> str:
    return "" if out is None else f' What was computed is in "{out}", marked as failed.'


def _reproduce(options: argparse.Namespace) -> int:
    # Imported here, because matplotlib takes longer to import than the other commands need.
    from .reproduce import reproduce

    if options.out.exists() and not options.out.is_dir():
        raise OutputError(f'Argument `--out` must be a folder, but "{options.out}" is a file.')
    reproduce(options.out)
    return 0


def _bench(options: argparse.Namespace) -> int:
    # Imported here, because the problems hold arrays, and the other commands have no use for them.
    from . import bench

    if options.list:
        print(bench.listing())
        return 0
    if options.out.exists() and not options.out.is_dir():
        raise OutputError(f'Argument `--out` must be a folder, but "{options.out}" is a file.')
    try:
        plan = bench.plan(options.problems, options.solvers, quick=options.quick)
    except bench.SelectionError as error:
        print(f"jaxball: {error}", file=sys.stderr)
        return BAD_INPUT
    changes = {
        "tolerances": options.tolerances and tuple(options.tolerances),
        "budget": options.budget,
        "limit": options.limit,
    }
    settings = dataclasses.replace(plan.settings, **{key: value for key, value in changes.items() if value is not None})
    done = bench.bench(plan.problems, plan.contenders, settings, options.out)
    return INTERRUPTED if done.interrupted else 0


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
    from . import plot

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
