"""Where shapes and types are checked at run time, and how often."""

import collections
import dataclasses
import functools
import importlib.util
import inspect
import itertools
import os
import pkgutil
from collections.abc import Callable, Iterator
from typing import Any

import jaxtyping

# The compiler's functions are called a hundred thousand times for a program, and take no arrays to be checked.
UNCHECKED = ("jaxball.programs.native",)
OPENED = ("jaxball.programs",)  # packages that contain these

# The checks of a call take longer than many a function; of all calls, they would take a quarter of the tests' time.
# Which calls are the first depends on the order of the tests, so that before a release all are: see tests/README.md.
EVERY_CALL = os.environ.get("JAXBALL_TESTS_EVERY_CALL", "0") != "0"
FIRST_CALLS = 10
FIRST_TIMES = 3  # that a function within another is defined; to check it, code is made each time
LATER = 1 if EVERY_CALL else 100  # of the later calls, and definitions, every so many are checked


def modules() -> list[str]:
    """Lists the modules and packages of jaxball, but for those that are not checked."""
    outer = [name for name in _within("jaxball") if name not in OPENED]
    inner = [name for package in OPENED for name in _within(package)]
    return [name for name in [*outer, *inner] if name not in UNCHECKED]


def _within(package: str) -> list[str]:
    spec = importlib.util.find_spec(package)
    assert spec is not None
    assert spec.submodule_search_locations
    return [f"{package}.{module.name}" for module in pkgutil.iter_modules(list(spec.submodule_search_locations))]


def install() -> None:
    """Checks what is imported from now on: of each function, in each process, the first calls and some of the later."""
    jaxtyping.jaxtyped = _sparing(jaxtyping.jaxtyped)
    jaxtyping.install_import_hook(modules(), "beartype.beartype")


def _sparing(checked: Callable[..., Any]) -> Callable[..., Any]:
    """The decorator that the import hook applies, with fewer checks."""
    definitions: dict[Any, Iterator[int]] = collections.defaultdict(itertools.count)

    def decorator(of: Any = None, **options: Any) -> Any:
        if of is None:
            return functools.partial(decorator, **options)
        if inspect.isclass(of):
            if dataclasses.is_dataclass(of) and not hasattr(of.__init__, "__wrapped__"):  # of a parent, it is checked
                of.__init__ = decorator(of.__init__, **options)
            return of
        if not inspect.isfunction(of):
            return checked(of, **options)
        time = next(definitions[of.__code__])
        if time >= FIRST_TIMES and time % LATER:
            return of
        every_call = functools.cache(lambda: checked(of, **options))  # made when called first: most functions never are
        calls = itertools.count()

        @functools.wraps(of)
        def function(*args: Any, **kwargs: Any) -> Any:
            call = next(calls)
            if call < FIRST_CALLS or call % LATER == 0:
                return every_call()(*args, **kwargs)
            return of(*args, **kwargs)

        return function

    return decorator
