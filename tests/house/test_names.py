"""Functions are named by what they do: by a verb, or by the noun for their value, and not by a participle."""

import ast
import re
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src/jaxball"
ROOMS = sorted(path.name for path in SOURCE.iterdir() if path.suffix in ("", ".py") and path.name != "__pycache__")
IRREGULAR = (
    "begun|bent|bought|broken|brought|built|caught|chosen|done|drawn|driven|fallen|fed|felt|flown|forgotten|found|"
    "frozen|given|gone|grown|held|hidden|hung|kept|known|laid|led|left|lent|lost|made|meant|met|outgrown|overdrawn|"
    "paid|proven|rewritten|risen|said|seen|sent|shaken|shown|slid|sold|sought|spoken|spent|spun|stood|struck|stuck|"
    "sunk|swept|taken|taught|thought|thrown|told|torn|undone|understood|unknown|withdrawn|worn|wound|woven|written"
)
PARTICIPLE = re.compile(rf"_*([a-z]{{2,}}ed|{IRREGULAR})(_|$)")
# Verbs and nouns that look like participles.
VERBS = re.compile(r"_*(bed|embed|exceed|feed|need|proceed|seed|shed|speed|succeed)(_|$)")
TERMS = {
    "augmented_lagrangian": "the term of the field",
    "bordered_solver": "a bordered system is the term of the field",
    "closed_form": "the term of the field",
    "closed_loop": "the term of the field",
    "squared_distances": "the term of the field",
}
# Users call these by their names, or implement them.
PUBLIC = {
    "designed_path": "a figure",
    "exceeded": "of a PredictiveControl",
    "held_inputs": "a figure",
    "held_paths": "a figure",
    "measured": "of a Trajectory",
    "perturbed": "of the designs",
    "projected": "of every system",
    "saved_scenario": "of the results",
    "smoothed": "of an Estimate",
}


def is_property(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Whether a function is read as an attribute, whose name may be an adjective."""
    return any("property" in ast.unparse(decorator) for decorator in function.decorator_list)


def participles(room: str) -> list[str]:
    """The functions and methods of a room that are named by a participle, with their places."""
    place = SOURCE / room
    return [
        f"{file.relative_to(SOURCE)}:{node.lineno}: {node.name}"
        for file in (sorted(place.rglob("*.py")) if place.is_dir() else [place])
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and PARTICIPLE.match(node.name)
        and not (VERBS.match(node.name) or node.name in TERMS or node.name in PUBLIC or is_property(node))
    ]


@pytest.mark.parametrize("room", ROOMS)
def test_functions_are_verbs(room):
    """Write ``check_times`` for ``checked_times``, and ``sample_path`` for ``sampled_path``."""
    found = participles(room)
    assert not found, "\n".join(found)


def test_exceptions_are_in_use():
    """So that the lists above have nothing that is no longer there."""
    names = {
        node.name
        for file in SOURCE.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    assert {*TERMS, *PUBLIC} <= names
    assert all(PARTICIPLE.match(name) for name in (*TERMS, *PUBLIC))


# First words of docstrings that end like a verb and are none.
NOUNS = {
    "angles",
    "arguments",
    "coefficients",
    "components",
    "conditions",
    "indices",
    "numbers",
    "parameters",
    "programs",
    "this",
    "those",
    "times",
    "values",
    "variables",
}


@pytest.mark.parametrize("room", ROOMS)
def test_docstrings_of_functions_begin_with_a_verb(room):
    """Write "Returns the rates" for "The rates"; what is read as an attribute may begin with its noun."""
    place = SOURCE / room
    others = [
        f"{file.relative_to(SOURCE)}:{node.lineno}: {docstring.splitlines()[0]}"
        for file in (sorted(place.rglob("*.py")) if place.is_dir() else [place])
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (docstring := ast.get_docstring(node))
        and not (is_property(node) or begins_with_verb(docstring))
    ]
    assert not others, "\n".join(others)


def begins_with_verb(docstring: str) -> bool:
    """Whether the first word is a verb of the third person, such as Returns."""
    word = docstring.split()[0].rstrip(",.:")
    return re.fullmatch("[A-Z][a-z]+s", word) is not None and word.lower() not in NOUNS


# Names of local variables that say how a value came about, or which of several it is, and not what it is.
VAGUE = {"at", "found", "given", "kept", "known", "made", "mine", "one", "own", "taken", "theirs", "told", "wanted"}


@pytest.mark.parametrize("room", ROOMS)
def test_locals_are_named_for_what_they_hold(room):
    """Write ``roots`` or ``columns`` for ``found``, and ``time`` or ``position`` for ``at``."""
    place = SOURCE / room
    vague = {
        f"{file.relative_to(SOURCE)}:{name.lineno}: {name.id}"
        for file in (sorted(place.rglob("*.py")) if place.is_dir() else [place])
        for function in ast.walk(ast.parse(file.read_text()))
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for name in ast.walk(function)
        if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store) and name.id in VAGUE
    }
    assert not vague, "\n".join(sorted(vague))
