"""What files may have: every key of every table, and what it means, in its declaration or the docstring of its class.

From it are made the page of keys (``tests.house.test_keys``) and the descriptions in JSON Schemas
(``tests.support.schema``).
"""

import functools
import inspect
import re
import sys
from collections.abc import Mapping

import numpy as np

import jaxball
from jaxball.files.scenario.files import CLASSICAL_KEYS, KEYS, RESISTED_KEYS
from jaxball.files.scenario.table import REQUIRED, Key
from jaxball.files.scenario.units import dimension_words
from jaxball.files.scenario.values import Integer, Kind, Nested, Numbers
from jaxball.numerics.declare import Dimension
from jaxball.studies.design.files import CONTROL_KEYS, SEARCH_KEYS
from jaxball.studies.sweep.study import KEYS as STUDY

MOST_SAID = 10**6  # no limit beyond this one is told
RULES = "0 or positive|positive|1 or more|increasing|from 0 to 1"  # which the value of a key says


@functools.cache
def readers() -> dict[str, dict[str, Mapping[str, Key]]]:
    """The keys of every table by its path, and by what decides which of them it has."""
    found: dict[str, dict[str, Mapping[str, Key]]] = {}

    def visit(path: str, choice: str, keys: Mapping[str, Key]) -> None:
        found.setdefault(path, {})[choice] = keys
        for name, key in keys.items():
            for inner, its_keys in key.kind.tables.items() if isinstance(key.kind, Nested) else ():
                visit(f"{path}.{name}", inner, its_keys)

    visit("scenario", "ball, disk, convex-body", KEYS)
    visit("scenario", "classical", CLASSICAL_KEYS)
    visit("scenario", "rolling-ellipsoid", RESISTED_KEYS)
    visit("study", "", STUDY)
    visit("problem", "search", SEARCH_KEYS)
    visit("problem", "control", CONTROL_KEYS)
    return found


def entries() -> dict[tuple[str, str, str], Key]:
    """Every key by the path of its table, what decides that the table has it, and its name."""
    return {
        (path, choice, name): key
        for path, tables in readers().items()
        for choice, keys in tables.items()
        for name, key in keys.items()
    }


def meaning(key: Key) -> str:
    """What a key means; empty where nothing says so."""
    if isinstance(key.says, str):
        return key.says
    words = _of_file(_line_of(*key.says), unit(key.kind))
    if default(key):
        words = re.sub("; [^;]+ if not given", "", words)
    return words if value(key.kind) == "number" else re.sub(rf", ({RULES})(?=[,;]|$)", "", words)


def summary(kind: type) -> str:
    """The first line of the docstring of a class, without where the paper has it and without a shape."""
    line = _plain(inspect.cleandoc(kind.__doc__ or "").partition("\n")[0])
    return re.sub(r", `(eq|EP)_\w+`| \(section [\d.]+\)|, as in sections [\w ]+|; shape \([^)]*\)", "", line)


_LINE = re.compile(r"^- ((?:``[\w-]+``(?:,\s+|\s+and\s+)?)+): (.*(?:\n  .*)*)", re.MULTILINE)
_ELSEWHERE = re.compile(r"as for (?:an? )?:class:`(?:~jaxball\.(?:\w+\.)*)?(\w+)`")


def _line_of(kind: type, argument: str) -> str:
    """What the docstring of a class, or of the nearest above it that does, says of an argument, or where it says so."""
    name = argument.rpartition(".")[2]
    for each in kind.__mro__:
        for names, text in _LINE.findall(inspect.cleandoc(vars(each).get("__doc__") or "")):
            if f"``{name}``" in names:
                other = _ELSEWHERE.match(text)
                return _line_of(_class_named(other[1], each), argument) if other else " ".join(text.split())
    return ""


def _class_named(name: str, near: type) -> type:
    return getattr(sys.modules[near.__module__], name, None) or getattr(jaxball, name)


def _of_file(line: str, its_unit: str) -> str:
    """The first sentence of a line, without the shape and the unit, which the other columns have."""
    sentence = re.split(r"\.(?= [A-ZΓ:`(]|$)", line)[0]
    shapeless = re.sub(r"(^|, )shape \([^)]*\)(, and \([^)]*\) for [\w ]+|, or \([^)]*\) for [\w ]+)?", "", sentence)
    named = {"mass": "in units of mass", "time": "a time", "length": "a length"}
    units = "|".join(map(re.escape, filter(None, [its_unit, named.get(its_unit), "dimensionless"])))
    return _plain(re.sub(rf"(^|, )({units})(?=[,;]|$)", "", shapeless)).lstrip(",; ")


def _plain(text: str) -> str:
    """Without what only Sphinx reads."""
    return re.sub(r":\w+:`~?(?:[\w.]*\.)?(\w+)`", r"`\1`", text).replace("``", "`")


def value(kind: Kind) -> str:
    """What a value of this kind is."""
    if isinstance(kind, Numbers):
        words = kind.rule._replace(phrase="").words(kind.shape)
    elif isinstance(kind, Integer) and kind.most > MOST_SAID:
        words = f"whole number from {kind.least} on"
    else:
        words = kind.words
    if isinstance(kind, Nested) and "table" not in words:
        words += ", or a table"
    plain = r"^(an?|the) (list of )?|\bfinite | of radians|, because.*|^a function that can be imported, as "
    return re.sub(plain, "", words).replace(" -", " −")


def unit(kind: Kind) -> str:
    """The unit of numbers; empty where it is not declared."""
    return _unit(kind.dimension) if isinstance(kind, Numbers) and kind.dimension is not None else ""


def _unit(dimension: Dimension) -> str:
    above, *below = dimension_words(dimension).split("/")
    below += ["rad"] * (dimension.coordinate < 0 and not dimension.mass)
    under = f"/({' '.join(below)})" if below[1:] else "".join(f"/{unit}" for unit in below)
    return re.sub(r"\^(\d)", lambda power: "⁰¹²³⁴"[int(power[1])], (above + under).replace("*", " "))


def default(key: Key) -> str:
    """The default of a key in words; empty where leaving it out has no value."""
    if key.default is REQUIRED:
        return "required"
    if key.default is None or not np.size(key.default) or key.default == "":
        return ""
    if isinstance(key.default, bool):
        return "true" if key.default else "false"
    if isinstance(key.default, str):
        return f'"{key.default}"'
    return repr(list(key.default) if isinstance(key.default, tuple) else key.default)
