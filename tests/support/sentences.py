"""Sentences for readers: a test checks their type and what they name, and one file holds them as they are shown.

``tests/sentences.txt`` is there to be read. A sentence that differs from it fails its test, until
``JAXBALL_WRITE_SENTENCES=1 pytest FILE`` has written what the tests that ran have shown.
"""

import contextlib
import os
import re
import tempfile
from functools import cache
from pathlib import Path

import filelock
import pytest

FILE = Path(__file__).parents[1] / "sentences.txt"
WRITES = os.environ.get("JAXBALL_WRITE_SENTENCES", "0") != "0"
COMPARED = os.environ.get("JAXBALL_TESTS_X64", "1") != "0"  # sentences that hold numbers are those of float64
COLLECTED = pytest.StashKey[set[str]]()  # the ids of all tests of the modules that this process has read
ROOT = str(Path(__file__).parents[2])

# What differs from one run or machine to the next, and what stands for it.
_TEMPORARY = re.compile(r"[^\s\"'`]*[/\\]pytest-of-[^/\\]+[/\\]pytest-\d+[/\\](popen-gw\d+[/\\])?[^/\\\s\"'`]+")
_INSTALL = re.compile(r"pip install (-e )?'(jaxball|\.)\[(\w+)\]'( in jaxball's folder)?")  # as jaxball itself was
_ADDRESS, _PIPE = re.compile(r"\b0x[0-9a-f]{6,}"), re.compile(r"/dev/fd/\d+")
_LONG_NUMBER = re.compile(r"(?<![\w.])\d+\.\d{6,}(e[+-]?\d+)?")

_now: "list[str]" = []  # what the test that runs has said so far
_test = ""


@contextlib.contextmanager
def refuses(error, *names):
    """The block must raise ``error`` with the test's next sentence, which names each of ``names``."""
    with pytest.raises(error) as refused:
        yield refused
    said(str(refused.value), *names)


def said(text: str, *names) -> None:
    """Compares ``text`` with the test's next sentence in the file; it must name each of ``names``.

    A name is a whole word, or several: an argument, the path of a key, a file.
    """
    for name in names:
        assert re.search(rf"(?<!\w){re.escape(str(name))}(?!\w)", text), f"{name} is not named in: {text}"
    if shown(text) in _now[-1:]:  # what several functions say alike stands there once
        return
    _now.append(shown(text))
    if WRITES or not COMPARED:
        return
    expected = sentences().get(_test, [])[len(_now) - 1 : len(_now)]
    assert expected == _now[-1:], (
        f"{FILE.name} has another sentence {len(_now)} of this test. Read the new one; if it is right, "
        f"JAXBALL_WRITE_SENTENCES=1 pytest {_test.partition('::')[0]} writes it."
    )


@contextlib.contextmanager
def listened(test: str):
    """The block is the test with the id ``test``: if it passes, all that the file has of it must have been said."""
    global _test
    _test = test
    _now.clear()
    yield
    if WRITES:
        _write({test: [*_now]}, lambda other: True)
    elif COMPARED:
        missing = sentences().get(test, [])[len(_now) :]
        assert not missing, f"{FILE.name} has sentences that this test no longer says: {missing}"


def forget_others(tests: set[str]) -> None:
    """Drops from the file what belongs to the modules of ``tests``, but to no test."""
    if WRITES:
        modules = {module_of(test) for test in tests}
        _write({}, lambda test: test in tests or module_of(test) not in modules)


def shown(text: str) -> str:
    """``text`` with placeholders for what is of this run or machine, and numbers of at most six digits."""
    text = _TEMPORARY.sub("TMP", text.strip()).replace(ROOT, "ROOT")
    text = _INSTALL.sub(r"pip install 'jaxball[\3]'", text)
    text = _ADDRESS.sub("0x...", _PIPE.sub("/dev/fd/N", text))
    text = _LONG_NUMBER.sub(lambda number: f"{float(number[0]):.6g}", text)
    return "\n".join(line.rstrip() for line in text.splitlines() if line.strip())


def module_of(test: str) -> str:
    return test.partition("::")[0]


@cache
def sentences() -> dict[str, list[str]]:
    """The sentences of the file, in order, under the id of their test."""
    return _read()


def _read():
    found = {}
    module = test = ""
    for line in FILE.read_text(encoding="utf-8").splitlines() if FILE.exists() else []:
        indent = len(line) - len(line.lstrip())
        if line and indent == 0:
            module = line
        elif indent == 2:
            test = f"{module}::{line.strip()}"
            found[test] = []
        elif indent == 4:
            found[test].append(line[4:])
        elif line:
            found[test][-1] += "\n" + line[6:]
    return found


def _write(new, is_kept):
    """Puts ``new`` into the file and leaves of the others those that are kept; other processes wait."""
    with filelock.FileLock(Path(tempfile.gettempdir()) / "jaxball_sentences.lock"):
        entries = {test: lines for test, lines in (_read() | new).items() if lines and is_kept(test)}
        written, module = [], ""
        for test in sorted(entries):
            if module_of(test) != module:
                module = module_of(test)
                written.append(f"\n{module}")
            written.append(f"  {test.partition('::')[2]}")
            written.extend("    " + sentence.replace("\n", "\n      ") for sentence in entries[test])
        FILE.write_text("\n".join(written).lstrip("\n") + "\n", encoding="utf-8")
