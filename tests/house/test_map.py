"""The walks of the page for newcomers: each function is entered, in the order in which the page names them."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "project" / "map.md"
STEP = re.compile(r"^\d+\. `(?P<file>[\w/]+\.py)` `(?P<function>[\w.]+)`", re.MULTILINE)

# Runs a program, and prints which of the given functions of jaxball it enters, each time that it enters one.
RECORDER = """
import json, pathlib, sys
import jaxball
root = str(pathlib.Path(jaxball.__file__).parent) + "/"
steps, entered = set(map(tuple, json.loads(sys.argv[1]))), []
def note(frame, event, _):
    code = frame.f_code
    if event == "call" and code.co_filename.startswith(root):
        place = code.co_filename.removeprefix(root), code.co_qualname.replace("<locals>.", "")
        if place in steps:
            entered.append(place)
program = compile(sys.stdin.read(), "walk", "exec")
sys.setprofile(note)
exec(program, {"__name__": "__main__"})
sys.setprofile(None)
print(json.dumps(entered))
"""


def walks() -> dict[str, tuple[str, list[tuple[str, str]]]]:
    """The program and the steps of each walk, by its heading."""
    found = {}
    for section in PAGE.read_text().split("\n## ")[1:]:
        if steps := [(step["file"], step["function"]) for step in STEP.finditer(section)]:
            (program,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
            found[section.splitlines()[0]] = program, steps
    return found


def test_the_page_has_two_walks():
    assert len(walks()) == 2


@pytest.mark.thorough
@pytest.mark.parametrize("walk", walks())
def test_a_walk_enters_the_functions_that_the_page_names_in_this_order(walk, tmp_path):
    program, steps = walks()[walk]
    command = [sys.executable, "-c", RECORDER, json.dumps(steps)]
    done = subprocess.run(command, input=program, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    following = iter(json.loads(done.stdout.splitlines()[-1]))
    assert [step for step in steps if list(step) not in following] == []  # each is looked for after the one before it
