"""Sentences in the source can be understood without being read twice."""

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
