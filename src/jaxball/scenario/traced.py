"""Rules on the numbers of a document: an error where they are known, a condition where they are traced."""

import concurrent.futures
import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from ..numerics.arrays import is_traced
from ..physics.conditions import Condition
from .errors import key_error


class Conditions:
    """The rules on the numbers of a document that a reader could not decide, because they are traced.

    - ``holds``: whether each rule holds, with the path of its key. If one does not, the document is not a scenario.
    - ``certain``: what must hold for these conditions to be the only reasons to refuse the document itself.

    Both are called for their values within the trace, so that an unused rule costs nothing.
    """

    def __init__(self):
        self.holds: list[tuple[str, Callable[[], Bool[Array, ""]]]] = []
        self.certain: list[Callable[[], Bool[Array, ""]]] = []

    def all_hold(self) -> Bool[Array, ""]:
        """Whether every rule holds."""
        return _all(holds() for _, holds in self.holds)

    def all_certain(self) -> Bool[Array, ""]:
        """Whether every rule has been decided."""
        return _all(certain() for certain in self.certain)


def _all(values: Iterator[Bool[Array, ""]]) -> Bool[Array, ""]:
    return jnp.all(jnp.stack([jnp.asarray(True), *map(jnp.asarray, values)]))


_CONDITIONS: ContextVar[Conditions | None] = ContextVar("_CONDITIONS", default=None)


@contextlib.contextmanager
def traced_conditions() -> Iterator[Conditions]:
    """The conditions on the traced numbers of a document that is read within.

    What does not depend on them is computed while tracing, and stays known.
    """
    conditions = Conditions()
    token = _CONDITIONS.set(conditions)
    try:
        with jax.ensure_compile_time_eval():
            yield conditions
    finally:
        _CONDITIONS.reset(token)


def require(holds: Any, path: str, must: str, got: Callable[[], str]) -> None:
    """Raises unless a rule holds, that the key at ``path`` must be ``must``; on traced numbers it is a condition."""
    if is_traced(holds):
        leave_open(path, lambda: holds)
    elif not holds:
        raise key_error(path, must, got())


def require_condition(condition: Condition, path: str) -> None:
    """Raises unless a condition of physics holds, or keeps it, as :func:`require` does."""
    require(condition.holds, path, condition.must, lambda: repr(np.asarray(condition.value).tolist()))


def require_conditions(item: Any, under: str = "", *name: str) -> None:
    """Raises for the first condition of an item that does not hold, as :func:`require` does.

    What they name stands ``under`` a path; an item that must be told its own ``name`` is given it. Of known numbers
    they are NumPy's conditions, for which nothing is compiled.
    """
    item = item if any_traced(item) else jax.tree.map(np.asarray, item)
    with np.errstate(all="ignore"):  # what overflows is infinite, as JAX has it
        for condition in item.conditions(*name):
            require_condition(condition, f"{under}{condition.name}")


def leave_open(
    path: str, holds: Callable[[], Bool[Array, ""]], certain: Callable[[], Bool[Array, ""]] | None = None
) -> None:
    """Keeps a rule on traced numbers as a condition; ``certain`` says where this decides the rule."""
    conditions = _CONDITIONS.get()
    assert conditions is not None, "Numbers of a document are traced where no conditions are collected."
    conditions.holds.append((path, holds))
    if certain is not None:
        conditions.certain.append(certain)


def outside_of_traces(function: Callable[[], Any]) -> Any:
    """The result of a function of known numbers, by the same programs as for a document that is not traced.

    **Raises:** ``jax.errors.JAXTypeError`` where a traced number is involved.
    """
    if _CONDITIONS.get() is None:
        return function()
    with concurrent.futures.ThreadPoolExecutor(1) as thread:  # in which nothing is traced
        return thread.submit(function).result()


def any_traced(tree: Any) -> bool:
    """Whether an array in a PyTree is traced."""
    return any(map(is_traced, jax.tree.leaves(tree)))


def namespace(*arrays: Any) -> Any:
    """The functions for these arrays: those of JAX where one is traced, else NumPy's."""
    return jnp if any_traced(arrays) else np


def number(x: Any) -> Any:
    """A single number as Python's, or as it is where it is traced."""
    return x if is_traced(x) else float(x)
