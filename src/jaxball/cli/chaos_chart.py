"""``jaxball chaos --chart``: the largest Lyapunov exponent over two numbers of a scenario."""

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..interface.output import OutputError
from ..interface.status import Status
from ..scenario import read_document
from .input import scenario_document
from .output import check_outputs, say, write_json, write_outputs

if TYPE_CHECKING:
    import xarray

INTERVAL = 10.0
MOST_VALUES = 10_000  # of one number


def add_options(parser: argparse.ArgumentParser, kinds: Any) -> None:
    """Adds --chart."""
    kinds.add_argument(
        "--chart",
        nargs=2,
        metavar="PATH=FROM:TO:COUNT",
        help="a chart instead: the largest exponent over two numbers, as in 'initial.Omega[0]=0:3:30' body.mass=1:2:20",
    )


def run(options: argparse.Namespace) -> int:
    """Computes the chart, saves it and draws it."""
    # Imported here, because the other commands have no use for it.
    from ..sweep.charts import scenario_chart

    check_outputs(options, (".nc", ".csv"))
    if options.exponents is not None:
        raise OutputError("Argument `--exponents` must be left out with --chart, which shows the largest one.")
    first, second = (_axis(text) for text in options.chart)
    if first.path == second.path:
        raise OutputError(f"Argument `--chart` must name two numbers, but it names `{first.path}` twice.")
    document = scenario_document(options)
    chart = scenario_chart(
        document,
        (first, second),
        end=options.end,
        transient=options.transient,
        interval=options.interval or INTERVAL,
        progress=None if options.quiet else _print_progress,
    )
    chart.attrs["title"] = str(document.get("title", ""))
    lines = _summary(chart)
    lines.append(
        write_outputs(
            options, read_document(document), lambda path: _save(chart, path), lambda plot: plot.chaos_chart(chart)
        )
    )
    write_json(options, {**chart.attrs, **{str(name): chart[name].values for name in chart.variables}})
    say(options, *lines)
    return 0


def _axis(text: str):
    from ..sweep.axes import Ranged

    path, _, values = text.partition("=")
    parts = values.split(":")
    try:
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
    except (ValueError, IndexError):
        low, high, count = math.nan, math.nan, 0
    if len(parts) != 3 or not math.isfinite(low + high) or low == high or not 2 <= count <= MOST_VALUES:
        raise OutputError(
            "Argument `--chart` must be PATH=FROM:TO:COUNT, with two different numbers and a count from 2 to "
            f"{MOST_VALUES:,}, such as 'initial.Omega[0]=0:3:30', but it is \"{text}\"."
        )
    return Ranged(path.strip(), low, high, count, False)


def _print_progress(done: int, cells: int) -> None:
    print(f"{done:,} of {cells:,} cells", file=sys.stderr, flush=True)


def _summary(chart: "xarray.Dataset") -> list[str]:
    exponents, status = chart["exponent"].values, chart["status"].values
    up, right = chart["exponent"].dims
    lines = [chart.attrs["title"], f"The largest Lyapunov exponent at {exponents.size:,} pairs of {up} and {right}"]
    if np.any(np.isfinite(exponents)):
        largest = np.unravel_index(np.nanargmax(exponents), exponents.shape)
        pair = ", ".join(f"{name} = {chart[name].values[k]:g}" for name, k in zip((up, right), largest, strict=True))
        error = chart["standard_error"].values[largest]
        lines.append(f"  from {np.nanmin(exponents):.6f} to {exponents[largest]:.6f} ± {error:.6f}, at {pair}")
    lifted = int(np.sum((status == Status.SUCCESS) & ~np.isfinite(exponents)))
    lines += [f"  {lifted:,} leave the plane"] if lifted else []
    counts = ((item, int(np.sum(status == item))) for item in Status if item != Status.SUCCESS)
    return lines + [f"  {count:,} {item.name}" for item, count in counts if count]


def _save(chart: "xarray.Dataset", path: Path) -> None:
    if path.suffix == ".nc":
        chart.to_netcdf(path, engine="h5netcdf")
        return
    up, right = chart["exponent"].dims
    grids = np.meshgrid(chart[up].values, chart[right].values, indexing="ij")
    names = [str(name) for name in chart.data_vars]
    columns = [*map(np.ravel, grids), *(chart[name].values.ravel() for name in names)]
    header = ",".join([str(up), str(right), *names])
    np.savetxt(path, np.column_stack(columns), fmt="%.17g", delimiter=",", header=header, comments="")
