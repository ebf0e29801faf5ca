"""The files of saved runs: checks of their paths, and their arrays and attributes as read. Nothing here needs JAX."""

import contextlib
import importlib.util
import math
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from ...interface.output import OutputError, check_destination
from ...interface.wording import one_of, pip_install
from ..scenario.errors import ScenarioError

FORMAT = 1
SUFFIXES = (".nc", ".npz", ".csv", ".mcap")
READ_BACK = SUFFIXES[:2]
NUMBERS_ONLY = {".csv": "numbers", ".mcap": "messages"}
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
    """Loads the attributes of a saved run.

    **Raises:** :class:`RunError` where there is none, or one of another version of the format.
    """
    check_saved(path)
    with refuse_errors(path):
        has_checksum = _require_unchanged(path)
        about = CONTENTS[path.suffix](path, arrays=False)
        if CHECKSUM in about and not has_checksum:
            raise no_run(path, f"it must end with its {CHECKSUM}, so that it has changed since")
    number = attribute_of(path, about, "format", int)
    if number != FORMAT:
        raise RunError(
            f'The run "{path}" was saved by jaxball {about.get("jaxball_version", "?")} in format {number}, '
            f"and this version reads format {FORMAT}; read it with the version that saved it."
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
    except RunError:
        raise
    except MemoryError:
        raise no_run(path, "its numbers would not fit into memory") from None
    except Exception as error:  # of any kind: a damaged file may hold anything, and the libraries raise all kinds
        reason = " ".join(str(error.args[0] if error.args else "").split())
        raise no_run(path, (reason or type(error).__name__).rstrip(".")) from error


def no_run(path: Path, reason: str) -> RunError:
    """Returns the error for a file that is not a run."""
    return RunError(f'The file "{path}" must be a run that jaxball saved, but it is not: {reason}.')


# The attribute says that the file ends with a checksum, which neither HDF5 nor zip reads. HDF5 itself would give other
# numbers where those of an array have changed, and would not come back where a heap of its texts has.
CHECKSUM = "checksum"
AT_THE_END = "CRC-32 of all before it, as 8 hexadecimal digits at the end of the file"
_MARK = b"CRC-32: "
_DIGITS = 8


def add_checksum(path: Path) -> None:
    """Appends the checksum of a file to it."""
    with path.open("r+b") as file:
        file.write(_MARK + b"%08x" % _crc(file, path.stat().st_size))


def _require_unchanged(path: Path) -> bool:
    """Returns whether a file ends with a checksum, which one that another program wrote again has not.

    **Raises:** :class:`RunError` where it is not that of the file.
    """
    size = max(path.stat().st_size - len(_MARK) - _DIGITS, 0)
    with path.open("rb") as file:
        crc = _crc(file, size)
        end = file.read()
    if not end.startswith(_MARK):
        return False
    if end != _MARK + b"%08x" % crc:
        raise no_run(path, f"it has changed since, as its {CHECKSUM} tells")
    return True


def _crc(file: BinaryIO, size: int) -> int:
    """Computes the checksum of the first bytes of a file, behind which it is left."""
    crc = 0
    for start in range(0, size, _BYTES_AT_ONCE):
        crc = zlib.crc32(file.read(min(_BYTES_AT_ONCE, size - start)), crc)
    return crc


_BYTES_AT_ONCE = 2**20

# An archive holds at most some thousand numbers in a byte.
BYTES_FROM_ONE = 2_000


def _require_held(path: Path, claimed: int) -> None:
    """Raises a :class:`RunError` where a file claims to hold more than it can, before memory is taken for it."""
    size = path.stat().st_size
    if claimed > BYTES_FROM_ONE * size:
        raise no_run(path, f"it says that it holds {claimed:.2g} bytes of numbers, but it has {size:,} bytes")


def _of_netcdf(path: Path, arrays: bool) -> Mapping[str, Any]:
    # Not h5netcdf, which writes to standard error where a file cannot be opened. Imported here, because code that loads
    # no run does not need it.
    import h5py

    with h5py.File(path, "r") as file:
        if not arrays:
            return {name: _attribute_of_netcdf(value) for name, value in file.attrs.items() if name[0] != "_"}
        variables = {name: item for name, item in file.items() if isinstance(item, h5py.Dataset)}
        _require_held(path, sum(math.prod(item.shape) * item.dtype.itemsize for item in variables.values()))
        return {name: item[()] for name, item in variables.items()}


def _attribute_of_netcdf(value: Any) -> Any:
    import h5py

    if isinstance(value, h5py.Empty):
        return ""
    item = value[0] if getattr(value, "shape", ()) == (1,) else value
    return item.decode() if isinstance(item, bytes) else getattr(item, "item", lambda: item)()


def _of_npz(path: Path, arrays: bool) -> Mapping[str, Any]:
    import numpy as np

    if not zipfile.is_zipfile(path):  # of which NumPy would say that a pickle can be loaded unsafely
        raise no_run(path, "it is no archive of arrays")
    # A pickle in a file would be a program that runs.
    with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
        _require_held(path, sum(info.file_size for info in data.zip.infolist()))
        _require_held(path, sum(_read_claim(data, name) for name in data.files))
        saved = {name: data[name] for name in data.files}
    # Attributes have no axis, and arrays over time have one.
    is_array = {name: array.ndim > 0 for name, array in saved.items()}
    return {name: array if arrays else array.item() for name, array in saved.items() if is_array[name] == arrays}


def _read_claim(data: Any, name: str) -> int:
    """Returns how many bytes an array of an archive says that it has."""
    from numpy.lib import format as npy

    with data.zip.open(f"{name}.npy") as file:
        first = npy.read_magic(file) == (1, 0)
        shape, _, kind = npy.read_array_header_1_0(file) if first else npy.read_array_header_2_0(file)
    return math.prod(shape) * kind.itemsize


CONTENTS: dict[str, Callable[..., Mapping[str, Any]]] = dict(zip(READ_BACK, (_of_netcdf, _of_npz), strict=True))


def load_arrays(path: Path) -> Mapping[str, Any]:
    """Loads the arrays of a saved run, whose attributes have been loaded.

    **Raises:** :class:`RunError` where they cannot be read.
    """
    with refuse_errors(path):
        return CONTENTS[path.suffix](path, arrays=True)
