"""Reproduces both runs of the paper, from the equations to the figures.

``compare_solvers`` measures jaxball's counterparts of all solvers that the authors name in sections 4 and 5.
"""

import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import diffrax
import numpy as np

from ... import paper
from ...interface.wording import all_of, number_of
from ...programs.program import compile_quickly
from ...simulation import solvers
from ...simulation.simulate import simulate
from ..systems import PAPER_END, PAPER_START
from .experiments import (
    EXPERIMENTS,
    SOLVERS,
    STEPS,
    Column,
    Experiment,
    Measurement,
    Table,
    agreement,
    ball_experiment,
    check_names,
    measure,
)


class Counterpart(NamedTuple):
    """A solver with the same method as one of the authors' solvers. ``name``: how it is made."""

    name: str
    solver: diffrax.AbstractAdaptiveSolver


# Sections 4 and 5, in their order: MATLAB R2017b, and radau5 by Hairer & Wanner in Fortran.
ODE = {
    "ode45": Counterpart("Dopri5()", diffrax.Dopri5()),
    "ode113": Counterpart("Adams()", solvers.Adams()),
    "ode15s": Counterpart("NDF()", solvers.NDF()),
    "ode23t": Counterpart("Trapezoidal()", solvers.Trapezoidal()),
    "ode23tb": Counterpart("TRBDF2()", solvers.TRBDF2()),
    "radau5": Counterpart("RadauIIA()", solvers.RadauIIA()),
}
# Section 5 only, `rolling_ball_dae_g`.
DAE = {name: ODE[name] for name in ("ode15s", "ode23t", "radau5")}

# In seconds, to t = 20. All six exist for the ball, and ode45, ode113 and ode23tb solve only the ODE.
TIMES: Mapping[str, Mapping[str, float]] = {
    "disk": {"ode45": 0.23, "ode113": 0.06, "ode15s": 0.30, "ode23t": 5.01, "ode23tb": 7.18, "radau5": 0.27},
    "ball": {"ode45": 0.25, "ode113": 0.10, "ode15s": 0.25, "ode23t": 2.19, "ode23tb": 3.72, "radau5": 0.41},
}
SOURCE_OF_TIMES = (
    "a comment in the LaTeX source of section 4, which is not printed; MATLAB R2017b and, for radau5, Fortran, on a "
    "machine that is not named"
)


UNKNOWN = "not published"
LEGEND = (
    "Counterpart: the same method in jaxball or diffrax, with the paper's tolerance, "
    f"{paper.DISK_TOLERANCE:.0e} for the disk and {paper.BALL_TOLERANCE:.0e} for the ball.",
    "DAE: |q|² = 1 replaces the equation of one component, the first in the paper, the largest here.",
    "Accepted, rejected: steps. Evaluations: of the right-hand side, counted; one for a Jacobian. Error: largest "
    "component at t = 0, 1, ..., 20 relative to a 30-digit reference. Time: median of warm calls. Compile: how much "
    "longer the first call took; little if the program was kept from an earlier run.",
    "All these refer to the counterpart. The authors published no steps, evaluations or errors, only that all solvers "
    "agreed and that ode113 was the fastest. Steps here end at t = 0, 1, ..., 20 and at the kinks of the actuation, "
    "and the motion of the masses is not integrated with the rest, so the authors' solvers took different steps.",
    f"Authors' time: from {SOURCE_OF_TIMES}. So it cannot be compared directly with the times here.",
)


@dataclass(frozen=True)
class Comparison:
    """One of the authors' solvers, and the cost of its counterpart here.

    - ``paper_solver``: its name in the paper.
    - ``form``: "ODE", or "DAE" for the differential-algebraic form.
    - ``authors_time``: the authors' time, in seconds, on an unnamed machine; None where they give none. They give no
      steps, evaluations or errors.
    - ``measurement``: of the counterpart.
    """

    paper_solver: str
    form: str
    authors_time: float | None
    measurement: Measurement

    @property
    def counterpart(self) -> str:
        """The counterpart's name."""
        return self.measurement.solver


COMPARED: Table[Comparison] = Table(
    name="solvers",
    columns=(
        Column("System", lambda c: c.measurement.system, 6, left=True),
        Column("Paper's solver", lambda c: c.paper_solver, 14, left=True),
        Column("Counterpart", lambda c: c.counterpart, 13, left=True),
        Column("Form", lambda c: c.form, 4, left=True),
        *(column.of(lambda c: c.measurement) for column in STEPS),
        Column("Time", lambda c: f"{1e3 * c.measurement.run_time:.2f} ms", 9),
        Column("Compile", lambda c: f"{c.measurement.compile_time:.1f} s", 7),
        Column("Authors' time", lambda c: UNKNOWN if c.authors_time is None else f"{c.authors_time:.2f} s", 13),
    ),
    legend=tuple(textwrap.fill(paragraph, 120) for paragraph in LEGEND),
)


def compare_solvers(
    out: Path | str = "out",
    *,
    solvers: Sequence[str] = tuple(ODE),
    systems: Sequence[str] = tuple(EXPERIMENTS),
    echo: Callable[[str], None] = print,
) -> list[Comparison]:
    """Measures, for every solver that sections 4 and 5 of the paper name, the same method here.

    Writes ``solvers.md`` and ``solvers.json`` to the folder ``out``, which is created if necessary. The ball is solved
    in both of the paper's forms. It takes three or four minutes on two cores, mostly compiling.

    **Arguments:**

    - ``solvers``: which of the authors' ode45, ode113, ode15s, ode23t, ode23tb and radau5.
    - ``systems``: the disk, the ball, or both.
    - ``echo``: called with each part of the report; with a row as soon as it is measured.

    **Raises:** ``ValueError`` for other names, :class:`~jaxball.simulation.PrecisionError` without float64, and
    :class:`~jaxball.SolveError` when a solve fails.
    """
    check_names("solvers", solvers, ODE)
    check_names("systems", systems, EXPERIMENTS)
    forms = [form for system in systems for form in _forms(system)]
    cases = [
        (form, name, counterparts[name]) for form, counterparts in forms for name in solvers if name in counterparts
    ]
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)

    echo(f"Measuring {number_of(len(cases), 'row')}, ten to twenty seconds each, mostly compiling.\n")
    comparisons = COMPARED.print_rows((_compare(*case) for case in cases), echo)
    conclusion = _conclusion(comparisons)
    COMPARED.write(out, comparisons, conclusion, source_of_authors_time=SOURCE_OF_TIMES)

    echo("\n" + "\n".join(COMPARED.legend))
    echo(f"\nWrote {' and '.join(COMPARED.files)} into {out}.")
    echo("\n" + conclusion)
    return comparisons


def _forms(system: str) -> Iterator[tuple[Experiment, Mapping[str, Counterpart]]]:
    """Yields the experiment in each of its forms, with the solvers that the authors used for it."""
    yield EXPERIMENTS[system](), ODE
    if system == "ball":
        yield ball_experiment(dae=True), DAE


def _compare(experiment: Experiment, name: str, counterpart: Counterpart) -> Comparison:
    form, time = ("DAE", None) if experiment.dae else ("ODE", TIMES[experiment.name][name])
    return Comparison(name, form, time, measure(experiment, counterpart.name, counterpart.solver))


def _conclusion(comparisons: Sequence[Comparison]) -> str:
    """Describes the largest errors, and if several solvers were measured, says which needed the fewest evaluations."""
    of_systems: dict[str, list[Comparison]] = {}
    for comparison in comparisons:
        of_systems.setdefault(comparison.measurement.system, []).append(comparison)
    fewest = {
        system: min(some, key=lambda comparison: comparison.measurement.evaluations).counterpart
        for system, some in of_systems.items()
        if len(some) > 1
    }
    sentence = agreement([comparison.measurement for comparison in comparisons], "all counterparts")
    if not fewest:
        return sentence
    return f"{sentence} Fewest evaluations: {all_of([f'{name} for the {system}' for system, name in fewest.items()])}."


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

    **Raises:** ``ValueError`` for other names, :class:`~jaxball.simulation.PrecisionError` without float64, and
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
    from ...plot.report import PANELS, write_figure  # here, so that a table without figures does not load matplotlib

    times = np.linspace(PAPER_START, PAPER_END, TIMES_COMPARED)
    tolerance = experiment.tolerance
    trajectory = simulate(experiment.system, times, rtol=tolerance, atol=tolerance, throw=True)
    functions = FIGURES[experiment.name] | {f"{experiment.name}_{name}": name for name in ADDITIONAL}
    paths = []
    for name, function in functions.items():
        paths.append(folder / f"{name}.png")
        write_figure(PANELS[function](trajectory), paths[-1], trajectory.system, TITLES[experiment.name])
    return paths
