"""Files with something wrong in them: what a hand, or another program, may do to a document."""

import copy
import datetime
import math
from typing import Any

import numpy as np
import tomli_w

STRANGE: tuple[Any, ...] = (
    True,
    False,
    0,
    1,
    -1,
    3,
    2.5,
    -0.0,
    1e300,
    -1e300,
    1e-300,
    5e-324,
    math.nan,
    math.inf,
    -math.inf,
    2**63,
    10**30,
    10**400,
    "",
    "text",
    "1.0",
    "kind",
    "disk",
    "initial.Omega[0]",
    "masses[0",
    "\0\n\t\\\"'",
    "Ω₁",
    [],
    [[]],
    [1.0],
    [1.0, 2.0],
    [1, 2, 3],
    [0.0, 0.0, 0.0, 0.0],
    [-1.0, 0.0, 1e200],
    [[1.0], [1.0, 2.0]],
    [[1e300, 0.0, 0.0], [0.0, 1e300, 0.0]],
    [math.nan, math.nan, math.nan],
    ["text"],
    [True],
    [{}],
    {},
    {"kind": "circle"},
    {"a": {"b": [1, {"c": 2}]}},
    datetime.date(2018, 1, 1),
    datetime.time(12, 0),
)
FACTORS = (-1.0, 0.0, 2.0, 1e-9, 1e9, 1e-160, 1e160, 1e300)


def mutated(document: dict[str, Any], random: np.random.Generator) -> str:
    """The text of the document with one thing changed in it, or two or three."""
    changed = copy.deepcopy(document)
    for _ in range(random.choice([1, 1, 1, 2, 3])):
        _change(changed, random)
    text = tomli_w.dumps(changed)
    return _in_text(text, random) if random.uniform() < 0.1 else text


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Every place in a document that has a value: the table or list, and the key or index in it."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [(value, key) for key, _ in inside] + [place for _, item in inside for place in _places(item)]


def _change(document: dict[str, Any], random: np.random.Generator) -> None:
    places = _places(document)
    if not places:
        return
    holder, key = places[random.integers(len(places))]
    _CHANGES[random.integers(len(_CHANGES))](holder, key, places, random)


def _replace(holder: Any, key: Any, places: Any, random: np.random.Generator) -> None:
    holder[key] = copy.deepcopy(STRANGE[random.integers(len(STRANGE))])


def _scale(holder: Any, key: Any, places: Any, random: np.random.Generator) -> None:
    """A number, or the first of a list, made much larger or smaller."""
    value, factor = holder[key], FACTORS[random.integers(len(FACTORS))]
    if isinstance(value, float):
        holder[key] = value * factor
    elif isinstance(value, int) and not isinstance(value, bool):
        holder[key] = value * int(factor)
    elif isinstance(value, list) and value:
        _scale(value, 0, places, random)


def _remove(holder: Any, key: Any, places: Any, random: np.random.Generator) -> None:
    del holder[key]


def _rename(holder: Any, key: Any, places: Any, random: np.random.Generator) -> None:
    if isinstance(holder, dict):
        holder[_other_name(key, random)] = holder.pop(key)


def _double(holder: Any, key: Any, places: Any, random: np.random.Generator) -> None:
    """A key once more under another name, or an item of a list once more."""
    again = copy.deepcopy(holder[key])
    if isinstance(holder, dict):
        holder[_other_name(key, random)] = again
    else:
        holder.append(again)


def _transplant(holder: Any, key: Any, places: Any, random: np.random.Generator) -> None:
    """A value from another place."""
    other, its_key = places[random.integers(len(places))]
    holder[key] = copy.deepcopy(other[its_key])


def _take_out(holder: Any, key: Any, places: Any, random: np.random.Generator) -> None:
    """A table or a list replaced by one of its values."""
    inside = holder[key]
    values = list(inside.values()) if isinstance(inside, dict) else inside if isinstance(inside, list) else []
    if values:
        holder[key] = values[random.integers(len(values))]


def _wrap(holder: Any, key: Any, places: Any, random: np.random.Generator) -> None:
    holder[key] = [holder[key]] if random.uniform() < 0.5 else {"value": holder[key]}


def _turn_round(holder: Any, key: Any, places: Any, random: np.random.Generator) -> None:
    if isinstance(holder[key], list):
        holder[key].reverse()


_CHANGES = (
    _replace,
    _replace,
    _replace,
    _scale,
    _scale,
    _remove,
    _rename,
    _double,
    _transplant,
    _take_out,
    _wrap,
    _turn_round,
)


def _other_name(name: str, random: np.random.Generator) -> str:
    names = (name + "s", name[:-1], name.upper(), "", "kind", "radius", "a b.c", "Ω", f"{name}`")
    return names[random.integers(len(names))]


def _in_text(text: str, random: np.random.Generator) -> str:
    """A line lost or doubled, the end lost, or a character put in."""
    lines, at = text.splitlines(), int(random.integers(len(text) + 1))
    line = int(random.integers(len(lines))) if lines else 0
    forms = (
        "\n".join(lines[:line] + lines[line + 1 :]),
        "\n".join(lines[: line + 1] + lines[line:]),
        text[:at],
        text[:at] + "[={\"\x01'#,."[random.integers(9)] + text[at:],
    )
    return forms[random.integers(len(forms))]
