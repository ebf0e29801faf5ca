"""Values as bytes that are the same in every process: equal bytes mean equal values; other values are refused.

They identify compiled programs: ``compiled`` asks for the name of a program in the store before it is traced. Functions
and classes of a library whose version is known are their names; any other, such as a user's, a closure or a ``lambda``,
is what it consists of (:mod:`~.code`).
"""

import enum
import functools
import hashlib
import struct
import types
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.tree_util import PyTreeDef

from ...interface.compat import Primitive, is_traced, node_of
from . import code, purity
from .names import NoNameError, home_of, is_known, name_of

_WITHOUT_EFFECT = ("__annotations__", "__doc__", "__module__")  # of a wrapper, copied from its function


class _Plain:
    """Has the size of objects that contain nothing but what ``vars`` shows."""


class Fingerprint(NamedTuple):
    """What identifies values.

    - ``digest``: usable as a file name.
    - ``reached``: the functions and classes without a name that they contain. Those of values with an equal digest, in
      another process, are the same ones, in the same order.
    - ``used``: what users' functions and classes among them use of jaxball.
    """

    digest: str
    reached: tuple[Any, ...]
    used: code.Used

    def require_pure(self) -> None:
        """Raises a :class:`NoNameError` where users' functions use what of jaxball reads files and the like.

        Finding that out takes longer than the digest, and depends on nothing but that and jaxball's files.
        """
        if self.used.names:
            purity.require_pure(self.used)


def digest(*values: Any) -> str:
    """Returns a name for the values, usable as a file name.

    **Raises:** :class:`NoNameError`, also for what reads files and the like.
    """
    identified = fingerprint(*values)
    identified.require_pure()
    return identified.digest


def fingerprint(*values: Any) -> Fingerprint:
    """Returns the fingerprint that identifies the values.

    **Raises:** :class:`NoNameError`; for what of jaxball reads files and the like, :meth:`Fingerprint.require_pure`.
    """
    writer = _Writer(code.Used())
    try:
        content = b"".join(map(writer.of, values))
    except RecursionError:
        raise NoNameError("A value contains itself.") from None
    return Fingerprint(hashlib.blake2b(content, digest_size=20).hexdigest(), tuple(writer.reached), writer.used)


class _Writer:
    def __init__(self, used: code.Used, of_users: bool = False):
        self.used = used
        self.reached: list[Any] = []
        self._places: dict[int, int] = {}
        self._of_users = of_users  # whether a user's function or class contains the value

    def of(self, value: Any) -> bytes:
        """Returns the bytes that identify a value, tagged with the kind and, where it varies, preceded by the length,
        so that no two values have the same.
        """
        if isinstance(value, enum.Enum):
            return _tag("enum", self._class(type(value)), self._plain(value.name))
        if value is None or isinstance(value, bool | int | float | complex | str | bytes):
            return self._plain(value)
        if isinstance(value, np.ndarray | np.generic | jax.Array):
            return self._array(value)
        if isinstance(value, np.dtype):
            return _tag("dtype", repr(value).encode())
        if isinstance(value, type):
            self._require_pure(value, _name(value) or "")
            return _tag("type", self._class(value))
        if isinstance(value, PyTreeDef):
            return self._structure(value)
        if isinstance(value, list | tuple | set | frozenset | Mapping) and type(value) is not types.MappingProxyType:
            return self._container(value)
        if isinstance(value, functools.partial):
            parts = value.func, value.args, value.keywords
            return _tag("partial", self._class(type(value)), *map(self.of, parts))
        if isinstance(value, types.MethodType):
            return _tag("method", *map(self.of, (value.__self__, value.__func__)))
        return self._describe_definition(value)

    def _container(self, value: Any) -> bytes:
        if getattr(value, "__dict__", None):
            raise NoNameError(f"{type(value)} contains more than its items.")
        of = self._class(type(value))
        if isinstance(value, Mapping):
            return _tag("mapping", of, *map(self.of, value.items()), self.of(getattr(value, "default_factory", 0)))
        if isinstance(value, list | tuple):
            return _tag("sequence", of, *map(self.of, value))
        # Each on its own, because their order is that of the process.
        return _tag("set", of, *sorted(_Writer(self.used, self._of_users).of(item) for item in value))

    def _describe_definition(self, value: Any) -> bytes:
        """Describes functions, modules, objects."""
        if isinstance(value, types.ModuleType):
            if not is_known(value.__name__):
                raise NoNameError(f"{value!r} may change without its name.")
            code.require_pure(value.__name__)
            self.used.add(value, value.__name__)
            return _tag("module", value.__name__.encode())
        name = _name(value)
        if name is not None:
            self._require_pure(value, name)
            return _tag("named", name.encode())
        if type(value) is object:  # which is only told from others
            return _tag("sentinel", self._once(value, lambda _: ()))
        if isinstance(value, types.FunctionType):
            return _tag("function", self._once(value, lambda function: code.of_function(function, self.used)))
        parts = code.of_other(value)
        if parts is not None:
            return _tag("consists of", type(value).__name__.encode(), *map(self.of, parts))
        is_plain = hasattr(value, "__dict__") and type(value).__basicsize__ == _Plain.__basicsize__
        if isinstance(value, Primitive) or not is_plain:
            raise NoNameError(f"{value!r} may contain more than it shows.")
        without = (*_WITHOUT_EFFECT, *code.names_of_caches(type(value)))
        fields = sorted((name, field) for name, field in vars(value).items() if name not in without)
        return _tag("object", self._class(type(value)), *map(self.of, fields))

    def _plain(self, value: Any) -> bytes:
        if type(value) not in (type(None), bool, int, float, complex, str, bytes):
            return _tag("derived", self._class(type(value)), repr(value).encode())
        if isinstance(value, float | complex):
            return _tag(type(value).__name__, struct.pack("<dd", value.real, value.imag))
        return _tag(type(value).__name__, value if isinstance(value, bytes) else str(value).encode())

    def _array(self, value: Any) -> bytes:
        if is_traced(value):
            raise NoNameError("The value of a traced array is not known.")
        if isinstance(value, jax.Array) and not isinstance(value.dtype, np.dtype):
            raise NoNameError(f"An array is of {value.dtype}.")
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise NoNameError("An array holds objects.")
        weak = bool(getattr(value, "weak_type", False))
        kind = type(value).__name__ if isinstance(value, np.generic) else "array" if weak else "strong"
        return _tag(kind, repr(array.dtype).encode(), self.of(array.shape), array.tobytes())

    def _structure(self, structure: Any) -> bytes:
        node, children = node_of(structure), jax.tree_util.treedef_children(structure)
        if node is None or node[0] is type(None):
            return _tag("none" if node else "leaf")
        return _tag("node", self._class(node[0]), self.of(node[1]), *map(self._structure, children))

    def _class(self, of: type) -> bytes:
        name = _name(of)
        self.used.add(of, of.__module__)
        return self._once(of, code.of_class) if name is None else name.encode()

    def _require_pure(self, value: Any, name: str) -> None:
        """Requires the objects that a user's function or class uses to be pure, and notes their use."""
        if self._of_users:
            module, _, path = name.partition(":")
            code.require_pure(module, path)
            self.used.add(value, module)

    def _once(self, value: Any, parts: Callable[[Any], tuple[Any, ...]]) -> bytes:
        """Returns the bytes of its parts; its place among the values reached if it is among them, as where a function
        calls itself.
        """
        place = self._places.setdefault(id(value), len(self.reached))
        if place < len(self.reached):
            return _tag("again", str(place).encode())
        self.reached.append(value)
        before, self._of_users = self._of_users, self._of_users or home_of(value) is None
        try:
            return _tag("of parts", *map(self.of, parts(value)))
        finally:
            self._of_users = before


def _name(value: Any) -> str | None:
    """Returns the name by which it is found in a known library, if it is."""
    try:
        return name_of(value)
    except NoNameError:
        return None


def _tag(kind: str, *parts: bytes) -> bytes:
    return b"".join(struct.pack("<q", len(part)) + part for part in (kind.encode(), *parts)) + b"."
