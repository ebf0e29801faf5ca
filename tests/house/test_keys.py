"""docs/reference/keys.md names every key that a file may have, with its default: held against the readers."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from jaxball.design.files import CONTROL_KEYS, SEARCH_KEYS
from jaxball.scenario import ScenarioError, read_scenario, table
from jaxball.scenario.files import CLASSICAL_KEYS, KEYS, RESISTED_KEYS
from jaxball.scenario.table import REQUIRED, Key
from jaxball.scenario.values import Nested
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


def test_every_default_is_on_the_page():
    said = page()
    for entry, key in entries().items():
        assert (said[entry] == "required") == (key.default is REQUIRED), entry
        if key.default is not REQUIRED and key.default is not None and np.size(key.default) > 0 and key.default != "":
            assert said[entry] == _written(key.default), entry


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
