"""Keys of files by their old names, which are read as the new ones, with a warning.

``docs/project/compatibility.md`` promises this until 1.0, and in 1.0 itself.
"""

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from ..interface.deprecation import warn_at_users_line
from .errors import ScenarioError

_INDEX = r"(?:\[[^\]]*\])*"


class NewName(NamedTuple):
    """What a key is called now, and the version since which it is."""

    name: str
    since: str


# By the path of the old key without indices, in which tables have their new names: "masses.rail.breadth".
RENAMED: dict[str, NewName] = {}


def with_new_keys(document: Any) -> Any:
    """Returns a document whose keys have their new names, with a ``FutureWarning`` for each that did not.

    The scenario within a study or a problem is one too, and the paths in these name its keys.

    **Raises:** :class:`ScenarioError` for a table that has a key by both names.
    """
    return _rename(document, "") if RENAMED else document


def _rename(value: Any, path: str) -> Any:
    if isinstance(value, list):
        return [_rename(item, path) for item in value]
    if not isinstance(value, Mapping):
        return value
    table = {}
    for old, item in value.items():
        name = _new_name(value, f"{path}.{old}" if path else old, old)
        # A scenario within a study has the same keys as one alone.
        inside = "" if not path and name == "scenario" else f"{path}.{name}" if path else name
        table[name] = _with_new_steps(item) if name == "path" and isinstance(item, str) else _rename(item, inside)
    return table


def _new_name(table: Mapping[str, Any], key: str, old: str) -> str:
    new = RENAMED.get(key)
    if new is None:
        return old
    if new.name in table:
        raise ScenarioError(
            f"Key `{key}` must be left out where `{new.name}` is given, because it is an old name of the same key."
        )
    _warn(key, new)
    return new.name


def _with_new_steps(path: str) -> str:
    """Returns a path in a study or a problem, such as ``masses[0].rail.radius``, with the new names of its keys."""
    for key, new in RENAMED.items():
        *tables, old = map(re.escape, key.split("."))
        above = "".join(rf"{table}{_INDEX}\." for table in tables)
        path, count = re.subn(rf"^((?:scenario\.)?{above}){old}(?=$|[.\[])", rf"\g<1>{new.name}", path)
        if count:
            _warn(key, new)
    return path


def _warn(key: str, new: NewName) -> None:
    message = f"Key `{key}` is called `{new.name}` since jaxball {new.since}; it is read as that, but rename it."
    warn_at_users_line(message, FutureWarning)
