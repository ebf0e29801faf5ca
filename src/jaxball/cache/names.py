"""Names of classes and functions of libraries whose version is known: the same in every process."""

import sys
from typing import Any

OWN = __name__.split(".")[0]
LIBRARIES = ("jax", "jaxlib", "numpy", "equinox", "diffrax", "optimistix", "lineax")
_KNOWN = frozenset((OWN, *LIBRARIES, "builtins", "collections", "enum", "functools", "math", "operator", "types"))


class NoNameError(TypeError):
    """A value may differ invisibly between processes."""


def name_of(named: Any) -> str:
    """The name by which a class or a function of a known library is found.

    **Raises:** :class:`NoNameError` where it belongs to another library or is not found by its name.
    """
    module, path = getattr(named, "__module__", None), getattr(named, "__qualname__", None)
    bearer: Any = None
    if isinstance(module, str) and isinstance(path, str) and module.split(".")[0] in _KNOWN:
        bearer = sys.modules.get(module)
        for name in path.split("."):
            bearer = getattr(bearer, name, None)
        while bearer is not named and hasattr(bearer, "__wrapped__"):
            bearer = bearer.__wrapped__
    if bearer is not named:
        raise NoNameError(f"{named!r} is not found by a name in a library whose version is known.")
    return f"{module}:{path}"
