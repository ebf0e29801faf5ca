"""Reads the input of a command: a file, a built-in scenario, the scenario of a saved run, or standard input.

The option ``--set`` may change numbers of it. The keys of a document tell which kind of file it is. Nothing here needs
JAX until :func:`scenario_of` makes a scenario of a document.
"""

import argparse
import contextlib
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..files import scenario
from ..files.results.files import READ_BACK, load_text
from ..files.scenario.errors import ScenarioError, all_problems
from ..files.scenario.logs import with_logs
from ..files.scenario.paths import with_values
from ..files.scenario.sources import document_of, naming, scenario_text, text_of
from .jax_setup import set_up_jax

if TYPE_CHECKING:
    from ..files.scenario.scenario import Scenario

STDIN = "-"
SETTINGS = ("solver", "rtol", "atol", "max_steps", "max_step", "step_to_times", "dae", "project")  # the keys of [solve]


class FileKind(NamedTuple):
    """A kind of file: what sentences call it, the keys each of which tells it from others, and what runs its files."""

    words: str
    keys: frozenset[str]
    command: str


SCENARIO = FileKind("a scenario", frozenset({"kind"}), "jaxball simulate {}")
STUDY = FileKind("a study", frozenset({"axes"}), "jaxball sweep {} --out STORE")
CONTROL = FileKind("a problem of optimal control", frozenset({"control"}), "jaxball design {} --out FOLDER")
PROBLEM = FileKind(
    "a design problem",
    frozenset({"variables", "objectives", "constraints", "robust", "search"}),
    "jaxball design {} --out FOLDER",
)
PROBLEMS = (PROBLEM, CONTROL)


def add_scenario(parser: argparse.ArgumentParser) -> None:
    """Adds FILE|NAME and --set."""
    parser.add_argument(
        "scenario",
        metavar="FILE|NAME",
        help="a scenario file, a built-in scenario, a saved run (.nc or .npz), or - for standard input",
    )
    add_changes(parser, "the scenario")


def add_changes(parser: argparse.ArgumentParser, what: str) -> None:
    """Adds --set, which changes ``what``."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="PATH=VALUE",
        help=f"change a value of {what}, as in body.mass=2 or 'masses[0].mass=0.3', or remove a key, as in time.step=; "
        "can be given several times",
    )


def is_run(source: str) -> bool:
    """Returns whether ``source`` is the name of a saved run, by its suffix."""
    return Path(source).suffix in READ_BACK


def input_text(source: str) -> str | None:
    """Returns the text of standard input where ``source`` is -, the text of the scenario in a saved run, or else None.

    **Raises:** :class:`~jaxball.ScenarioError` where it is not text, and where there is no scenario.
    """
    if is_run(source):
        return load_text(Path(source))
    if source != STDIN:
        return None
    try:
        return sys.stdin.read()
    except UnicodeDecodeError:
        raise ScenarioError("Standard input must be text in UTF-8, but it is not.") from None


def scenario_document(options: argparse.Namespace, end: float | None = None) -> dict[str, Any]:
    """Returns the document that the options name, changed by ``--set`` and, if ``end`` is passed, with another
    ``time.end``.

    **Raises:** :class:`~jaxball.ScenarioError` where it cannot be read or changed.
    """
    document = change_document(options.scenario, options.set)
    if end is not None:
        times = document.get("time")
        if isinstance(times, dict) and "at" in times:
            raise ScenarioError(
                "Argument `--end` must be left out where the scenario lists its times one by one, as this one does "
                "in `time.at`; give others with --set 'time.at=[0, 1, 2]'."
            )
        document = with_values(document, [f"time.end={end!r}"])
    return document


def refuse_settings(options: argparse.Namespace, command: str, names: Sequence[str]) -> None:
    """Raises a :class:`~jaxball.ScenarioError` where --set gives a setting of the solve that a command does not use."""
    for change in options.set:
        path, _, value = (part.strip() for part in change.partition("="))
        if value and path in [f"solve.{name}" for name in names]:
            raise ScenarioError(
                f"Argument `--set` must change what `jaxball {command}` uses, but it changes `{path}`; leave it out."
            )


def change_document(source: str, changes: Sequence[str]) -> dict[str, Any]:
    """Loads the document of a source, changed, with the numbers of the logs that it names, relative to its file.

    **Raises:** as :func:`load_document`, and where a change cannot be made.
    """
    document = with_values(load_document(source), changes)
    return with_logs(document, Path() if source == STDIN else Path(source).parent)


def load_document(source: str) -> dict[str, Any]:
    """Loads the document of a scenario file, of a built-in name, of a saved run, or on standard input.

    **Raises:** :class:`~jaxball.ScenarioError` where it cannot be read, and for a file of another kind.
    """
    text = input_text(source)
    return _document(scenario_text(source) if text is None else text, source, "scenario", SCENARIO)


def text_and_document(source: str, what: str, *kinds: FileKind) -> tuple[str, dict[str, Any]]:
    """Returns the text and the document of the file ``source``, which must be ``what``, of one of these kinds.

    **Raises:** :class:`~jaxball.ScenarioError` where it cannot be read, and for a file of another kind.
    """
    text = text_of(source, f"{what} file", ScenarioError)
    return text, _document(text, source, what, *kinds)


def refuse_document(path: Path) -> None:
    """Raises a :class:`~jaxball.ScenarioError` where a file that must be something else is a scenario or the like."""
    if is_run(str(path)):
        return  # which may be large
    try:
        document = document_of(path.read_text(encoding="utf-8"), "file", ScenarioError)
    except (OSError, UnicodeDecodeError, ScenarioError):
        return
    check_kind(document, str(path), str(path))


def _document(text: str, source: str, what: str, *kinds: FileKind) -> dict[str, Any]:
    with naming(source_name(source)):
        document = document_of(text, what, ScenarioError)
    check_kind(document, source_name(source), "FILE" if source == STDIN else source, *kinds)
    return document


def read_scenario(options: argparse.Namespace) -> "Scenario":
    """Sets JAX up, and reads the scenario of the options; raises as :func:`scenario_document` and
    :func:`scenario_of`.
    """
    document = scenario_document(options)
    set_up_jax()
    return scenario_of(document, options.scenario)


def scenario_of(document: dict[str, Any], source: str) -> "Scenario":
    """Returns the scenario that the document of ``source`` describes.

    **Raises:** :class:`~jaxball.ScenarioError` where it cannot be read.
    """
    with gather_problems(source):
        return scenario.read_document(document)
    # Not reached: the block above raises if nothing is returned. Type checkers cannot know.
    raise AssertionError("A document that cannot be read has a problem.")


@contextlib.contextmanager
def gather_problems(source: str) -> Iterator[None]:
    """Makes the error raised within, in what ``source`` has, one of all its problems, each in a line of its own."""
    with all_problems() as problems:
        yield
    if problems:
        name = source_name(source)
        raise ScenarioError("\n".join(f"{name}: {problem}" for problem in first_problems(problems)))


MOST_PROBLEMS = 10  # of a file that are told one by one


def first_problems(problems: Sequence[ScenarioError]) -> list[ScenarioError]:
    """Returns the first problems of a file, and one that says how many more there are."""
    more = len(problems) - MOST_PROBLEMS
    if more <= 1:
        return list(problems)
    return [*problems[:MOST_PROBLEMS], ScenarioError(f"{more:,} more problems are not listed.")]


def source_name(source: str) -> str:
    """Returns the name of a source in messages."""
    return "standard input" if source == STDIN else source


def kind_of_document(document: Mapping[str, Any]) -> FileKind | None:
    """Returns the kind of a document; None where it has none of the keys by which a kind is known.

    Problems name a scenario too, but what has no other key that is known is taken for a study without its axes.
    """
    kind = next((kind for kind in (STUDY, CONTROL, PROBLEM, SCENARIO) if kind.keys & document.keys()), None)
    return STUDY if kind is None and "scenario" in document else kind


def check_kind(document: Mapping[str, Any], name: str, file: str, *kinds: FileKind) -> None:
    """Raises a :class:`~jaxball.ScenarioError` where a document is of none of ``kinds``.

    What is not recognised is left to its reader, which names the keys that are wrong.

    - ``name``: what messages call its source.
    - ``file``: the operand of the command that runs it.
    """
    kind = kind_of_document(document)
    if kind is not None and kind not in kinds:
        raise ScenarioError(f"{name} is {kind.words}; run it with `{kind.command.format(shlex.quote(file))}`.")
