"""Functions and classes of users in a file: ``function = "my_module:force"``, ``kind = "my_module:MyRail"``.

Numbers are passed to a function as its parameters, and to a class as its arguments, which are keys. A family of kinds
that is :class:`Open` takes every subclass of its contract under the name from which it can be imported, so that a class
needs no registration: what makes it readable is its contract.
"""

import contextlib
import dataclasses
import inspect
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import jax
import numpy as np

from ...numerics.arrays import to_array
from ...numerics.declare import FINITE, Declared
from .errors import ScenarioError, describe, key_error
from .imports import import_name, is_python_name, name_of
from .table import REQUIRED, Check, Key, Keys, Module, OpenFamily, join, read_family
from .values import Flag, Kind, Numbers, Text, require_conditions


@contextlib.contextmanager
def trying(path: str, argument: str = "function", must: str = "a function that fits here, but it") -> Iterator[None]:
    """Turns whatever a function raises within this block into an error of the key at ``path`` that names it.

    An error of the ``argument`` by which Python takes it is reported as that of the key. ``must`` says what the key
    must name, and what raises.
    """
    try:
        yield
    except ScenarioError:
        raise
    except Exception as error:
        sentence, prefix = " ".join(str(error).split()), f"Argument `{argument}` "
        # Such a sentence is about the argument; to the user of a file, that is the key.
        if sentence.startswith(prefix):
            end = "" if sentence.endswith((".", "?")) else "."
            raise ScenarioError(f"Key `{path}` {sentence.removeprefix(prefix)}{end}") from None
        raised = ": ".join(filter(None, [type(error).__name__, sentence.rstrip(".")]))
        raise ScenarioError(f"Key `{path}` must name {must} raises {raised}.") from error


@dataclass(frozen=True)
class Function(Text):
    """A function that can be imported."""

    words: str = 'a function that can be imported, as "module:function"'

    def read(self, value: Any, path: str) -> Callable[..., Any]:
        return import_name(path, super().read(value, path))

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
        """Reads one array or a dictionary of arrays."""
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


FUNCTION = {"function": Key(Function()), "parameters": Key(Parameters(), None, says="passed to the function")}


@dataclass(frozen=True)
class Setting:
    """The value of a static field: a text, true or false, a number, or a list of these, which becomes a tuple."""

    words: str = "a text, a number, true or false, or a list of these"

    def read(self, value: Any, path: str) -> Any:
        if isinstance(value, list):
            return tuple(self.read(item, path) for item in value)
        if isinstance(value, float):
            return float(Numbers().read(value, path))
        if isinstance(value, str | int):
            return value
        raise key_error(path, self.words, describe(value))

    def write(self, value: Any, path: str) -> Any:
        if isinstance(value, tuple | list):
            return [self.write(item, path) for item in value]
        if isinstance(value, str | int | float):
            return value
        raise key_error(path, f"{self.words} to be written to a file", f"a {type(value).__name__}")


@dataclass(frozen=True)
class _Array(Numbers):
    """Numbers as an array, so that a class need not convert them."""

    def read(self, value: Any, path: str) -> Any:
        return to_array(super().read(value, path))


class Open(OpenFamily):
    """A family of kinds that users' subclasses of ``contract`` join.

    ``check`` is given what a user's class makes, and raises an exception if it does not fit; ``parts`` are those of
    :func:`module_of`.
    """

    def __init__(
        self,
        contract: type,
        members: Mapping[str, Module],
        check: Callable[[Any], None] = lambda item: None,
        parts: "Parts" = MappingProxyType({}),
    ):
        super().__init__(members)
        self.contract, self.check, self.parts = contract, check, parts

    def own(self, named: str, path: str) -> Module:
        # From its own arguments: a class of users needs no list of keys.
        module = module_of(own_class(named, path, self.contract), self.parts)

        def build(**arguments: Any) -> Any:
            with trying_class(path, named):
                item = module.type(**arguments)
                self.check(item)
            return item

        return dataclasses.replace(module, build=build)

    def own_name(self, item: Any, path: str) -> tuple[str, Module] | None:
        kind = type(item)
        # Classes of jaxball that are not in the family are refused by the caller, with the names of those that are.
        if not isinstance(item, self.contract) or _is_jaxballs(kind):
            return None
        name = name_of(kind, path)
        if name is None:
            raise ScenarioError(
                f"Key `{join(path, 'kind')}` must be a class that can be imported to be written to a file, but "
                f"{kind.__module__}:{kind.__qualname__} cannot be; keep its scenario as a Python script."
            )
        return name, module_of(kind, self.parts)


def own_class(named: str, path: str, contract: type) -> Any:
    """Returns the class "module:Class", a subclass of ``contract``.

    **Raises:** :class:`ScenarioError` where there is none.
    """
    candidate = import_name(path, named, "class")
    if isinstance(candidate, type) and issubclass(candidate, contract) and not inspect.isabstract(candidate):
        return candidate
    lacks = sorted(getattr(candidate, "__abstractmethods__", ())) if isinstance(candidate, type) else []
    what = (
        f"it lacks {', '.join(lacks)}" if lacks and issubclass(candidate, contract) else f"{describe(named)} is not one"
    )
    raise ScenarioError(f"Key `{path}` must name a subclass of {contract.__name__} with all its methods, but {what}.")


Parts = Mapping[Any, Kind]  # how fields of other classes stand in a file, by their annotations
NONE: Mapping[Any, Any] = MappingProxyType({})


def module_of(
    kind: Any,
    parts: Parts = NONE,
    *,
    keys: Keys = NONE,
    attributes: Mapping[str, str] = NONE,
    required: Collection[str] = (),
    build: Callable[..., Any] | None = None,
    check: Check | None = None,
) -> Module:
    """Describes how an object of a class stands in a file: each argument of the class is a key.

    Numbers are what their fields declare. Those of a user's class need no declaration: static fields are settings, all
    others numbers, of the shape with which they are annotated if they are; the default None stands for that of the
    class. Other arguments of jaxball's classes are keys where they are among ``parts`` or ``keys``, which come first.
    Those that are ``required`` have a default in Python alone.
    """
    fields = {field.name: field for field in dataclasses.fields(kind)}
    _, *parameters = inspect.signature(kind.__init__).parameters.values()
    names = {python: name for name, python in attributes.items()}
    described = {}
    for parameter in parameters:
        name = names.get(parameter.name, parameter.name)
        key = keys.get(name) or _key_of(parameter, fields.get(parameter.name), parts, _is_jaxballs(kind))
        if key is not None:
            described[name] = Key(key.kind) if name in required else key
    return Module(kind, described, build, attributes, check)


def modules_of(kinds: Mapping[str, type], parts: Parts = NONE) -> dict[str, Module]:
    """Describes classes by their names in files, as :func:`module_of` does."""
    return {name: module_of(kind, parts) for name, kind in kinds.items()}


def _is_jaxballs(kind: type) -> bool:
    return kind.__module__.partition(".")[0] == "jaxball"


def _key_of(parameter: inspect.Parameter, field: dataclasses.Field | None, parts: Parts, is_ours: bool) -> Key | None:
    required = parameter.default is parameter.empty
    declared = None if field is None else field.metadata.get("converter")
    if isinstance(declared, Declared):
        shape = tuple(n if isinstance(n, int) else None for n in declared.shape)
        value = Numbers(shape, declared.rule or FINITE, declared.dimension, declared.by_size)
        return Key(value, REQUIRED if required else parameter.default)
    part = next((parts[given] for given in parts if field is not None and field.type in (given, given | None)), None)
    if part is not None:
        return Key(part, REQUIRED if required else None)
    if field is not None and field.type is bool:
        return Key(Flag(), REQUIRED if required else parameter.default)
    return None if is_ours else Key(_value_of(field), REQUIRED if required else None)


def _value_of(field: dataclasses.Field | None) -> Kind:
    """Returns the kind of value of a user's field; for an argument that is no field, numbers of any shape."""
    if field is not None and field.metadata.get("static", False):
        return Setting()
    axes = str(getattr(None if field is None else field.type, "dim_str", "...")).split()
    # Three axes or more, and sizes that are expressions, are not what a list in a file can be checked for.
    if len(axes) > 2 or not all(axis.isidentifier() or axis.isdecimal() for axis in axes):
        return Parameters()
    return _Array(tuple(int(axis) if axis.isdecimal() else None for axis in axes))


def names_own(values: Any) -> bool:
    """Returns whether a table has the key ``kind`` "module:Class"."""
    return isinstance(values, dict) and is_python_name(values.get("kind"))


def read_own(values: Any, path: str, family: OpenFamily) -> Any:
    """Reads the object that a table with the key ``kind`` "module:Class" describes, whose own conditions must hold."""
    named = values["kind"]
    item = family.own(named, join(path, "kind")).read({k: v for k, v in values.items() if k != "kind"}, path)
    if hasattr(item, "conditions"):
        require_conditions(item)
    return item


def read_open(values: Any, path: str, family: Open) -> Any:
    """Reads the object of an open family that a table describes, whose function must fit."""
    if names_own(values):
        return read_own(values, path, family)
    with trying(join(path, "function")):
        return read_family(values, path, family)


def trying_class(path: str, named: str) -> contextlib.AbstractContextManager[None]:
    """Turns what a user's class raises into an error of the key at ``path`` that names it."""
    return trying(path, "", f"a class that these keys can make, but {describe(named)}")
