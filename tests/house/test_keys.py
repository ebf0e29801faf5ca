"""docs/reference/keys.md names every key that a file may have, with its value, unit and default, which readers know.

``python -m tests.house.test_keys`` fills in these three columns; what keys mean is written there by hand.
"""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from jaxball.design.files import CONTROL_KEYS, SEARCH_KEYS
from jaxball.numerics.declare import Dimension
from jaxball.scenario import ScenarioError, read_scenario, table
from jaxball.scenario.dimensions import dimension_words
from jaxball.scenario.files import CLASSICAL_KEYS, KEYS, RESISTED_KEYS
from jaxball.scenario.table import REQUIRED, Key
from jaxball.scenario.values import Flag, Nested, Numbers
from jaxball.sweep.study import KEYS as STUDY
from tests.support import corpus

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "keys.md"
Found = dict[tuple[str, str, str], str]


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


def sections() -> list[str]:
    return re.split(r"^### ", PAGE.read_text(), flags=re.MULTILINE)[1:]


def page() -> Found:
    """The default that the page says of each key: by the path of its table, its kind or the like, and its name."""
    found: Found = {}
    for section in sections():
        title, *lines = section.splitlines()
        rows = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines if line.startswith("|")]
        for path in re.findall(r"`([^`]+)`", title):
            for row in rows[2:]:
                cells = dict(zip([*rows[0][:-1], "meaning"], row, strict=True))
                for choice in _choices(path, cells.get("of", "")):
                    entry = (path, choice, cells["key"].strip("`"))
                    assert entry not in found, entry
                    found[entry] = cells["default"]
    return found


def _choices(path: str, cell: str) -> list[str]:
    known = readers()[path]
    return [cell] if cell in known else cell.split(", ") if cell else list(known)


def entries() -> dict[tuple[str, str, str], Key]:
    return {
        (path, choice, name): key
        for path, tables in readers().items()
        for choice, keys in tables.items()
        for name, key in keys.items()
    }


def test_every_key_is_on_the_page_and_no_other():
    assert set(page()) == set(entries())


def test_every_kind_is_on_the_page():
    said: dict[str, str] = {}
    for section in sections():
        for path in re.findall(r"`([^`]+)`", section.splitlines()[0]):
            said[path] = said.get(path, "") + section
    for path, choice, _ in entries():
        assert path.count(".") == 0 or re.search(rf"(?<![\w-]){choice}(?![\w-])", said[path]), (path, choice)


def test_cells_are_those_of_the_readers():
    assert PAGE.read_text() == filled(PAGE.read_text())


def filled(text: str) -> str:
    """Fills in what readers know: the value, unit and default of numbers and flags, and which keys are required.

    A cell may go on after it with a comma, where there is more to say.
    """
    lines, paths, head = [], [], []
    for line in text.splitlines():
        if line.startswith("### "):
            paths, head = re.findall(r"`([^`]+)`", line), []
        row = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] if line.startswith("|") else []
        if row and not head:
            head = [*row[:-1], "meaning"]
        elif row and paths and not row[0].startswith("---"):
            cells = dict(zip(head, row, strict=True))
            keys = [
                readers()[paths[0]][choice][cells["key"].strip("`")]
                for choice in _choices(paths[0], cells.get("of", ""))
            ]
            known = _cells(keys[0])
            if len({tuple(_cells(key).items()) for key in keys}) == 1:
                cells |= {name: cell for name, cell in known.items() if not _goes_on(cells[name], cell)}
            line = f"| {' | '.join(cells.values())} |".replace("|  |", "| |").replace("|  |", "| |")
        lines.append(line)
    return "\n".join(lines) + "\n"


def _goes_on(written: str, cell: str) -> bool:
    return written == cell or written.startswith((f"{cell}, ", f"{cell}; ", "that of "))


def _cells(key: Key) -> dict[str, str]:
    """What a reader says of a key, by the columns of the page."""
    kind, cells = key.kind, {}
    if isinstance(kind, Flag):
        cells["value"] = "true or false"
    if isinstance(kind, Numbers):
        words = kind.rule._replace(phrase="").words(kind.shape)
        cells["value"] = re.sub(r"^a (list of )?|finite | of radians|, because.*", "", words).replace(" -", " −")
        if kind.dimension is not None:
            cells["unit"] = _unit(kind.dimension)
    if key.default is REQUIRED:
        cells["default"] = "required"
    elif key.default is not None and np.size(key.default) > 0 and key.default != "":
        cells["default"] = _written(key.default)
    return cells


def _unit(dimension: Dimension) -> str:
    above, *below = dimension_words(dimension).split("/")
    below += ["rad"] * (dimension.coordinate < 0 and not dimension.mass)
    under = f"/({' '.join(below)})" if below[1:] else "".join(f"/{unit}" for unit in below)
    return re.sub(r"\^(\d)", lambda power: "⁰¹²³⁴"[int(power[1])], (above + under).replace("*", " "))


def _written(default):
    if isinstance(default, bool):
        return "true" if default else "false"
    return (
        f'"{default}"' if isinstance(default, str) else repr(list(default) if isinstance(default, tuple) else default)
    )


@pytest.fixture
def known(monkeypatch):
    """Which keys readers take for known, by the path of a table."""
    found, refuse = {}, table.refuse_unknown

    def noted(values, path, known, *elsewhere):
        known = set(known)
        found.setdefault(_plain(path), set()).update(known)
        refuse(values, path, known, *elsewhere)

    monkeypatch.setattr(table, "refuse_unknown", noted)
    monkeypatch.setattr("jaxball.scenario.files.check_confinement", lambda system, times, state: None)
    return found


def _plain(path):
    """Without the places in lists, the names of sensors and of events, and with the axes of a zip as a study's."""
    path = re.sub(r"^(sensors|events)\.\w+", r"\1", re.sub(r"\[\d+\]", "", path))
    return path.replace("axes.zip", "axes").partition('."')[0]


@pytest.mark.thorough
def test_readers_take_no_other_keys_than_they_tell(known):
    """What they take while they read documents of every kind, but for `kind` and `form`, which choose."""
    for document in corpus.with_everything():
        corpus.read_any(document)
    with pytest.raises(ScenarioError, match="must not be combined with `theta`"):
        read_scenario(corpus.EVERY_MOTION.replace("[time]", "balance = { masses = [1] }\n[time]"))
    told = {}
    for path, _, name in entries():
        told.setdefault(path.partition(".")[2], set()).add(name)
    del known["control.first_weights"]  # whose keys are the objectives that there are
    assert known.keys() == told.keys()
    for path, keys in known.items():
        assert keys - {"kind", "form"} <= told[path], path


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text()))
