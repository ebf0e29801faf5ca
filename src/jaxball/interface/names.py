"""The public names of a package: what ``dir`` and ``from ... import *`` find, and what is imported on first use."""

import importlib
import sys
from collections.abc import Callable, Mapping


def interface(names: Mapping[str, object], *packages: str) -> tuple[list[str], Callable[[], list[str]]]:
    """Returns ``__all__`` and ``__dir__`` of a package, from its ``globals()`` at the end of its ``__init__``.

    Modules are left out, except for ``packages``, the public packages within it, which ``dir`` shows too.
    """
    from types import ModuleType  # here, because jaxball itself is imported without

    public = sorted(
        name for name, value in names.items() if not (name.startswith("_") or isinstance(value, ModuleType))
    )
    return public, lambda: sorted([*public, *packages])


def lazy_interface(
    package: str, names: Mapping[str, str] | None = None, *shown: str
) -> tuple[list[str], Callable[[], list[str]], Callable[[str], object]]:
    """Returns ``__all__``, ``__dir__`` and ``__getattr__`` of a package that imports its names when they are first
    used.

    ``names`` are the modules of the public names, by default :func:`imports_of` the package; no name may be that of a
    module of the package, which would hide it. ``dir`` shows what is ``shown`` as well.
    """
    module_of = imports_of(package) if names is None else names

    def load(name: str) -> object:
        if name not in module_of:
            raise missing(package, name)
        value = getattr(importlib.import_module(module_of[name], package), name)
        return vars(sys.modules[package]).setdefault(name, value)

    return sorted(module_of), lambda: sorted([*module_of, *shown]), load


def imports_of(package: str) -> dict[str, str]:
    """Returns the module, as in ``.styles``, of each name that a package's ``__init__`` imports for type checkers
    alone.

    It states them as ``from .styles import caption as caption`` under ``if TYPE_CHECKING``, and no second time.
    """
    spec = sys.modules[package].__spec__
    source = spec.loader.get_data(spec.origin).decode()  # pyright: ignore
    block = source.partition("\nif TYPE_CHECKING:")[2].partition("\nelse:")[0]
    modules, module = {}, ""
    for words in map(str.split, block.splitlines()):
        module = words[1] if words[:1] == ["from"] else module
        modules |= {words[k + 1].rstrip(","): module for k, word in enumerate(words) if word == "as"}
    return modules


def missing(package: str, name: str) -> AttributeError:
    """Makes the error for a name that a package does not have."""
    return AttributeError(f"module {package!r} has no attribute {name!r}", name=name, obj=sys.modules[package])
