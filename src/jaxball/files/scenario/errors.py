"""Errors in a file: the first problem as an error, or all problems at once."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from typing import Any, TypeVar

from ...interface.wording import UserError

LONGEST_SHOWN = 60


class ScenarioError(UserError):
    """A scenario cannot be read or written; the message is one sentence that names the key."""


class UntraceableError(ScenarioError):
    """A traced number of a document determines something that cannot be traced."""


def key_error(path: str, must: str, got: str, error: type[ScenarioError] = ScenarioError) -> ScenarioError:
    """Returns the ``error`` of the key at ``path``, which says what it must be and what it is."""
    return error(f"Key `{path}` must be {must}, but it is {got}.")


def describe(value: Any) -> str:
    """Describes a value of a file in a few words, for an error message."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, bool):
        return "true" if value else "false"
    import json  # here, because it is for mistakes alone

    text = json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."


Kept = TypeVar("Kept")


@contextlib.contextmanager
def keep_within(variable: ContextVar[Any], value: Kept) -> Iterator[Kept]:
    """Gives a variable a value in this block, and yields it."""
    token = variable.set(value)
    try:
        yield value
    finally:
        variable.reset(token)


_PROBLEMS: ContextVar[list[ScenarioError] | None] = ContextVar("_PROBLEMS", default=None)


@contextlib.contextmanager
def all_problems() -> Iterator[list[ScenarioError]]:
    """Collects the errors that readers find within this block, in the order of the file."""
    more: list[ScenarioError] = []
    with keep_within(_PROBLEMS, more):
        try:
            yield more
        except ScenarioError as error:
            more.insert(0, error)


def each_of(*readers: Callable[[], Any]) -> list[Any]:
    """Returns the results of readers of independent parts.

    **Raises:** the first :class:`ScenarioError`. Within :func:`all_problems` the other readers run too before that, and
    their errors are found there.
    """
    results, errors = try_readers(*readers)
    raise_first(errors)
    return results


def try_readers(*readers: Callable[[], Any]) -> tuple[list[Any], list[ScenarioError]]:
    """Returns what the readers return, None of those that fail, and the errors of these.

    **Raises:** the first error, but within :func:`all_problems`.
    """
    more = _PROBLEMS.get()
    # Outside of `all_problems` one sentence is raised, and nothing else is read for it.
    if more is None:
        return [reader() for reader in readers], []
    results, errors, before = [], [], len(more)
    for reader in readers:
        try:
            results.append(reader())
        except ScenarioError as error:
            results.append(None)
            # Errors that its own parts raised besides come after it.
            errors += [error, *more[before:]]
            del more[before:]
    return results, errors


def raise_first(errors: Sequence[ScenarioError]) -> None:
    """Raises the first of the errors, and keeps the others for :func:`all_problems`."""
    if errors:
        more = _PROBLEMS.get()
        if more is not None:
            more += errors[1:]
        raise errors[0]
