"""The kinds of files: which one a document is, by its keys, and the command that runs it. Nothing here needs JAX."""

import shlex
from collections.abc import Mapping
from typing import Any, NamedTuple

from ..scenario.errors import ScenarioError


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
