"""Runs per second over the number of rows."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import harness
from gpu_sections import OURS

WIDTHS = {OURS: 2.0}


def draw(rows: Sequence[dict[str, Any]], device: str, path: Path) -> None:
    """Writes the figure of :func:`diagram`."""
    harness.set_up_jax(cpu_settings=False)  # jaxball's style imports JAX, which need not start a GPU for that
    diagram(rows, device).savefig(path, dpi=200)


def diagram(rows: Sequence[dict[str, Any]], device: str):
    """A panel for each tolerance and a line for each solver; ours on the GPU is bold."""
    from matplotlib.figure import Figure

    from jaxball.plot import palette, style

    solvers = list(dict.fromkeys(row["solver"] for row in rows))
    tolerances = sorted({row["tolerance"] for row in rows}, reverse=True)
    figure = Figure(figsize=(3.6 * len(tolerances), 3.9), layout="constrained")
    panels = figure.subplots(1, len(tolerances), sharey=True, squeeze=False)[0]
    for ax, tolerance in zip(panels, tolerances, strict=True):
        for i, solver in enumerate(solvers, start=1):
            mine = [row for row in rows if row["solver"] == solver and row["tolerance"] == tolerance]
            line = style.mass_line(i, linewidth=WIDTHS.get(solver, 1.0))
            ax.plot(
                [row["rows"] for row in mine],
                [row["rate"] for row in mine],
                marker="o",
                markersize=3,
                label=solver,
                **line,
            )
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.grid(True, color=palette.FAINT, linewidth=0.4)
        style.label_axes(
            ax,
            rf"rows, at a tolerance of $10^{{{math.log10(tolerance):.3g}}}$",
            "runs per second" if ax is panels[0] else "",
        )
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False, prop=style.SMALL_FONT)
    figure.supxlabel(device, **style.CAPTION)
    return figure
