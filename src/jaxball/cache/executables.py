"""Compiled programs as bytes, and as programs again."""

import functools
import io
import pickle
import sys
import types
from typing import Any, NamedTuple

import jax
from jax.experimental import serialize_executable
from jax.tree_util import PyTreeDef

from .names import name_of


class Loaded(NamedTuple):
    """An executable from a list of arrays to another one, and what the result has beside its arrays, pickled."""

    executable: Any
    pickled: bytes

    def result(self) -> Any:
        """What the result has beside its arrays; imports the modules that its classes are in."""
        return pickle.loads(self.pickled)


def content(compiled: Any, takes: int, gives: int, result: Any) -> bytes | None:
    """A program that takes and gives so many arrays, as bytes; None where it has none, as one that calls Python."""
    try:
        payload, _, _ = serialize_executable.serialize(compiled)
        pickled = io.BytesIO()
        _Pickler(pickled).dump(result)
        # What is compared by identity would be another after loading.
        same = pickle.loads(pickled.getvalue()) == result
        return pickle.dumps((payload, takes, gives, pickled.getvalue())) if same else None
    except Exception:  # whatever versions of JAX raise
        return None


def loaded(content: bytes | None) -> Loaded | None:
    """The program; None where there is none or it cannot be loaded. Several threads may do this at once."""
    if content is None:
        return None
    try:
        payload, takes, gives, pickled = pickle.loads(content)
        if b"lapack_" in payload:
            _set_up_lapack()
        structures = jax.tree.structure((([0] * takes,), {})), jax.tree.structure([0] * gives)
        return Loaded(serialize_executable.deserialize_and_load(payload, *structures), pickled)
    except Exception:  # whatever versions of JAX raise
        return None


@functools.cache
def _set_up_lapack() -> None:
    """Gives XLA the addresses of LAPACK's functions, which programs call unchecked, as JAX does where it traces one."""
    jax.jit(jax.lax.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), "float32"))


class _Pickler(pickle.Pickler):
    """Pickles structures, with classes and functions of known libraries alone, by their names."""

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, PyTreeDef):
            return _structure_of, (obj.unflatten([0] * obj.num_leaves),)
        if obj is not type(None) and isinstance(obj, type | types.FunctionType):
            name_of(obj)
        elif getattr(obj, "__dict__", None) == {}:  # perhaps one whose identity is its meaning
            names = [name for name, value in vars(sys.modules[type(obj).__module__]).items() if value is obj]
            return names[0] if names else NotImplemented
        return NotImplemented


def _structure_of(tree: Any) -> Any:
    return jax.tree.structure(tree)
