"""Documents run: their blocks in order, and what they print held against what the page shows."""

import ast
import contextlib
import importlib.util
import io
import os
import re
import subprocess
import sys
from pathlib import Path

from sybil import Example, Sybil
from sybil.parsers.markdown import CodeBlockParser

ROOT = Path(__file__).parents[2]
NUMBER = r"[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
ANYTHING = "…"  # in an output, as where a time is shown
STEPS = re.compile(r"\d+ steps, \d+ of them rejected")
BESIDE_BRACKETS = re.compile(r"(?<=\[) | (?=\])")
VALUE = re.compile(r"[-\d\[({']|True|False")  # how a comment begins that is one
FILE_NAME = re.compile(r"# ([\w-]+\.toml)\n")
MODULE_NAME = re.compile(r"# (\w+)\.py\n")


def examples_of(document: Path, *, followed: bool) -> list[Example]:
    """The blocks of a document that run: Python, and what it prints in a block ``output`` right after it.

    A block of Python whose first line is a comment with the name of a file is a module that later blocks import.

    A document that is ``followed`` from its first line to its last also has commands, with what they print, in blocks
    ``console``, and files in blocks ``toml`` whose first line is a comment with the name.
    """
    parsers = [CodeBlockParser("python", _run_python), CodeBlockParser("output", _compare_with_printed)]
    if followed:
        parsers += [CodeBlockParser("console", _run_commands), CodeBlockParser("toml", _write_file)]
    return list(Sybil(parsers=parsers, pattern="*.md", path=str(ROOT)).parse(document))


def agrees(shown: str, printed: str) -> bool:
    """Whether two outputs have the same words, and the same numbers up to two units of the last digit shown.

    Any white space counts as one space, or as none within brackets, and how many steps a solver took does not count: it
    depends on rounding.
    """
    shown, printed = (STEPS.sub(ANYTHING, BESIDE_BRACKETS.sub("", " ".join(text.split()))) for text in (shown, printed))
    pattern = "".join(_pattern(part) for part in re.split(rf"({ANYTHING}|{NUMBER})", shown))
    found = re.fullmatch(pattern, printed)
    numbers = re.findall(NUMBER, shown)
    return found is not None and all(map(_close, numbers, found.groups()))


def _pattern(part: str) -> str:
    if part == ANYTHING:
        return ".*?"
    return f"({NUMBER})" if re.fullmatch(NUMBER, part) else re.escape(part)


def _close(shown: str, printed: str) -> bool:
    expected, got = (float(number.replace("−", "-")) for number in (shown, printed))
    mantissa, _, exponent = shown.partition("e")
    decimals = len(mantissa.partition(".")[2])
    return expected == got or (decimals > 0 and abs(expected - got) <= 2.001 * 10.0 ** (int(exponent or 0) - decimals))


def _run_python(example: Example) -> str | None:
    """Runs a block; an expression with a comment beside it that begins as a value does must have that value."""
    names = example.namespace
    module = MODULE_NAME.match(example.parsed)
    if module:
        make_module(module[1], example.parsed, Path())
        return None
    wrong = []
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        for statement in ast.parse(example.parsed).body:
            ast.increment_lineno(statement, example.line + example.parsed.line_offset)
            if isinstance(statement, ast.Expr):
                value = eval(compile(ast.Expression(statement.value), example.path, "eval"), names)
                comment = _comment_beside(statement, example.path)
                if VALUE.match(comment) and not _has_value(comment, value):
                    wrong.append(f"The page says {comment}, but the value is {value!r}.")
            else:
                exec(compile(ast.Module([statement], []), example.path, "exec"), names)
    names["_printed"] = printed.getvalue()
    return "\n".join(wrong) or None


def make_module(name: str, source: str, folder: Path) -> None:
    """Writes the file ``name``.py to a folder, and imports it from there."""
    file = folder / f"{name}.py"
    file.write_text(source)
    specification = importlib.util.spec_from_file_location(name, file)
    sys.modules[name] = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(sys.modules[name])


def modules_of(document: Path) -> dict[str, str]:
    """The text of each module that a document shows, by its name."""
    blocks = re.findall(r"^```python\n(.*?)^```", document.read_text(), flags=re.MULTILINE | re.DOTALL)
    return {name[1]: block for block in blocks if (name := MODULE_NAME.match(block))}


def _comment_beside(statement: ast.Expr, path: str) -> str:
    line = Path(path).read_bytes().splitlines()[statement.end_lineno - 1]
    return line[statement.end_col_offset :].decode().strip().removeprefix("# ")


def _has_value(comment: str, value: object) -> bool:
    """Whether a comment is a value, perhaps before a colon or the like and words, or after an equality sign."""
    ends = [match.start() for match in re.finditer(r"[:;,] |$", comment)]
    shown = [*(comment[:end] for end in ends), comment.rpartition(" = ")[2]]
    return any(agrees(one, text) for one in shown for text in (str(value), repr(value)))


def _compare_with_printed(example: Example) -> str | None:
    shown, printed = example.parsed, example.namespace["_printed"]
    return None if agrees(shown, printed) else f"The page shows\n{shown}\nbut what is printed is\n{printed}"


def _run_commands(example: Example) -> str | None:
    """Each line after ``$`` is a command, and the lines up to the next are what it prints."""
    folder = Path(sys.executable).parent
    inherited = {name: value for name, value in os.environ.items() if value}  # a page's settings are taken back to ""
    environment = {**inherited, "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}", "COLUMNS": "120"}
    for part in re.split(r"^\$ ", example.parsed, flags=re.MULTILINE)[1:]:
        command, shown = re.fullmatch(r"((?:.*\\\n)*.*)\n([\s\S]*)", part).groups()
        done = subprocess.run(command, shell=True, env=environment, capture_output=True, text=True, timeout=300)
        if done.returncode:
            return f"{command} ended with {done.returncode}: {done.stderr}"
        if shown.strip() and not agrees(shown, done.stdout):
            return f"{command}: the page shows\n{shown}\nbut what is printed is\n{done.stdout}"
    return None


def _write_file(example: Example) -> None:
    name = FILE_NAME.match(example.parsed)
    if name:
        Path(name[1]).write_text(example.parsed)
