"""The animation that ``jaxball simulate --animate`` makes, its options, and the run that it shows."""

import argparse
import dataclasses
import math
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.scenario.errors import ScenarioError
from ..interface.output import OutputError, check_destination
from .options import count, number, positive, refuse, working

if TYPE_CHECKING:
    from ..files.scenario.scenario import Scenario
    from ..simulation.trajectory import Trajectory

SUFFIXES = (".mp4", ".gif")
# A GIF counts in hundredths of a second; players ignore delays of a single one.
MOST_FRAMES_A_SECOND = {".mp4": 240, ".gif": 50}
SMALLEST_SIDE, LARGEST_SIDE = 64, 7680
OPTIONS = ("fps", "speed", "size", "from", "to")


def add_animation(parser: argparse.ArgumentParser) -> None:
    """Adds --animate and its options."""
    parser.add_argument("--animate", type=Path, metavar="FILE", help="write an animation: .mp4 or .gif")
    parser.add_argument("--fps", type=count, help="frames per second of the animation (default: 30, or 20 in a GIF)")
    parser.add_argument("--speed", type=positive, help="units of time per second of the animation (default: 1)")
    parser.add_argument("--size", type=_size, metavar="WIDTHxHEIGHT", help="its size in pixels, as in 1280x720")
    parser.add_argument("--from", type=number, metavar="T", help="start of the animation (default: that of the run)")
    parser.add_argument("--to", type=number, metavar="T", help="end of the animation (default: that of the run)")


def check_animation(options: argparse.Namespace) -> None:
    """Raises an :class:`~jaxball.files.results.OutputError` for an animation that is impossible for any run."""
    if options.animate is None:
        refuse(options, OPTIONS, "is for an animation; give --animate FILE with it.")
        return
    check_destination(options.animate, SUFFIXES, "--animate")
    suffix = options.animate.suffix
    # Not by `has_ffmpeg`, because matplotlib takes long to import, and all refusals come before.
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise OutputError(
            f'Argument `--animate` must end in .gif where ffmpeg is not installed, but it is "{options.animate}"; '
            "install ffmpeg, or make a .gif."
        )
    if options.fps is not None and options.fps > MOST_FRAMES_A_SECOND[suffix]:
        raise OutputError(
            f"Argument `--fps` must be at most {MOST_FRAMES_A_SECOND[suffix]} for {suffix}, but it is {options.fps}."
        )


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    size = (int(match[1]), int(match[2])) if match else (0, 0)
    if not all(SMALLEST_SIDE <= side <= LARGEST_SIDE for side in size):
        raise argparse.ArgumentTypeError(
            f"it must be WIDTHxHEIGHT in pixels, each from {SMALLEST_SIDE} to {LARGEST_SIDE}, as in 1280x720, "
            f"but it is {text}"
        )
    return size


def check_span(options: argparse.Namespace, scenario: "Scenario") -> None:
    """Raises an error with one sentence for an animation that is impossible for this scenario's run."""
    from ..physics.body import AbstractBody

    if options.animate is None:
        return
    if not isinstance(scenario.system, AbstractBody):
        raise OutputError(
            f"Argument `--animate` must be left out for a {scenario.system.title}, which is not animated, but it "
            f'is "{options.animate}"; use --plot or --out.'
        )
    if scenario.feedback is not None:
        raise OutputError(
            "Argument `--animate` must be left out for a scenario with feedback, whose states are known at its samples "
            f'alone, but it is "{options.animate}"; use --view.'
        )
    start, end = float(scenario.times[0]), float(scenario.times[-1])
    first, last = _span(options, scenario)
    if not start <= first < last <= end:
        raise ScenarioError(
            f"Arguments `--from` and `--to` must be times of the run, from {start:g} to {end:g}, one after the other, "
            f"but they are {first:g} and {last:g}."
        )


def write_animation(options: argparse.Namespace, scenario: "Scenario") -> None:
    """Writes the animation."""
    from ..plot.animation import FRAMES  # here, because importing matplotlib takes longer than many runs

    speed, fps = options.speed or 1.0, options.fps or FRAMES[options.animate.suffix]
    with working(options, "animating") as line:
        run = _run_with_frames(scenario, *_span(options, scenario), speed / fps)

        def report(done: int, frames: int) -> None:
            line.change(f"animating: {done:,} of {frames:,} frames")

        run.animate(options.animate, fps, speed=speed, size=options.size, progress=report)


def _span(options: argparse.Namespace, scenario: "Scenario") -> tuple[float, float]:
    ends = float(scenario.times[0]), float(scenario.times[-1])
    first, last = getattr(options, "from"), options.to
    return ends[0] if first is None else first, ends[1] if last is None else last


def _run_with_frames(scenario: "Scenario", first: float, last: float, step: float) -> "Trajectory[Any, Any]":
    """Repeats the run, saved once for each frame, from ``first`` to ``last``."""
    import jax
    import numpy as np

    # Less a rounding error, so that a whole number of frames does not become one more.
    times = np.linspace(first, last, math.ceil((last - first) / step - 1e-9) + 1)
    if first == float(scenario.times[0]):
        return dataclasses.replace(scenario, times=times).simulate()
    # The run begins where the scenario does, also when the animation begins later.
    times = np.concatenate([scenario.times[:1], times])
    run = dataclasses.replace(scenario, times=times).simulate()
    later = slice(1, None)
    state = jax.tree.map(lambda leaf: leaf[later], run.state)
    return dataclasses.replace(run, times=run.times[later], state=state, history=run.history.at_rows(later))
