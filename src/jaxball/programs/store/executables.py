"""Converts compiled programs of both compilers to bytes and back, for ``compiled``, with classes by their names."""

import functools
import io
import pickle
import sys
import types
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
from jax.experimental import serialize_executable
from jax.tree_util import PyTreeDef

from .. import native
from ..identity.names import name_of
from .current import GPU, NATIVE, REFUSAL, XLA


class Loaded(NamedTuple):
    """A program from a list of arrays to another, and the rest of the result, without its arrays, pickled."""

    executable: Any
    pickled: bytes

    def result(self, reached: Sequence[Any] = ()) -> Any:
        """Returns the rest of the result, without its arrays; imports the modules of its classes. ``reached`` must be
        as it was when the program was written.
        """
        return _Unpickler(self.pickled, reached).load()


def content(program: Any, takes: int, gives: int, result: Any, reached: Sequence[Any] = ()) -> bytes | None:
    """Returns a program that ``takes`` and ``gives`` these numbers of arrays, as bytes; None where it calls Python.

    ``program`` is one of the native compiler, of a CPU or a GPU, or an executable of JAX; ``reached`` are functions and
    classes that the result may contain, without a name.
    """
    try:
        pickled = io.BytesIO()
        _Pickler(pickled, reached).dump(result)
        # Objects compared by identity would differ after loading.
        if _Unpickler(pickled.getvalue(), reached).load() != result:
            return None
        if isinstance(program, native.Executable | native.GridExecutable):
            beginning = NATIVE if isinstance(program, native.Executable) else GPU
            return beginning + pickle.dumps((program.form, pickled.getvalue()))
        payload, _, _ = serialize_executable.serialize(program)
        return XLA + pickle.dumps((payload, takes, gives, pickled.getvalue()))
    except Exception:  # depends on the version of JAX
        return None


def content_of_refusal(refusal: native.Refusal) -> bytes:
    """Returns the note that a program is not compiled natively, so that this is not tried again."""
    return REFUSAL + refusal.reason.encode()


def load_program(content: bytes | None) -> Loaded | native.Refusal | None:
    """Returns the program, or the note that it is refused; None if there is none or it cannot be loaded.

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
    return Loaded(native.Executable(form), pickled)


def _on_gpu(content: bytes) -> Loaded:
    form, pickled = pickle.loads(content)
    return Loaded(native.GridExecutable(form), pickled)


_LOADERS: dict[bytes, Callable[[bytes], Loaded | native.Refusal]] = {
    NATIVE: _native,
    GPU: _on_gpu,
    XLA: _of_xla,
    REFUSAL: lambda content: native.Refusal(content.decode()),
}


@functools.cache
def _set_up_lapack() -> None:
    """Gives XLA the addresses of LAPACK's functions, which programs call unchecked, as JAX does where it traces one."""
    jax.jit(jax.lax.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), "float32"))


class _Pickler(pickle.Pickler):
    """Pickles structures with classes and functions of known libraries by their names, and ``reached`` by places."""

    def __init__(self, file: io.BytesIO, reached: Sequence[Any]):
        super().__init__(file)
        self._places = {id(value): place for place, value in enumerate(reached)}

    def persistent_id(self, obj: Any) -> int | None:
        return self._places.get(id(obj))

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, PyTreeDef):
            return _structure_of, (obj.unflatten([0] * obj.num_leaves),)
        if obj is not type(None) and isinstance(obj, type | types.FunctionType):
            name_of(obj)
        elif getattr(obj, "__dict__", None) == {}:  # possibly a sentinel, compared by identity
            names = [name for name, value in vars(sys.modules[type(obj).__module__]).items() if value is obj]
            return names[0] if names else NotImplemented
        return NotImplemented


class _Unpickler(pickle.Unpickler):
    def __init__(self, pickled: bytes, reached: Sequence[Any]):
        super().__init__(io.BytesIO(pickled))
        self._reached = reached

    def persistent_load(self, pid: int) -> Any:
        return self._reached[pid]


def _structure_of(tree: Any) -> Any:
    return jax.tree.structure(tree)
