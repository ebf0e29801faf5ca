"""The files of figures: each records its run, and does not replace a figure of another run unless asked to."""

import contextlib
import hashlib
import itertools
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..interface.output import OutputError, replacing
from ..interface.wording import any_of
from ..numerics.arrays import arrays_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..simulation.trajectory import Trajectory

# The metadata field of each format for the description. In a file it is plain text.
METADATA = {"png": "Description", "pdf": "Subject", "svg": "Description"}
LONGEST_NAME = 60  # letters of a name


def run_mark(trajectory: "Trajectory[Any, Any]") -> str:
    """Returns the mark of a run: a digest of its scenario, or of its states without one, and where it ended."""
    from ..files.scenario.errors import ScenarioError
    from ..files.scenario.files import write_scenario

    digest = ""
    # A scenario that cannot be written has no text; its states tell the run then.
    if trajectory.scenario is not None:
        with contextlib.suppress(ScenarioError):
            digest = scenario_mark(write_scenario(trajectory.scenario))
    if not digest:
        leaves = (np.asarray(leaf).tobytes() for _, leaf in sorted(arrays_of(trajectory.state).items()))
        digest = _mark(b"".join([np.asarray(trajectory.times).tobytes(), *leaves]))
    # With the end, because a run that failed early is another run of the same scenario.
    return f"{digest} to {float(trajectory.reached):.9g}"


def scenario_mark(text: str) -> str:
    """Returns the common prefix of the marks of all runs of a scenario with this text."""
    return _mark(text.encode())


def _mark(content: bytes) -> str:
    return f"of the run {hashlib.sha256(content).hexdigest()[:20]}"


def plain_name(text: str, otherwise: str) -> str:
    """Converts a text to a file name: its letters, digits, dots, hyphens and underscores; ``otherwise`` if none
    remains.
    """
    words = re.sub(r"[^\w.-]+", "-", text).strip("-._")
    return words[:LONGEST_NAME].rstrip("-._") or otherwise


def check_others(paths: Iterable[Path], mark: str, option: str) -> None:
    """Raises an :class:`~jaxball.files.results.OutputError` where one of the ``paths`` is a figure of another run."""
    for path in paths:
        if path.is_file() and mark.encode() not in path.read_bytes():
            raise OutputError(
                f'The file "{path}" is not a figure of this run, but would be replaced by one; choose another folder, '
                f"or give {option} to replace it."
            )


def figures_in(folder: Path, name: str, formats: Sequence[str]) -> list[Path]:
    """Lists the figures called ``name`` in a folder."""
    return sorted(path for suffix in formats for path in folder.glob(f"{name}_*.{suffix}"))


def save_figures(
    drawings: "Sequence[tuple[str, Callable[[], Axes | Figure]]]",
    folder: str | Path,
    mark: str,
    formats: Sequence[str],
    *,
    svg_text: bool,
    replace: bool,
) -> list[Path]:
    """Writes figures by their names into a folder, in each format, and returns their paths.

    **Raises:** :class:`~jaxball.files.results.OutputError` where there is a figure of another run and ``replace`` is
    False; nothing is written then.
    """
    if isinstance(formats, str) or not set(formats) <= set(METADATA):
        raise ValueError(
            f'Argument `formats` must be a list of {any_of(tuple(METADATA))}, such as ["png"], but it is {formats!r}.'
        )
    # All of them are checked before any is written.
    paths = [[Path(folder) / f"{name}.{suffix}" for suffix in formats] for name, _ in drawings]
    if not replace:
        check_others(itertools.chain(*paths), mark, "replace=True")
    Path(folder).mkdir(parents=True, exist_ok=True)
    for files, (_, draw) in zip(paths, drawings, strict=True):
        drawn = draw()
        for path in files:
            save_figure(drawn, path, mark, svg_text=svg_text)
    return list(itertools.chain(*paths))


def save_figure(drawn: "Axes | Figure", path: Path, mark: str = "", *, svg_text: bool = False) -> None:
    """Writes a figure, or that of some Axes: PDF with TrueType fonts, SVG with paths, or ``svg_text``, with text."""
    import matplotlib

    figure: Any = drawn if not hasattr(drawn, "figure") or drawn.figure is None else drawn.figure
    kind = path.suffix[1:]
    metadata = {METADATA[kind]: mark} if mark and kind in METADATA else {}
    # Type 42 is TrueType: publishers refuse Type 3, matplotlib's default.
    settings: Any = {"pdf.fonttype": 42, "svg.fonttype": "none" if svg_text else "path"}
    with matplotlib.rc_context(settings), replacing(path) as temporary:
        figure.savefig(temporary, dpi=200, metadata=metadata)
