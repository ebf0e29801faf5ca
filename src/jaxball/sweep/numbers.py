"""The numbers of a scenario's document, addressed by their paths: ``masses[0].rail.radius``."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from ..interface.wording import did_you_mean
from ..scenario.paths import steps
from .errors import StudyError

# These change what is compiled or how much is saved, and not the motion.
_FIXED = re.compile(r"format|time\.saves|solve\.max_steps|.*\.balance\.masses\[\d+\]")


def numbers_of(document: Any, path: str = "") -> Iterator[str]:
    """The paths of all numbers that a study can change, in the order of the document."""
    if isinstance(document, Mapping):
        for name, value in document.items():
            yield from numbers_of(value, f"{path}.{name}" if path else name)
    elif isinstance(document, list):
        for index, value in enumerate(document):
            yield from numbers_of(value, f"{path}[{index}]")
    elif isinstance(document, int | float) and not isinstance(document, bool) and not _FIXED.fullmatch(path):
        yield path


def check_number(document: Mapping[str, Any], path: str) -> None:
    """Raises a :class:`StudyError` unless ``path`` is that of a number that a study can change."""
    known = list(numbers_of(document))
    if path in known:
        return
    if _FIXED.fullmatch(path):
        raise StudyError(f"Key `{path}` must be the same in all rows, because it shapes what is computed and saved.")
    hint = did_you_mean(path, known, f"its numbers are {', '.join(known)}", "`")
    raise StudyError(
        f"Key `{path}` names no number that stands in the scenario; write it there if it has its default{hint}"
    )


def with_numbers(document: Mapping[str, Any], values: Mapping[str, float]) -> dict[str, Any]:
    """A copy of the document with other numbers at the paths in ``values``, all of which it has."""
    copy = _copy(document)
    for path, value in values.items():
        *above, last = steps(path)
        _at(copy, above)[last] = value
    return copy


def list_of(path: str) -> tuple[str, tuple[int, ...]]:
    """The path of the list in which a number stands, and its place there; of a number in no list, its own and ()."""
    name = re.sub(r"(\[\d+\])+$", "", path)
    return name, tuple(int(step) for step in steps(path[len(name) :]))


def value_at(document: Mapping[str, Any], path: str) -> Any:
    """What stands in the document at ``path``.

    **Raises:** ``LookupError`` when nothing does.
    """
    return _at(document, steps(path))


def _at(place: Any, way: list[str | int]) -> Any:
    for step in way:
        place = place[step]
    return place


def _copy(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _copy(item) for name, item in value.items()}
    return [_copy(item) for item in value] if isinstance(value, list) else value
