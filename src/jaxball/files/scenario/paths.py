"""Paths that name the entries of a document, with indices counted from 0: ``masses[0].radius``.

A key with other letters is quoted, as in ``feedback.start.'Omega[0]'``.
"""

import copy
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ...interface.wording import did_you_mean, number_of
from .errors import ScenarioError, describe

_NAME = r"[A-Za-z_][\w-]*"
_STEP = re.compile(rf"\.?({_NAME})|\.'([^']*)'|\[(\d+)\]")
_PATH = re.compile(rf"{_NAME}(\.{_NAME}|\.'[^']*'|\[\d+\])*")
_WORD = re.compile(r"[A-Za-z][\w+-]*")
SUGGESTED = 3  # paths at most, where one is wrong
EXACT = 2**53  # the largest number up to which float64 holds every whole one
# These change what is compiled or how much is saved, and not the motion.
_OF_ALL = (
    r"format|time\.saves|solve\.max_steps?|.*\.balance\.masses\[\d+\]|actuation\.masses\[\d+\]|mechanisms.*\.(on|joint)"
    r"|feedback\.horizon|events\.\w+\.capacity"
)
_FIXED = re.compile(rf"{_OF_ALL}|sensors\..*")
# Where sensors are read, and the motion is one under feedback.
_FIXED_BESIDES = re.compile(rf"{_OF_ALL}|sensors\.\w+\.errors\.(rate|delay)")


def entries(name: str, shape: tuple[int, ...]) -> dict[str, tuple[int, ...]]:
    """Returns the index of each number of an array by the number's path: ``{"z[0]": (0,), "z[1]": (1,)}``.

    A single number, of shape (), has the name of the array.
    """
    return {name + "".join(f"[{k}]" for k in index): index for index in itertools.product(*map(range, shape))}


def steps(path: str) -> list[str | int]:
    """Lists the names and indices in a path."""
    return [int(index) if index else name or quoted for name, quoted, index in _STEP.findall(path)]


def numbers_of(document: Any, path: str = "", measured: bool = False) -> Iterator[str]:
    """Lists the paths of all numbers that a study can change, in the order of the document; also the numbers of sensors
    if it is ``measured``.
    """
    fixed = _FIXED_BESIDES if measured else _FIXED
    for entry, value in walk(document, path):
        if isinstance(value, int | float) and not isinstance(value, bool) and not fixed.fullmatch(entry):
            yield entry


def walk(place: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Lists the paths of all entries below ``place``, each with its value, in the order of the document."""
    named = place.items() if isinstance(place, Mapping) else enumerate(place) if isinstance(place, list) else ()
    for name, value in named:
        # A key with dots or brackets would read as several steps.
        step = name if isinstance(name, int) or re.fullmatch(_NAME, name) or not path else f"'{name}'"
        entry = f"{path}[{step}]" if isinstance(step, int) else f"{path}.{step}".removeprefix(".")
        yield entry, value
        yield from walk(value, entry)


def check_number(
    document: Mapping[str, Any],
    path: str,
    measured: bool = False,
    key: str = "",
    every: bool = False,
    has_defaults: bool = False,
) -> None:
    """Raises a :class:`ScenarioError` unless ``path`` is that of a number that a study can change.

    - ``measured``: whether sensors are read.
    - ``key``: the key that has the path as its value, which the sentence names.
    - ``every``: whether ``[*]`` stands for every index.
    - ``has_defaults``: whether the document is one :func:`~jaxball.files.scenario.files.with_defaults`.
    """
    number_paths = list(numbers_of(document, measured=measured))
    if path in number_paths:
        return
    if (_FIXED_BESIDES if measured else _FIXED).fullmatch(path):
        names = f"Key `{key}` names `{path}`, which" if key else f"Key `{path}`"
        raise ScenarioError(f"{names} must be the same in all rows, because it determines what is computed and saved.")
    reason = _not_one_number(document, path, every)
    if not reason:
        default = "" if has_defaults else "; write it there if it has its default"
        reason = f"is not there{default}{did_you_mean(path, number_paths, quote='`', most=SUGGESTED)}"
    where, this = "of" if has_defaults else "written in", f"`{path}`" if key else "it"
    raise ScenarioError(f"Key `{key or path}` must name a number {where} the scenario, but {this} {reason}")


def _not_one_number(document: Mapping[str, Any], path: str, every: bool) -> str:
    """Returns the end of a sentence about a path that leads to something other than a number; empty if it leads
    nowhere.
    """
    if not has_path(document, path):
        return ""
    value = value_at(document, path)
    inside = list(numbers_of(value, path))
    if not inside:
        return f"is {describe(value)}."
    tables = isinstance(value, dict) or any(isinstance(entry, dict) for entry in value)
    if tables:
        what = "a table" if isinstance(value, dict) else "a list of tables"
        return f"is {what}; name a number in it, such as `{inside[0]}`."
    pattern = re.sub(r"\d+", "*", inside[0].removeprefix(path))
    each = f", or each of them by `{path}{pattern}`" if every else ""
    return f"is a list of {number_of(len(inside), 'number')}; name one of them, such as `{inside[0]}`{each}."


def with_numbers(document: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a copy of the document with other numbers at the paths in ``values``, all of which it has.

    What is a whole number in the document stays one, where float64 holds it exactly.
    """
    # A deep copy, because tables within are changed.
    changed = copy.deepcopy(dict(document))
    for path, value in values.items():
        *above, last = steps(path)
        place = _at(changed, above)
        # Keys for whole numbers refuse 2.0, which is what a variable or an axis has for 2.
        stays_whole = isinstance(place[last], int) and isinstance(value, float) and value.is_integer()
        place[last] = int(value) if stays_whole and abs(value) <= EXACT else value
    return changed


def key_of(path: str) -> str:
    """Returns the path of the key whose value a number is, or in whose list it stands."""
    return re.sub(r"(\[\d+\])+$", "", path)


def value_at(document: Mapping[str, Any], path: str) -> Any:
    """Returns the entry of the document at ``path``.

    **Raises:** ``LookupError`` when nothing does.
    """
    return _at(document, steps(path))


def has_path(document: Mapping[str, Any], path: str) -> bool:
    """Returns whether the document has an entry at ``path``."""
    try:
        value_at(document, path)
    except (LookupError, TypeError):
        return False
    return True


def _at(place: Any, way: list[str | int]) -> Any:
    for step in way:
        place = place[step]
    return place


def with_values(document: Mapping[str, Any], changes: Sequence[str]) -> dict[str, Any]:
    """Returns a copy of the document with each change, ``PATH=VALUE``, made.

    The value is a number or any other of TOML; a single word needs no quotes. Keys and tables that the document leaves
    out may be named too; whether they exist is checked when it is read. ``PATH=``, without a value, removes the key,
    the table or the entry of a list.

    **Raises:** :class:`ScenarioError` for a malformed change, for an entry that a list does not have, and where there
    is nothing to remove.
    """
    changed = copy.deepcopy(dict(document))
    for change in changes:
        path, equals, text = change.partition("=")
        path = path.strip()
        if not equals or not _PATH.fullmatch(path):
            raise ScenarioError(
                f'A change must be PATH=VALUE, such as body.mass=2 or masses[0].mass=0.3, but it is "{change}".'
            )
        way, text = steps(path), text.strip()
        if not text:
            _take_away(changed, way, path)
            continue
        place: Any = changed
        for depth, after in enumerate(way[1:], start=1):
            place = _entry(place, way[:depth], path, {} if isinstance(after, str) else None)
        # A value in the place, so that an index or a table that is not there is refused before the value is read.
        _entry(place, way, path, 0)
        place[way[-1]] = _value(text, path)
    return changed


def _take_away(document: dict[str, Any], way: list[str | int], path: str) -> None:
    """Removes the entry at the end of ``way``; later entries of a list move up."""
    *above, last = way
    try:
        del _at(document, above)[last]
    except (LookupError, TypeError):
        hint = did_you_mean(path, [entry for entry, _ in walk(document)], quote="`")
        raise ScenarioError(f"Path `{path}` cannot be removed, because it is not in the scenario{hint}") from None


def _entry(place: Any, way: Sequence[str | int], path: str, missing: Any) -> Any:
    """Returns the entry at the last step of ``way``, in ``place``; ``missing`` is inserted there if there is none."""
    *above, step = way
    name = _path(above)
    if isinstance(step, int):
        if not isinstance(place, list):
            raise ScenarioError(f"Path `{path}` does not exist, because `{name}` is not a list.")
        if step >= len(place):
            has = number_of(len(place), "entry", "entries")
            raise ScenarioError(f"Path `{path}` does not exist, because `{name}` has {has}, counted from 0.")
        return place[step]
    if not isinstance(place, dict):
        raise ScenarioError(f"Path `{path}` does not exist, because `{name}` is not a table.")
    if missing is None and step not in place:
        raise ScenarioError(
            f"Path `{path}` does not exist, because the list `{_path(way)}` is not in the scenario; give all of it."
        )
    return place.setdefault(step, missing)


def _path(way: Sequence[str | int]) -> str:
    quoted = [step if isinstance(step, int) or re.fullmatch(_NAME, step) else f"'{step}'" for step in way]
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in quoted).removeprefix(".")


def _value(text: str, path: str) -> Any:
    try:
        number = float(text)
        # `int` alone would refuse 1e3, and `float` alone would make whole numbers into numbers that keys refuse.
        return int(text) if re.fullmatch(r"[+-]?\d+", text) else number
    except ValueError:
        pass
    if _WORD.fullmatch(text) and text not in ("true", "false"):
        return text
    import tomllib  # here, because most values are numbers and words

    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        raise ScenarioError(
            f"The value of `{path}` must be a number, a word, or another value of TOML, such as [1, 0, 0], but it is "
            f'"{text}".'
        ) from None
