"""The periodic motion near a scenario's state, and charts of the stability of such motions."""

import argparse
import dataclasses
import math
import sys
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from ...interface.status import Status
from ...interface.wording import counted
from ...numerics.programs import compiled_quickly
from ...physics.system import AbstractState
from ...scenario import Scenario, ScenarioError, read_document
from ...scenario.body import rolling_state
from ...scenario.checks import message_in_keys
from ...scenario.paths import entries, value_at
from ...simulation.trajectory import Trajectory
from ...stability import PeriodicMotion, periodic_motion
from ...stability.periodic import DEFAULT_TOLERANCE
from ...stability.shooting import countable
from ...sweep.charts import scenario_floquet_chart
from ..chart import Axis
from ..input import scenario_of
from ..jax_setup import compiled_for
from ..options import FAILED_SOLVE, BadInputError
from ..output import say, working
from .chart import ranged, save_chart
from .files import write_json, write_outputs
from .motions import complex_numbers, content, save, state_line

if TYPE_CHECKING:
    import xarray

NAMES = (
    *("period", "turns", "residual", "periodic", "stable", "kind", "growth"),
    *("least_normal_force", "iterations"),
)
COMPLEX = ("multipliers", "exponents")


def run(options: argparse.Namespace, document: dict[str, Any], period: float | str) -> int:
    """Finds the motion of a document, saves it and draws its multipliers."""
    scenario = scenario_of(document, options.scenario)
    state = rolling_state(scenario.state, scenario.contact, "periodic motions are")
    start = float(scenario.times[0])
    if options.after is not None:
        before = _run_before(options, scenario)
        if not before.ok:
            print(f"jaxball: {message_in_keys(before)}", file=sys.stderr)
            return FAILED_SOLVE
        start, state = options.after, jax.tree.map(lambda leaf: leaf[-1], before.state)
    if isinstance(period, str):
        period = 2 * math.pi / float(value_at(document, period))
    try:
        with working(options, "searching for a periodic motion"), compiled_quickly():
            motion = periodic_motion(
                scenario.system,
                state,
                period,
                turns=options.turns,
                t=start,
                rtol=min(scenario.rtol, DEFAULT_TOLERANCE),
                atol=min(scenario.atol, DEFAULT_TOLERANCE),
                iterations=options.iterations,
                max_steps=scenario.max_steps,
            )
    except (ValueError, TypeError) as error:
        raise ScenarioError(str(error)) from None
    motions = [content(motion, (*NAMES, "message"), COMPLEX)]
    write_json(options, {"title": scenario.title, "motions": motions})
    if not motion.periodic:
        print(f"jaxball: {motion.message}", file=sys.stderr)
        return FAILED_SOLVE
    written = write_outputs(
        options,
        scenario,
        lambda path: save([motion], path, NAMES, COMPLEX),
        lambda plot: plot.multipliers([motion]),
    )
    say(options, scenario.title, *_summary(motion), written)
    return 0


def chart(options: argparse.Namespace, document: dict[str, Any], period: float | str, axes: tuple[Axis, Axis]) -> int:
    """Computes the chart of a document, saves it and draws it."""
    with working(options, "computing the chart") as line:

        def report(done: int, cells: int) -> None:
            line.print(f"{done:,} of {cells:,} cells", sys.stderr)

        try:
            chart = scenario_floquet_chart(
                document,
                ranged(axes),
                period,
                iterations=options.iterations,
                progress=None if options.quiet else report,
            )
        except (ValueError, TypeError) as error:
            raise ScenarioError(str(error)) from None
    chart.attrs["title"] = str(document.get("title", ""))
    lines = _chart_summary(chart)
    lines.append(
        write_outputs(
            options,
            read_document(document),
            lambda path: save_chart(chart, path),
            lambda plot: plot.stability_chart(chart),
        )
    )
    write_json(options, {**chart.attrs, **{str(name): chart[name].values for name in chart.variables}})
    say(options, *lines)
    return 0


def _run_before(options: argparse.Namespace, scenario: Scenario) -> Trajectory[Any, Any]:
    """The scenario's run to the time of --after."""
    start = float(scenario.times[0])
    if options.after <= start:
        raise BadInputError(f"Argument `--after` must be after the start, {start:g}, but it is {options.after:g}.")
    before = dataclasses.replace(scenario, times=np.array([start, options.after]))
    with working(options, f"simulating to t = {options.after:g}"), compiled_for(before):
        return before.simulate()


def _summary(motion: PeriodicMotion) -> list[str]:
    angles = zip(_angles(motion.state), motion.turns, strict=True)
    turned = ", ".join(f"{name} {turns}" for name, turns in angles if turns)
    steps = counted(motion.iterations, "step")
    lines = [
        state_line(motion),
        f"  {motion.message}",
        f"period {motion.period:.10g}{turned and f' (turns: {turned})'}, closed to {motion.residual:.1g} after {steps} "
        "of Newton's method",
        f"  multipliers {complex_numbers(motion.multipliers)}",
        f"  exponents {complex_numbers(motion.exponents)}",
    ]
    rolls = np.isfinite(motion.least_normal_force)
    return [*lines, f"  least normal force {motion.least_normal_force:.6g}"] if rolls else lines


def _angles(state: AbstractState) -> list[str]:
    """The names of the components that may gain whole turns."""
    names = [entry for name, leaf in vars(state).items() for entry in entries(name, np.shape(leaf))]
    return [name for name, angle in zip(names, countable(state), strict=True) if angle]


def _chart_summary(chart: "xarray.Dataset") -> list[str]:
    growth, status, closed = (chart[name].values for name in ("growth", "status", "closed"))
    up, right = chart["growth"].dims
    lines = [
        chart.attrs["title"],
        f"The growth rate of deviations from periodic motions at {growth.size:,} pairs of {up} and {right}",
    ]
    if np.any(closed):
        largest = np.unravel_index(np.nanargmax(growth), growth.shape)
        pair = ", ".join(f"{name} = {chart[name].values[k]:g}" for name, k in zip((up, right), largest, strict=True))
        lines.append(f"  from {round(np.nanmin(growth), 6) + 0.0:.6f} to {growth[largest]:.6f}, at {pair}")
        lifted = int(np.sum(closed & (chart["least_normal_force"].values <= 0)))
        lines += [f"  {lifted:,} leave the plane"] if lifted else []
    lost = int(np.sum((status == Status.SUCCESS) & ~closed))
    lines += [f"  {lost:,} where no periodic motion was found"] if lost else []
    counts = ((item, int(np.sum(status == item))) for item in Status if item != Status.SUCCESS)
    return lines + [f"  {number:,} {item.name}" for item, number in counts if number]
