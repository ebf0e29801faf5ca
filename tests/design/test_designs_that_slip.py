"""Designs and identifications of a disk that begins with a slip, against closed forms.

It slides at v − μ g t until v/(3 μ g), and then rolls at ⅔ v, so that it is at ⅔ v T + v²/(18 μ g) at the time T.
"""

import functools
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.studies import design
from jaxball.studies.design import DesignError, DesignSpace, Variable
from tests.support.sentences import refuses

PROBLEM = """
format = 1
title = "A throw that ends at 2"

[scenario]
format = 1
kind = "disk"
body = { mass = 1.0, radius = 1.0, inertia = 0.5, gravity = 1.0 }
contact = { friction = 0.2 }
initial = { velocity = [0.5, 0.0, 0.0], phidot = 0.0 }
time = { start = 0.0, end = 4.0, saves = 9 }
solve = { solver = "dopri5", rtol = 1e-9, atol = 1e-9 }

[[variables]]
path = "initial.velocity[0]"
lower = 0.1
upper = 2.0

[[objectives]]
kind = "reach-place"
place = 2.0

[search]
starts = 1
steps = 10
rounds = 10
tolerance = 1e-8
stationary = 1e-9
"""
MU, T = 0.2, 4.0


def end(v, mu):
    return 2 / 3 * v * T + v**2 / (18 * mu)


def with_constraint(lines):
    return PROBLEM.replace("[search]", f"[[constraints]]\n{lines}\n\n[search]")


def document():
    return tomllib.loads(PROBLEM)["scenario"]


@functools.cache
def problem():
    return design.read_problem(PROBLEM)


@pytest.mark.thorough
def test_where_it_ends_and_the_derivative_of_that():
    posed = problem().problem
    space = DesignSpace(document(), [Variable(("initial.velocity[0]",)), Variable(("contact.friction",))])

    def end_of(x):
        candidate = space.candidate_of(x)
        return design.problem.run.run_of(candidate, posed.pytree.solve()).z[-1, 0]

    value, slopes = jax.value_and_grad(end_of)(jnp.array([0.7, MU]))
    np.testing.assert_allclose(value, end(0.7, MU), rtol=1e-9)
    np.testing.assert_allclose(slopes, [2 / 3 * T + 0.7 / (9 * MU), -(0.7**2) / (18 * MU**2)], rtol=1e-7)


@pytest.mark.thorough
def test_a_throw_is_found(tmp_path):
    found = problem()
    done = found.problem.optimise(found.settings, tmp_path)
    (v,) = done.numbers
    np.testing.assert_allclose(end(v, MU), 2.0, rtol=0, atol=1e-6)
    assert done.verified.apart < 1e-7


@pytest.mark.thorough
def test_its_friction_is_identified():
    times = np.linspace(0.0, T, 9)
    slides = np.minimum(times, 0.9 / (3 * MU))
    path = 0.9 * slides - MU * slides**2 / 2 + 0.6 * (times - slides)
    start = document() | {"initial": {"velocity": [0.9, 0.0, 0.0], "phidot": 0.0}}
    result = DesignSpace(start, [Variable(("contact.friction",), start=0.3)]).identify(path)
    assert result.ok
    np.testing.assert_allclose(result.estimates, [MU], rtol=1e-6)


def test_what_it_cannot_have():
    with refuses(DesignError, "search.intervals"):
        design.search.program.Shooting(problem().problem, intervals=2)
    rail = "[[scenario.masses]]\nmass = 0.1\nposition = [0.5, 0.0, 0.0]\n\n[[variables]]"
    text = with_constraint('kind = "force-limit"\nmost = 1.0').replace("[[variables]]", rail, 1)
    with refuses(DesignError, "contact"):
        _ = design.read_problem(text).problem.layout
