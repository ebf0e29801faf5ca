"""Users' functions that a file names as "module:function", and the numbers passed to them."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ..numerics.arrays import to_array
from .errors import ScenarioError, key_error, shown
from .imports import imported as imported, name_of
from .table import Key, join
from .values import Numbers


@contextlib.contextmanager
def trying(path: str) -> Iterator[None]:
    """Turns whatever a function raises within this block into an error of the key at ``path`` that names it."""
    try:
        yield
    except ScenarioError:
        raise
    except Exception as error:
        sentence, own = " ".join(str(error).split()).rstrip("."), "Argument `function` "
        if sentence.startswith(own):
            raise ScenarioError(f"Key `{path}` {sentence.removeprefix(own)}.") from None
        raised = f"{type(error).__name__}: {sentence}" if sentence else type(error).__name__
        raise ScenarioError(f"Key `{path}` must name a function that fits here, but it raises {raised}.") from error


@dataclass(frozen=True)
class Function:
    """A function that can be imported."""

    words: str = 'a function that can be imported, as "module:function"'

    def read(self, value: Any, path: str) -> Callable[..., Any]:
        if not isinstance(value, str):
            raise key_error(path, self.words, shown(value))
        return imported(path, value)

    def write(self, value: Any, path: str) -> str:
        name = name_of(value, path)
        if name is not None:
            return name
        called = f"{getattr(value, '__module__', '')}:{getattr(value, '__qualname__', '')}"
        raise ScenarioError(
            f"Key `{path}` must be a function that can be imported to be written to a file, but {called} cannot be; "
            "keep its scenario as a Python script."
        )


@dataclass(frozen=True)
class Parameters:
    """The parameters of a function: a number, a list of numbers, or a table of these by name."""

    words: str = "a number, a list of numbers, or a table of these"

    def read(self, value: Any, path: str) -> Any:
        """Arrays, one or a dictionary of them."""
        if isinstance(value, dict):
            return {name: self.read(item, join(path, name)) for name, item in value.items()}
        depth, inner = 0, value
        while isinstance(inner, list):
            depth, inner = depth + 1, inner[0] if inner else None
        return to_array(Numbers((None,) * depth).read(value, path))

    def write(self, value: Any, path: str) -> Any:
        if isinstance(value, dict) and all(isinstance(name, str) for name in value):
            return {name: self.write(item, join(path, name)) for name, item in value.items()}
        if not jax.tree_util.all_leaves([value]):
            raise key_error(path, f"{self.words} to be written to a file", f"a {type(value).__name__}")
        return np.asarray(value, dtype=float).tolist()


FUNCTION = {"function": Key(Function()), "parameters": Key(Parameters(), None)}
