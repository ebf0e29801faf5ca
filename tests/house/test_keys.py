"""docs/reference/keys.md has every key that a file may have, with its value, unit and default, and what it means.

Headings, the paths of tables below each and a few words stand there by hand; ``python -m tests.house.test_keys`` writes
the rest.
"""

import re
from collections.abc import Iterable
from pathlib import Path

import pytest

from jaxball import ScenarioError, read_scenario
from jaxball.files.scenario import table
from tests.support import corpus
from tests.support.keys import default, entries, meaning, readers, summary, unit, value
from tests.support.sentences import refuses

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "keys.md"
HEAD = ("of", "key", "value", "unit", "default", "")


def written(text: str) -> str:
    """The page, with the tables of every section."""
    first, *files = re.split(r"^(?=## )", text, flags=re.MULTILINE)
    return first + "".join(map(_file, files))


def _file(text: str) -> str:
    """The part of the page on one kind of file."""
    first, *sections = re.split(r"^(?=### )", text, flags=re.MULTILINE)
    file = first.split()[1].lower()
    return first + "".join(_section(section, file) for section in sections)


def _section(text: str, file: str) -> str:
    by_hand = text.partition("\n|")[0].strip()
    paths = paths_of(by_hand, file)
    return "\n\n".join([by_hand, *filter(None, [_kinds(paths), _keys(paths)])]) + "\n\n"


def paths_of(section: str, file: str) -> list[str]:
    """The paths of the tables that a section is about, from the line below its heading; the file itself if none."""
    second = [line for line in section.splitlines() if line][1:2]
    named = re.fullmatch(r"(`[^`]+`(, )?)+", second[0]) if second else None
    return [f"{file}.{path}" for path in re.findall("`([^`]+)`", named[0])] if named else [file]


def _choices(paths: list[str]) -> list[str]:
    """What the tables at these paths have in common, and no table elsewhere: kinds, or single keys that decide."""
    tables = readers()

    def everywhere(choice: str) -> list[str]:
        like = tables[paths[0]][choice]
        return [path for path, choices in tables.items() if choice in choices and _same(choices[choice], like)]

    return [choice for choice in tables[paths[0]] if sorted(everywhere(choice)) == sorted(paths)]


def _same(keys, others) -> bool:
    return keys.keys() == others.keys() and all(keys[name] is others[name] for name in keys)


def _rows(paths: list[str]) -> dict[tuple[str, ...], list[str]]:
    """The cells of each key, and the choices that have it."""
    rows: dict[tuple[str, ...], list[str]] = {}
    for choice in _choices(paths):
        for name, key in readers()[paths[0]][choice].items():
            cells = (f"`{name}`", value(key.kind), unit(key.kind), default(key), meaning(key))
            rows.setdefault(cells, []).append(choice)
    return rows


def _keys(paths: list[str]) -> str:
    rows, choices = _rows(paths), _choices(paths)
    lines = [
        ("" if of == choices else ", ".join(choice or "otherwise" for choice in of), *cells)
        for cells, of in rows.items()
    ]
    if not any(of for of, *_ in lines):
        return _table([HEAD[1:], *(cells for _, *cells in lines)])
    return _table([HEAD, *lines])


def _kinds(paths: list[str]) -> str:
    """What the class of each kind says that it is."""
    classes = {
        choice: key.says[0]
        for choice in _choices(paths)
        for key in readers()[paths[0]][choice].values()
        if choice and isinstance(key.says, tuple)
    }
    lines = [(f"`{choice}`", summary(kind)) for choice, kind in classes.items()]
    return _table([("kind", ""), *lines]) if len(set(classes.values())) > 1 else ""


def _table(rows: Iterable[Iterable[str]]) -> str:
    head, *lines = (
        "|" + "".join(f" {cell} |" if cell else " |" for cell in (text.replace("|", r"\|") for text in row))
        for row in rows
    )
    return "\n".join([head, "|---" * (len(re.findall(r"(?<!\\)\|", head)) - 1) + "|", *lines])


def test_the_page_is_that_of_the_readers():
    """If not, ``python -m tests.house.test_keys`` writes it again."""
    assert PAGE.read_text() == written(PAGE.read_text())


def test_every_key_is_on_the_page():
    files = re.split(r"^## ", PAGE.read_text(), flags=re.MULTILINE)[1:]
    on_page = {
        (path, choice)
        for text in files
        for section in re.split(r"^### ", text, flags=re.MULTILINE)[1:]
        for paths in [paths_of(section, text.split()[0].lower())]
        for path in paths
        for choice in _choices(paths)
    }
    assert on_page == {(path, choice) for path, tables in readers().items() for choice in tables}


def test_every_key_has_a_meaning():
    assert [entry for entry, key in entries().items() if not meaning(key)] == []


def test_units_in_words_are_those_declared():
    """What is left of a unit in the words of a key is not declared, or the docstring says another."""
    said = re.compile(r"(?<=, )(rad|mass|length|time|1/)[\w/ ²³]*(?=[,;]|$)")
    assert [entry for entry, key in entries().items() if unit(key.kind) and said.search(meaning(key))] == []


@pytest.fixture
def known(monkeypatch):
    """Which keys readers take for known, by the path of a table."""
    found, refuse = {}, table.refuse_unknown

    def noted(values, path, known, *elsewhere):
        known = set(known)
        found.setdefault(_plain(path), set()).update(known)
        refuse(values, path, known, *elsewhere)

    monkeypatch.setattr(table, "refuse_unknown", noted)
    monkeypatch.setattr("jaxball.files.scenario.files.check_confinement", lambda system, times, state: None)
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
    with refuses(ScenarioError, "theta"):
        read_scenario(corpus.EVERY_MOTION.replace("[time]", "balance = { masses = [1] }\n[time]"))
    told = {}
    for path, _, name in entries():
        told.setdefault(path.partition(".")[2], set()).add(name)
    del known["control.first_weights"]  # whose keys are the objectives that there are
    assert known.keys() == told.keys()
    for path, keys in known.items():
        assert keys - {"kind", "form"} <= told[path], path


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text()))
