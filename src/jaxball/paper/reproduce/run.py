"""Reproduces both runs of the paper, from the equations to the figures."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ... import paper
from ...interface.wording import number_of
from ...programs.program import compile_quickly
from ...simulation.simulate import simulate
from .experiments import (
    EXPERIMENTS,
    SOLVERS,
    STEPS,
    Column,
    Experiment,
    Measurement,
    Table,
    agreement,
    check_names,
    measure,
)

TABLE: Table[Measurement] = Table(
    name="table",
    columns=(
        Column("System", lambda m: m.system, 6, left=True),
        Column("Solver", lambda m: m.solver, 8, left=True),
        Column("Tolerance", lambda m: f"{m.tolerance:.0e}", 9),
        *STEPS,
        Column("Error at 20", lambda m: f"{m.error_at_end:.1e}", 11),
        Column("Run", lambda m: f"{1e3 * m.run_time:.2f} ms", 9),
        Column("Compile", lambda m: f"{m.compile_time:.1f} s", 7),
    ),
    legend=(
        "Accepted, rejected: steps. Evaluations: of the right-hand side, counted; one for a Jacobian.\n"
        "Error: largest component at t = 0, 1, ..., 20, where steps end, and only at t = 20,\n"
        "relative to a 30-digit reference. Run: median of warm calls. Compile: how much longer the first call took.",
    ),
)


TIMES_COMPARED = 2001
TITLES = {"disk": "The paper's disk, section 4", "ball": "The paper's ball, section 5"}

FIGURES = {
    "disk": {
        "fig_abs_ui": "acceleration",
        "fig_disk_masses_rails_bf_gc": "configuration",
        "fig_disk_cm_time_bf_gc": "body_paths",
        "fig_disk_cm_time_spatial_gc": "space_paths",
        "fig_disk_dot_angle": "angular_velocity",
        "fig_disk_gc": "centre_path",
    },
    "ball": {
        "fig_ball_masses_rail_bf_gc": "configuration",
        "fig_ball_cm_bf_gc": "body_paths",
        "fig_ball_cm_spatial_gc": "space_paths",
        "fig_ball_Omega": "angular_velocity",
        "fig_ball_gc_path": "centre_path",
    },
}

ADDITIONAL = ("energies", "power", "contact_force", "friction_ratio")  # which the paper does not draw


def reproduce(
    out: Path | str = "out",
    *,
    solvers: Sequence[str] = tuple(SOLVERS),
    systems: Sequence[str] = ("disk", "ball"),
    figures: bool = True,
    echo: Callable[[str], None] = print,
) -> list[Measurement]:
    """Reproduces sections 4 and 5: a table of solvers against the reference, and every figure.

    Writes ``table.md``, ``table.json`` and the figures, named after the paper's labels, to the folder ``out``, which is
    created if necessary. It takes about 40 seconds on two quiet cores, mostly compiling.

    **Arguments:**

    - ``solvers``: which of Dopri5, Tsit5, Dopri8 and Kvaerno5 to measure, all at the paper's tolerance.
    - ``systems``: the disk, the ball, or both.
    - ``figures``: whether to draw.
    - ``echo``: called with each part of the report.

    **Raises:** ``ValueError`` for other names, :class:`~jaxball.PrecisionError` without float64, and
    :class:`~jaxball.SolveError` when a solve fails.
    """
    check_names("solvers", solvers, SOLVERS)
    check_names("systems", systems, EXPERIMENTS)
    experiments = [EXPERIMENTS[name]() for name in systems]
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)

    rows = (measure(experiment, name, SOLVERS[name]) for experiment in experiments for name in solvers)
    measurements = TABLE.print_rows(rows, echo)
    conclusion = agreement(measurements)
    TABLE.write(out, measurements, conclusion)
    drawn = []
    if figures:
        with compile_quickly():
            for experiment in experiments:
                drawn += draw(experiment, out)

    echo("\n" + "\n".join(TABLE.legend))
    echo(f"\nWrote table.md, table.json and {number_of(len(drawn), 'figure')} into {out}.")
    echo("\n" + conclusion)
    return measurements


def draw(experiment: Experiment, folder: Path) -> list[Path]:
    """Writes the figures of ``experiment`` as PNG into ``folder``, and returns their paths.

    **Raises:** :class:`~jaxball.SolveError` when the solve fails.
    """
    from ... import plot  # here, so that a table without figures does not load matplotlib
    from ...plot.report import write_figure

    times = np.linspace(paper.PAPER_START, paper.PAPER_END, TIMES_COMPARED)
    tolerance = experiment.tolerance
    trajectory = simulate(experiment.system, times, rtol=tolerance, atol=tolerance, throw=True)
    functions = FIGURES[experiment.name] | {f"{experiment.name}_{name}": name for name in ADDITIONAL}
    paths = []
    for name, function in functions.items():
        paths.append(folder / f"{name}.png")
        write_figure(getattr(plot, function)(trajectory), paths[-1], trajectory.system, TITLES[experiment.name])
    return paths
