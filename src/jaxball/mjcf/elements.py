"""Elements of XML and the numbers in their attributes."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ..interface.wording import UserError

LEAST = 1e-15  # MuJoCo's mjMINVAL: the mass and the moments that it requires of a link that moves


class MJCFError(UserError):
    """A robot cannot be written as MJCF, or read from it; the message is one sentence that names the part."""


def text_of(*values: Any) -> str:
    """Numbers as the text of an attribute, with every digit."""
    flat = np.concatenate([np.ravel(np.asarray(value, dtype=float)) for value in values])
    return " ".join(repr(float(x) + 0.0).removesuffix(".0") for x in flat)


def add(parent: ET.Element, tag: str, **attributes: Any) -> ET.Element:
    """A new element in ``parent``; numbers become text, and attributes that are None are left out."""
    given = {name: value for name, value in attributes.items() if value is not None}
    texts = {name: value if isinstance(value, str) else text_of(value) for name, value in given.items()}
    return ET.SubElement(parent, tag, texts)


def called(element: ET.Element) -> str:
    """What sentences call an element: its tag and its name."""
    name = element.get("name")
    return f"<{element.tag}>" if name is None else f'<{element.tag} name="{name}">'


def numbers(
    element: ET.Element,
    name: str,
    default: Sequence[float] | Float[np.ndarray, " n"] | None = None,
    count: int | None = None,
) -> Float[np.ndarray, " n"]:
    """The numbers of an attribute: ``count`` of them, as many as the ``default`` has if that is given and not None.

    **Raises:** :class:`MJCFError` where they are missing without a default, or something else.
    """
    text = element.get(name)
    count = len(default) if count is None and default is not None else count
    must = f"{count} numbers" if count != 1 else "a number"
    if text is None:
        if default is None:
            raise MJCFError(f"Element {called(element)} must have `{name}`, {must}, but it is missing.")
        return np.asarray(default, dtype=float)
    try:
        values = np.asarray([float(word) for word in text.split()])
    except ValueError:
        values = np.asarray([np.nan])
    if not np.isfinite(values).all() or (count is not None and len(values) != count):
        raise MJCFError(f'Attribute `{name}` of {called(element)} must be {must}, but it is "{text}".')
    return values


def number(element: ET.Element, name: str, default: float | None = None) -> float:
    """The number of an attribute; raises as :func:`numbers`."""
    return float(numbers(element, name, None if default is None else (default,), 1)[0])


def refuse_others(element: ET.Element, known: Iterable[str], why: str) -> None:
    """Raises a :class:`MJCFError` for the first element in ``element`` whose tag is not ``known``."""
    known = tuple(known)
    for child in element:
        if child.tag not in known:
            accepted = ", ".join(f"<{tag}>" for tag in known)
            raise MJCFError(
                f"Element {called(child)} in {called(element)} must be left out, because {why}; accepted there are "
                f"{accepted}."
            )


def refuse_values(element: ET.Element, names: Iterable[str], why: str) -> None:
    """Raises a :class:`MJCFError` for the first of these attributes that has a number other than 0."""
    for name in names:
        if element.get(name) is not None and np.any(numbers(element, name) != 0):
            raise MJCFError(
                f"Attribute `{name}` of {called(element)} must be 0 or left out, because {why}, but it is "
                f'"{element.get(name)}".'
            )
