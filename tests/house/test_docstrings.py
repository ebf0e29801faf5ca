"""The examples in the docstrings of public names run, and print what they say."""

import ast
import doctest
import inspect

import pytest

import jaxball
from tests.house.test_interface import SOURCE, everything, public

FIRST_NAMES = {id(found): name for name, found in reversed(list(everything()))}
EXAMPLES = {
    FIRST_NAMES[id(found)]: found
    for _, found in everything()
    if (inspect.isclass(found) or inspect.isfunction(found)) and ">>>" in (found.__doc__ or "")
}
# Why a name of `jaxball` has no example of its own. Of the contracts, docs/how-to/extending.md has one each.
WITHOUT = {
    "Occurrences": "the example of `Event` prints them",
    "ContactHistory": "that of a run is what `simulate` gives, whose example shows it",
    "Switches": "the example of `simulate` prints them",
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", EXAMPLES)
def test_example_prints_what_it_says(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (test,) = doctest.DocTestFinder(recurse=False).find(EXAMPLES[name], name, globs={})
    report = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS, verbose=False)
    assert runner.run(test, out=report.append).failed == 0, "".join(report)
    assert test.examples[-1].want, f"the example of {name} ends without showing anything"


def test_every_example_of_the_source_is_run():
    written = [
        node.name
        for path in SOURCE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and ">>>" in (ast.get_docstring(node) or "")
    ]
    assert sorted(written) == sorted(found.__name__ for found in EXAMPLES.values())


def test_every_name_of_jaxball_has_an_example_or_a_reason():
    """But for exceptions: what raises them says so."""
    names = {name.removeprefix("jaxball.") for name, _ in public() if name.removeprefix("jaxball.") in jaxball.__all__}
    shown = {name.removeprefix("jaxball.") for name in EXAMPLES}
    contracts = {name for name in names if name.startswith("Abstract")}
    assert names - shown == contracts | set(WITHOUT)


def test_examples_stand_at_the_end():
    """So that `help()` says first what a thing is."""
    for name, found in EXAMPLES.items():
        head, title, example = inspect.getdoc(found).partition("**Example:**\n\n")
        assert title, name
        assert ">>>" not in head, name
        assert "\n\n" not in example.strip(), name
