"""Arranges the rows of a study as a grid, a dimension for each of its axes, for ``open_grid``."""

import functools
from typing import Any

import numpy as np
import xarray
from xarray.backends import BackendArray
from xarray.core import indexing

from .outputs import dimensions


def cross_axes(data: xarray.Dataset, points: xarray.Dataset) -> xarray.Dataset:
    """Puts the rows in ``data`` along the axes of their study; ``points`` are the values along these."""
    axes, shape = dimensions(data.attrs["paths"], data.attrs["path_axis"]), tuple(data.attrs["shape"])
    counted = {name: np.arange(size) for name, size in zip(axes, shape, strict=True) if name not in points.variables}
    crossed = {
        name: _cross_variable(item, axes, shape)
        for name, item in data.variables.items()
        if name not in points.variables
    }
    coordinates = {name: crossed.pop(name) for name in data.coords if name in crossed}
    return xarray.Dataset(crossed, {**counted, **points.variables, **coordinates}, data.attrs)


def _cross_variable(variable: Any, axes: list[str], shape: tuple[int, ...]) -> Any:
    """Puts a variable along the axes in place of its dimension ``row``, if it has one."""
    if variable.dims[:1] != ("row",):
        return variable
    # Not read yet: a grid may be much larger than what is looked at.
    lazy = indexing.LazilyIndexedArray(_Crossed(variable, shape))
    return xarray.Variable((*axes, *variable.dims[1:]), lazy, variable.attrs)


class _Crossed(BackendArray):
    """A variable over rows as an array over the points of all axes, read when it is indexed."""

    def __init__(self, variable: Any, axes: tuple[int, ...]):
        self.variable, self.axes = variable, axes
        self.shape, self.dtype = (*axes, *variable.shape[1:]), variable.dtype

    def __getitem__(self, key: Any) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._read)

    def _read(self, key: tuple[Any, ...]) -> np.ndarray:
        along, rest = key[: len(self.axes)], key[len(self.axes) :]
        # The last axis changes fastest, as in the rows of a study.
        strides = np.cumprod([1, *self.axes[:0:-1]])[::-1]
        places = [stride * np.arange(size)[k] for stride, size, k in zip(strides, self.axes, along, strict=True)]
        rows = np.asarray(functools.reduce(np.add.outer, places))
        values = self.variable[(rows.ravel(), *rest)].values
        return values.reshape(rows.shape + values.shape[1:])
