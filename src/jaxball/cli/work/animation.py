"""The animation that ``jaxball simulate --animate`` makes, and the run that it shows."""

import argparse
import dataclasses
import math

import jax
import numpy as np

from ...interface.output import OutputError
from ...physics.body import AbstractBody
from ...scenario import Scenario, ScenarioError
from ...simulation.trajectory import Trajectory
from ..output import working


def check_against(options: argparse.Namespace, scenario: Scenario) -> None:
    """Raises an error with one sentence for an animation that is impossible for this scenario's run."""
    if options.animate is None:
        return
    if not isinstance(scenario.system, AbstractBody):
        raise OutputError(
            f"Argument `--animate` must be left out for a {scenario.system.title}, which has no shell to draw, but it "
            f'is "{options.animate}"; use --plot or --out.'
        )
    start, end = float(scenario.times[0]), float(scenario.times[-1])
    first, last = _span(options, scenario)
    if not start <= first < last <= end:
        raise ScenarioError(
            f"Arguments `--from` and `--to` must be times of the run, from {start:g} to {end:g}, one after the other, "
            f"but they are {first:g} and {last:g}."
        )


def write_animation(options: argparse.Namespace, scenario: Scenario) -> None:
    """Writes the animation."""
    # Imported here, because importing matplotlib takes longer than many runs.
    from ...plot.animation import FRAMES, animate

    speed, fps = options.speed or 1.0, options.fps or FRAMES[options.animate.suffix]
    with working(options, "animating") as line:
        run = _run_with_frames(scenario, *_span(options, scenario), speed / fps)

        def report(done: int, frames: int) -> None:
            line.change(f"animating: {done:,} of {frames:,} frames")

        animate(run, options.animate, fps, speed=speed, size=options.size, progress=report)


def _span(options: argparse.Namespace, scenario: Scenario) -> tuple[float, float]:
    ends = float(scenario.times[0]), float(scenario.times[-1])
    first, last = getattr(options, "from"), options.to
    return ends[0] if first is None else first, ends[1] if last is None else last


def _run_with_frames(scenario: Scenario, first: float, last: float, step: float) -> Trajectory:
    """The run again, saved once for each frame, from ``first`` to ``last``."""
    times = np.linspace(first, last, math.ceil((last - first) / step - 1e-9) + 1)
    if first == float(scenario.times[0]):
        return dataclasses.replace(scenario, times=times).simulate()
    times = np.concatenate([scenario.times[:1], times])
    run = dataclasses.replace(scenario, times=times).simulate()
    later = slice(1, None)
    contact = None if run.contact is None else run.contact.at_rows(later)
    state = jax.tree.map(lambda leaf: leaf[later], run.state)
    return dataclasses.replace(run, times=run.times[later], state=state, contact=contact)
