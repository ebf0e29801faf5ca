"""Reproduces both runs of the paper, from the equations to the figures."""

from collections.abc import Callable, Sequence
from pathlib import Path

from ...interface.wording import counted
from ...numerics.programs import compiled_quickly
from .experiments import EXPERIMENTS, SOLVERS, Measurement, check_names, measure
from .table import STEPS, Column, Table, agreement

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
    created if necessary. It takes about a minute on two cores, mostly compiling.

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
    measurements = TABLE.printed(rows, echo)
    conclusion = agreement(measurements)
    TABLE.write(out, measurements, conclusion)
    drawn = []
    if figures:
        from .figures import draw  # here, so that a table without figures does not load matplotlib

        with compiled_quickly():
            for experiment in experiments:
                drawn += draw(experiment, out)

    echo("\n" + "\n".join(TABLE.legend))
    echo(f"\nWrote table.md, table.json and {counted(len(drawn), 'figure')} into {out}.")
    echo("\n" + conclusion)
    return measurements
