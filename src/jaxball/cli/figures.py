"""The figures of a run, written into a folder in one format or several."""

import argparse
from pathlib import Path
from typing import Any

from ..interface.output import OutputError, check_folder
from ..interface.wording import counted
from ..simulation.trajectory import Trajectory

FORMATS = ("png", "pdf", "svg")
SUFFIXES = tuple(f".{name}" for name in FORMATS)


def add_formats(parser: argparse.ArgumentParser, option: str) -> None:
    """Adds the option that names the formats of figures."""
    parser.add_argument(
        option, nargs="+", choices=FORMATS, metavar="FORMAT", help="of the figures: png, pdf or svg (default: png)"
    )


def check_figures_folder(options: argparse.Namespace, folder: str, formats: str) -> None:
    """Raises an :class:`~jaxball.results.OutputError` where figures cannot be written into the folder of an option."""
    path, option = getattr(options, folder), formats.replace("_", "-")
    if path is None:
        if getattr(options, formats) is not None:
            raise OutputError(f"Argument `--{option}` is for figures; give --{folder} FOLDER with it.")
        return
    if path.suffix in SUFFIXES and not path.exists():
        raise OutputError(
            f'Argument `--{folder}` must be a folder, because there are several figures, but it is "{path}"; '
            f"give --{folder} {path.with_suffix('')} --{option} {path.suffix[1:]}."
        )
    check_folder(path, f"--{folder}")


def draw_figures(trajectory: Trajectory[Any, Any], folder: Path, formats: list[str] | None, title: str) -> str:
    """Draws the standard figures, and returns how many there are and where."""
    # Imported here, because matplotlib takes longer to import than many a run.
    from .. import plot

    paths = plot.figures(trajectory, folder, title, formats=tuple(dict.fromkeys(formats or ("png",))))
    return f"{counted(len(paths), 'figure')} in {folder}"
