"""The warning that a user's function may jump at times that no solve knows; ``numerics.kinks`` gives it."""

import functools
import warnings
from collections.abc import Callable
from typing import Any

# The warnings that were shown, each with the filters then. Python's own registry forgets them whenever any library
# enters `warnings.catch_warnings`, as JAX does while it traces.
_shown: set[Any] = set()


class KinkWarning(UserWarning):
    """A function may jump at times that a solve does not know, so that derivatives with respect to these are 0."""


def warn_of_kinks(function: Callable[..., Any], symbols: tuple[str, ...], remedy: str) -> None:
    """Warns that ``function`` compares the time by these operations, in a way that gives no times.

    The warning is shown at the first line of the function, and once while filters are the same unless one of them says
    "always".

    - ``remedy``: how its times are given.
    """
    while isinstance(function, functools.partial):
        function = function.func
    code = getattr(function, "__code__", None)
    name = getattr(function, "__qualname__", type(function).__qualname__).replace("<locals>.", "")
    by = ", ".join(f"`{symbol}`" for symbol in symbols)
    message = (
        f"{name} compares or rounds the time by {by}, so that it may jump at times that are not known. Steps do not "
        f"end there, and derivatives with respect to what moves a jump are 0. If it jumps, {remedy}; if a jump depends "
        "on the state, make it a mode of a hybrid system. If it does not jump, ignore jaxball.KinkWarning with "
        "warnings.filterwarnings."
    )
    file, line = ("<function>", 1) if code is None else (code.co_filename, code.co_firstlineno)
    warning = message, file, line, tuple(warnings.filters)
    always = any(action == "always" and issubclass(KinkWarning, kind) for action, _, kind, *_ in warnings.filters)
    if always or warning not in _shown:
        warnings.warn_explicit(message, KinkWarning, file, line, getattr(function, "__module__", None))
        _shown.add(warning)
