"""JSON Schemas of files, by a validator that knows nothing of jaxball: they accept every file that is read, and refuse
none that a reader accepts.

``python -m tests.scenario.test_schema`` writes those that come with jaxball, from the tables of keys.
"""

import copy
import functools
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from jaxball import ScenarioError
from jaxball.cli import main
from jaxball.cli.commands.schema import KINDS
from jaxball.files.scenario import builtin_scenarios
from jaxball.files.scenario.sources import SCHEMAS, builtin_text, document_of
from tests.support import corpus
from tests.support.mutations import mutated
from tests.support.schema import schemas

SHIPPED = {kind: SCHEMAS / f"{kind}.json" for kind in KINDS}


def texts_from_keys() -> dict[str, str]:
    return {kind: json.dumps(schema, indent=1, ensure_ascii=False) + "\n" for kind, schema in schemas().items()}


@functools.cache
def validator(kind: str) -> Draft202012Validator:
    return Draft202012Validator(json.loads(SHIPPED[kind].read_text("utf-8")))


def validator_of(document: dict[str, Any]) -> Draft202012Validator:
    if "axes" in document:
        return validator("study")
    if "objectives" in document or "variables" in document or "control" in document:
        return validator("control" if "control" in document else "problem")
    return validator("scenario")


def problems_of(document: dict[str, Any]) -> list[str]:
    return [f"{error.json_path}: {error.message}"[:200] for error in validator_of(document).iter_errors(document)]


def test_those_that_come_with_jaxball_are_of_the_keys_there_are():
    """If not, ``python -m tests.scenario.test_schema`` writes them again."""
    assert {path.stem: path.read_text("utf-8") for path in SCHEMAS.iterdir()} == texts_from_keys()


@pytest.mark.parametrize("kind", KINDS)
def test_each_is_a_schema_and_is_printed(kind, capsys):
    assert main(["schema", kind]) == 0
    printed = capsys.readouterr().out
    assert printed == SHIPPED[kind].read_text("utf-8")
    Draft202012Validator.check_schema(json.loads(printed))
    assert json.loads(printed)["$defs"]


def test_builtin_files_name_it_by_where_it_is_from_them():
    files = [*(SCHEMAS.parent / "builtin").iterdir()]
    assert {path.stem for path in files} == {*builtin_scenarios()}
    for path in files:
        directive, _, named = path.read_text("utf-8").partition("\n")[0].partition(" ")
        assert directive == "#:schema", path
        assert (path.parent / named).resolve() == SHIPPED["scenario"], path


def test_files_of_users_name_it_by_where_it_is_installed(capsys):
    assert main(["scenarios", "ball"]) == 0
    first, _, rest = capsys.readouterr().out.partition("\n")
    directive, named = first.split(" ")
    assert directive == "#:schema"
    assert urlsplit(named).scheme == "file"
    assert Path(url2pathname(urlsplit(named).path)) == SHIPPED["scenario"]
    assert rest == builtin_text("ball")


@pytest.mark.parametrize("name", builtin_scenarios())
def test_builtin_scenarios_are_valid(name):
    assert problems_of(document_of(builtin_text(name), "scenario", ScenarioError)) == []


@pytest.mark.parametrize("corpora", [corpus.scenarios, corpus.studies, corpus.problems])
def test_files_of_the_corpus_are_valid(corpora):
    assert {name: problems for name, document in corpora().items() if (problems := problems_of(document))} == {}


def test_files_with_everything_are_valid():
    assert [problems for document in corpus.with_everything() if (problems := problems_of(document))] == []


@pytest.mark.thorough
@pytest.mark.parametrize("corpora", [corpus.scenarios, corpus.studies, corpus.problems])
def test_a_mutated_file_that_is_read_is_valid(corpora):
    """And of those that are not read more than half are refused, though many rules involve several keys."""
    documents, refused, unread = corpora(), 0, 0
    for seed in range(150):
        name = list(documents)[seed % len(documents)]
        text = mutated(documents[name], np.random.default_rng([2, seed]))
        try:
            document = tomllib.loads(text)
        except tomllib.TOMLDecodeError:
            continue
        read = True
        validates = validator_of(documents[name])
        problems = [f"{error.json_path}: {error.message}"[:200] for error in validates.iter_errors(document)]
        try:
            corpus.reader_of(documents[name])(text)
        except ScenarioError:
            read = False
        assert not (read and problems), (name, seed, problems)
        unread, refused = unread + (not read), refused + bool(problems)
    assert 2 * refused > unread > 40


BALL = {
    "format": 1,
    "kind": "ball",
    "body": {"mass": 1.0, "radius": 1.0, "inertia": [0.4, 0.4, 0.4], "gravity": 1.0},
    "masses": [{"mass": 0.5, "rail": {"kind": "circle", "radius": 0.5}, "schedule": {"kind": "pulse", "theta": 0.0}}],
    "time": {"start": 0.0, "end": 1.0, "saves": 3},
}


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("body.mass", -1.0),
        ("body.mass", "1 kg"),
        ("body.inertia", [0.4, 0.4]),
        ("body.mas", 1.0),
        ("kind", "bal"),
        ("kind", 1),
        ("masses", {}),
        ("masses.0.rail.kind", "circel"),
        ("masses.0.rail.radius", 0.0),
        ("masses.0.rail.semi_axes", [1.0, 1.0]),
        ("masses.0.rail.frame", {"azimuth": 30.0, "elevation": 0.0}),
        ("masses.0.schedule.theta", True),
        ("masses.0.position", [0.0, 0.0, 0.0]),
        ("time.saves", 1),
        ("time.step", 0.1),
        ("solve", {"solver": "dopri9"}),
        ("solve", {"max_steps": 1.5}),
        ("actuation", {"form": "servo", "stiffness": [1.0]}),
        ("contact", {"friction": {"kind": "smoothed-coulomb", "kinetic": -0.1, "smoothing": 0.1}}),
        ("ground", {"kind": "bowl"}),
        ("units", "dimensionles"),
        ("events", {"low": {"level": 0.0}}),
        ("feedback", {"kind": "mpc", "Q": 1.0, "R": 1.0}),
    ],
)
def test_wrong_files_are_refused(path, value):
    assert problems_of(BALL) == []
    wrong = copy.deepcopy(BALL)
    *above, last = path.split(".")
    place: Any = wrong
    for step in above:
        place = place[int(step) if step.isdecimal() else step]
    place[last] = value
    assert problems_of(wrong)
    with pytest.raises(ScenarioError):
        corpus.read_any(wrong)


def missing_keys(document: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    for step, value in document.items() if isinstance(document, dict) else enumerate(document):
        yield (*path, step)
        if isinstance(value, dict | list):
            yield from missing_keys(value, (*path, step))


def test_what_must_be_there_is_asked_for():
    """Without each key and entry in turn: the schema refuses no file that the reader accepts."""
    refused = 0
    for *above, last in missing_keys(BALL):
        changed = copy.deepcopy(BALL)
        place: Any = changed
        for step in above:
            place = place[step]
        del place[last]
        if problems_of(changed):
            refused += 1
            with pytest.raises(ScenarioError):
                corpus.read_any(changed)
    assert refused >= 15


if __name__ == "__main__":
    for kind, text in texts_from_keys().items():
        SHIPPED[kind].write_text(text, encoding="utf-8")
