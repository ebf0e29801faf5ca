"""Finds which functions of jaxball read more than their arguments, such as files, the time and the environment.

``fingerprints`` refuses users' functions that use one, because a program kept for them could be out of date.

A function is impure if its code names something outside jaxball that can be read, or another impure function, and so
on. Which methods are called is told by their names: those of every class in reach that any code in reach loads as an
attribute.
"""

import functools
import importlib
import importlib.util
import sys
import types
from collections.abc import Iterable
from typing import Any

import jax
import numpy as np

from .code import IMPURE, Import, Use, Used, codes_in, imports, is_own, names_in, names_of_caches, of_other, uses
from .names import OWN, NoNameError, is_known

# Packages, besides those that are known, whose functions give the same in every process; a warning is no result.
_PURE = frozenset(
    ("concurrent", "difflib", "inspect", "json", "re", "thread", "threading", "warnings", "weakref", "zlib")
)
_PURE |= {"ml_dtypes", "scipy", "typing_extensions"}
# What these read decides how a program is compiled, kept and interrupted, and what is said meanwhile; not its results.
_MACHINERY = tuple(
    f"{OWN}.programs.{name}"
    for name in ("cache", "cpu", "native", "store", "identity.names", "computation", "compiled", "operation", "program")
)
SEEDED = ("default_rng", "Philox")  # generators of random numbers, which jaxball gives seeds
_FUNCTIONS_THAT_READ = frozenset(("__import__", "breakpoint", "eval", "exec", "help", "input", "open", "print"))
_DATA = bool | int | float | complex | str | bytes | None | np.ndarray | np.generic | jax.Array


def require_pure(used: Used) -> None:
    """Raises a :class:`NoNameError` where something used reads more than its arguments."""
    reached = _Reached(used.names)
    for value in used.values.values():
        value = _unwrap(value)
        if not isinstance(value, type) and _module_of(value).startswith(_MACHINERY):
            raise _reads(value, _module_of(value))
        reached.add(value)
    try:
        reached.follow()
    except ImportError as error:  # what is not installed
        raise NoNameError(str(error)) from None


class _Reached:
    """All that some values use, of which none may read anything.

    - ``names``: of all attributes that may be loaded.
    """

    def __init__(self, names: set[str]):
        self.names = set(names)
        self._values: dict[int, Any] = {}  # by identity, which they keep
        self._next: list[Any] = []
        self._by_name: dict[str, list[Any]] = {}  # entries of classes, of names that no code in reach loads

    def add(self, value: Any) -> None:
        """Puts a value in reach, unless it is of the machinery of programs."""
        value = _unwrap(value)
        if isinstance(value, _DATA) or id(value) in self._values:
            return
        if isinstance(value, types.FunctionType | type) and _module_of(value).startswith(_MACHINERY):
            return
        self._values[id(value)] = value
        self._next.append(value)

    def follow(self) -> None:
        """Goes through all values.

        **Raises:** :class:`NoNameError`.
        """
        while self._next:
            value = self._next.pop()
            if isinstance(value, types.ModuleType):
                self._follow_module(value)
            elif isinstance(value, type):
                self._follow_class(value)
            elif isinstance(value, types.FunctionType):
                self._follow_function(value)
            elif type(value) in (list, tuple, set, frozenset):
                self._add_all(value)
            elif type(value) in (dict, types.MappingProxyType):
                self._add_all((*value.keys(), *value.values()))
            else:
                self._follow_object(value)

    def _add_all(self, values: Any) -> None:
        for value in values:
            self.add(value)

    def _add_name(self, name: str) -> None:
        self.names.add(name)
        self._add_all(self._by_name.pop(name, ()))

    def _follow_module(self, module: types.ModuleType) -> None:
        """Puts the members that may be loaded from a module, any of them, in reach."""
        if is_own(module.__name__):
            self._add_members(module, self.names)
        else:
            _require_known(module, module.__name__)
            if not _impure_in(module.__name__).isdisjoint(self.names):
                raise _reads(module, module.__name__)

    def _add_members(self, module: types.ModuleType, names: Iterable[str]) -> None:
        """Adds the members that may be loaded from a module of jaxball."""
        for name in sorted(names):
            if name in vars(module) or name in getattr(module, "__all__", ()):
                member = getattr(module, name)
                if not isinstance(member, types.ModuleType):
                    self.add(member)
                elif is_own(member.__name__) and member.__name__.startswith(f"{module.__name__}."):
                    self._add_members(member, names)

    def _follow_class(self, of: type) -> None:
        for base in of.__mro__:
            if not is_own(base.__module__):
                _require_known(base, base.__module__)
                continue
            for name, entry in vars(base).items():
                if name in self.names or (name.startswith("__") and hasattr(type(entry), "__get__")):
                    self.add(entry)
                else:
                    self._by_name.setdefault(name, []).append(entry)

    def _follow_function(self, function: types.FunctionType) -> None:
        home = _module_of(function)
        if not is_own(home) and home in sys.modules:  # others are made by what makes named tuples, and the like
            _require_known(function, home)
            return
        self._add_all((function.__defaults__, function.__kwdefaults__))
        for cell in function.__closure__ or ():
            if cell != types.CellType():
                self.add(cell.cell_contents)
        for code in codes_in(function.__code__):
            self._follow_code(code, function)

    def _follow_code(self, code: types.CodeType, function: types.FunctionType) -> None:
        names = set(names_in(code))
        for name in names:
            self._add_name(name)
        values = {name: function.__globals__[name] for name in code.co_names if name in function.__globals__}
        for value in values.values():
            if isinstance(value, types.ModuleType) and is_known(value.__name__):
                if is_own(value.__name__):
                    self._add_members(value, names)
            else:
                self.add(value)
        if not names.isdisjoint(_suspicious()):
            for use in uses(code):
                _require_no_reading(use, values.get(use.name), function)
        for imported in imports(code):
            self._follow_import(imported, function, names)

    def _follow_import(self, imported: Import, function: types.FunctionType, names: set[str]) -> None:
        name = importlib.util.resolve_name("." * imported.level + imported.module, function.__globals__["__package__"])
        if not is_own(name):
            _require_known(function, name)
        elif not name.startswith(_MACHINERY):
            module = importlib.import_module(name)
            for of in imported.names:
                value = getattr(module, of, None) or importlib.import_module(f"{name}.{of}")
                if isinstance(value, types.ModuleType):
                    self._add_members(value, names)
                else:
                    self.add(value)

    def _follow_object(self, value: Any) -> None:
        self.add(type(value))
        if isinstance(value, types.MethodType):
            self._add_all((value.__self__, value.__func__))
        elif isinstance(value, functools.partial):
            self._add_all((value.func, value.args, value.keywords))
        elif isinstance(value, types.BuiltinFunctionType):
            _require_known(value, value.__module__ or "builtins")
        elif type(value).__module__ != "typing":
            try:
                parts = of_other(value)
            except NoNameError:
                parts = None
            if parts is None:
                follows = names_of_caches(type(value))
                parts = [part for name, part in getattr(value, "__dict__", {}).items() if name not in follows]
            self._add_all(parts)


def _require_no_reading(use: Use, value: Any, function: types.FunctionType) -> None:
    """Requires that a global name, and the attributes loaded from it, in a function of jaxball, read nothing."""
    if value is None:
        is_refused = not use.is_held and use.name in _FUNCTIONS_THAT_READ
    elif isinstance(value, types.ModuleType) and not _impure_in(value.__name__).isdisjoint(use.attributes):
        is_refused = use.attributes[-1] not in SEEDED
    else:
        is_refused = False
    if is_refused:
        raise _reads(function, ".".join((use.name, *use.attributes)))


def _impure_in(module: str) -> frozenset[str]:
    """Returns the impure names of a module, without JAX's settings, because these distinguish programs."""
    return frozenset(IMPURE.get(module.partition(".")[0], "").split()) - {"config"}


@functools.cache
def _suspicious() -> frozenset[str]:
    """Returns the names that code has, among others, if it reads something."""
    return _FUNCTIONS_THAT_READ.union(*(_impure_in(package) for package in IMPURE if package != "builtins"))


def _require_known(value: Any, module: str) -> None:
    if not is_known(module.lstrip("_")) and module.lstrip("_").partition(".")[0] not in _PURE:
        raise _reads(value, module)


def _reads(value: Any, what: str) -> NoNameError:
    return NoNameError(f"{getattr(value, '__qualname__', value)} may read more than its arguments, by {what}.")


def _unwrap(value: Any) -> Any:
    """Returns a function of jaxball without the wrappers that others have put around it, as where types are checked at
    run time.
    """
    while isinstance(value, types.FunctionType) and not is_own(_module_of(value)) and hasattr(value, "__wrapped__"):
        value = vars(value)["__wrapped__"]
    return value


def _module_of(value: Any) -> str:
    if isinstance(value, types.FunctionType):
        return value.__globals__.get("__name__", "")
    if isinstance(value, types.ModuleType):
        return value.__name__
    return getattr(value, "__module__", None) or ""
