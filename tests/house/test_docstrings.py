"""The examples in docstrings run, and print what they say."""

import ast
import doctest
import importlib
import operator

import pytest

from tests.house.test_interface import SOURCE


def with_examples(node, path=()):
    """The paths of the classes, functions and methods below a node whose docstring has an example."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ClassDef | ast.FunctionDef):
            here = (*path, child.name)
            if ">>>" in (ast.get_docstring(child) or ""):
                yield ".".join(here)
            yield from with_examples(child, here)


EXAMPLES = {  # by module and path
    f"{'.'.join(('jaxball', *path.relative_to(SOURCE).with_suffix('').parts))}:{name}"
    for path in SOURCE.rglob("*.py")
    for name in with_examples(ast.parse(path.read_text()))
}


@pytest.mark.thorough
@pytest.mark.parametrize("example", sorted(EXAMPLES))
def test_example_prints_what_it_says(example, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module, name = example.split(":")
    found = operator.attrgetter(name)(importlib.import_module(module))
    (test,) = doctest.DocTestFinder(recurse=False).find(found, name, globs={})
    report = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS, verbose=False)
    assert runner.run(test, out=report.append).failed == 0, "".join(report)
    assert test.examples[-1].want, f"the example of {name} ends without showing anything"
