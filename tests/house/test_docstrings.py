"""The examples in the docstrings of public names run, and print what they say."""

import doctest
import inspect

import pytest

import jaxball
from tests.house.test_interface import public

NAMES = dict(public())
EXAMPLES = {name: found for name, found in NAMES.items() if ">>>" in (found.__doc__ or "")}
# Why a name of `jaxball` has no example of its own.
WITHOUT = {
    "an example is a class: docs/extending.md has them": [
        "AbstractEvent",
        "AbstractForce",
        "AbstractFrame",
        "AbstractLaw",
        "AbstractRail",
        "AbstractSchedule",
    ],
    "what `Event` shows": ["Occurrences"],
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_example_prints_what_it_says(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (test,) = doctest.DocTestFinder(recurse=False).find(EXAMPLES[name], name, globs={})
    report = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS, verbose=False)
    assert runner.run(test, out=report.append).failed == 0, "".join(report)
    assert test.examples[-1].want, f"the example of {name} ends without showing anything"


def test_every_name_of_jaxball_has_an_example_or_a_reason():
    """`public` leaves out exceptions and enumerations: what raises or gives them says so."""
    names = {name.removeprefix("jaxball.") for name in NAMES if name.removeprefix("jaxball.") in jaxball.__all__}
    shown = {name.removeprefix("jaxball.") for name in EXAMPLES}
    excused = [name for names in WITHOUT.values() for name in names]
    assert names - shown == set(excused)


def test_examples_stand_at_the_end_and_fit_a_terminal():
    """So that `help()` says first what a thing is, and no line of an example wraps."""
    for name, found in EXAMPLES.items():
        text = inspect.getdoc(found)
        head, title, example = text.partition("**Example:**\n\n")
        assert title, name
        assert ">>>" not in head, name
        assert "\n\n" not in example.strip(), name
        assert max(map(len, text.splitlines())) <= 116, name
