"""What a command is doing stands on one line of a terminal while it lasts, and nowhere else."""

import os
import pty
import subprocess
import sys

import pytest

from jaxball.interface import activity

PRELUDE = """
import sys, time
from jaxball.interface import activity as module
from jaxball.interface.activity import activity

module.DELAY = 0.01

def until_shown(line):
    while line._stream is not None and not line._shown:
        time.sleep(0.001)
"""
SHOWN = "\r\x1b[Kcompiling …"
ERASED = "\r\x1b[K"
LONG = 'with activity("compiling") as line:\n    until_shown(line)\n'
PROGRAMS = {
    "shown, then erased": (LONG, SHOWN + ERASED),
    "erased by an error": (
        'try:\n    with activity("compiling") as line:\n        until_shown(line)\n        1 / 0\n'
        'except ZeroDivisionError:\n    print("caught", file=sys.stderr)',
        f"{SHOWN}{ERASED}caught\r\n",
    ),
    "one after the other": (LONG + LONG, (SHOWN + ERASED) * 2),
    "room for what is printed": (
        LONG + '    line.print("half of it", sys.stderr)\n    line.print("all of it", sys.stderr)',
        f"{SHOWN}{ERASED}half of it\r\n{SHOWN}{ERASED}all of it\r\n{SHOWN}{ERASED}",
    ),
    "changed": (
        LONG + "    module.BETWEEN_CHANGES = 0.0\n    line.change('half of it')\n"
        "    module.BETWEEN_CHANGES = 60.0\n    line.change('more than half')",
        f"{SHOWN}\r\x1b[Khalf of it …{ERASED}",
    ),
    "what is done at once": ("module.DELAY = 60.0\nwith activity('compiling'):\n    pass", ""),
    "quiet": ('with activity("compiling", quiet=True) as line:\n    time.sleep(0.1)', ""),
    "while Python compiles": (
        "module.SILENCE = 0.01\nwith module.compiling():\n    time.sleep(0.5)",
        f"\r\x1b[Kjaxball: the first call of its kind (compiling) …{ERASED}",
    ),
    "while Python compiles for a moment": ("with module.compiling():\n    time.sleep(0.1)", ""),
    "while a command compiles quietly": (
        'module.SILENCE = 0.01\nwith activity("simulating", quiet=True), module.compiling():\n    time.sleep(0.1)',
        "",
    ),
    "no wider than the terminal": (
        'with activity("x" * 500) as line:\n    until_shown(line)',
        f"\r\x1b[K{'x' * 79}{ERASED}",
    ),
}


def on_a_terminal(program):
    """What a program writes to standard error, a terminal of 80 columns, and to standard output, which is none."""
    master, terminal = pty.openpty()
    os.set_blocking(master, True)
    environment = {**os.environ, "COLUMNS": "80"}
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=terminal, env=environment) as process:
        os.close(terminal)
        written = b""
        while True:
            try:
                part = os.read(master, 1024)
            except OSError:  # on Linux, where nobody has the terminal any more
                break
            if not part:
                break
            written += part
        output = process.stdout.read()
    os.close(master)
    assert process.returncode == 0, written.decode()
    return written.decode(), output.decode()


@pytest.mark.parametrize(("program", "written"), PROGRAMS.values(), ids=PROGRAMS.keys())
def test_on_a_terminal(program, written):
    assert on_a_terminal(PRELUDE + program) == (written, "")


@pytest.mark.parametrize("program", ["shown, then erased", "changed", "room for what is printed"])
def test_in_a_log(program):
    command = [sys.executable, "-c", PRELUDE + PROGRAMS[program][0]]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == ""
    assert done.stderr == ("half of it\nall of it\n" if "printed" in program else "")


def test_a_line_counts_its_seconds_and_says_that_something_is_compiled(monkeypatch, tmp_path):
    now, path = [10.0], tmp_path / "written"
    monkeypatch.setattr(activity.time, "monotonic", lambda: now[0])

    def shown(after):
        now[0] += after
        line.show()
        return path.read_bytes().decode().split(activity.ERASE)[-1]

    with path.open("w", encoding="utf-8") as stream:
        line = activity.Line("simulating", stream)
        assert shown(0.5) == "simulating …"
        with activity.compiling(), activity.compiling():
            assert shown(0.0) == "simulating (compiling) …"
            assert shown(2.6) == "simulating (compiling) …, 3 s"
        assert shown(1.0) == "simulating …, 4 s"
        line.change("half of it")
        assert shown(0.5) == "half of it …"
        line.change("half of it")
        assert shown(0.5) == "half of it …, 1 s"
