"""Throughput at equal achieved error: interpolation, ratios, a table and a diagram."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

Row = dict[str, Any]


def rate_at(rows: Sequence[Row], error: float) -> float | None:
    """Trajectories per second of one solver at a median error, on straight lines between its settings in logarithms.

    None where none of its settings is as exact, or none as coarse.
    """
    rows = sorted((row for row in rows if row["error_median"] > 0), key=lambda row: row["error_median"])
    if not rows or not rows[0]["error_median"] <= error <= rows[-1]["error_median"]:
        return None
    errors, rates = ([math.log(row[key]) for row in rows] for key in ("error_median", "rate"))
    return math.exp(np.interp(math.log(error), errors, rates))


def at_equal_error(rows: Sequence[Row], ours: str, goals: Sequence[float]) -> dict[str, dict[str, dict]]:
    """For each goal and solver its ``rate`` and the ``ratio`` of ours to it; None where the goal is out of reach."""
    solvers = dict.fromkeys(row["solver"] for row in rows)
    found = {}
    for goal in goals:
        rates = {name: rate_at([row for row in rows if row["solver"] == name], goal) for name in solvers}
        mine = rates.get(ours)
        found[f"{goal:.0e}"] = {
            name: {"rate": rate, "ratio": mine / rate if mine and rate else None} for name, rate in rates.items()
        }
    return found


def report(rows: Sequence[Row], ratios: dict[str, dict[str, dict]], ours: str) -> None:
    """Prints all rows and the ratios."""
    print(
        f"\n{'Solver':38}{'Rows':>9}{'Tolerance':>10}{'Runs/s':>10}{'Error':>10}{'Largest':>10}{'Failed':>7}{'Build':>9}"
    )
    for row in rows:
        print(
            f"{row['solver']:38}{row['rows']:>9}{row['tolerance']:>10.0e}{row['rate']:>10.0f}{row['error_median']:>10.1e}"
            f"{row['error_max']:>10.1e}{row['failed']:>7}{row['build_time']:>7.1f} s"
        )
    for goal, found in ratios.items():
        print(f"\nAt a median error of {goal}:")
        for name, item in found.items():
            rate = "out of reach" if item["rate"] is None else f"{item['rate']:.0f} runs/s"
            ratio = "" if item["ratio"] is None or name == ours else f", {ours} {item['ratio']:.2f} times as many"
            print(f"  {name:38}{rate}{ratio}")


def draw(rows: Sequence[Row], ours: str, path: Path) -> None:
    """Writes the diagram of :func:`diagram`."""
    diagram(rows, ours).savefig(path, dpi=200)


def diagram(rows: Sequence[Row], ours: str):
    """Throughput over median error, more exact to the right; ``ours`` is bold."""
    from jaxball.plot import palette, style

    ax = style.plane_axes(None, (6.0, 4.2))
    for i, solver in enumerate(dict.fromkeys(row["solver"] for row in rows), start=1):
        mine = [row for row in rows if row["solver"] == solver and row["error_median"] > 0]
        line = style.mass_line(i, linewidth=2.0 if solver == ours else 1.0)
        errors, rates = ([row[key] for row in mine] for key in ("error_median", "rate"))
        ax.plot(errors, rates, marker="o", markersize=3, label=solver, **line)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.invert_xaxis()
    ax.grid(True, color=palette.FAINT, linewidth=0.4)
    style.label_axes(ax, "median over runs of the largest error at $t = 20$", "runs per second")
    style.legend_above(ax, most=2)
    return ax.figure
