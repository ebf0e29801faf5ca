"""The largest Lyapunov exponent over two numbers of a scenario."""

import argparse
import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from ...interface.status import Status
from ...scenario import read_document
from ...sweep.charts import scenario_chart
from ..chart import Axis
from ..output import say, working
from .chart import ranged, save_chart
from .files import write_json, write_outputs

if TYPE_CHECKING:
    import xarray

INTERVAL = 10.0


def run(options: argparse.Namespace, document: dict[str, Any], axes: tuple[Axis, Axis]) -> int:
    """Computes the chart of a document, saves it and draws it."""
    with working(options, "computing the chart") as line:

        def report(done: int, cells: int) -> None:
            line.print(f"{done:,} of {cells:,} cells", sys.stderr)

        chart = scenario_chart(
            document,
            ranged(axes),
            end=options.end,
            transient=options.transient,
            interval=options.interval or INTERVAL,
            progress=None if options.quiet else report,
        )
    chart.attrs["title"] = str(document.get("title", ""))
    lines = _summary(chart)
    lines.append(
        write_outputs(
            options, read_document(document), lambda path: save_chart(chart, path), lambda plot: plot.chaos_chart(chart)
        )
    )
    write_json(options, {**chart.attrs, **{str(name): chart[name].values for name in chart.variables}})
    say(options, *lines)
    return 0


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
