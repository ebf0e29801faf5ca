"""All problems of a file at once, where a reader would stop at the first."""

import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any

from .values import ScenarioError

_MORE: ContextVar[list[ScenarioError] | None] = ContextVar("_MORE", default=None)


@contextlib.contextmanager
def all_problems() -> Iterator[list[ScenarioError]]:
    """The errors that a reader finds within, in the order of the file."""
    more: list[ScenarioError] = []
    token = _MORE.set(more)
    try:
        yield more
    except ScenarioError as error:
        more.insert(0, error)
    finally:
        _MORE.reset(token)


def each_of(*readers: Callable[[], Any]) -> list[Any]:
    """What the readers return; they read parts that do not depend on each other.

    **Raises:** the first :class:`ScenarioError`. Within :func:`all_problems` the other readers run too before that, and
    their errors are found there.
    """
    more = _MORE.get()
    if more is None:
        return [reader() for reader in readers]
    found, errors, before = [], [], len(more)
    for reader in readers:
        try:
            found.append(reader())
        except ScenarioError as error:
            # What parts of this part raised beside it comes after it.
            errors += [error, *more[before:]]
            del more[before:]
    if errors:
        more += errors[1:]
        raise errors[0]
    return found
