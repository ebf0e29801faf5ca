"""The names by which fingerprints and kept programs refer to classes and functions of libraries of known versions."""

import sys
import types
from typing import Any

OWN = __name__.split(".")[0]
LIBRARIES = ("jax", "jaxlib", "numpy", "equinox", "diffrax", "optimistix", "lineax", "jaxtyping")
_OF_PYTHON = ("abc", "builtins", "cmath", "collections", "contextlib", "copy", "dataclasses", "enum", "functools")
_OF_PYTHON += ("itertools", "math", "numbers", "operator", "reprlib", "types", "typing")
_KNOWN = frozenset((OWN, *LIBRARIES, *_OF_PYTHON))


class NoNameError(TypeError):
    """A value may differ invisibly between processes."""


def is_known(module: str) -> bool:
    """Returns whether a module belongs to a library whose version is known."""
    return module.split(".")[0] in _KNOWN


def home_of(defined: Any) -> types.ModuleType | None:
    """Returns the module of a known library in which a function or a class was defined; None for any other."""
    if isinstance(defined, types.FunctionType):  # which may say that it is from elsewhere
        home = sys.modules.get(defined.__globals__.get("__name__", ""))
        return home if home and is_known(home.__name__) and vars(home) is defined.__globals__ else None
    module = getattr(defined, "__module__", None)
    return sys.modules.get(module) if isinstance(module, str) and is_known(module) else None


def name_of(named: Any) -> str:
    """Returns the name by which a class or a function of a known library is found.

    **Raises:** :class:`NoNameError` where it belongs to another library or is not found by its name.
    """
    module, path = getattr(named, "__module__", None), getattr(named, "__qualname__", None)
    bearer: Any = None
    if isinstance(module, str) and isinstance(path, str) and is_known(module):
        bearer = sys.modules.get(module)
        for name in path.split("."):
            bearer = getattr(bearer, name, None)
        while bearer is not named and hasattr(bearer, "__wrapped__"):
            bearer = bearer.__wrapped__
    if bearer is not named:
        raise NoNameError(f"{named!r} is not found by a name in a library whose version is known.")
    return f"{module}:{path}"
