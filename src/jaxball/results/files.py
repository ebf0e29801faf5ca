"""The files that a run is saved in and read back from; nothing here needs JAX."""

from pathlib import Path

from ..scenario.errors import ScenarioError

SUFFIXES = (".nc", ".npz", ".csv")
READ_BACK = SUFFIXES[:2]  # a .csv holds only numbers


class RunError(ScenarioError):
    """A file is not a run that can be read back; the message is one sentence that names the file."""


def check_saved(path: Path) -> None:
    """Raises a :class:`RunError` unless there is a file at ``path`` with the suffix of one that can be read back."""
    if path.suffix not in READ_BACK:
        hint = "; a .csv holds only numbers, not the system that they belong to" if path.suffix == ".csv" else ""
        raise RunError(f'A run is read back from a {" or ".join(READ_BACK)} file, but this is "{path}"{hint}.')
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "does not exist"
        raise RunError(f'A run is read back from a file, but "{path}" {what}.')
