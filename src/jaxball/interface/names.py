"""The public names of a package: what ``dir`` and ``from ... import *`` find, and what is imported on first use.

A class may also declare methods whose functions a module built upon its own has, so that it does not import that one.
``Trajectory`` has its methods to save, draw and view a run in this way.
"""

import importlib
import sys
from collections.abc import Callable, Iterator, Mapping

TYPE_CHECKING = False  # as in jaxball/__init__.py

if TYPE_CHECKING:
    from types import ModuleType
else:
    ModuleType = type(sys)  # `types` would be imported with jaxball itself


def interface(names: Mapping[str, object], *packages: str) -> tuple[list[str], Callable[[], list[str]]]:
    """Returns ``__all__`` and ``__dir__`` of a package, from its ``globals()`` at the end of its ``__init__``.

    Modules are left out, except for ``packages``, the public packages within it, which ``dir`` shows too.
    """
    public = sorted(
        name for name, value in names.items() if not (name.startswith("_") or isinstance(value, ModuleType))
    )
    return public, lambda: sorted([*public, *packages])


def lazy_interface(package: str, *shown: str) -> tuple[list[str], Callable[[], list[str]], Callable[[str], object]]:
    """Returns ``__all__``, ``__dir__`` and ``__getattr__`` of a package that imports its names when they are first
    used.

    They are those of :func:`imports_of` the package. No name may be that of a module of the package, which would hide
    it. ``dir`` shows the packages that it imports from ``.``, and what is ``shown``, as well.
    """
    module_of = imports_of(package)
    packages = [name for name, module in module_of.items() if module == "."]
    public = sorted(module_of.keys() - set(packages))

    def load(name: str) -> object:
        if name not in module_of:
            raise missing(package, name)
        module = importlib.import_module(f"{package}.{name}" if name in packages else module_of[name], package)
        return module if name in packages else vars(sys.modules[package]).setdefault(name, getattr(module, name))

    return public, lambda: sorted([*public, *packages, *shown]), load


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


def public_packages(package: ModuleType) -> Iterator[ModuleType]:
    """Yields a package and, from the top down, the packages within it that ``dir`` shows."""
    yield package
    for name in dir(package):
        if isinstance(value := getattr(package, name), ModuleType) and hasattr(value, "__all__"):
            yield from public_packages(value)


if TYPE_CHECKING:
    from typing import TypeVar

    Method = TypeVar("Method", bound=Callable[..., object])
else:
    Method = Callable


def leave_to(function: str) -> Callable[[Method], Method]:
    """Makes a method that calls a function of another module, as in ``.loop:run_loop``, or ``.loop`` with its own name.

    The module is imported when it is called. Its class has the signature and the docstring.
    """
    import functools  # here, because it would double the time to import jaxball

    def declare(method: Method) -> Method:
        package, (module, _, other) = method.__module__.rpartition(".")[0], function.partition(":")
        name = other or method.__name__

        @functools.wraps(method)
        def call(*args: object, **options: object) -> object:
            return getattr(importlib.import_module(module, package), name)(*args, **options)

        call.left_to = (module, package, name)  # pyright: ignore[reportAttributeAccessIssue]
        return call  # pyright: ignore[reportReturnType]

    return declare
