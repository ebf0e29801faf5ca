"""Sentences in the source can be understood without being read twice."""

import ast
import contextlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PLAIN = {
    "as of": "as in, such as, as for",
    "of what": "the thing that is meant",
    "so many": "a number, by the name of the argument",
    "that of which": "two sentences",
}
# Numbers of file formats and flags, which every package has under the same name.
SHARED_NAMES = ("FORMAT", "TYPE_CHECKING")
PATTERN = re.compile(r"\b(" + "|".join(PLAIN) + r")\b", re.IGNORECASE)


@pytest.mark.parametrize(
    "room", sorted(path.name for path in (ROOT / "src/jaxball").iterdir() if path.suffix != ".typed")
)
def test_no_riddles(room):
    """Phrases that leave out what they speak of; each has a plain one beside it above."""
    place = ROOT / "src/jaxball" / room
    files = sorted(place.rglob("*.py")) if place.is_dir() else [place]
    riddles = [
        f"{file.relative_to(ROOT)}:{number}: {match[0]!r}; write {PLAIN[match[0].lower()]}"
        for file in files
        for number, line in enumerate(file.read_text().splitlines(), 1)
        if (match := PATTERN.search(line))
    ]
    assert not riddles, "\n".join(riddles)


def numbers_by_name():
    """The values of all constants that are numbers, by name and by file."""
    values: dict[str, dict[str, float]] = {}
    for file in sorted((ROOT / "src/jaxball").rglob("*.py")):
        for statement in ast.parse(file.read_text()).body:
            if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
                name = statement.targets[0].id
                if name.isupper() and not name.startswith("_"):
                    with contextlib.suppress(ValueError):
                        value = ast.literal_eval(statement.value)
                        if isinstance(value, float | int):
                            values.setdefault(name, {})[str(file.relative_to(ROOT))] = value
    return values


def test_a_constant_is_defined_once():
    """So that its name tells it from all others, wherever it is read."""
    several = {name: files for name, files in numbers_by_name().items() if len(files) > 1 and name not in SHARED_NAMES}
    assert not several
