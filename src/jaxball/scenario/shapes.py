"""The surface of a convex body in a scenario file: one of jaxball's shapes, a user's function, or a user's class."""

from typing import Any

from ..interface.arguments import require_function
from ..numerics.arrays import a_vector
from ..physics.shape import AbstractShape, Ellipsoid, SupportFunction
from .own import FUNCTION, Open, module_of, names_own, read_own, trying
from .table import join, keys_of, read_family, write_family
from .values import Nested

SHAPES = Open(
    AbstractShape,
    {
        "ellipsoid": module_of(Ellipsoid),
        "function": module_of(SupportFunction, keys=FUNCTION),
    },
    lambda shape: require_function("shape", shape.height, (), Gamma=a_vector()),
)


def _read_shape(values: Any, path: str) -> AbstractShape:
    if names_own(values):
        return read_own(values, path, SHAPES)
    with trying(join(path, "function")):
        return read_family(values, path, SHAPES)


def _write_shape(value: Any, path: str) -> Any:
    return write_family(value, path, SHAPES)


SHAPE = Nested(_read_shape, _write_shape, tables=keys_of(SHAPES))
