"""Converts compiled programs of both compilers to bytes and back, with classes and functions by their names."""

import functools
import io
import pickle
import sys
import types
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
from jax.experimental import serialize_executable
from jax.tree_util import PyTreeDef

from .. import native
from .current import NATIVE, REFUSAL, XLA

OWN = __name__.split(".")[0]
LIBRARIES = ("jax", "jaxlib", "numpy", "equinox", "diffrax", "optimistix", "lineax")
_KNOWN = frozenset((OWN, *LIBRARIES, "builtins", "collections", "enum", "functools", "math", "operator", "types"))


class NoNameError(TypeError):
    """A value may differ invisibly between processes."""


def name_of(named: Any) -> str:
    """The name by which a class or a function of a known library is found.

    **Raises:** :class:`NoNameError` where it belongs to another library or is not found by its name.
    """
    module, path = getattr(named, "__module__", None), getattr(named, "__qualname__", None)
    bearer: Any = None
    if isinstance(module, str) and isinstance(path, str) and module.split(".")[0] in _KNOWN:
        bearer = sys.modules.get(module)
        for name in path.split("."):
            bearer = getattr(bearer, name, None)
        while bearer is not named and hasattr(bearer, "__wrapped__"):
            bearer = bearer.__wrapped__
    if bearer is not named:
        raise NoNameError(f"{named!r} is not found by a name in a library whose version is known.")
    return f"{module}:{path}"


class Loaded(NamedTuple):
    """A program from a list of arrays to another, and the rest of the result, without its arrays, pickled."""

    executable: Any
    pickled: bytes

    def result(self) -> Any:
        """The rest of the result, without its arrays; imports the modules of its classes."""
        return pickle.loads(self.pickled)


def content(program: Any, takes: int, gives: int, result: Any) -> bytes | None:
    """A program with so many input and output arrays, as bytes; None if impossible, as for one that calls Python.

    ``program`` is one of the native compiler or an executable of JAX.
    """
    try:
        pickled = io.BytesIO()
        _Pickler(pickled).dump(result)
        # Objects compared by identity would differ after loading.
        if pickle.loads(pickled.getvalue()) != result:
            return None
        if isinstance(program, native.Program):
            return NATIVE + pickle.dumps((program.form, pickled.getvalue()))
        payload, _, _ = serialize_executable.serialize(program)
        return XLA + pickle.dumps((payload, takes, gives, pickled.getvalue()))
    except Exception:  # depends on the version of JAX
        return None


def content_of_refusal(refusal: native.Refusal) -> bytes:
    """The note that a program is not compiled natively, so that this is not tried again."""
    return REFUSAL + refusal.reason.encode()


def loaded(content: bytes | None) -> Loaded | native.Refusal | None:
    """The program, or the note that it is refused; None if there is none or it cannot be loaded.

    Several threads may do this at once.
    """
    if content is None:
        return None
    try:
        for beginning, load in _LOADERS.items():
            if content.startswith(beginning):
                return load(content[len(beginning) :])
    except Exception:  # depends on the version of JAX
        return None
    return None


def _of_xla(content: bytes) -> Loaded:
    payload, takes, gives, pickled = pickle.loads(content)
    if b"lapack_" in payload:
        _set_up_lapack()
    structures = jax.tree.structure((([0] * takes,), {})), jax.tree.structure([0] * gives)
    return Loaded(serialize_executable.deserialize_and_load(payload, *structures), pickled)


def _native(content: bytes) -> Loaded:
    form, pickled = pickle.loads(content)
    return Loaded(native.Program(form), pickled)


_LOADERS: dict[bytes, Callable[[bytes], Loaded | native.Refusal]] = {
    NATIVE: _native,
    XLA: _of_xla,
    REFUSAL: lambda content: native.Refusal(content.decode()),
}


@functools.cache
def _set_up_lapack() -> None:
    """Gives XLA the addresses of LAPACK's functions, which programs call unchecked, as JAX does where it traces one."""
    jax.jit(jax.lax.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), "float32"))


class _Pickler(pickle.Pickler):
    """Pickles structures that contain only classes and functions of known libraries, by their names."""

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, PyTreeDef):
            return _structure_of, (obj.unflatten([0] * obj.num_leaves),)
        if obj is not type(None) and isinstance(obj, type | types.FunctionType):
            name_of(obj)
        elif getattr(obj, "__dict__", None) == {}:  # possibly a sentinel, compared by identity
            names = [name for name, value in vars(sys.modules[type(obj).__module__]).items() if value is obj]
            return names[0] if names else NotImplemented
        return NotImplemented


def _structure_of(tree: Any) -> Any:
    return jax.tree.structure(tree)
