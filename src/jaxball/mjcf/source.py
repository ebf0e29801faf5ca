"""Reads the XML of a robot's file, of MuJoCo or of ROS, from its path or its text."""

import os
import xml.etree.ElementTree as ET
from pathlib import Path

from ..interface.arguments import refusal
from ..interface.wording import UserError
from .elements import label

Source = str | os.PathLike[str]


def read_xml(source: Source, kind: str, tag: str, error: type[UserError]) -> ET.Element:
    """Reads the root of an XML file, from its path or its text, which has a ``<`` in it.

    - ``kind``: what the file is, such as "an MJCF file".
    - ``tag``: that its root must have.

    **Raises:** ``error`` where there is no such file, and for a text that is no XML, that declares entities, or that
    has another root.
    """
    text = _text_of(source, kind, error)
    # A short file of nested entities can grow to gigabytes while it is parsed.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise error("The file must have no document type and no entities, but it declares some; leave them out.")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, ValueError) as cause:
        raise error(f"The file must be XML, but it is not: {cause}.") from None
    if root.tag != tag:
        raise error(f"The file must have <{tag}> as its root, but it has {label(root)}.")
    return root


def _text_of(source: Source, kind: str, error: type[UserError]) -> str:
    must = f"the path of {kind}, or its text"
    if not isinstance(source, str | os.PathLike):
        raise refusal("source", must, source)
    # No path of a robot has this letter, and every XML file does.
    if isinstance(source, str) and ("<" in source or "\n" in source):
        return source.removeprefix("\ufeff")
    try:
        return Path(source).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as cause:
        reason = cause.strerror if isinstance(cause, OSError) else "it is not UTF-8 text"
        raise error(f'Argument `source` must be {must}, but it is "{source}" ({reason}).') from None
