"""The kinds of values of keys, and the rules on their numbers, which may be traced.

A kind of value reads what the TOML parser returned, or raises one sentence, and writes it back.
"""

import abc
import concurrent.futures
import contextlib
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from ...interface.compat import is_traced
from ...interface.wording import beyond_numbers, did_you_mean, nearest, one_of
from ...numerics.declare import FINITE, Dimension, Rule
from ...physics.conditions import Condition
from .errors import ScenarioError as ScenarioError, describe as describe, keep_within, key_error
from .paths import key_of


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
        """Returns whether every rule holds."""
        return _all(holds() for _, holds in self.holds)

    def all_certain(self) -> Bool[Array, ""]:
        """Returns whether every rule has been decided."""
        return _all(certain() for certain in self.certain)


def _all(values: Iterator[Bool[Array, ""]]) -> Bool[Array, ""]:
    return jnp.all(jnp.stack([jnp.asarray(True), *map(jnp.asarray, values)]))


_CONDITIONS: ContextVar[Conditions | None] = ContextVar("_CONDITIONS", default=None)


@contextlib.contextmanager
def collect_conditions() -> Iterator[Conditions]:
    """Collects the conditions on the traced numbers of a document that is read within.

    What does not depend on them is computed while tracing, and stays known.
    """
    # Inside a trace JAX would trace operations on known numbers, too; a reader needs their values.
    with keep_within(_CONDITIONS, Conditions()) as conditions, jax.ensure_compile_time_eval():
        yield conditions


def is_traced_document() -> bool:
    """Returns whether numbers of a document that is read are traced."""
    return _CONDITIONS.get() is not None


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
    # NumPy compiles nothing for what a file with known numbers must be checked for.
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
    """Returns the result of a function of known numbers, by the same programs as for a document that is not traced.

    **Raises:** ``jax.errors.JAXTypeError`` where a traced number is involved.
    """
    if _CONDITIONS.get() is None:
        return function()
    with concurrent.futures.ThreadPoolExecutor(1) as thread:  # in which nothing is traced
        return thread.submit(function).result()


def any_traced(tree: Any) -> bool:
    """Returns whether an array in a PyTree is traced."""
    return any(map(is_traced, jax.tree.leaves(tree)))


def namespace(*arrays: Any) -> Any:
    """Returns the module whose functions suit these arrays: JAX's where one is traced, else NumPy."""
    return jnp if any_traced(arrays) else np


def number(x: Any) -> Any:
    """Returns a single number as Python's, or unchanged where it is traced."""
    return x if is_traced(x) else float(x)


@runtime_checkable
class Kind(Protocol):
    """A kind of value."""

    @property
    def words(self) -> str:
        """What a value of this kind is, as in "it must be ..."."""
        ...

    def read(self, value: Any, path: str, /) -> Any:
        """Returns the value as it is used, or raises a :class:`ScenarioError`."""
        ...

    def write(self, value: Any, path: str, /) -> Any:
        """Returns the value as it stands in a file."""
        ...


AnyArray = Array | np.ndarray
Form = Literal["item", "list", "by name"]


@dataclass(frozen=True)
class Numbers:
    """Finite numbers of a given shape, in which None stands for one or more; () is a single number.

    - ``dimension``: theirs, if it is declared; it does not affect how they are read.
    - ``by_size``: whether a design scales them by their size, where it would otherwise by their dimension.
    """

    shape: tuple[int | None, ...] = ()
    rule: Rule = FINITE
    dimension: Dimension | None = None
    by_size: bool = False

    @property
    def words(self) -> str:
        return self.rule.words(self.shape)

    def read(self, value: Any, path: str) -> Any:
        """Reads the numbers as an array, a single one as it is; traced where some in ``value`` are."""
        array = _as_floats(value)
        if array is None or not self._fits(array.shape):
            raise key_error(path, self.words, describe(value))
        require(self.rule.holds(array), path, self.words, lambda: self._shown(value))
        kinds_read = _KINDS_READ.get()
        # Also where the number is traced, since its kind depends on the key alone.
        if kinds_read is not None:
            kinds_read[key_of(path)] = self
        return array if self.shape else number(array)

    def write(self, value: Any, path: str) -> Any:
        return np.asarray(value, dtype=float).tolist()

    def _shown(self, value: Any) -> str:
        if self.rule.is_angle and math.isfinite(value):
            return f"{describe(value)}; {describe(value)} degrees are {math.radians(value):.8g} radians"
        return f"{describe(value)}{beyond_numbers(value)}"

    def _fits(self, shape: tuple[int, ...]) -> bool:
        return len(shape) == len(self.shape) and all(
            n > 0 if length is None else n == length for n, length in zip(shape, self.shape, strict=True)
        )


_KINDS_READ: ContextVar[dict[str, Numbers] | None] = ContextVar("_KINDS_READ", default=None)


def kinds_of_numbers() -> AbstractContextManager[dict[str, Numbers]]:
    """Records the kind of every number, and of every list of numbers, that is read within the block, by the path of its
    key.
    """
    return keep_within(_KINDS_READ, {})


class Checked(abc.ABC):
    """A kind of value that is used as it stands in the file, but for lists, which become tuples."""

    words: Any  # a text, or a property that is one

    @abc.abstractmethod
    def fits(self, value: Any) -> bool:
        """Returns whether a value is of this kind."""

    def read(self, value: Any, path: str) -> Any:
        if not self.fits(value):
            raise key_error(path, self.words, describe(value))
        return tuple(value) if isinstance(value, list) else value

    def write(self, value: Any, path: str) -> Any:
        return list(value) if isinstance(value, tuple) else value


@dataclass(frozen=True)
class Integer(Checked):
    """A whole number between two limits, both included."""

    least: int
    most: int

    @property
    def words(self) -> str:
        return f"a whole number from {self.least} to {self.most}" if self.least < self.most else f"{self.least}"

    def fits(self, value: Any) -> bool:
        return _is_integer(value) and self.least <= value <= self.most

    def write(self, value: Any, path: str) -> int:
        return int(value)


@dataclass(frozen=True)
class WholeNumber(Integer):
    """A whole number that may be traced, as what it is used for can be."""

    def read(self, value: Any, path: str) -> Any:
        if not is_traced(value):
            return super().read(value, path)
        holds = (value == jnp.round(value)) & (value >= self.least) & (value <= self.most)
        require(holds, path, self.words, lambda: describe(value))
        return jnp.round(value).astype(int)


@dataclass(frozen=True)
class Flag(Checked):
    """True or false."""

    words: str = "true or false"

    def fits(self, value: Any) -> bool:
        return isinstance(value, bool)

    def write(self, value: Any, path: str) -> bool:
        return bool(value)


@dataclass(frozen=True)
class Indices(Checked):
    """Masses by index, counted from 0; the list may be empty only if that is allowed."""

    words: str = "a list of increasing whole numbers, one or more, each the number of a mass counted from 0"
    empty: bool = False

    def fits(self, value: Any) -> bool:
        good = isinstance(value, list) and all(_is_integer(item) and item >= 0 for item in value)
        return good and sorted(set(value)) == value and bool(value or self.empty)


@dataclass(frozen=True)
class Text(Checked):
    """A text."""

    words: str = "a text"

    def fits(self, value: Any) -> bool:
        return isinstance(value, str)


@dataclass(frozen=True)
class Names(Checked):
    """Names, one or more."""

    words: str = "a list of names"

    def fits(self, value: Any) -> bool:
        return isinstance(value, list) and value != [] and all(isinstance(name, str) for name in value)


@dataclass(frozen=True)
class Choice(Checked):
    """One of several names."""

    names: tuple[str, ...]

    @property
    def words(self) -> str:
        return one_of([f'"{name}"' for name in self.names])

    def fits(self, value: Any) -> bool:
        return isinstance(value, str) and value in self.names

    def read(self, value: Any, path: str) -> str:
        if isinstance(value, str) and not self.fits(value) and nearest(value, self.names):
            raise ScenarioError(f"Key `{path}` cannot be {describe(value)}{did_you_mean(value, self.names)}")
        return super().read(value, path)


@dataclass(frozen=True)
class Nested:
    """A table, or a list of tables, that has a reader and a writer of its own.

    - ``tables``: the keys that a table may have, by what decides which: its kind, the one key of several that it has,
      or the kind of body; under "" where it always has the same.
    - ``by``: the key that names the kind.
    - ``own``: whether the key ``kind`` may name a user's class instead, where jaxball's tables have no kind.
    - ``forms``: whether there may be one item, a list of them, or a table of them by name; none where anything may be.
    - ``others``: what an item may be besides a table.
    """

    read: Callable[[Any, str], Any]
    write: Callable[[Any, str], Any]
    words: str = "a table"
    tables: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    by: str = "kind"
    own: bool = False
    forms: tuple[Form, ...] = ("item",)
    others: tuple[Kind, ...] = ()


def unread(words: str = "a table", tables: Mapping[str, Mapping[str, Any]] | None = None, **others: Any) -> Nested:
    """Describes a value that is not checked here, because its rules depend on other keys; see :class:`Nested`."""
    return Nested(lambda value, path: value, lambda value, path: value, words, tables or {}, **others)


def _is_integer(value: Any) -> bool:
    # In Python true and false are integers.
    return isinstance(value, int) and not isinstance(value, bool)


def _as_floats(value: Any) -> Any:
    """Returns ``value`` as an array, or None where it is not made of numbers alone or its rows differ in length."""
    numbers = list(_numbers_in(value))
    # NumPy would convert texts and truth values silently.
    if not all(is_traced(x) or (isinstance(x, int | float) and not isinstance(x, bool)) for x in numbers):
        return None
    try:
        return (jnp if any(map(is_traced, numbers)) else np).asarray(value, dtype=float)
    except (ValueError, OverflowError):
        return None


def _numbers_in(value: Any) -> Iterator[Any]:
    if isinstance(value, list):
        for item in value:
            yield from _numbers_in(item)
    else:
        yield value
