"""The public interface is that of ``public_interface.txt``, which a change of it has to change.

``python -m tests.house.test_public_interface`` writes the file anew.
"""

import difflib
import enum
import inspect
from pathlib import Path

import jaxball
from jaxball.interface.names import public_packages

FILE = Path(__file__).with_name("public_interface.txt")


def entry(path, thing):
    """A name, with the names of its arguments and a mark for those that are given by name alone."""
    if not callable(thing) or (inspect.isclass(thing) and issubclass(thing, BaseException | enum.Enum)):
        return path
    try:
        parameters = inspect.signature(thing).parameters.values()
    except ValueError:
        return path
    marks = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}
    names, by_name = [], False
    for parameter in parameters:
        if parameter.kind is inspect.Parameter.VAR_POSITIONAL:
            by_name = True
        elif parameter.kind is inspect.Parameter.KEYWORD_ONLY and not by_name:
            names.append("*")
            by_name = True
        names.append(marks.get(parameter.kind, "") + parameter.name)
    return f"{path}({', '.join(names)})"


def interface():
    """A line for each public name, by its package."""
    lines = []
    for package in public_packages(jaxball):
        lines += [entry(f"{package.__name__}.{name}", getattr(package, name)) for name in sorted(package.__all__)]
    return lines


def test_the_interface_is_the_one_that_is_written_down():
    written, known = FILE.read_text().splitlines(), interface()
    change = list(difflib.unified_diff(written, known, "written", "imported", n=0, lineterm=""))
    assert not change, "\n".join(["The public interface has changed:", *change])


if __name__ == "__main__":
    FILE.write_text("\n".join(interface()) + "\n")
