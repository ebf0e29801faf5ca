"""The files of saved runs: checks of their paths, and their arrays and attributes as read. Nothing here needs JAX."""

import contextlib
import importlib.util
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..interface.output import OutputError, check_destination
from ..interface.wording import one_of, pip_install
from ..scenario.errors import ScenarioError

FORMAT = 1
SUFFIXES = (".nc", ".npz", ".csv", ".mcap")
READ_BACK = SUFFIXES[:2]
NUMBERS_ONLY = {".csv": "numbers", ".mcap": "messages"}
# Names in files of earlier versions, and those of today.
OLDER = {"rejected_steps": "rejected", "rubbed": "friction_loss", "struck": "impact_loss"}
UNKNOWN_SOLVER = "# Made from a trajectory, which does not contain its solver settings: there is no table [solve].\n"


def check_format(path: Path, argument: str = "path") -> None:
    """Raises an :class:`OutputError` unless a run can be saved at ``path``, which the message calls ``argument``."""
    check_destination(path, SUFFIXES, argument)
    if path.suffix == ".mcap" and importlib.util.find_spec("mcap") is None:
        raise OutputError(
            f'Argument `{argument}` must end in {one_of(SUFFIXES[:-1])}, but it is "{path}", which needs mcap, and '
            f"mcap is not installed; {pip_install('mcap')}."
        )


class RunError(ScenarioError):
    """A file is not a run that can be loaded; the message is one sentence that names the file."""


def check_saved(path: Path) -> None:
    """Raises a :class:`RunError` unless there is a file at ``path`` with the suffix of one that can be loaded."""
    if path.suffix not in READ_BACK:
        held = NUMBERS_ONLY.get(path.suffix)
        hint = f"; a {path.suffix} holds only {held}, not the system that they belong to" if held else ""
        raise RunError(f'A run can be loaded from a {" or ".join(READ_BACK)} file, but this is "{path}"{hint}.')
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "does not exist"
        raise RunError(f'A run can be loaded from a file, but "{path}" {what}.')


def load_attributes(path: Path) -> Mapping[str, Any]:
    """Loads the attributes of a saved run, under today's names; a warning says where a file has older ones.

    **Raises:** :class:`RunError` where there is none, or one of another version of the format.
    """
    check_saved(path)
    with refuse_errors(path):
        about = CONTENTS[path.suffix](path, arrays=False)
    if OLDER.keys() & about.keys():
        message = (
            f'The run "{path}" has names of an earlier version of jaxball; load it and save it again for today\'s.'
        )
        warnings.warn(message, FutureWarning, stacklevel=3)
        about = _of_today(about)
    number = attribute_of(path, about, "format", int)
    if number != FORMAT:
        raise RunError(
            f'The run "{path}" was saved by jaxball {about.get("jaxball_version", "?")} in format {number}, '
            f"and this version reads format {FORMAT}; read it with that version, or a later one."
        )
    return about


def attribute_of(path: Path, about: Mapping[str, Any], name: str, read: Callable[[Any], Any]) -> Any:
    """Reads an attribute of a file.

    **Raises:** :class:`RunError` that names it where it is missing or wrong.
    """
    try:
        return read(about[name])
    except (KeyError, TypeError, ValueError):
        raise no_run(path, f"its `{name}` is {about[name]!r}" if name in about else f"it has no `{name}`") from None


def load_text(path: Path) -> str:
    """Loads the text of the scenario in a saved run.

    **Raises:** as :func:`load_attributes` and :func:`text_in`.
    """
    return text_in(path, load_attributes(path))


def text_in(path: Path, about: Mapping[str, Any]) -> str:
    """Returns the text of the scenario among the attributes of the run.

    **Raises:** :class:`RunError` where there is none.
    """
    text = str(about.get("scenario", ""))
    if not text:
        raise RunError(
            f'The run "{path}" contains no scenario, because a file cannot hold some part of it, such as a Python '
            "function or an impossible number; give its system: load_run(path, system)."
        )
    return text


@contextlib.contextmanager
def refuse_errors(path: Path) -> Iterator[None]:
    """Turns errors raised while reading a file into a :class:`RunError`."""
    try:
        yield
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise no_run(path, str(error).splitlines()[0] if str(error) else type(error).__name__) from None


def no_run(path: Path, reason: str) -> RunError:
    """Returns the error for a file that is not a run."""
    return RunError(f'The file "{path}" must be a run that jaxball saved, but it is not: {reason}.')


def _of_netcdf(path: Path, arrays: bool) -> Mapping[str, Any]:
    # Imported here, because code that loads no run does not need it; xarray, which could do this, takes ten times as
    # long.
    import h5netcdf

    with h5netcdf.File(path, "r") as file:
        return {name: variable[...] for name, variable in file.variables.items()} if arrays else dict(file.attrs)


def _of_npz(path: Path, arrays: bool) -> Mapping[str, Any]:
    import numpy as np

    # A pickle in a file would be a program that runs.
    with np.load(path, allow_pickle=False) as data:
        saved = {name: data[name] for name in data.files}
    # Attributes have no axis, and arrays over time have one.
    return saved if arrays else {name: array.item() for name, array in saved.items() if array.ndim == 0}


CONTENTS: dict[str, Callable[..., Mapping[str, Any]]] = dict(zip(READ_BACK, (_of_netcdf, _of_npz), strict=True))


def load_arrays(path: Path) -> Mapping[str, Any]:
    """Loads the arrays of a saved run, under today's names."""
    return _of_today(CONTENTS[path.suffix](path, arrays=True))


def _of_today(saved: Mapping[str, Any]) -> Mapping[str, Any]:
    return {OLDER.get(name, name): value for name, value in saved.items()}
