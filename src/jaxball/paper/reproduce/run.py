"""Reproduces both runs of the paper, from the equations to the figures."""

from collections.abc import Callable, Sequence
from pathlib import Path

from ...interface.output import replacing
from ...interface.wording import counted
from ...numerics.programs import compiled_quickly
from . import table
from .experiments import SOLVERS, Measurement, ball_experiment, disk_experiment, measure


def reproduce(
    out: Path | str = "out",
    *,
    solvers: Sequence[str] = tuple(SOLVERS),
    systems: Sequence[str] = ("disk", "ball"),
    figures: bool = True,
    echo: Callable[[str], None] = print,
) -> list[Measurement]:
    """Reproduces sections 4 and 5: a table of solvers against the reference, and every figure.

    Writes ``table.md``, ``table.json`` and the figures, named by the paper's labels, into the folder ``out``,
    which is created if necessary. It takes about a minute on two cores, most of it compiling.

    **Arguments:**

    - ``solvers``: which of Dopri5, Tsit5, Dopri8 and Kvaerno5 to measure, all at the paper's tolerance.
    - ``systems``: the disk, the ball, or both.
    - ``figures``: whether to draw.
    - ``echo``: called with each part of the report.

    **Raises:** ``ValueError`` for a name that is none of those, :class:`~jaxball.PrecisionError` without
    float64, and :class:`~jaxball.SolveError` when a solve fails.
    """
    experiments = {"disk": disk_experiment, "ball": ball_experiment}
    _check_names("solvers", solvers, SOLVERS)
    _check_names("systems", systems, experiments)
    chosen = [experiments[name]() for name in systems]
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)

    echo(table.heading())
    measurements = []
    for experiment in chosen:
        for solver in solvers:
            measurements.append(measure(experiment, solver))
            echo(table.row(measurements[-1]))
    for name, content in (("table.md", table.markdown(measurements)), ("table.json", table.as_json(measurements))):
        with replacing(out / name) as temporary:
            temporary.write_text(content, encoding="utf-8")
    drawn = []
    if figures:
        from .figures import draw  # here, so that a table without figures does not load matplotlib

        with compiled_quickly():
            for experiment in chosen:
                drawn += draw(experiment, out)

    echo("\n" + "\n".join(table.LEGEND))
    echo(f"\nWrote table.md, table.json and {counted(len(drawn), 'figure')} into {out}.")
    echo("\n" + table.agreement(measurements))
    return measurements


def _check_names(argument: str, names: Sequence[str], known: dict) -> None:
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        raise ValueError(f"Argument `{argument}` must hold one or more of {', '.join(known)}, but it is {list(names)}.")
