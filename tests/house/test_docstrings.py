"""The examples in the docstrings of public names run, and print what they say."""

import ast
import doctest
import inspect

import pytest

from tests.house.test_interface import SOURCE, everything

FIRST_NAMES = {id(found): name for name, found in reversed(list(everything()))}
EXAMPLES = {
    FIRST_NAMES[id(found)]: found
    for _, found in everything()
    if (inspect.isclass(found) or inspect.isfunction(found)) and ">>>" in (found.__doc__ or "")
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
