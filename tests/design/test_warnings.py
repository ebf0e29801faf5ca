"""What a design could not do is told: of a shell that stays where it is while a mass goes up and down in it."""

import functools

import numpy as np
import pytest

from jaxball.studies import design
from jaxball.studies.design.search.design import Design, warnings
from jaxball.studies.design.search.optimise import Merit, Progress
from tests.support.sentences import refuses

AMPLITUDE, FREQUENCY = 0.3, 3.0
PROBLEM = f"""
format = 1

[scenario]
format = 1
kind = "ball"
body = {{ mass = 1.0, radius = 1.0, inertia = [0.4, 0.4, 0.4], gravity = 1.0 }}
initial = {{ Omega = [0.0, 0.0, 0.0] }}
time = {{ start = 0.0, end = {np.pi / FREQUENCY}, saves = 5 }}
solve = {{ solver = "tsit5", rtol = 1e-9, atol = 1e-9 }}

[[scenario.masses]]
mass = 1.0
rail = {{ kind = "tube", direction = [0.0, 0.0, 1.0] }}
schedule = {{ kind = "sinusoids", theta = 0.0, amplitude = [{AMPLITUDE}], frequency = [{FREQUENCY}] }}

[[variables]]
path = "initial.Omega[1]"

[[objectives]]
kind = "reach-place"
place = [0.3, 0.4]

[[constraints]]
kind = "within"
lower = [0.5, -1.0]
upper = [1.0, 1.0]

[[constraints]]
kind = "within"
lower = [-1.0, -1.0]
upper = [-0.25, 1.0]
"""


@functools.cache
def at_rest():
    found = design.read_problem(PROBLEM).problem
    return found, found.verify(found.space.start)


def told(gradient, tolerance):
    problem, seen = at_rest()
    merit = Merit(0.25, 0.5, gradient)
    progress = Progress("done", 1, problem.space.start[None], [], problem.space.start, merit)
    settings = design.Settings(tolerance=tolerance)
    done = Design(problem, settings, problem.space.start, None, progress, seen.designed, seen, seen.designed)
    return warnings(done)


@pytest.mark.thorough
def test_the_least_normal_force_in_closed_form():
    """M g − m A ω² at the top, where the mass is thrown back."""
    assert abs(at_rest()[1].margin - (1 - AMPLITUDE * FREQUENCY**2 / 2)) < 1e-9


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("words"),
    [
        "the best design violates `within` by 0.5, `within 2` by 0.25; check whether they contradict each other",
        "The ball would leave the plane: its least normal force is -0.35 of its weight",
        "The target of `reach-place` is missed by 0.5 radii",
    ],
)
def test_what_could_not_be_done_is_told(words):
    assert sum(words in warning for warning in told(1e-9, 1e-6)) == 1


@pytest.mark.thorough
def test_a_gradient_that_is_not_finite_is_told():
    assert "The gradient at the best design is not finite" in told(np.nan, 1e-6)[-1]


@pytest.mark.thorough
def test_constraints_that_hold_are_not_told():
    assert not any("violates" in warning for warning in told(1e-9, 0.6))


def test_a_clearance_that_leaves_no_room_is_refused_before_the_search():
    """A rail is nowhere at least as far from the shell as its centre is; a search would report only that it failed."""
    inside = '[[constraints]]\nkind = "rails-inside"\nclearance = {}\n'
    with refuses(design.DesignError, "rails-inside"):
        design.read_problem(PROBLEM + inside.format(1.5))
    assert "rails-inside" in design.read_problem(PROBLEM + inside.format(0.5)).problem.constraints
    varied = '[[variables]]\npath = "body.radius"\nlower = 1.0\nupper = 3.0\n'
    assert design.read_problem(PROBLEM + inside.format(1.5) + varied).problem.space.size == 2
