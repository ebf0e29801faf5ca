"""The provenance of a report: the command, the problem file, of which a copy is kept, the versions and the time."""

import importlib.metadata
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from ..results import OutputError, replacing
from ..results.provenance import PACKAGES
from ..scenario.sources import scenario_document
from .problem.variables import DesignError

COPY = "problem.toml"


def write_text(path: Path, text: str) -> Path:
    """Writes a file atomically; its path."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="surrogateescape")  # a file name may not be valid text
    return path


class Source(NamedTuple):
    """A problem file and the command that read it.

    - ``command``: as it can be typed again.
    - ``file``: its path, and ``text``, its content when it was read.
    """

    command: str
    file: Path
    text: str

    @property
    def document(self) -> dict[str, Any]:
        """The problem, its scenario written out, so that it needs no other file."""
        document = tomllib.loads(self.text)
        return {**document, "scenario": scenario_document(document["scenario"], self.file.parent, DesignError)}

    def check(self, folder: Path) -> None:
        """Refuses a folder that has another problem's copy, or any other file of that name.

        **Raises:** :class:`~jaxball.results.OutputError`.
        """
        there = folder / COPY
        if there.exists() and not self._is(there) and _document(there) != self.document:
            raise OutputError(
                f'Argument `--out` must be a folder without another problem, but "{there}" is not the one being '
                "read; choose another folder, or remove it."
            )

    def copy(self, folder: Path) -> None:
        """Writes the copy: the text itself, or, where the scenario is in another file, the problem with it."""
        if self._is(folder / COPY):
            return
        document = tomllib.loads(self.text)
        write_text(folder / COPY, self.text if isinstance(document["scenario"], dict) else tomli_w.dumps(self.document))

    def _is(self, path: Path) -> bool:
        return path.exists() and path.samefile(self.file)


def duration(seconds: float) -> str:
    """A time in hours, minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{seconds:.1f} s"


def made(source: Source | None, elapsed: float, resumed: bool = False) -> list[str]:
    """The lines of a report that say how it was made; ``elapsed`` is in seconds."""
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in PACKAGES)
    by = "By" if source is None else f"By `{source.command}`, with"
    lines = [f"{by} {versions}, in {duration(elapsed)}{', all runs of the search together' * resumed}."]
    if source is not None:
        lines += ["", f"The problem is `{COPY}`, a copy of the file that was read."]
    return ["## How it was made", "", *lines, ""]


def _document(path: Path) -> Any:
    """The content of a file; None if it is not a document."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
