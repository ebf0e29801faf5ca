"""The public names of a package: what ``dir`` and ``from ... import *`` find, and what is imported on first use."""

import importlib
import sys
from collections.abc import Callable, Mapping
from types import ModuleType


def interface(names: Mapping[str, object], *packages: str) -> tuple[list[str], Callable[[], list[str]]]:
    """``__all__`` and ``__dir__`` of a package, from its ``globals()`` at the end of its ``__init__``.

    Modules are left out, except for ``packages``, the public packages within it, which ``dir`` shows too.
    """
    public = sorted(
        name for name, value in names.items() if not (name.startswith("_") or isinstance(value, ModuleType))
    )
    return public, lambda: sorted([*public, *packages])


def lazy_interface(
    package: str, names: Mapping[str, str], *shown: str
) -> tuple[list[str], Callable[[], list[str]], Callable[[str], object]]:
    """``__all__``, ``__dir__`` and ``__getattr__`` of a package that imports its names when they are first used.

    ``names`` are the public names of each module, separated by spaces; none may be the name of a module of the package,
    which would hide it. ``dir`` shows what is ``shown`` as well.
    """
    module_of = {name: module for module, words in names.items() for name in words.split()}

    def load(name: str) -> object:
        if name not in module_of:
            raise missing(package, name)
        value = getattr(importlib.import_module(f".{module_of[name]}", package), name)
        return vars(sys.modules[package]).setdefault(name, value)

    return sorted(module_of), lambda: sorted([*module_of, *shown]), load


def missing(package: str, name: str) -> AttributeError:
    """The error for a name that a package does not have."""
    return AttributeError(f"module {package!r} has no attribute {name!r}", name=name, obj=sys.modules[package])
