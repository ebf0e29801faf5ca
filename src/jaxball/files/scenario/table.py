"""Tables of a scenario file: their keys, read and written by the same description."""

import functools
import json
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any

from ...interface.wording import did_you_mean, number_of, plain
from .errors import ScenarioError, describe, each_of, keep_within, key_error
from .imports import is_python_name
from .values import Choice, Kind, Nested

REQUIRED = object()


@dataclass(frozen=True)
class Key:
    """A key of a table: the kind of its value, and its default if it is optional.

    A default None leaves the choice to what is built from the table. ``says`` is what the key means, for the page of
    keys and the schemas: in words, or by a class and the name of its argument, whose docstring has them.
    """

    kind: Kind
    default: Any = REQUIRED
    says: str | tuple[type, str] = ""


Keys = Mapping[str, Key]
# Raises for values of a table that do not fit each other, given the values and the path.
Check = Callable[[dict[str, Any], str], None]


@dataclass(frozen=True)
class Module:
    """How an object stands in a file as a table.

    - ``type``: its class, by which it is recognised for writing.
    - ``keys``: the keys of its table.
    - ``build``: makes the object from the values of the keys; the class itself if not given.
    - ``attributes``: where the object holds a key's value, if not under the same name; without ``build``, the argument.
    - ``check``: of the values.
    - ``elsewhere``: what stands in a file for an argument of the class that is no key, in words.
    """

    type: type
    keys: Keys
    build: Callable[..., Any] | None = None
    attributes: Mapping[str, str] = field(default_factory=dict)
    check: Check | None = None
    elsewhere: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self):
        # What a key means is said once: where its declaration does not, by the docstring of the class.
        said = {
            name: key if key.says else replace(key, says=(self.type, self.attributes.get(name, name)))
            for name, key in self.keys.items()
        }
        object.__setattr__(self, "keys", said)

    def read(self, values: Any, path: str) -> Any:
        """Reads the object that a table describes."""
        named_otherwise = {python: f"`{key}`" for key, python in self.attributes.items()}
        table = read_table(values, path, self.keys, named_otherwise | dict(self.elsewhere))
        if self.check is not None:
            self.check(table, path)
        return self.make(table)

    def make(self, table: Mapping[str, Any]) -> Any:
        """Makes the object from the values of its keys."""
        # A default None is an argument that is left out, so that the class has its own.
        arguments = {name: value for name, value in table.items() if value is not None}
        if self.build is not None:
            return self.build(**arguments)
        return self.type(**{self.attributes.get(name, name): value for name, value in arguments.items()})

    def write(self, item: Any, path: str) -> dict[str, Any]:
        """Returns the table that describes an object."""
        contents = {name: attrgetter(self.attributes.get(name, name))(item) for name in self.keys}
        return write_table(contents, path, self.keys)

    @property
    def nested(self) -> Nested:
        """The kind of value of such a table within another table."""
        return Nested(self.read, self.write, tables={"": self.keys})


Family = Mapping[str, Module]


class OpenFamily(dict[str, Module]):
    """A family that has kinds besides those listed: classes of users, by the names from which they are imported."""

    def own(self, named: str, path: str) -> Module:
        """Describes how an object of the class "module:Class", which the key at ``path`` names, stands in a file."""
        raise NotImplementedError

    def own_name(self, item: Any, path: str) -> tuple[str, Module] | None:
        """Returns the name of a user's class and how its objects stand in a file; None for an object of
        another class.
        """
        raise NotImplementedError


def join(path: str, name: str) -> str:
    """Returns the path of the key ``name`` in the table at ``path``; a key without letters is quoted, as in a file."""
    name = name if name and plain(name) == name and "\n" not in name else json.dumps(name)
    return f"{path}.{name}" if path else name


def read_table(values: Any, path: str, keys: Keys, elsewhere: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Reads the values of a table, defaults filled in. An unknown, missing or wrong key raises.

    ``elsewhere`` says what stands for a name of Python that is no key.
    """
    if not isinstance(values, dict):
        raise key_error(path, "a table", describe(values))

    def value(name: str, key: Key) -> Any:
        if name in values:
            return key.kind.read(values[name], join(path, name))
        if key.default is REQUIRED:
            raise ScenarioError(f"Key `{join(path, name)}` must be {key.kind.words}, but it is missing.")
        return key.default

    readers = [functools.partial(value, name, key) for name, key in keys.items()]
    # Together with what is missing or wrong, so that one message names a misspelt key and the one that is missing for
    # it.
    _, *read = each_of(lambda: refuse_unknown(values, path, keys, elsewhere), *readers)
    return dict(zip(keys, read, strict=True))


_KEEPS_DEFAULTS: ContextVar[bool] = ContextVar("_KEEPS_DEFAULTS", default=False)


def keeping_defaults() -> AbstractContextManager[bool]:
    """Writes tables in this block with their defaults, so that each of their numbers has a path."""
    return keep_within(_KEEPS_DEFAULTS, True)


def write_table(contents: Mapping[str, Any], path: str, keys: Keys) -> dict[str, Any]:
    """Returns the table with the values ``contents``; defaults are left out, unless :func:`keeping_defaults`."""
    table = {}
    for name, key in keys.items():
        value = None if contents[name] is None else key.kind.write(contents[name], join(path, name))
        if value is not None and not _is_default(value, key):
            table[name] = value
    return table


def read_one_of(
    values: Any, path: str, choices: Mapping[str, Keys], otherwise: Keys | None = None
) -> tuple[str, dict[str, Any]]:
    """Finds which of the keys in ``choices`` a table has, and reads its values: each choice has keys of its own.

    A table must have exactly one of them, or none if there is an ``otherwise``.
    """
    every = {name for keys in [*choices.values(), otherwise or {}] for name in keys}
    refuse_unknown(values, path, every)
    present = [name for name in choices if name in values]
    if not present and otherwise is not None:
        return "", read_table(values, path, otherwise)
    if len(present) != 1:
        names = ", ".join(f"`{name}`" for name in choices)
        got = " and ".join(f"`{name}`" for name in present) or "none of them"
        raise ScenarioError(f"Key `{path}` must have exactly one of the keys {names}, but it has {got}.")
    return present[0], read_table(values, path, choices[present[0]])


def read_family(values: Any, path: str, family: Family, key: str = "kind") -> Any:
    """Reads the object that a table describes, of the kind given by its key ``kind``."""
    if not isinstance(values, dict):
        raise key_error(path, "a table", describe(values))
    rest = {name: value for name, value in values.items() if name != key}
    chosen = values.get(key)
    if isinstance(chosen, str) and chosen in family:
        return family[chosen].read(rest, path)
    if isinstance(chosen, str) and is_python_name(chosen) and isinstance(family, OpenFamily):
        return family.own(chosen, join(path, key)).read(rest, path)
    # Without a known kind, a key is wrong only if no kind has it.
    every = {key, *(name for member in family.values() for name in member.keys)}
    kinds = {key: Key(Choice(tuple(family)))}
    each_of(
        lambda: refuse_unknown(values, path, every),
        lambda: read_table({key: chosen} if key in values else {}, path, kinds),
    )
    raise AssertionError("A kind that is known has been read above.")


def write_member(item: Any, path: str, family: Family) -> tuple[str, dict[str, Any]]:
    """Returns the kind of an object of a family, and the table that describes it except for its kind.

    **Raises:** :class:`ScenarioError` for an object that a file cannot hold, such as a Python function.
    """
    for name, member in family.items():
        if type(item) is member.type:
            return name, member.write(item, path)
    entry = family.own_name(item, path) if isinstance(family, OpenFamily) else None
    if entry is not None:
        return entry[0], entry[1].write(item, path)
    names = ", ".join(member.type.__name__ for member in family.values())
    got = f"a {type(item).__name__}; keep a scenario that has Python functions as a Python script"
    raise key_error(path, f"one of {names} to be written to a file", got)


def write_family(item: Any, path: str, family: Family) -> dict[str, Any]:
    """Returns the table that describes an object of a family, its ``kind`` first, unless that is the one without a
    name.
    """
    kind, table = write_member(item, path, family)
    return {"kind": kind, **table} if kind else table


def member_of(family: Family) -> Nested:
    """Returns the kind of value of an object of a family within another table."""
    return Nested(
        lambda values, path: read_family(values, path, family),
        lambda item, path: write_family(item, path, family),
        tables=keys_of(family),
    )


def keys_of(family: Family) -> dict[str, Keys]:
    """Returns the keys of each kind of a family, except for the kind itself."""
    return {name: member.keys for name, member in family.items()}


def read_list(values: Any, path: str, read: Callable[[Any, str], Any], empty: bool = False) -> list[Any]:
    """Returns the results of ``read`` for each table of a list and its path; the list may be empty only if
    ``empty``.
    """
    if not isinstance(values, list) or not (values or empty):
        heading = re.sub(r"\[\d+\]", "", path)  # as in TOML, where tables have no indices
        raise key_error(path, f"a list of tables, each under the heading [[{heading}]]", describe(values))
    return each_of(*(functools.partial(read, item, f"{path}[{index}]") for index, item in enumerate(values)))


def as_long_as(other: str, *names: str, entry: tuple[str, str] = ("entry", "entries")) -> Check:
    """Returns the check that the lists ``names`` of a table are as long as ``other``."""

    def check(table: dict[str, Any], path: str) -> None:
        n = len(table[other])
        for name in names:
            if len(table[name]) != n:
                must = f"as long as `{other}`, which has {number_of(n, *entry)}"
                raise key_error(join(path, name), must, f"one of {len(table[name])}")

    return check


def at_least(name: str, least: int, words: str) -> Check:
    """Returns the check that the list ``name`` of a table has this many entries, which are ``words``, or more."""

    def check(table: dict[str, Any], path: str) -> None:
        if len(table[name]) < least:
            raise key_error(join(path, name), f"a list of {words} or more", f"one of {len(table[name])}")

    return check


_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


def read_by_name(values: Any, path: str, read: Callable[[Any, str], Any]) -> dict[str, Any]:
    """Applies ``read`` to each table of a table and its path; returns the results by the names of the tables."""
    if not isinstance(values, dict):
        raise key_error(path, f"a table of tables, each under the heading [{path}.name]", describe(values))
    for name in values:
        if not _NAME.fullmatch(name):
            raise ScenarioError(
                f"Key `{path}` must have names of letters, digits and underscores that begin with a letter, but it has "
                f"{describe(name)}."
            )
    read_each = each_of(*(functools.partial(read, table, join(path, name)) for name, table in values.items()))
    return dict(zip(values, read_each, strict=True))


MOST_UNKNOWN = 10  # keys of one table that are told one by one


def refuse_unknown(values: Any, path: str, names: Iterable[str], elsewhere: Mapping[str, str] | None = None) -> None:
    """Raises for a value that is not a table, and for a key that is not among ``names``; see :func:`read_table`."""
    if not isinstance(values, dict):
        raise key_error(path, "a table", describe(values))
    names = sorted(names)
    right_names = set(names)
    unknown = [name for name in values if name not in right_names]

    def refuse(name: str) -> None:
        here = f"the keys here are {', '.join(names)}" if names else "there are no keys here"
        hint = did_you_mean(name, names, here, "`")
        if elsewhere and name in elsewhere:
            hint = f"; in a file it is {elsewhere[name]}."
        raise ScenarioError(f"Key `{join(path, name)}` is not known{hint}")

    def refuse_others(first: str, more: int) -> None:
        others = f"{number_of(more, 'other key')} here {'is' if more == 1 else 'are'}"
        raise ScenarioError(f"Key `{join(path, first)}` is not known, and {others} not.")

    readers = [functools.partial(refuse, name) for name in unknown[:MOST_UNKNOWN]]
    if unknown[MOST_UNKNOWN + 1 :]:
        readers.append(functools.partial(refuse_others, unknown[MOST_UNKNOWN], len(unknown) - MOST_UNKNOWN - 1))
    elif unknown[MOST_UNKNOWN:]:
        readers.append(functools.partial(refuse, unknown[MOST_UNKNOWN]))
    each_of(*readers)


def _is_default(value: Any, key: Key) -> bool:
    """Returns whether a value is the key's default, by the digits, which distinguish 0.0 from -0.0."""
    if key.default is REQUIRED or key.default is None or _KEEPS_DEFAULTS.get():
        return False
    return repr(value) == repr(key.kind.write(key.default, ""))
