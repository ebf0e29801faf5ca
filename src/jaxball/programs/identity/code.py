"""What functions and classes of users consist of, as values: code, and everything that it names or holds.

Two that consist of equal values compute the same, in any process. Code that may read something else, such as a file,
the time or a random number, is refused.
"""

import dataclasses
import dis
import enum
import functools
import inspect
import itertools
import types
from collections.abc import Iterator
from typing import Any, NamedTuple

from ...interface.compat import node_functions, unwrap_jit
from .names import OWN, NoNameError, home_of, is_known

_GLOBAL = ("LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS")
_HELD = ("LOAD_DEREF", "LOAD_CLASSDEREF", "LOAD_FROM_DICT_OR_DEREF")
_ATTRIBUTE = ("LOAD_ATTR", "LOAD_METHOD")
_BY_STRINGS = frozenset(("attrgetter", "getattr", "methodcaller"))  # load attributes of names that are strings
# Entries of classes that have no effect on what these compute, or that follow from the others.
_ANNOTATIONS = ("__annotate__", "__annotate_func__", "__annotations__", "__annotations_cache__", "__doc__")
_OF_GENERIC = ("__orig_bases__", "__parameters__", "__type_params__")
_OF_LAYOUT = (
    "__dict__",
    "__slotnames__",
    "__weakref__",
    "__module__",
    "__firstlineno__",
    "__static_attributes__",
    "__classdictcell__",
)
_WITHOUT_EFFECT = frozenset((*_ANNOTATIONS, *_OF_GENERIC, *_OF_LAYOUT, "_abc_impl"))
# What depends on more than its arguments, or does more than return a value, in packages that are otherwise known.
IMPURE = {
    "builtins": "__import__ breakpoint compile eval exec globals help id input locals open print vars",
    "numpy": "fromfile fromregex genfromtxt load loadtxt memmap random save savetxt savez savez_compressed",
    "jax": "config fromfile load profiler save",
    "equinox": "tree_deserialise_leaves tree_serialise_leaves",
}
_IMPORT = dis.opmap["IMPORT_NAME"]
_MISSING = "missing"
_MADE_BY_PYTHON = 1 << 9  # among the flags of a class; others are written in C, and follow from Python's version


class Use(NamedTuple):
    """A value that code loads by its name, and the attributes that it then loads, one of the other."""

    name: str
    is_held: bool
    attributes: tuple[str, ...]


class Member(NamedTuple):
    """What code takes from a module that is known: its name there, and the value if that could be another one."""

    module: str
    name: str
    value: Any


class Used:
    """What users' code may use of jaxball.

    - ``values``: functions, classes and modules that it names, and the classes of objects that it holds, by identity.
    - ``names``: those of all attributes that it may load; empty if there is no users' code.
    """

    def __init__(self) -> None:
        self.values: dict[int, Any] = {}
        self.names: set[str] = set()

    def add(self, value: Any, module: str | None) -> None:
        """Notes a value that this module has, if that is one of jaxball's."""
        if is_own(module or ""):
            self.values[id(value)] = value


def is_own(module: str) -> bool:
    """Returns whether a module is one of jaxball's."""
    return module.partition(".")[0] == OWN


def require_pure(module: str, path: str = "") -> None:
    """Raises a :class:`NoNameError` for what reads files and the like, in the packages of others that are known.

    What jaxball's own functions read is found in their code (:mod:`~.purity`).
    """
    package, *rooms = module.split(".")
    if not set(IMPURE.get(package, "").split()).isdisjoint((*rooms, *path.split("."))):
        raise NoNameError(f"What {module}.{path} gives may depend on more than its arguments.")


def of_function(function: types.FunctionType, used: Used) -> tuple[Any, ...]:
    """Returns the parts of a function: its code, defaults and attributes, and the values that it holds and names.

    What it uses of jaxball is added to ``used``.

    **Raises:** :class:`NoNameError`.
    """
    held = dict(zip(function.__code__.co_freevars, map(_content, function.__closure__ or ()), strict=True))
    attributes = function.__name__, function.__defaults__, function.__kwdefaults__, vars(function)
    if home_of(function) is not None:  # the rest of its module is known
        return function.__code__, attributes, tuple(held.values())
    for code in codes_in(function.__code__):
        for imported in imports(code):
            raise NoNameError(f"{code.co_name} imports {imported.module}.")
        used.names.update(names_in(code))
    builtins: Any = getattr(function, "__builtins__", {})
    named = []
    for use in sorted({use for code in codes_in(function.__code__) for use in uses(code)}):
        if not use.is_held:
            value = function.__globals__.get(use.name, builtins.get(use.name, _MISSING))
            named.append((use.name, _load_attributes(value, use.attributes, used)))
        elif isinstance(held.get(use.name), types.ModuleType):
            named.append((use.name, _load_attributes(held[use.name], use.attributes, used)))
    contents = tuple(None if isinstance(value, types.ModuleType) else value for value in held.values())
    return function.__code__, attributes, contents, tuple(named)


def of_code(code: types.CodeType) -> tuple[Any, ...]:
    """Returns the parts of code, except for where it is written."""
    counts = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    return code.co_name, code.co_code, code.co_exceptiontable, counts, names, code.co_consts


def of_class(of: type) -> tuple[Any, ...]:
    """Returns the parts of a class: its bases, its entries, and how PyTrees take its objects apart.

    **Raises:** :class:`NoNameError`.
    """
    if not of.__flags__ & _MADE_BY_PYTHON:
        return of.__module__, of.__qualname__
    if issubclass(of, enum.Enum):
        raise NoNameError(f"{of!r} is a class of members, which hold each other.")
    entries = {name: entry for name, entry in sorted(vars(of).items()) if name not in _WITHOUT_EFFECT}
    try:
        return of.__name__, type(of), of.__bases__, entries, node_functions(of)
    except RuntimeError as error:
        raise NoNameError(str(error)) from None


def of_other(value: Any) -> tuple[Any, ...] | None:
    """Returns the parts of a value of Python's own classes, or of a function that is compiled; None for anything else.

    **Raises:** :class:`NoNameError`.
    """
    for kinds, parts in _PARTS:
        if isinstance(value, kinds):
            return parts(value)
    try:
        return unwrap_jit(value)
    except RuntimeError as error:
        raise NoNameError(str(error)) from None


def names_of_caches(of: type) -> frozenset[str]:
    """Returns the names under which objects of a class keep values that follow from the rest of them."""
    entries = ((name, entry) for base in of.__mro__ for name, entry in vars(base).items())
    cached = (name for name, entry in entries if isinstance(entry, functools.cached_property))
    return frozenset((*cached, *(getattr(of, "follows", ()) if home_of(of) else ())))


def _content(cell: Any) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # it is empty
        return _MISSING


def codes_in(code: types.CodeType) -> Iterator[types.CodeType]:
    """Yields the code, and the code of all functions and classes that it makes."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from codes_in(constant)


def uses(code: types.CodeType) -> Iterator[Use]:
    """Yields all values that code loads by names."""
    instructions = [
        instruction
        for instruction in dis.get_instructions(code)
        if instruction.opname not in ("EXTENDED_ARG", "PUSH_NULL")
    ]
    for k, instruction in enumerate(instructions):
        if instruction.opname in (*_GLOBAL, *_HELD):
            attributes = itertools.takewhile(lambda following: following.opname in _ATTRIBUTE, instructions[k + 1 :])
            yield Use(
                instruction.argval, instruction.opname in _HELD, tuple(following.argval for following in attributes)
            )


class Import(NamedTuple):
    """An import within a function: ``from ..module import names`` has ``level`` 2."""

    module: str
    level: int
    names: tuple[str, ...]


def imports(code: types.CodeType) -> Iterator[Import]:
    """Yields the imports that code makes when it runs."""
    if _IMPORT not in code.co_code[::2]:  # far faster than what follows
        return
    instructions = [instruction for instruction in dis.get_instructions(code) if instruction.opname != "EXTENDED_ARG"]
    for level, names, instruction in zip(instructions, instructions[1:], instructions[2:], strict=False):
        if instruction.opcode == _IMPORT:
            yield Import(instruction.argval, level.argval, names.argval or ())


def names_in(code: types.CodeType) -> Iterator[str]:
    """Yields all names of globals and of attributes that code may load."""
    yield from code.co_names
    if not _BY_STRINGS.isdisjoint(code.co_names):
        yield from (name for name in code.co_consts if isinstance(name, str))


def _load_attributes(value: Any, attributes: tuple[str, ...], used: Used) -> Any:
    """Returns the value from which these attributes are loaded; for a module, the first one that is not a module."""
    if not isinstance(value, types.ModuleType):
        return value
    if not is_known(value.__name__):
        if not attributes or attributes[0] not in vars(value):
            raise NoNameError(f"{value!r} is a module of which anything may be used.")
        return attributes[0], _load_attributes(vars(value)[attributes[0]], attributes[1:], used)
    if not attributes:
        return value
    require_pure(value.__name__, attributes[0])
    member = getattr(value, attributes[0], _MISSING)
    if isinstance(member, types.ModuleType):
        return _load_attributes(member, attributes[1:], used)
    require_pure(getattr(member, "__module__", None) or "", getattr(member, "__qualname__", ""))
    used.add(member, value.__name__)
    # What a known module holds follows from its version, unless a user has put something else there.
    replaced = isinstance(member, types.FunctionType | type) and home_of(member) is None
    constant = isinstance(member, bool | int | float | complex | str)
    return Member(value.__name__, attributes[0], member if replaced or constant else None)


def _of_field(field: dataclasses.Field) -> tuple[Any, ...]:
    flags = field.init, field.repr, field.hash, field.compare, field.kw_only
    return field.name, field.default, field.default_factory, flags, dict(field.metadata), str(field._field_type)


def _of_parameter(parameter: inspect.Parameter) -> tuple[Any, ...]:
    defaults = () if parameter.default is inspect.Parameter.empty else (parameter.default,)
    return parameter.name, int(parameter.kind), defaults


def _of_builtin(function: Any) -> tuple[Any, ...] | None:
    """Returns the object to which a method is bound, and its name; None for a function of a module."""
    owner = function.__self__
    return None if owner is None or isinstance(owner, types.ModuleType) else (owner, function.__name__)


_WRAPPERS = types.WrapperDescriptorType, types.MethodDescriptorType, types.ClassMethodDescriptorType
_PARTS: tuple[tuple[Any, Any], ...] = (
    (types.EllipsisType | types.NotImplementedType, lambda value: (str(value),)),
    (property, lambda value: (value.fget, value.fset, value.fdel)),
    (staticmethod | classmethod, lambda value: (value.__func__,)),
    (functools.cached_property, lambda value: (value.func,)),
    (type(functools.cache(lambda: None)), lambda value: (value.__wrapped__,)),
    (dataclasses.Field, _of_field),
    (getattr(dataclasses, "_DataclassParams", ()), lambda value: (repr(value),)),
    (types.MemberDescriptorType, lambda value: (value.__name__,)),
    (_WRAPPERS, lambda value: (value.__objclass__, value.__name__)),
    (types.BuiltinFunctionType, _of_builtin),
    (type(vars(Use)["name"]), lambda value: (value.__reduce__()[1][0],)),  # an entry of a named tuple
    (inspect.Signature, lambda value: tuple(map(_of_parameter, value.parameters.values()))),
    (slice | range, lambda value: (value.start, value.stop, value.step)),
    (types.MappingProxyType, lambda value: (dict(value),)),
    (types.CodeType, of_code),
)
