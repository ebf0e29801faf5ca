"""Problems that differ in numbers alone: the same operations, of the numbers as arguments."""

import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tomli_w

from jaxball import design
from jaxball.design.problem import shared
from tests.design.documents import builtin

PROBLEM = {
    "format": 1,
    "scenario": builtin("ball", start=0.0, end=2.0, saves=5),
    "variables": [
        {"path": ["masses[0].mass", "masses[1].mass"], "factors": [1.0, 0.5], "lower": 0.5, "scale": 0.3},
        {"path": "masses[1].rail.radius", "lower": 0.2, "upper": 0.95},
    ],
    "objectives": [
        {"kind": "reach-place", "place": [1.0, 0.5], "weight": 2.0},
        {
            "kind": "follow-curve",
            "curve": {"kind": "through", "points": [[0.0, 0.0], [1.0, 0.5], [2.0, 0.2]]},
            "weight": 0.5,
        },
    ],
    "constraints": [{"kind": "friction", "friction": 0.3}, {"kind": "rails-inside", "clearance": 0.05}],
    "robust": {"count": 2, "masses": 0.01, "offset": 0.02},
}
FIXED = re.compile(r"format|count|saves|versor|[ra]tol")


def changed(value, name=""):
    """The same with other numbers, where these do not determine how much is computed."""
    if isinstance(value, dict):
        return {key: changed(item, key) for key, item in value.items()}
    if isinstance(value, list):
        return [changed(item, name) for item in value]
    return 0.99 * value + 1e-3 if isinstance(value, float) and not FIXED.fullmatch(name) else value


@functools.cache
def program(different=False):
    document = changed(PROBLEM) if different else PROBLEM
    return design.Shooting(design.read_problem(tomli_w.dumps(document)).problem, 2)


def evaluated(form, content, y):
    return form(content).evaluate(y)


@pytest.mark.thorough
def test_all_numbers_are_arguments():
    """What is traced for the one has no number of the other: neither a constant nor a literal differs."""
    (form, one), (other, two) = (program(different).parted for different in (False, True))
    assert form == other
    assert hash(form) == hash(other)
    assert all(not np.array_equal(a, b) for a, b in zip(*map(jax.tree.leaves, (one, two)), strict=True))
    y = jnp.zeros(len(program().names))
    traced = [
        jax.make_jaxpr(functools.partial(evaluated, of))(content, y) for of, content in ((form, one), (other, two))
    ]
    first, second = (re.sub("0x[0-9a-f]+", "", str(each.jaxpr)) for each in traced)
    assert first == second
    for a, b in zip(*(each.consts for each in traced), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.thorough
def test_what_is_no_number_distinguishes():
    solver = {**PROBLEM, "scenario": {**PROBLEM["scenario"], "solve": {"solver": "tsit5"}}}
    longer = {**PROBLEM, "scenario": {**PROBLEM["scenario"], "time": {"start": 0.0, "end": 2.0, "saves": 7}}}
    fewer = {**PROBLEM, "constraints": PROBLEM["constraints"][:1]}
    forms = [shared.split_problem(design.read_problem(tomli_w.dumps(d)).problem)[0] for d in (solver, longer, fewer)]
    assert len({*forms, shared.split_problem(program().problem)[0]}) == 4


def test_users_objectives_are_not_traced():
    """A class of a user may need to know its numbers."""

    class Radius(design.AbstractObjective):
        def __call__(self, run):
            return run.length if float(self.weight) > 0 else -run.length

    objectives = {"radius": Radius()}
    form, content = shared.split_problem(design.Problem(program().problem.space, objectives, {}))
    assert content == ()
    assert form(content).objectives["radius"] is objectives["radius"]
