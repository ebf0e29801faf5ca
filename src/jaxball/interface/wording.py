"""Words of messages: enumerations, plurals, "did you mean", how to install a package; and :class:`UserError`."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any


class UserError(ValueError):
    """What was typed, or written in a file, cannot be done; the message is one sentence that says what and why."""


# Control characters but for tab and newline, separators of lines, and what turns the direction of writing.
_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def plain(text: str) -> str:
    """Returns a text in which everything that would steer a terminal is spelled, as in ``\\x1b``."""
    return _STEERING.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def heading(title: str) -> str:
    """Returns the title of a file as a line of plain text."""
    return plain(" ".join(title.split()))


def beyond_numbers(value: object) -> str:
    """Returns a clause that says why a number of a file is infinite, where one in ``value`` is."""
    items = value if isinstance(value, list | tuple) else [value]
    infinite = any(beyond_numbers(item) if isinstance(item, list | tuple) else item in _INFINITE for item in items)
    return ", and the largest number is 1.8e308" if infinite else ""


_INFINITE = (float("inf"), float("-inf"))


def tell_numbers_apart(*numbers: float) -> list[str]:
    """Writes numbers with the fewest digits, six or more, by which all that differ can be told apart."""
    shown: list[str] = []
    for digits in (6, 10, 17):
        shown = [f"{number:.{digits}g}" for number in numbers]
        if len(set(shown)) == len(set(numbers)):
            break
    return shown


def one_of(names: Sequence[str]) -> str:
    """Returns ``one of a, b, c``, and a single name as it is."""
    return names[0] if len(names) == 1 else f"one of {', '.join(names)}"


def all_of(names: Sequence[str]) -> str:
    """Returns ``a, b and c``."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def number_of(number: int, thing: str, things: str = "") -> str:
    """Writes ``1 mass``, ``2 masses``, ``1,000 rows``; ``things`` is the plural if it is not formed by adding an s."""
    return f"{number:,} {thing if number == 1 else things or f'{thing}s'}"


def duration(seconds: float) -> str:
    """Formats a duration as text: ``42 s``, ``5 min``, ``3.2 h``."""
    if seconds < 100:
        return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def nearest(name: Any, known: Iterable[str], most: int = 1, cutoff: float = 0.6) -> list[str]:
    """Finds up to ``most`` known names similar to ``name``, the most similar first.

    Case does not count, nor do the dashes before an option, by which any two would be similar.
    """
    if not isinstance(name, str):  # which the error shows
        return []
    import difflib  # here, because it is for mistakes alone

    lower = {candidate.lower().lstrip("-"): candidate for candidate in known}
    return [lower[near] for near in difflib.get_close_matches(name.lower().lstrip("-"), lower, most, cutoff)]


def any_of(names: Sequence[str]) -> str:
    """Returns ``a, b or c``."""
    *first, last = names
    return f"{', '.join(first)} or {last}" if first else last


def did_you_mean(name: Any, known: Iterable[str], otherwise: str = "", quote: str = '"', most: int = 1) -> str:
    """Returns ``; did you mean "circle"?`` where known names are similar, up to ``most``, else ``otherwise`` as a
    clause.
    """
    near = nearest(name, known, most)
    if near:
        return f"; did you mean {any_of([f'{quote}{candidate}{quote}' for candidate in near])}?"
    return f"; {otherwise}." if otherwise else "."


def no_attribute(kind: type, name: str, places: Mapping[str, str]) -> AttributeError:
    """Makes the error of an attribute that is absent; ``places`` says where it is instead, such as "state.z" of "z"."""
    names = {*dir(kind), *getattr(kind, "__dataclass_fields__", ())}  # fields without a default are no attributes of it
    where = f"; it is `{places[name]}`." if name in places else did_you_mean(name, sorted(names), quote="`")
    article = "An" if kind.__name__[0] in "AEIOU" else "A"
    message = f"{article} {kind.__name__} has no attribute `{name}`{where}"
    return AttributeError(message, name=name, obj=None)  # of no object, to which Python would add a hint of its own


def pip_install(extra: str) -> str:
    """Returns the command that installs what an extra of jaxball needs: from the folder that jaxball came from, if it
    did.
    """
    import importlib.metadata  # here, because it is for mistakes alone
    import json

    text = importlib.metadata.distribution("jaxball").read_text("direct_url.json")
    folder = json.loads(text or "{}").get("dir_info")
    if folder is None:
        return f"pip install 'jaxball[{extra}]'"
    return f"pip install {'-e ' if folder.get('editable') else ''}'.[{extra}]' in jaxball's folder"
