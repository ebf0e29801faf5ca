"""All problems of a file at once, where a reader would stop at the first."""

import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any

from .values import ScenarioError

_MORE: ContextVar[list[ScenarioError] | None] = ContextVar("_MORE", default=None)


@contextlib.contextmanager
def all_problems() -> Iterator[list[ScenarioError]]:
    """The errors that a reader finds within, beside the one that it raises, which is the last of them here."""
    more: list[ScenarioError] = []
    token = _MORE.set(more)
    try:
        yield more
    except ScenarioError as error:
        more.append(error)
    finally:
        _MORE.reset(token)


def each_of(*readers: Callable[[], Any]) -> list[Any]:
    """What the readers return; they read parts that do not depend on each other.

    **Raises:** the first :class:`ScenarioError`. Within :func:`all_problems` all of them run before, and it gets the
    errors of the others.
    """
    more = _MORE.get()
    if more is None:
        return [reader() for reader in readers]
    found, errors = [], []
    for reader in readers:
        try:
            found.append(reader())
        except ScenarioError as error:
            errors.append(error)
    if errors:
        more.extend(errors[:-1])
        raise errors[-1]
    return found
