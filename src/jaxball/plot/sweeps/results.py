"""The results of a study's rows by name, such as ``z[0]``, and their labels in figures."""

import re
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ...interface.wording import did_you_mean
from ...scenario.paths import entries
from ..symbols import SYMBOLS
from .rows import PictureError, Rows, listed
from .symbols import Labels

if TYPE_CHECKING:
    import xarray

_WORDS = {"friction_needed": r"$\mu_{\min}$", "reached": "time reached", "least_normal_force": "least $N$"}
# Of what a study can find by itself, in whose store there are none.
_UNITS = {"distance": "length", "largest_angular_speed": "rad/time", "energy_drift": "energy"}
_FIRST = ("friction_needed", "z", "phi", "x", "y")
_NOT_RESULTS = ("row", "status")
MOST_STANDARD = 3


def result_names(data: "xarray.Dataset") -> list[str]:
    """The names of all results of a study, those that its key ``find`` lists first; vectors by entries, as ``z[0]``."""
    names = [str(name) for name in data.data_vars if name not in _NOT_RESULTS and "row" in data[name].dims]
    first = [*_finds(data), *_FIRST]
    names.sort(key=lambda name: (first.index(name) if name in first else len(first), name))
    return [entry for name in names for entry in entries(name, _shape(data, name))]


def standard_results(data: "xarray.Dataset") -> list[str]:
    """A few important results: those that the key ``find`` lists, or else the friction needed and the final position
    where they exist, and the steps.
    """
    names = [name for name in result_names(data) if name not in ("steps", "rejected", "reached")]
    return [*names[: max(MOST_STANDARD, len(_finds(data)))], "steps"]


def _finds(data: "xarray.Dataset") -> list[str]:
    """The results that the study's key ``find`` lists."""
    return [name for name in listed(data, "finds") if name in data.data_vars] if "finds" in data.attrs else []


def values_of(rows: Rows, result: str) -> Float[np.ndarray, " rows"]:
    """A result of each row, at the last save time if there are several.

    **Raises:** :class:`PictureError` when there is no such result.
    """
    name, index = parsed(rows.data, result)
    array = rows.data[name]
    if "save" in array.dims:
        array = array.isel(save=-1)
    return array.values[(rows.places, *index)].astype(float)


def histories_of(rows: Rows, result: str) -> Float[np.ndarray, "rows saves"]:
    """A result of each row at all save times; only these rows are read.

    **Raises:** :class:`PictureError` when there is no such result, or when it was not saved at all times.
    """
    name, index = parsed(rows.data, result)
    array = rows.data[name]
    if "save" not in array.dims:
        saved = [item for item in result_names(rows.data) if "save" in rows.data[parsed(rows.data, item)[0]].dims]
        known = ", ".join(saved) or 'none: the study needs `save = "times"`'
        raise PictureError(f"Result `{result}` must be one that was saved at all times, which are {known}.")
    return array.isel(row=rows.places).values[(slice(None), slice(None), *index)]


def parsed(data: "xarray.Dataset", result: str) -> tuple[str, tuple[int, ...]]:
    """The variable that a name such as ``z[0]`` stands for, and the index in it.

    **Raises:** :class:`PictureError` when there is no such result.
    """
    known = result_names(data)
    if result not in known:
        hint = did_you_mean(result, known, f"it has {', '.join(known)}", "`")
        raise PictureError(f"Result `{result}` must be one of the study's results{hint}")
    return result.partition("[")[0], tuple(int(k) for k in re.findall(r"\[(\d+)\]", result))


def label_of(data: "xarray.Dataset", result: str, labels: Labels = None, *, at_the_end: bool = True) -> str:
    """The label of a result in a figure, from ``labels``, or with its units."""
    if labels and result in labels:
        return labels[result]
    name, index = parsed(data, result)
    words = _WORDS.get(name, name.replace("_", " "))
    if name in SYMBOLS:
        dimensions = [dimension for dimension in data[name].dims if dimension not in ("row", "save")]
        indices = [_index(data, str(dimension), k) for dimension, k in zip(dimensions, index, strict=True)]
        words = f"${SYMBOLS[name]}{'_{' + ','.join(indices) + '}' if indices else ''}$"
        words += " at the end" if at_the_end else ""
    units = data[name].attrs.get("units", "") or _UNITS.get(name, "")
    return words if units in ("", "1") else f"{words} ({units})"


def _index(data: "xarray.Dataset", dimension: str, k: int) -> str:
    """The index of the paper's symbol: it counts from 1, for a versor from 0; for driven masses it is the mass's."""
    if dimension == "component":
        return str(k)
    masses = dimension == "driven" and dimension in data.variables and data[dimension].dtype.kind == "i"
    return str(1 + (int(data[dimension][k]) if masses else k))


def _shape(data: "xarray.Dataset", name: str) -> tuple[int, ...]:
    return tuple(size for dimension, size in data[name].sizes.items() if dimension not in ("row", "save"))
