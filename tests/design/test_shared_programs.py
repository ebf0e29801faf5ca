"""Problems that differ in numbers alone: the same operations, of the numbers as arguments."""

import functools
import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tomli_w

from jaxball.studies import design
from jaxball.studies.design.search.program import Shooting
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
    return Shooting(design.read_problem(tomli_w.dumps(document)).problem, 2)


def evaluated(terms, y):
    return terms.evaluate(y)


@pytest.mark.thorough
def test_all_numbers_are_arguments():
    """What is traced for the one has no number of the other: neither a constant nor a literal differs."""
    one, two = (program(different).pytree for different in (False, True))
    assert jax.tree.structure(one) == jax.tree.structure(two)
    assert hash(jax.tree.structure(one)) == hash(jax.tree.structure(two))
    assert all(map(eqx.is_array, jax.tree.leaves(one)))
    assert all(not np.array_equal(a, b) for a, b in zip(*map(jax.tree.leaves, (one, two)), strict=True))
    y = jnp.zeros(len(program().names))
    traced = [jax.make_jaxpr(evaluated)(terms, y) for terms in (one, two)]
    first, second = (re.sub("0x[0-9a-f]+", "", str(each.jaxpr)) for each in traced)
    assert first == second
    for a, b in zip(*(each.consts for each in traced), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.thorough
def test_what_is_no_number_distinguishes():
    solver = {**PROBLEM, "scenario": {**PROBLEM["scenario"], "solve": {"solver": "tsit5"}}}
    longer = {**PROBLEM, "scenario": {**PROBLEM["scenario"], "time": {"start": 0.0, "end": 2.0, "saves": 7}}}
    fewer = {**PROBLEM, "constraints": PROBLEM["constraints"][:1]}
    problems = [design.read_problem(tomli_w.dumps(d)).problem for d in (PROBLEM, solver, longer, fewer)]
    assert len({(jax.tree.structure(one.pytree), *map(np.shape, jax.tree.leaves(one.pytree))) for one in problems}) == 4


def test_users_objectives_are_not_traced():
    """A class of a user may need to know its numbers."""

    class Radius(design.AbstractObjective):
        def __call__(self, run):
            return run.length if float(self.weight) > 0 else -run.length

    objectives = {"radius": Radius()}
    problem = design.Problem(program().problem.space, objectives, {})
    assert all(leaf is not objectives["radius"].weight for leaf in jax.tree.leaves(problem.pytree))
    value = eqx.filter_jit(lambda traced, y: traced.evaluate_run(traced.run(y)).terms)(problem.pytree, jnp.zeros(2))
    np.testing.assert_array_equal(value, [1.0])
