"""``jaxball periodic``: the periodic motion near a scenario's state, its Floquet multipliers, and charts of them."""

import argparse
import dataclasses
import functools
import math
import sys
from typing import TYPE_CHECKING, Any

from ...files.scenario.errors import ScenarioError
from ...files.scenario.paths import check_number, entries, value_at
from ...interface.status import Status
from ...interface.wording import number_of
from ..input import add_scenario, refuse_settings, scenario_document, scenario_of
from ..jax_setup import compile_for, set_up_jax
from ..options import (
    CHART_AXIS,
    FAILED_SOLVE,
    BadInputError,
    ChartAxis,
    add_results,
    chart_axes,
    check_outputs,
    count,
    number,
    positive,
    refuse,
    working,
)

if TYPE_CHECKING:
    import xarray

    from ...analysis.stability.periodic import PeriodicMotion

ITERATIONS = 20
NAMES = ("period", "turns", "residual", "ok", "stable", "kind", "growth", "least_normal_force", "iterations")
COMPLEX = ("multipliers", "exponents")


UNUSED = ("solver", "max_step", "step_to_times", "dae", "project")  # settings of a solve


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Finds a periodic motion near the scenario's initial state by Newton's method, and its Floquet "
        "multipliers, the factors by which deviations change in a period, which decide its stability. Position and "
        "heading need not return if nothing depends on them, and angles return up to whole turns. Solved to "
        "1e-11, or to the scenario's tolerances if these are tighter."
    )
    add_scenario(parser)
    period = parser.add_mutually_exclusive_group(required=True)
    period.add_argument(
        "--period",
        type=positive,
        metavar="T",
        help="the period; an estimate, unless the equations depend on time, as with a schedule: then the exact value",
    )
    period.add_argument(
        "--frequency",
        type=_frequency,
        metavar="OMEGA|PATH",
        help="the angular frequency 2 pi / T instead, or its path in the scenario, as in "
        "'ground.motion.free.frequency[0]'",
    )
    parser.add_argument(
        "--after", type=number, metavar="T", help="start from the state of the scenario's run at this time"
    )
    parser.add_argument(
        "--turns",
        type=int,
        nargs="+",
        metavar="N",
        help="number of whole turns that each angle gains in a period (default: the nearest)",
    )
    parser.add_argument(
        "--iterations", type=count, metavar="N", help=f"maximum number of Newton steps (default: {ITERATIONS})"
    )
    parser.add_argument(
        "--chart",
        nargs=2,
        metavar=CHART_AXIS,
        help="compute a chart instead: the growth rate of deviations over two numbers, as in "
        "'body.offset[2]=-0.3:-0.1:20' resistance.rolling=0:0.5:20",
    )
    add_results(parser, "the numbers: .csv, or .nc for a chart", "the multipliers, or the chart")


def run(options: argparse.Namespace) -> int:
    if options.chart is not None:
        refuse(options, ("after", "turns"), "is for one motion; leave it out with --chart.")
    check_outputs(options, (".csv",) if options.chart is None else (".nc", ".csv"))
    axes = None if options.chart is None else chart_axes(options)
    # The run of --after uses all.
    refuse_settings(options, "periodic", UNUSED if options.after is None else ())
    document = scenario_document(options)
    period = _period(options, document)
    options.iterations = options.iterations or ITERATIONS
    set_up_jax()
    return _motion(options, document, period) if axes is None else _chart(options, document, period, axes)


def _period(options: argparse.Namespace, document: dict[str, Any]) -> float | str:
    """Returns the period, or the path of an angular frequency that the document has."""
    if options.period is not None:
        return options.period
    if isinstance(options.frequency, str):
        check_number(document, options.frequency)
        return options.frequency
    return 2 * math.pi / options.frequency


def _frequency(text: str) -> float | str:
    try:
        float(text)
    except ValueError:
        return text.strip()
    return positive(text)


def _motion(options: argparse.Namespace, document: dict[str, Any], period: float | str) -> int:
    """Finds the motion of a document, saves it and draws its multipliers."""
    import jax
    import numpy as np

    from ...analysis.stability import periodic_motion
    from ...analysis.stability.periodic import PERIODIC_TOLERANCE
    from ...files.scenario.body import require_whole_run
    from ...files.scenario.checks import message_in_keys
    from ...physics.contact.released import ReleasedState
    from ...programs.program import compile_quickly
    from ..files import motion_content, report, save_motions

    scenario = scenario_of(document, options.scenario)
    require_whole_run(scenario, "periodic motions are")
    state = scenario.state
    start = float(scenario.times[0])
    if options.after is not None:
        if options.after <= start:
            raise BadInputError(f"Argument `--after` must be after the start, {start:g}, but it is {options.after:g}.")
        before = dataclasses.replace(scenario, times=np.array([start, options.after]))
        with working(options, f"simulating to t = {options.after:g}"), compile_for(before):
            before = before.simulate()
        if not before.ok:
            print(f"jaxball: {message_in_keys(before)}", file=sys.stderr)
            return FAILED_SOLVE
        start, state = options.after, jax.tree.map(lambda leaf: leaf[-1], before.state)
        if before.contact is not None:
            state = ReleasedState(state, before.contact.V[-1], before.contact.height[-1])
    if isinstance(period, str):
        period = 2 * math.pi / float(value_at(document, period))
    try:
        with working(options, "searching for a periodic motion"), compile_quickly():
            motion = periodic_motion(
                scenario.system,
                state,
                period,
                contact=scenario.contact,
                turns=options.turns,
                t=start,
                # Multipliers are derivatives of the motion, and need it more exactly than a figure does.
                rtol=min(scenario.rtol, PERIODIC_TOLERANCE),
                atol=min(scenario.atol, PERIODIC_TOLERANCE),
                iterations=options.iterations,
                max_steps=scenario.max_steps,
            )
    except (ValueError, TypeError) as error:
        raise ScenarioError(str(error)) from None
    return report(
        options,
        scenario,
        {"title": scenario.title, "motions": [motion_content(motion, (*NAMES, "message"), COMPLEX)]},
        _summary(motion),
        save=lambda path: save_motions([motion], path, NAMES, COMPLEX),
        draw=lambda plot: plot.eigenvalues([motion]),
        failure="" if motion.ok else motion.message,
    )


def _chart(
    options: argparse.Namespace, document: dict[str, Any], period: float | str, axes: tuple[ChartAxis, ChartAxis]
) -> int:
    """Computes the chart of a document, saves it and draws it."""
    from ...studies.sweep.charts import scenario_floquet_chart
    from ..files import write_chart

    compute = functools.partial(scenario_floquet_chart, document, period=period, iterations=options.iterations)
    try:
        return write_chart(options, document, axes, compute, _chart_summary, lambda plot: plot.chart)
    except (ValueError, TypeError) as error:
        raise ScenarioError(str(error)) from None


def _chart_summary(chart: "xarray.Dataset") -> list[str]:
    from ..files import extremes_of

    closed, status = chart["closed"].values, chart["status"].values
    up, right = chart["growth"].dims
    lines = [f"The growth rate of deviations from periodic motions at {closed.size:,} pairs of {up} and {right}"]
    if closed.any():
        least, largest, _, pair = extremes_of(chart, "growth")
        lines.append(f"  from {round(least, 6) + 0.0:.6f} to {largest:.6f}, at {pair}")
        lifted = int((closed & (chart["least_normal_force"].values <= 0)).sum())
        lines += [f"  {lifted:,} leave the plane"] if lifted else []
    lost = int(((status == Status.SUCCESS) & ~closed).sum())
    return [*lines, f"  {lost:,} where no periodic motion was found"] if lost else lines


def _summary(motion: "PeriodicMotion") -> list[str]:
    from ..files import complex_numbers, state_line

    angles = zip(_angles(motion.state), motion.turns, strict=True)
    turned = ", ".join(f"{name} {turns}" for name, turns in angles if turns)
    steps = number_of(motion.iterations, "step")
    lines = [
        state_line(motion),
        f"  {motion.message}",
        f"period {motion.period:.10g}{turned and f' (turns: {turned})'}, closed to {motion.residual:.1g} after {steps} "
        "of Newton's method",
        f"  multipliers {complex_numbers(motion.multipliers)}",
        f"  exponents {complex_numbers(motion.exponents)}",
    ]
    rolls = math.isfinite(motion.least_normal_force)
    return [*lines, f"  least normal force {motion.least_normal_force:.6g}"] if rolls else lines


def _angles(state: Any) -> list[str]:
    """Lists the names of the components that may gain whole turns."""
    import numpy as np

    from ...analysis.stability.shooting import countable
    from ..files import numbers_of

    names = [entry for name, leaf in numbers_of(state).items() for entry in entries(name, np.shape(leaf))]
    return [name for name, angle in zip(names, countable(state), strict=True) if angle]
