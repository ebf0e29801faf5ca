"""Texts, documents and names of scenarios, including built-in ones and those in studies and problems."""

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ...interface.wording import did_you_mean
from .errors import ScenarioError, describe, key_error
from .logs import with_logs

_FOLDER = os.path.join(os.path.dirname(__file__), "builtin")
SCHEMAS = Path(__file__).absolute().parent / "schemas"
SAVED_RUNS = {".nc", ".npz"}
_TITLE = re.compile(r'^title = "(.*)"$', re.MULTILINE)  # every title is such a line, and TOML takes long to parse


def builtin_scenarios() -> tuple[str, ...]:
    """Returns the names of the built-in scenarios, in alphabetical order.

    **Example:**

    >>> from jaxball.files.scenario import builtin_scenarios
    >>> builtin_scenarios()[:3]
    ('axisymmetric-pendulum', 'axisymmetric-pendulum-on-a-slope', 'ball')
    """
    return tuple(sorted(name.removesuffix(".toml") for name in os.listdir(_FOLDER) if name.endswith(".toml")))


def builtin_text(name: str) -> str:
    """Returns the text of the file of the built-in scenario ``name``, comments included, but for the first line, which
    names its schema by a path that is right in that file's folder only.

    **Raises:** :class:`ScenarioError` when there is none of that name.

    **Example:**

    >>> from jaxball.files.scenario.sources import builtin_text
    >>> print(builtin_text("disk").splitlines()[2])
    title = "The paper's disk: four masses on concentric circles"
    """
    if name not in builtin_scenarios():
        raise ScenarioError(
            f'Argument `name` must be the name of a built-in scenario, but it is "{name}"{nearest_builtin(name)}'
        )
    with open(os.path.join(_FOLDER, f"{name}.toml"), encoding="utf-8") as file:
        return file.read().partition("\n")[2]


def with_schema(text: str) -> str:
    """Returns the text of a user's scenario file, with a first line by which editors find the installed schema."""
    return f"#:schema {(SCHEMAS / 'scenario.json').as_uri()}\n{text}"


def builtin_title(name: str) -> str:
    """Returns the title of the built-in scenario ``name``.

    **Example:**

    >>> from jaxball.files.scenario.sources import builtin_title
    >>> builtin_title("disk")
    "The paper's disk: four masses on concentric circles"
    """
    title = _TITLE.search(builtin_text(name))
    assert title is not None
    return title[1]


def nearest_builtin(name: str) -> str:
    """Returns the end of a sentence about a name that no built-in scenario has."""
    return did_you_mean(name, builtin_scenarios(), "`jaxball scenarios` lists them")


SCENARIO = "a table, a name or a file"  # which a study or a problem holds or names


@contextlib.contextmanager
def naming(source: str | Path) -> Iterator[None]:
    """Makes the errors raised within begin with the name of the file."""
    try:
        yield
    except ScenarioError as error:
        raise type(error)(f"{source}: {error}") from None


@contextlib.contextmanager
def naming_scenario(value: Any, what: str, error: type[ScenarioError]) -> Iterator[None]:
    """Makes errors in the scenario that ``what`` holds or names say so; those of the type ``error`` already do."""
    try:
        yield
    except error:
        raise
    except ScenarioError as cause:
        name = f', "{value}",' if isinstance(value, str) else ""
        raise error(f"The scenario of the {what}{name} is wrong: {cause}") from None


def scenario_text(source: str | Path) -> str:
    """Reads the text of the scenario file at the path ``source``, or of the built-in scenario of that name.

    **Raises:** :class:`ScenarioError` when there is no such file or name.
    """
    if isinstance(source, str) and source in builtin_scenarios():
        return builtin_text(source)
    return text_of(source, "scenario file, or the name of a built-in one", ScenarioError, nearest_builtin(str(source)))


def text_of(source: str | Path, what: str, error: type[ScenarioError], hint: str = ".") -> str:
    """Reads the text of a file, which is ``what``; ``hint`` ends the sentence where there is none.

    **Raises:** ``error``, with one sentence, when there is no such file, or when it is not text.
    """
    if not isinstance(source, str | os.PathLike):
        raise TypeError(f"Argument `source` must be the path of a {what}, but it is {source!r}.")
    try:
        return Path(source).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as cause:
        reason = cause.strerror if isinstance(cause, OSError) else "it is not UTF-8 text"
        hint = hint if isinstance(cause, FileNotFoundError) else "."
        if Path(source).suffix in SAVED_RUNS and not isinstance(cause, OSError):
            hint = "; the scenario of a saved run is read by jaxball.files.results.saved_scenario."
        raise error(f'Argument `source` must be a {what}, but it is "{source}" ({reason}){hint}') from None


def document_of(text: str, what: str, error: type[ScenarioError]) -> dict[str, Any]:
    """Parses the TOML document of a text, which is ``what``.

    **Raises:** ``error`` when it is not TOML, ``TypeError`` for what is no text.
    """
    if not isinstance(text, str):
        raise TypeError(f"Argument `text` must be the text of a {what} file, but it is a {type(text).__name__}.")
    try:
        return _parse(text)
    except (ValueError, RecursionError) as cause:
        raise error(f"A {what} must be a TOML document, but it is not: {_reason(cause)}{_heading(text)}.") from None


def scenario_document(value: Any, folder: Path, error: type[ScenarioError]) -> dict[str, Any]:
    """Returns the document of the scenario that the key `scenario` holds or names; files are looked for relative to
    ``folder``.

    It has the numbers of the logs that it names, whose files are looked for relative to its own.

    **Raises:** ``error`` where it does not exist.
    """
    if isinstance(value, dict):
        return with_logs(value, folder)
    if not isinstance(value, str):
        raise key_error("scenario", SCENARIO, describe(value))
    try:
        is_builtin = value in builtin_scenarios()
        document = _parse(builtin_text(value) if is_builtin else (folder / value).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as cause:
        raise error(
            f"Key `scenario` must be a table, a scenario file, or the name of a built-in one, but it is "
            f"{describe(value)} ({_reason(cause)}){nearest_builtin(value)}"
        ) from None
    return with_logs(document, (folder / value).parent)


def _parse(text: str) -> dict[str, Any]:
    """Parses TOML without the byte-order mark that some editors put at the beginning, which TOML does not allow."""
    import tomllib  # here, as below, because it takes as long as Python itself to start

    document = tomllib.loads(text.removeprefix("\ufeff"))
    _require_shallow(document)
    return document


DEEPEST = 100  # levels of tables and lists in a file


def _require_shallow(document: dict[str, Any]) -> None:
    """Raises a ``RecursionError`` for a document that is nested too deeply for whatever reads it, level by level."""
    level: list[Any] = [document]
    for _ in range(DEEPEST):
        level = [
            item
            for above in level
            for item in (above.values() if isinstance(above, dict) else above)
            if isinstance(item, dict | list)
        ]
        if not level:
            return
    raise RecursionError


def _heading(text: str) -> str:
    """Says what to write instead of a heading with an index, such as ``[[mechanisms[0].masses]]``; empty if there is
    none.

    Keys are written with indices on the command line and in studies.
    """
    counting = re.search(r"^\s*(\[\[?)([\w.-]+)\[(\d+)\]([\w.\[\]-]*?)(\]\]?)\s*$", text, re.MULTILINE)
    if counting is None:
        return ""
    opening, key, _, rest, closing = counting.groups()
    rest = re.sub(r"\[\d+\]", "", rest)
    return (
        f"; a heading has no index: {opening}{key}{rest}{closing} belongs to the last [[{key}]] before it"
        if rest
        else f"; a heading has no index: every [[{key}]] begins the next one"
    )


def _reason(cause: Exception) -> str:
    """Says why a text is not a document; the parser also raises errors other than its own."""
    if isinstance(cause, OSError):
        return cause.strerror or str(cause)
    if isinstance(cause, UnicodeDecodeError):
        return "it is not UTF-8 text"
    if isinstance(cause, RecursionError):
        return "it is nested too deeply"
    import tomllib

    return str(cause) if isinstance(cause, tomllib.TOMLDecodeError) else "it has a number of too many digits"
