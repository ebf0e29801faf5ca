"""How objects print: arrays of a few known numbers by their values, all others by their shapes."""

import copy
import dataclasses
import html
import inspect
import math
import types
from collections.abc import Iterable, Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from .arguments import require_arguments
from .compat import is_traced

SIZE = 140  # of a sketch, in pixels
MARGIN = 6
MOST_POINTS = 400
LEAST_EXTENT = 1e-9  # of the size of its coordinates, below which a path is a point


def repr_html(self: object) -> str:
    """Returns the ``_repr_html_`` of a class whose ``repr`` has a headline and indented lines."""
    return as_html(repr(self))


def as_html(text: str, sketch: str = "") -> str:
    """Formats a headline in bold and the lines below it, with a sketch to the right."""
    head, _, lines = text.partition("\n")
    body = f'<pre style="margin:0;white-space:pre-wrap"><b>{html.escape(head)}</b>\n{html.escape(lines)}</pre>'
    return f'<div style="display:flex;gap:1.5em;align-items:flex-start">{body}{sketch}</div>'


def sketch_of(points: Float[np.ndarray, "n 2"], name: str) -> str:
    """Draws a path as SVG, with a dot where it ends and the same scale along both axes; empty if it is a point.

    - ``name``: what it shows, for readers of the screen.
    """
    points = points[np.isfinite(points).all(axis=1)]
    points = points[:: max(1, -(-len(points) // MOST_POINTS))] if len(points) else points
    extent = float(np.max(np.ptp(points, axis=0), initial=0.0)) if len(points) else 0.0
    if len(points) < 2 or extent <= LEAST_EXTENT * np.max(np.abs(points)):
        return ""
    scale = (SIZE - 2 * MARGIN) / extent
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = np.ceil((high - low) * scale + 2 * MARGIN).astype(int)
    x = MARGIN + (points[:, 0] - low[0]) * scale
    y = MARGIN + (high[1] - points[:, 1]) * scale  # upwards, as in a figure
    line = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return (
        f'<svg width="{width}" height="{height}" role="img" aria-label="{html.escape(name, quote=True)}">'
        f'<polyline points="{line}" fill="none" stroke="currentColor" stroke-width="1.2"/>'
        f'<circle cx="{x[-1]:.1f}" cy="{y[-1]:.1f}" r="3" fill="currentColor"/></svg>'
    )


MOST_WRITTEN_OUT = 9


class Printed(eqx.Module):
    """A module that prints its numbers, not just their shapes, and names itself in errors about arguments.

    A converter of a field that has a method ``belong_to`` is told the name and the annotation of its field. Each field
    has a converter of its own.
    """

    def __init_subclass__(cls, **options: Any):
        super().__init_subclass__(**options)
        for name, field in vars(cls).items():
            converter: Any = getattr(field, "metadata", {}).get("converter")
            if hasattr(converter, "belong_to"):
                # A copy, because several fields may have been given the same one.
                converter = copy.copy(converter)
                converter.belong_to(name, inspect.get_annotations(cls)[name])
                field.metadata = types.MappingProxyType({**field.metadata, "converter": converter})

    def __new__(cls, *given: Any, **named: Any):
        require_arguments(cls, given, named)
        return super().__new__(cls)

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Copies and pickles are made without arguments."""
        return object.__new__, (type(self),), vars(self)

    def __repr__(self) -> str:
        return format_value(self)

    _repr_html_ = repr_html


def format_value(value: Any) -> str:
    """Formats a value in one line: a module with all its fields, and the modules within it without defaults."""
    if isinstance(value, eqx.Module):
        return format_fields(value, dataclasses.fields(value))
    return _within(value)


def format_fields(module: eqx.Module, fields: Iterable[dataclasses.Field], *, brief: bool = False) -> str:
    """Formats ``Name(field=value, ...)`` with some fields of a module; ``brief`` leaves out defaults."""
    values = vars(module)  # some are missing while the module is being made
    entries = [
        f"{field.name}={_within(value)}"
        for field in fields
        if (value := values.get(field.name)) is not None and not (brief and _is_default(field, value))
    ]
    return f"{type(module).__name__}({', '.join(entries)})"


def in_short(value: Any) -> str:
    """Describes an array by its numbers where there are up to three, else by its shape and range."""
    if not is_array(value) or not _is_known(value) or value.size <= 3:
        return _within(value)
    finite = np.asarray(value)[np.isfinite(value)]
    return _shape(value) + (f", from {np.min(finite):.6g} to {np.max(finite):.6g}" if finite.size else ", not finite")


def _within(value: Any) -> str:
    if is_array(value):
        by_shape = not _is_known(value) or value.size > MOST_WRITTEN_OUT or (value.size == 0 and value.ndim > 1)
        return _shape(value) if by_shape else _nest(np.asarray(value))
    if isinstance(value, eqx.Module):
        return format_fields(value, dataclasses.fields(value), brief=True)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key!r}: {_within(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple) and not hasattr(value, "_fields"):
        return f"({', '.join(map(_within, value))}{',' if len(value) == 1 else ''})"
    name = getattr(value, "__name__", None)
    return repr(value) if name is None or not callable(value) else name


def _is_default(field: dataclasses.Field, value: Any) -> bool:
    if isinstance(field.default_factory, type):
        return _within(value) == f"{field.default_factory.__name__}()"
    if field.default is dataclasses.MISSING:
        return False
    if is_array(value):
        return _is_known(value) and np.array_equal(np.asarray(value), np.asarray(field.default, value.dtype))
    return not is_array(field.default) and bool(field.default == value)


def json_types(value: Any) -> Any:
    """Converts a value to the types of JSON: arrays to lists, and numbers that are not finite, which JSON lacks, to
    None.
    """
    if isinstance(value, Mapping):
        return {str(name): json_types(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_types(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return json_types(value.tolist())
    if isinstance(value, complex):
        return {"real": json_types(value.real), "imaginary": json_types(value.imag)}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def is_array(value: Any) -> bool:
    """Returns whether this is an array, traced or not, or the shape of one."""
    return isinstance(value, jax.Array | np.ndarray | np.generic | jax.ShapeDtypeStruct)


def is_single(*values: Any) -> bool:
    """Returns whether these are known numbers: not traced, and not of a batch."""
    return all(not _is_abstract(value) and np.ndim(value) == 0 for value in values)


def entry(value: Any, axis: int, index: int) -> Any:
    """Returns the entry of an array along an axis, or its shape where it is traced; anything else as it is."""
    if not is_array(value) or np.ndim(value) <= axis or value.shape[axis] <= index:
        return value
    if not _is_known(value):
        return jax.ShapeDtypeStruct(value.shape[:axis] + value.shape[axis + 1 :], value.dtype)
    return np.take(np.asarray(value), index, axis=axis)


def _is_abstract(value: Any) -> bool:
    return is_traced(value) or isinstance(value, jax.ShapeDtypeStruct)


def _is_known(array: Any) -> bool:
    if _is_abstract(array) or not isinstance(array.dtype, np.dtype):  # a random key has no numbers
        return False
    return not isinstance(array, jax.Array) or (array.is_fully_addressable and not array.is_deleted())


def _shape(array: Any) -> str:
    kind = np.dtype(array.dtype).name if isinstance(array.dtype, np.dtype) else str(array.dtype)
    return f"{kind}[{','.join(map(str, array.shape))}]"


def _nest(array: Any) -> str:
    if array.ndim == 0:
        return str(array)
    return f"({', '.join(map(_nest, array))}{',' if len(array) == 1 else ''})"
