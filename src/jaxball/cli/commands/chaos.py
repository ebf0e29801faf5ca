"""``jaxball chaos``: the Lyapunov exponents of a scenario, charts of the largest one, and Poincaré maps."""

import argparse
import functools
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...files.scenario.paths import entries
from ...files.scenario.solvers import SOLVERS
from ...interface.status import Status
from ..input import add_scenario, read_scenario, refuse_settings, scenario_document
from ..jax_setup import set_up_jax
from ..options import (
    CHART_AXIS,
    BadInputError,
    add_results,
    chart_axes,
    check_outputs,
    number,
    positive,
    refuse,
    working,
)

if TYPE_CHECKING:
    import xarray

    from ...analysis.chaos.result import LyapunovSpectrum
    from ...files.scenario.scenario import Scenario

DIRECTIONS = {"rising": 1, "falling": -1, "both": 0}
INTERVAL, INTERVAL_OF_A_CHART = 1.0, 10.0
MOST_CROSSINGS = 10_000


UNUSED = ("max_step", "step_to_times", "dae", "project")  # settings of a solve


def add(parser: argparse.ArgumentParser) -> None:
    add_scenario(parser)
    parser.add_argument("--end", type=number, help="end at this time, instead of the scenario's")
    parser.add_argument("--transient", type=number, help="start averaging after this time (default: 0)")
    parser.add_argument(
        "--interval", type=positive, help="time between orthonormalisations (default: 1, or 10 for a chart)"
    )
    parser.add_argument("--exponents", type=int, metavar="K", help="compute only the K largest (default: all)")
    add_results(parser, "the numbers: .csv, or .nc for a chart", "them")
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument(
        "--chart",
        nargs=2,
        metavar=CHART_AXIS,
        help="compute a chart instead: the largest exponent over two numbers, as in 'initial.Omega[0]=0:3:30' "
        "body.mass=1:2:20",
    )
    kinds.add_argument(
        "--poincare",
        metavar="COMPONENT=VALUE",
        help="compute a Poincaré map instead: the states in which a component has a value, as in 'Omega[0]=0'",
    )
    parser.add_argument("--direction", choices=DIRECTIONS, help="direction of --poincare's crossings (default: rising)")
    parser.add_argument(
        "--axes", nargs=2, metavar="COMPONENT", help="the axes of --poincare's figure, as in 'Omega[1]' 'Gamma[2]'"
    )


def run(options: argparse.Namespace) -> int:
    if options.poincare is None:
        refuse(options, ("direction", "axes"), "is for a Poincaré map; give --poincare COMPONENT=VALUE with it.")
    else:
        others = ("exponents", "interval", "transient")
        refuse(options, others, "is for Lyapunov exponents; leave it out with --poincare.")
    refuse_settings(options, "chaos", UNUSED)
    try:
        if options.chart is not None:
            return _chart(options)
        if options.poincare is not None:
            return _poincare(options)
        return _exponents(options)
    except ValueError as error:
        raise BadInputError(str(error)) from None


def _exponents(options: argparse.Namespace) -> int:
    check_outputs(options, (".csv",))
    scenario = read_scenario(options)
    from ...analysis.chaos import lyapunov_spectrum
    from ...files.scenario.body import require_whole_run
    from ..files import report

    require_whole_run(scenario, "Lyapunov exponents are")
    end = scenario.times[-1] if options.end is None else options.end
    if end <= scenario.times[0]:
        raise BadInputError(f"Argument `--end` must be after the start, {scenario.times[0]:g}, but it is {end:g}.")
    with working(options, "computing Lyapunov exponents"):
        spectrum = lyapunov_spectrum(
            scenario.system,
            (scenario.times[0], end),
            scenario.state,
            contact=scenario.contact,
            exponents=options.exponents,
            transient=options.transient or 0.0,
            interval=options.interval or INTERVAL,
            solver=SOLVERS[scenario.solver](),
            rtol=scenario.rtol,
            atol=scenario.atol,
            max_steps=scenario.max_steps,
        )
    return report(
        options,
        scenario,
        _content(scenario, spectrum),
        [spectrum],
        save=lambda path: _save_means(spectrum, path),
        draw=lambda plot: spectrum.plot(),
        failure="" if spectrum.ok else spectrum.message,
    )


def _chart(options: argparse.Namespace) -> int:
    check_outputs(options, (".nc", ".csv"))
    refuse(options, ("exponents",), "must be left out with --chart, which shows the largest one.")
    axes = chart_axes(options)
    document = scenario_document(options)
    set_up_jax()
    from ...studies.sweep.charts import scenario_chart
    from ..files import write_chart

    compute = functools.partial(
        scenario_chart,
        document,
        end=options.end,
        transient=options.transient or 0.0,
        interval=options.interval or INTERVAL_OF_A_CHART,
    )
    return write_chart(options, document, axes, compute, _chart_summary, lambda plot: plot.chart)


def _poincare(options: argparse.Namespace) -> int:
    check_outputs(options, (".csv", ".npz"))
    path, value = _section(options.poincare)
    scenario = read_scenario(options)
    from ...analysis.chaos import poincare_map
    from ...files.scenario.body import require_whole_run
    from ...numerics.arrays import to_array
    from ...simulation.deviations_with_modes import point_of_run
    from ..files import numbers_of, report

    require_whole_run(scenario, "a Poincaré map is")
    _, state = point_of_run(scenario.system, scenario.state, scenario.contact, to_array(scenario.times[0]))
    components = _components(state)
    path = _check_component(path, components)
    others = [name for name in components if name != path]
    # Two others for the figure; the same one twice where there is only one.
    across, up = (_check_component(name, components) for name in options.axes or (others * 2)[:2])

    with working(options, "computing the Poincaré map"):
        crossings = poincare_map(
            scenario.system,
            path,
            (scenario.times[0], scenario.times[-1] if options.end is None else options.end),
            state,
            contact=scenario.contact,
            level=value,
            direction=DIRECTIONS[options.direction or "rising"],
            capacity=MOST_CROSSINGS,
            solver=SOLVERS[scenario.solver](),
            rtol=scenario.rtol,
            atol=scenario.atol,
            max_steps=scenario.max_steps,
        )
    crossed = numbers_of(crossings.state)
    columns = {"time": crossings.times} | {
        name: crossed[leaf][:, *indices] for name, (leaf, indices) in components.items()
    }
    title = {"title": scenario.title} if scenario.title else {}
    return report(
        options,
        scenario,
        {**title, "ok": crossings.ok, "message": crossings.message, "count": crossings.count},
        [f"{crossings.count} crossings of {path} = {value:g}", f"  {crossings.message}"],
        save=lambda path: _save_crossings(columns, path),
        draw=lambda plot: plot.poincare_section(columns[across], columns[up], (across, up)),
        failure="" if crossings.status == Status.SUCCESS else crossings.message,
    )


def _section(text: str) -> tuple[str, float]:
    path, equals, value = text.partition("=")
    try:
        number = float(value) if equals else math.nan
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise BadInputError(
            f"Argument `--poincare` must be COMPONENT=VALUE, such as 'Omega[0]=0', but it is \"{text}\"."
        )
    return path.strip(), number


def _chart_summary(chart: "xarray.Dataset") -> list[str]:
    import numpy as np

    from ..files import extremes_of

    finite, status = np.isfinite(chart["exponent"].values), chart["status"].values
    up, right = chart["exponent"].dims
    lines = [f"The largest Lyapunov exponent at {finite.size:,} pairs of {up} and {right}"]
    if finite.any():
        least, largest, place, pair = extremes_of(chart, "exponent")
        error = chart["standard_error"].values[place]
        lines.append(f"  from {least:.6f} to {largest:.6f} ± {error:.6f}, at {pair}")
    lifted = int(((status == Status.SUCCESS) & ~finite).sum())
    return [*lines, f"  {lifted:,} leave the plane"] if lifted else lines


def _content(scenario: "Scenario", spectrum: "LyapunovSpectrum") -> dict[str, Any]:
    import numpy as np

    limits = spectrum.limits
    force = spectrum.least_normal_force
    return {
        "title": scenario.title,
        "ok": spectrum.ok,
        "message": spectrum.message,
        "reached": float(spectrum.reached),
        "exponents": np.asarray(spectrum.exponents),
        "standard_error": np.asarray(spectrum.standard_error),
        "told_from_zero": limits.told,
        "limits": limits.limits,
        "limit_errors": limits.errors + np.asarray(spectrum.solve_error),
        "dimension": spectrum.dimension,
        "least_normal_force": None if force is None else float(force),
    }


def _save_means(spectrum: "LyapunovSpectrum", path: Path) -> None:
    """Saves the running means of the exponents, one row for each interval."""
    import numpy as np

    from ..files import write_csv

    times, means = np.asarray(spectrum.times), np.asarray(spectrum.running)
    header = ["time", *(f"exponent[{k}]" for k in range(means.shape[1]))]
    write_csv(path, header, np.column_stack([times, means]).tolist())


def _save_crossings(columns: dict[str, Any], path: Path) -> None:
    import numpy as np

    from ..files import write_csv

    if path.suffix == ".npz":
        np.savez_compressed(path, **columns)
    else:
        write_csv(path, columns, zip(*(values.tolist() for values in columns.values()), strict=True))


def _components(state: Any) -> dict[str, tuple[str, tuple[int, ...]]]:
    """Returns the numbers of a state by their paths, counted from 0."""
    import numpy as np

    from ..files import numbers_of

    return {
        entry: (name, index)
        for name, leaf in numbers_of(state).items()
        for entry, index in entries(name, np.shape(leaf)).items()
    }


def _check_component(name: str, components: dict[str, Any]) -> str:
    if name not in components:
        raise BadInputError(f'The component must be one of {", ".join(components)}, but it is "{name}".')
    return name
