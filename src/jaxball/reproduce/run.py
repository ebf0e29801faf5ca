"""Both runs of the paper from equations to figures."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from .. import paper
from ..simulation import simulate
from . import table
from .experiments import SOLVERS, Experiment, Measurement, ball_experiment, disk_experiment, measure

FIGURE_TIMES = 2001


def reproduce(
    out: Path | str = "out",
    *,
    solvers: Sequence[str] = tuple(SOLVERS),
    systems: Sequence[str] = ("disk", "ball"),
    figures: bool = True,
    echo: Callable[[str], None] = print,
) -> list[Measurement]:
    """Runs sections 4 and 5 again: a table of solvers against the reference, and every figure.

    Writes ``table.md``, ``table.json`` and the figures, named by the paper's labels, into ``out``,
    which is made if need be. It takes about a minute on two cores, most of it compiling.

    **Arguments:**

    - ``solvers``: which of Dopri5, Tsit5, Dopri8 and Kvaerno5 to measure, all at the paper's tolerance.
    - ``systems``: the disk, the ball, or both.
    - ``figures``: whether to draw.
    - ``echo``: what to do with each line of the report.

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
    written = [out / "table.md", out / "table.json"]
    written[0].write_text(table.markdown(measurements), encoding="utf-8")
    written[1].write_text(table.as_json(measurements), encoding="utf-8")
    if figures:
        for experiment in chosen:
            written += _draw(experiment, out)

    echo("\n" + "\n".join(table.LEGEND))
    echo(f"\nWrote {len(written)} files into {out}: {', '.join(path.name for path in written)}.")
    echo("\n" + table.agreement(measurements))
    return measurements


def _draw(experiment: Experiment, out: Path) -> list[Path]:
    from ..plot import figures  # only here, so that a table without figures does not load matplotlib

    times = np.linspace(paper.START, paper.END, FIGURE_TIMES)
    tolerance = experiment.tolerance
    trajectory = simulate(experiment.system, times, rtol=tolerance, atol=tolerance, throw=True)
    return figures(trajectory, out)


def _check_names(argument: str, names: Sequence[str], known: dict) -> None:
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        raise ValueError(
            f"Argument `{argument}` must hold one or more of {', '.join(known)}, but it is {list(names)}."
        )
