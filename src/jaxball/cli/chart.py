"""``jaxball chaos --chart``: the largest Lyapunov exponent over two numbers of a scenario."""

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..interface.output import OutputError, check_destination, replacing
from ..interface.status import Status
from ..scenario import read_document
from .pictures import write_figure
from .source import source_document
from .speaking import say, write_json

if TYPE_CHECKING:
    import xarray

INTERVAL = 10.0
MOST = 10_000  # values of a number


def add_options(parser: argparse.ArgumentParser, kinds: Any) -> None:
    """Adds --chart."""
    kinds.add_argument(
        "--chart",
        nargs=2,
        metavar="PATH=FROM:TO:COUNT",
        help="a chart instead: the largest exponent over two numbers, as in 'initial.Omega[0]=0:3:30' body.mass=1:2:20",
    )


def run(options: argparse.Namespace) -> int:
    """Makes the chart, saves it and draws it."""
    # Imported here, because the other commands have no use for it.
    from ..sweep.charts import scenario_chart

    if options.out is not None:
        check_destination(options.out, (".nc", ".csv"), "--out")
    if options.exponents is not None:
        raise OutputError("Argument `--exponents` must be left out beside --chart, which is of the largest one.")
    first, second = (_axis(text) for text in options.chart)
    if first.path == second.path:
        raise OutputError(f"Argument `--chart` must name two numbers, but it names `{first.path}` twice.")
    document = source_document(options)
    found = scenario_chart(
        document,
        (first, second),
        end=options.end,
        transient=options.transient,
        interval=options.interval or INTERVAL,
        progress=None if options.quiet else _progress,
    )
    found.attrs["title"] = str(document.get("title", ""))
    lines = _summary(found)
    if options.out is not None:
        _write(found, options.out)
        lines.append(f"  written: {options.out}")
    if options.plot is not None:
        from .. import plot

        write_figure(plot.chaos_chart(found), options.plot, read_document(document))
        lines.append(f"  written: {options.plot}")
    write_json(options, {**found.attrs, **{str(name): found[name].values for name in found.variables}})
    say(options, "\n".join(lines))
    return 0


def _axis(text: str):
    from ..sweep.axes import Ranged

    path, _, values = text.partition("=")
    parts = values.split(":")
    try:
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
    except (ValueError, IndexError):
        low, high, count = math.nan, math.nan, 0
    if len(parts) != 3 or not math.isfinite(low + high) or low == high or not 2 <= count <= MOST:
        raise OutputError(
            "Argument `--chart` must be PATH=FROM:TO:COUNT, with two different numbers and a count from 2 to "
            f"{MOST:,}, such as 'initial.Omega[0]=0:3:30', but it is \"{text}\"."
        )
    return Ranged(path.strip(), low, high, count, False)


def _progress(done: int, cells: int) -> None:
    print(f"{done:,} of {cells:,} cells", file=sys.stderr, flush=True)


def _summary(found: "xarray.Dataset") -> list[str]:
    exponents, status = found["exponent"].values, found["status"].values
    lines = [found.attrs["title"]] if found.attrs["title"] else []
    up, right = found["exponent"].dims
    lines.append(f"The largest Lyapunov exponent at {exponents.size:,} pairs of {up} and {right}")
    if np.any(np.isfinite(exponents)):
        at = np.unravel_index(np.nanargmax(exponents), exponents.shape)
        pair = ", ".join(f"{name} = {found[name].values[k]:g}" for name, k in zip((up, right), at, strict=True))
        error = found["standard_error"].values[at]
        lines.append(f"  from {np.nanmin(exponents):.6f} to {exponents[at]:.6f} ± {error:.6f}, at {pair}")
    lifted = int(np.sum((status == Status.SUCCESS) & ~np.isfinite(exponents)))
    lines += [f"  {lifted:,} leave the plane"] if lifted else []
    counts = ((item, int(np.sum(status == item))) for item in Status if item != Status.SUCCESS)
    return lines + [f"  {count:,} {item.name}" for item, count in counts if count]


def _write(found: "xarray.Dataset", path: Path) -> None:
    with replacing(path) as beside:
        if path.suffix == ".nc":
            found.to_netcdf(beside, engine="h5netcdf")
            return
        up, right = found["exponent"].dims
        grids = np.meshgrid(found[up].values, found[right].values, indexing="ij")
        names = [str(name) for name in found.data_vars]
        columns = [*map(np.ravel, grids), *(found[name].values.ravel() for name in names)]
        header = ",".join([str(up), str(right), *names])
        np.savetxt(beside, np.column_stack(columns), fmt="%.17g", delimiter=",", header=header, comments="")
