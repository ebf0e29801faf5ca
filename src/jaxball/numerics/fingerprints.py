"""Values as bytes that are the same in every process: equal bytes mean equal values; other values are refused.

They identify compiled programs. So functions and classes are accepted only if they belong to a library whose version is
known, and have a name there: a user's module, a closure or a ``lambda`` can change unnoticed.
"""

import enum
import functools
import hashlib
import struct
import types
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from jax.tree_util import PyTreeDef

from ..cache.executables import NoNameError, name_of
from ..compat import is_traced, node_of

_WITHOUT_EFFECT = ("__annotations__", "__doc__")  # of methods that equinox binds


class _Plain:
    """Has the size of objects that contain nothing but what ``vars`` shows."""


def digest(*values: Any) -> str:
    """A name for the values, usable as a file name.

    **Raises:** :class:`NoNameError`.
    """
    try:
        return hashlib.blake2b(b"".join(map(_bytes, values)), digest_size=20).hexdigest()
    except RecursionError:
        raise NoNameError("A value contains itself.") from None


def _bytes(value: Any) -> bytes:
    """Tagged with the kind and, where it varies, preceded by the length, so that no two values have the same."""
    if isinstance(value, enum.Enum):
        return _tagged("enum", _named(type(value)), _plain(value.name))
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        return _plain(value)
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        return _array(value)
    if isinstance(value, np.dtype):
        return _tagged("dtype", repr(value).encode())
    if isinstance(value, type):
        return _tagged("type", _named(value))
    if isinstance(value, PyTreeDef):
        return _structure(value)
    if isinstance(value, list | tuple):
        return _tagged("sequence", _named(type(value)), *map(_bytes, value))
    if isinstance(value, Mapping):
        return _tagged("mapping", _named(type(value)), *(_bytes(item) for item in value.items()))
    if isinstance(value, set | frozenset):
        return _tagged("set", _named(type(value)), *sorted(map(_bytes, value)))
    if isinstance(value, functools.partial):
        return _tagged("partial", _named(type(value)), *map(_bytes, (value.func, value.args, value.keywords)))
    if isinstance(value, types.MethodType):
        return _tagged("method", _bytes(value.__self__), _plain(value.__name__))
    if hasattr(value, "__dict__") and type(value).__basicsize__ == _Plain.__basicsize__:
        fields = sorted(item for item in vars(value).items() if item[0] not in _WITHOUT_EFFECT)
        return _tagged("object", _named(type(value)), *map(_bytes, fields))
    return _tagged("named", _named(value))


def _plain(value: Any) -> bytes:
    if type(value) not in (type(None), bool, int, float, complex, str, bytes):
        return _tagged("derived", _named(type(value)), repr(value).encode())
    if isinstance(value, float | complex):
        return _tagged(type(value).__name__, struct.pack("<dd", value.real, value.imag))
    return _tagged(type(value).__name__, value if isinstance(value, bytes) else str(value).encode())


def _array(value: Any) -> bytes:
    if is_traced(value):
        raise NoNameError("The value of a traced array is not known.")
    array = np.asarray(value)
    if array.dtype.hasobject:
        raise NoNameError("An array holds objects.")
    weak = bool(getattr(value, "weak_type", False))
    kind = type(value).__name__ if isinstance(value, np.generic) else "array" if weak else "strong"
    return _tagged(kind, repr(array.dtype).encode(), _bytes(array.shape), array.tobytes())


def _structure(structure: Any) -> bytes:
    node, children = node_of(structure), jax.tree_util.treedef_children(structure)
    if node is None or node[0] is type(None):
        return _tagged("none" if node else "leaf")
    return _tagged("node", _named(node[0]), _bytes(node[1]), *map(_structure, children))


def _named(named: Any) -> bytes:
    return name_of(named).encode()


def _tagged(kind: str, *parts: bytes) -> bytes:
    return b"".join(struct.pack("<q", len(part)) + part for part in (kind.encode(), *parts)) + b"."
