"""Recognises views that jaxball wrote, so that a view never overwrites any other file."""

from pathlib import Path

from .output import OutputError, check_destination

SUFFIXES = (".html",)
MOST_BODIES = 24  # in a view
MARK = "<!doctype html>\n<!-- jaxball view -->\n"  # what every view begins with


def check_view(path: Path, argument: str = "path") -> None:
    """Raises an :class:`~jaxball.results.OutputError` unless a view can be written at ``path``.

    A file that is already there must be a view. The message calls the path ``argument``.
    """
    check_destination(path, SUFFIXES, argument)
    if not path.exists():
        return
    with path.open("rb") as file:
        if file.read(len(MARK.encode())) != MARK.encode():
            raise OutputError(
                f'Argument `{argument}` must be a new file or a view to replace, but "{path}" is another file; remove '
                "it first, or write elsewhere."
            )
