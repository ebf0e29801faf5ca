"""The table of measurements, as plain text, Markdown and JSON."""

import dataclasses
import json
import platform
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import NamedTuple

from .experiments import Measurement

PACKAGES = ("jaxball", "diffrax", "equinox", "jax", "jaxlib", "numpy")


class Column(NamedTuple):
    """A column's heading and how it shows a measurement; words are aligned left, numbers right."""

    heading: str
    cell: Callable[[Measurement], str]
    width: int
    left: bool = False

    def aligned(self, text: str) -> str:
        """``text`` padded with blanks to the column's width."""
        return text.ljust(self.width) if self.left else text.rjust(self.width)


COLUMNS = (
    Column("System", lambda m: m.system, 6, left=True),
    Column("Solver", lambda m: m.solver, 8, left=True),
    Column("Tolerance", lambda m: f"{m.tolerance:.0e}", 9),
    Column("Accepted", lambda m: str(m.accepted), 8),
    Column("Rejected", lambda m: str(m.rejected), 8),
    Column("Evaluations", lambda m: str(m.evaluations), 11),
    Column("Error", lambda m: f"{m.error:.1e}", 7),
    Column("Error at 20", lambda m: f"{m.error_at_end:.1e}", 11),
    Column("Run", lambda m: f"{1e3 * m.run_time:.2f} ms", 9),
    Column("Compile", lambda m: f"{m.compile_time:.1f} s", 7),
)

LEGEND = (
    "Accepted, rejected: steps. Evaluations: of the right-hand side, counted; one for a Jacobian.",
    "Error: largest component at t = 0, 1, ..., 20, which are stepped to, and at t = 20 alone,",
    "against a reference of 30 digits. Run: median of warm calls. Compile: how much longer the first call took.",
)


def heading() -> str:
    """The two lines above the rows in a terminal."""
    titles = "  ".join(column.aligned(column.heading) for column in COLUMNS)
    return titles + "\n" + "  ".join("-" * column.width for column in COLUMNS)


def row(measurement: Measurement) -> str:
    """One measurement as a line for a terminal."""
    return "  ".join(column.aligned(column.cell(measurement)) for column in COLUMNS)


def agreement(measurements: Sequence[Measurement]) -> str:
    """A sentence with the largest error of all solvers, system by system."""
    systems = dict.fromkeys(m.system for m in measurements)
    parts = [f"{max(m.error for m in measurements if m.system == system):.1e} for the {system}" for system in systems]
    solvers = ", ".join(dict.fromkeys(m.solver for m in measurements))
    return f"Agreement with the paper's runs: the largest error of {solvers} is {' and '.join(parts)}."


def markdown(measurements: Sequence[Measurement]) -> str:
    """The table, its legend and the agreement as Markdown."""
    lines = [
        "| " + " | ".join(column.heading for column in COLUMNS) + " |",
        "|" + "|".join(":--" if column.left else "--:" for column in COLUMNS) + "|",
        *("| " + " | ".join(column.cell(m) for column in COLUMNS) + " |" for m in measurements),
    ]
    return "\n".join([*lines, "", *LEGEND, "", agreement(measurements), ""])


def as_json(measurements: Sequence[Measurement]) -> str:
    """The measurements in full precision, with the versions that made them."""
    content = {
        "versions": {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}},
        "measurements": [dataclasses.asdict(m) for m in measurements],
    }
    return json.dumps(content, indent=2) + "\n"
