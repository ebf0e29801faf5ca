"""What is said of each constraint does not depend on the order in which a file has them.

JAX returns dictionaries in the order of their keys: numbers of one constraint must not be those of another.
"""

import functools
import itertools
import re

import jax.numpy as jnp
import numpy as np
import pytest
import tomli_w

from jaxball.studies import design
from jaxball.studies.design.problem.run import RAIL_SAMPLES
from jaxball.studies.design.report import _constraints
from jaxball.studies.design.search.design import Design
from jaxball.studies.design.search.optimise import Progress
from jaxball.studies.design.search.verify import AS_BUILT
from tests.design.documents import builtin

# Circles of these radii about the centre, in planes that intersect, come as near as the radii differ.
RADII, SAVES, CLEARANCE, DISTANCE = (0.95, 0.9, 0.85), 6, 0.03, 0.06
CONSTRAINTS = (
    {"kind": "friction", "friction": 0.2},
    {"kind": "normal-force", "least": 0.1},
    {"kind": "rails-inside", "clearance": CLEARANCE},
    {"kind": "rails-apart", "distance": DISTANCE},
)
ORDERS = (CONSTRAINTS, CONSTRAINTS[::-1], tuple(CONSTRAINTS[k] for k in (3, 1, 2, 0)))
PLACES = {
    "friction": SAVES,
    "normal-force": SAVES,
    "rails-inside": len(RADII) * (RAIL_SAMPLES + SAVES),
    "rails-apart": 3 * RAIL_SAMPLES,
}


@functools.cache
def problem(order):
    document = {
        "format": 1,
        "scenario": builtin("ball", start=0.0, end=3.0, saves=SAVES),
        "variables": [{"path": "masses[0].mass", "lower": 0.5}],
        "objectives": [{"kind": "reach-place", "place": [1.0, 0.5]}],
        "constraints": list(ORDERS[order]),
    }
    return design.read_problem(tomli_w.dumps(document)).problem


@pytest.mark.parametrize("order", range(len(ORDERS)))
def test_places_belong_to_their_constraint(order):
    layout = problem(order).layout
    names = [constraint["kind"] for constraint in ORDERS[order]]
    assert dict(layout.sizes) == PLACES
    assert list(layout.sizes) == names
    starts = [0, *itertools.accumulate(PLACES[name] for name in names)]
    assert [layout.name(start) for start in starts[:-1]] == names
    for name in names:
        np.testing.assert_array_equal(layout.spread({name: 1.0}), [layout.name(k) == name for k in range(layout.size)])


@functools.cache
def rows(order):
    """The table of constraints, by name, of a design that is the start itself."""
    start = problem(order).space.start
    verified, settings = problem(order).verify(start), design.Settings()
    finished = Design(
        problem=problem(order),
        settings=settings,
        numbers=problem(order).space.values(start),
        check=None,
        progress=Progress("done", 0, start[None], [], start),
        before=verified.designed,
        verified=verified,
        perturbed=problem(order).perturbed(start, AS_BUILT),
    )
    cells = [[cell.strip() for cell in line.strip("| ").split("|")] for line in _constraints(finished)[2:6]]
    return {name: columns for name, *columns in cells}


def violation(words):
    """The violation that a cell states."""
    (number,) = re.findall(r"[\d.]+e[+-]\d+", words)
    return float(number) if "violated" in words or "within" in words else -float(number)


@pytest.mark.thorough
@pytest.mark.parametrize("order", range(len(ORDERS)))
def test_the_table_has_the_numbers_of_each_constraint(order):
    """Those of the forces are evaluated by the constraints themselves along the run, one by one, and those of rails
    are in closed form. Rails do not depend on masses, so that perturbed balls have the same.
    """
    start, cells = problem(order).space.start, rows(order)
    run = problem(order).run(jnp.asarray(start))
    for name in ("friction", "normal-force"):
        expected = float(np.max(np.asarray(problem(order).constraints[name](run))))
        # A cell has three digits, of which the last is rounded.
        assert violation(cells[name][0]) == pytest.approx(expected, rel=5e-3)
        assert cells[name][0] == cells[name][1]
    inside, apart = max(RADII) + CLEARANCE - 1, DISTANCE - 0.05
    assert violation(cells["rails-inside"][0]) == pytest.approx(inside, rel=5e-3)
    # A chord of n is as far as r (1 − cos π/n) within its circle, here 2e-3 of 48 and 2e-5 of 480.
    assert violation(cells["rails-apart"][0]) == pytest.approx(apart, abs=2e-3)
    assert violation(cells["rails-apart"][2]) == pytest.approx(apart, abs=1e-4)
    for name in ("rails-inside", "rails-apart"):
        assert cells[name][0] == cells[name][3]


@pytest.mark.thorough
def test_the_table_does_not_depend_on_the_order():
    assert rows(0) == rows(1) == rows(2)
