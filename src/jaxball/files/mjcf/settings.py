"""Reads what <compiler> and <option> say of a whole file: angles, inertias, limits, gravity, and what is disabled."""

import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .elements import Angles, Inertias, MJCFError, label, numbers

SWITCHES = ("enable", "disable")
AXES = set("xyzXYZ")


class Settings(NamedTuple):
    """What holds for a whole file.

    - ``inertias``: how it gives inertias, and angles.
    - ``autolimits``: whether a range is a limit without a word that says so.
    - ``gravity``: the acceleration.
    - ``disabled``: the flags of ``<option>`` that are disabled.
    - ``idle_groups``: the groups of actuators that exert no force.
    - ``alignfree``: whether a free body without bodies in it moves in its principal axes.
    """

    inertias: Inertias
    autolimits: bool
    gravity: Float[np.ndarray, "3"]
    disabled: frozenset[str]
    idle_groups: frozenset[int]
    alignfree: bool

    @property
    def angles(self) -> Angles:
        return self.inertias.angles

    def limits(self, element: ET.Element, what: str) -> tuple[float, float] | None:
        """Reads the limits of an element: of its control (``ctrl``), its force, or of a joint (an empty ``what``).

        None where it has none, or does not keep to them.

        **Raises:** :class:`MJCFError` for a range that is none, and where the file does not say whether it is a limit.
        """
        text = element.get(f"{what}range")
        word = word_of(element, f"{what}limited", ("auto", "true", "false"))
        if word == "false" or (text is None and word == "auto"):
            return None
        low, high = numbers(element, f"{what}range", count=2)
        if word == "auto" and not self.autolimits:
            raise MJCFError(
                f"Element {label(element)} must have `{what}limited` beside `{what}range`, because the file has "
                "`autolimits` false, but it is missing."
            )
        if low < high:
            return float(low), float(high)
        # As in MuJoCo, where "0 0" says that there is no limit.
        if word == "auto":
            return None
        raise MJCFError(f'Attribute `{what}range` of {label(element)} must increase, but it is "{text}".')


def read_settings(root: ET.Element) -> Settings:
    """Reads the settings of a file; what a later element states replaces what an earlier one does.

    **Raises:** :class:`MJCFError` for words that are none of MuJoCo's.
    """
    angle, sequence, from_geoms, autolimits, alignfree = "degree", "xyz", "auto", "true", "false"
    for compiler in root.findall("compiler"):
        from_geoms = word_of(compiler, "inertiafromgeom", ("auto", "true", "false"), from_geoms)
        angle = word_of(compiler, "angle", ("degree", "radian"), angle)
        autolimits = word_of(compiler, "autolimits", ("true", "false"), autolimits)
        alignfree = word_of(compiler, "alignfree", ("true", "false"), alignfree)
        sequence = compiler.get("eulerseq", sequence)
        if len(sequence) != 3 or not set(sequence) <= AXES:
            raise MJCFError(
                "Attribute `eulerseq` of <compiler> must be three of the letters x, y, z, in capitals for fixed axes, "
                f'but it is "{sequence}".'
            )
    gravity, flags, idle_groups = np.array([0.0, 0.0, -9.81]), dict[str, str](), frozenset[int]()
    for option in root.findall("option"):
        gravity = numbers(option, "gravity", gravity)
        groups = option.get("actuatorgroupdisable")
        idle_groups = idle_groups if groups is None else frozenset(map(int, numbers(option, "actuatorgroupdisable")))
        for element in option.findall("flag"):
            flags |= {name: word_of(element, name, SWITCHES) for name in element.attrib}
    disabled = frozenset(name for name, word in flags.items() if word == "disable")
    if "gravity" in disabled:
        gravity = np.zeros(3)
    unit = 1.0 if angle == "radian" else np.pi / 180
    inertias = Inertias(Angles(unit, sequence), from_geoms)
    return Settings(inertias, autolimits == "true", gravity, disabled, idle_groups, alignfree == "true")


def word_of(element: ET.Element, name: str, words: tuple[str, ...], default: str | None = None) -> str:
    """Reads an attribute that is one of some words; the first of them, unless a default is given, where it is missing.

    **Raises:** :class:`MJCFError` for another word.
    """
    word = element.get(name, words[0] if default is None else default)
    if word not in words:
        listed = ", ".join(f'"{choice}"' for choice in words)
        raise MJCFError(f'Attribute `{name}` of {label(element)} must be one of {listed}, but it is "{word}".')
    return word
