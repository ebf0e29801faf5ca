"""Old names that still work: a package, a function or a class accepts one, and warns with the new name.

Whoever renames a public name uses it; old keys of files are in ``scenario/renamed.py``.

``docs/project/compatibility.md`` says how long, which :func:`removal` computes.
"""

import functools
import inspect
import sys
import warnings
from collections.abc import Callable, Mapping
from types import FrameType
from typing import Any, TypeVar

from .names import missing

RELEASES_WITH_A_WARNING = 2  # minor releases in which an old name works and warns
# Packages whose frames lie between the line of a user and an old name: classes are called through equinox.
PASSED = ("jaxball", "equinox", "jaxtyping", "beartype", "importlib")

Called = TypeVar("Called", bound=Callable[..., Any])


def removal(since: str) -> str:
    """Computes the version from which an old name may be missing, from the version that first warns: 0.4 from 0.2."""
    major, minor = since.split(".")
    return f"{major}.{int(minor) + RELEASES_WITH_A_WARNING}"


def warn_of_old_name(old: str, new: str, since: str) -> None:
    """Warns with a ``DeprecationWarning`` at the line of the user, which is the first outside jaxball.

    - ``old``, ``new``: the names, as a user writes them.
    - ``since``: the version that first warns, such as ``"0.2"``.
    """
    warn_at_users_line(
        f"{old} is deprecated since jaxball {since}, and will be removed in {removal(since)}; use {new}.",
        DeprecationWarning,
    )


def warn_at_users_line(message: str, category: type[Warning]) -> None:
    """Warns at the line of the user, which is the first outside jaxball."""
    frame: FrameType | None = sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] in PASSED:
        frame = frame.f_back
    module = frame.f_globals.get("__name__", "<unknown>")
    registry = frame.f_globals.setdefault("__warningregistry__", {})
    warnings.warn_explicit(message, category, frame.f_code.co_filename, frame.f_lineno, module, registry)


def keep_old_names(
    package: str, names: Mapping[str, str], since: str, load: Callable[[str], Any] | None = None
) -> Callable[[str], Any]:
    """Makes the ``__getattr__`` of a package whose public names were renamed, at the end of its ``__init__``.

    An old name is neither in ``__all__`` nor in ``dir``, and is the same object as the new one, so that ``isinstance``
    and ``except`` work with either::

        __getattr__ = keep_old_names(__name__, {"Sphere": "Ball"}, since="0.2", load=__getattr__)

    - ``names``: the new name of each old one, both of this package.
    - ``since``: the version that first warns.
    - ``load``: the ``__getattr__`` that the package has without this one, if it has one.

    **Raises:** ``AttributeError`` for a name that the package never had.
    """

    def get(name: str) -> Any:
        if name in names:
            value = getattr(sys.modules[package], names[name])
            warn_of_old_name(f"{package}.{name}", f"{package}.{names[name]}", since)
            return value
        if load is None:
            raise missing(package, name)
        return load(name)

    return get


def keep_old_argument(old: str, new: str, since: str) -> Callable[[Called], Called]:
    """Decorates a function or a class whose argument ``old`` was renamed to ``new``.

    Callers may give it by its old name; one who gave it by its place notices nothing. The signature shows the new name
    alone. A subclass with fields of its own has only the new name.

    - ``since``: the version that first warns.

    **Raises:** ``ValueError``, where it decorates, if there is no argument ``new``, or still one named ``old``; the
    decorated one raises ``TypeError`` if it is given both.
    """

    def decorate(called: Called) -> Called:
        function = called.__init__ if isinstance(called, type) else called
        parameters = inspect.signature(function).parameters
        name = getattr(called, "__qualname__", repr(called))
        if new not in parameters:
            raise ValueError(f"Argument `new` must be an argument of {name}, but it is {new!r}; write the renamed one.")
        if old in parameters:
            raise ValueError(f"Argument `old` must be no argument of {name}, but it is {old!r}; rename that first.")

        @functools.wraps(function)
        def accept(*arguments: Any, **by_name: Any) -> Any:
            if old in by_name:
                if new in by_name:
                    raise TypeError(f"{name} got `{old}` and `{new}`, which are one argument; give `{new}` alone.")
                warn_of_old_name(f"Argument `{old}` of {name}", f"`{new}`", since)
                by_name[new] = by_name.pop(old)
            return function(*arguments, **by_name)

        decorated: Any = accept
        if isinstance(called, type):
            type.__setattr__(called, "__init__", accept)
            decorated = called
        return decorated

    return decorate


class OldAttribute:
    """A method or property of a class by its old name: ``speed_of = OldAttribute("speed", since="0.2")``.

    It is read through the new name, so that a subclass that replaces the new one is asked by either.
    """

    def __init__(self, new: str, since: str):
        self._new, self._since, self._old = new, since, ""

    def __set_name__(self, owner: type, name: str) -> None:
        self._old = name

    def __get__(self, instance: Any, owner: type) -> Any:
        value = getattr(owner if instance is None else instance, self._new)
        warn_of_old_name(f"{owner.__name__}.{self._old}", f"{owner.__name__}.{self._new}", self._since)
        return value
