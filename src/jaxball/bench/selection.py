"""Problems and solvers chosen by name."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeVar

from ..interface.wording import nearest
from .contenders import ALL, Contender
from .problem import Problem

Item = TypeVar("Item")
NEAREST = 3


class SelectionError(ValueError):
    """No problem or solver has that name; the message is a sentence with the nearest names."""


def select_problems(known: Mapping[str, Problem], names: Sequence[str]) -> list[Problem]:
    """The problems with these names, in the order of ``known``; all where there are no names.

    **Arguments:**

    - ``names``: as they are called.

    **Raises:** :class:`SelectionError` for a name that no problem has.
    """
    found = {key for name in names for key in _matching("problems", name, {key: (key,) for key in known})}
    return [problem for key, problem in known.items() if not names or key in found]


def select_contenders(names: Sequence[str], known: Mapping[str, Contender] = ALL) -> list[Contender]:
    """The contenders with these names, in the order of ``known``; all where there are no names.

    A name may also be whole words of one, or the package: "RadauIIA" are all of its stage numbers, and
    "SciPy" all of SciPy.

    **Arguments:**

    - ``names``: as they are called, or words of that.

    **Raises:** :class:`SelectionError` for a name that no contender has.
    """
    labels = {key: (key, contender.family.name) for key, contender in known.items()}
    found = {key for name in names for key in _matching("solvers", name, labels)}
    return [contender for key, contender in known.items() if not names or key in found]


def _matching(argument: str, name: str, labels: Mapping[str, tuple[str, ...]]) -> list[str]:
    """The keys whose label is ``name``, or else those that hold its words one after the other."""
    exact = [key for key in labels if key.lower() == name.lower()]
    found = exact or [key for key, values in labels.items() if any(_holds(value, name) for value in values)]
    if not found:
        known = dict.fromkeys(label for values in labels.values() for label in values)
        raise SelectionError(
            f"Argument `{argument}` must name some of what `jaxball bench --list` shows, but it has {name!r}; "
            f"{_suggestion(name, known)}."
        )
    return found


def _holds(label: str, name: str) -> bool:
    words, wanted = label.lower().split(), name.lower().split()
    starts = range(len(words) - len(wanted) + 1)
    return bool(wanted) and any(words[start : start + len(wanted)] == wanted for start in starts)


def _suggestion(name: str, known: Iterable[str]) -> str:
    known = list(known)
    near = nearest(name, known, NEAREST, cutoff=0.3)
    if len(near) == 1:
        return f"the nearest name is {near[0]}"
    return f"the nearest names are {', '.join(near)}" if near else f"the names are {', '.join(known)}"
