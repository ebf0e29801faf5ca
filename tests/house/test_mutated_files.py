"""Whatever is wrong in a file, reading it ends in one sentence that names a key of it, and in nothing else."""

import re

import numpy as np
import pytest

from jaxball import ScenarioError
from jaxball.files.scenario.body import FRICTIONS, SENSORS
from jaxball.files.scenario.feedback import FEEDBACK
from jaxball.files.scenario.mechanisms import JOINT_FORCES, JOINTS
from jaxball.files.scenario.motions import RAILS, SCHEDULES
from jaxball.studies.design.kinds import PLANE, constraints_of, objectives_of
from tests.support import corpus
from tests.support.mutations import mutated

# What a sentence names: a key, or in a design the number that varies; or it says that the text is no TOML.
NAMES = r"(^|: )(Key `.+`|Variables? `?.+`?|Path `.+`|`.+`) |must be a TOML document"
QUICK = {
    "scenarios": (
        corpus.scenarios,
        ("disk", "heavy-top", "suslov", "vakonomic-particle", "pendulum-on-a-slope", "bouncing-ball"),
    ),
    "studies": (corpus.studies, ("how-to/sweeps.md 0", "every axis")),
    "problems": (corpus.problems, ("every kind, ball", "every kind, disk, controlled")),
}


def check(name, document, seed):
    """One document with something wrong in it; warnings are errors here."""
    text = mutated(document, np.random.default_rng(seed))
    try:
        corpus.reader_of(document)(text)
    except ScenarioError as error:
        sentence = str(error)
        assert re.search(NAMES, sentence), (name, seed, sentence)
        assert re.search(r"[.?]$", sentence), (name, seed, sentence)
        assert "\n" not in sentence, (name, seed, sentence)
        return 1
    except Exception as error:
        raise AssertionError(f"{name}, seed {seed}: {type(error).__name__} of the file\n{text}") from error
    return 0


def test_every_kind_is_among_the_files_that_are_mutated():
    """So that one which is added to a registry is put there, too."""
    required = objectives_of(PLANE), constraints_of(PLANE)
    registries = (RAILS, SCHEDULES, JOINTS, JOINT_FORCES, FRICTIONS, SENSORS, FEEDBACK, *required)
    assert {kind for family in registries for kind in family} <= corpus.kinds()


@pytest.mark.thorough
@pytest.mark.parametrize("kind", QUICK)
def test_a_mutated_file_is_read_or_told(kind):
    documents, names = QUICK[kind]
    told = [check(name, documents()[name], [0, seed]) for seed in range(40) for name in names]
    # Most of what is done to a file cannot be read, and some can.
    assert 0.3 < np.mean(told) < 1


@pytest.mark.slow
@pytest.mark.parametrize("documents", [corpus.scenarios, corpus.studies, corpus.problems], ids=lambda one: one.__name__)
def test_thousands_of_mutated_files_are_read_or_told(documents):
    known = documents()
    for seed in range(2000):
        name = list(known)[seed % len(known)]
        check(name, known[name], [1, seed])
