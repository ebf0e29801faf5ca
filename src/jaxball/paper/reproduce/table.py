"""Tables of measurements, as plain text, Markdown and JSON."""

import dataclasses
import json
import platform
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

from ...interface.output import write_text
from .experiments import Measurement

PACKAGES = ("jaxball", "diffrax", "equinox", "jax", "jaxlib", "numpy")
Row = TypeVar("Row")
Whole = TypeVar("Whole")


@dataclasses.dataclass(frozen=True)
class Column(Generic[Row]):
    """A column's heading and how it shows a row; words are aligned left, numbers right."""

    heading: str
    cell: Callable[[Row], str]
    width: int
    left: bool = False

    def aligned(self, text: str) -> str:
        """``text`` padded with blanks to the column's width."""
        return text.ljust(self.width) if self.left else text.rjust(self.width)

    def of(self, part: Callable[[Whole], Row]) -> "Column[Whole]":
        """The same column for rows that contain such a row."""
        return Column(self.heading, lambda whole: self.cell(part(whole)), self.width, self.left)


@dataclasses.dataclass(frozen=True)
class Table(Generic[Row]):
    """A table whose rows are dataclasses.

    - ``name``: of its files, without a suffix.
    - ``legend``: the paragraphs below it.
    """

    name: str
    columns: Sequence[Column[Row]]
    legend: Sequence[str]

    @property
    def files(self) -> tuple[str, str]:
        """The names of its files."""
        return f"{self.name}.md", f"{self.name}.json"

    def printed(self, rows: Iterable[Row], echo: Callable[[str], None]) -> list[Row]:
        """All ``rows``, each printed as soon as it is available."""
        titles = "  ".join(column.aligned(column.heading) for column in self.columns)
        echo(titles + "\n" + "  ".join("-" * column.width for column in self.columns))
        taken = []
        for row in rows:
            taken.append(row)
            echo("  ".join(column.aligned(column.cell(row)) for column in self.columns))
        return taken

    def write(self, folder: Path, rows: Sequence[Row], conclusion: str, **about: Any) -> None:
        """Writes the table with its legend and ``conclusion`` as Markdown, and as JSON the rows with ``about``.

        The JSON has the rows in full precision, with the versions that made them.

        **Raises:** :class:`~jaxball.results.OutputError` when a file cannot be written.
        """
        versions = {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}
        content = {"versions": versions, **about, "measurements": [dataclasses.asdict(cast(Any, row)) for row in rows]}
        as_json = json.dumps(content, indent=2, ensure_ascii=False) + "\n"
        for name, text in zip(self.files, (self._markdown(rows, conclusion), as_json), strict=True):
            write_text(folder / name, text)

    def _markdown(self, rows: Sequence[Row], conclusion: str) -> str:
        lines = [
            "| " + " | ".join(column.heading for column in self.columns) + " |",
            "|" + "|".join(":--" if column.left else "--:" for column in self.columns) + "|",
            *("| " + " | ".join(column.cell(row) for column in self.columns) + " |" for row in rows),
        ]
        return "\n\n".join(["\n".join(lines), *self.legend, conclusion]) + "\n"


# The columns that the tables share.
STEPS: tuple[Column[Measurement], ...] = (
    Column("Accepted", lambda m: str(m.accepted), 8),
    Column("Rejected", lambda m: str(m.rejected), 8),
    Column("Evaluations", lambda m: str(m.evaluations), 11),
    Column("Error", lambda m: f"{m.error:.1e}", 7),
)


def agreement(measurements: Sequence[Measurement], solvers: str = "") -> str:
    """A sentence with the largest error of all ``solvers``, system by system; by default their names."""
    systems = dict.fromkeys(m.system for m in measurements)
    parts = [f"{max(m.error for m in measurements if m.system == system):.1e} for the {system}" for system in systems]
    solvers = solvers or ", ".join(dict.fromkeys(m.solver for m in measurements))
    return f"Agreement with the paper's runs: the largest error of {solvers} is {' and '.join(parts)}."
