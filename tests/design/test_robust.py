"""Designs for many balls at once, beside closed forms of a uniform ball, which rolls alike whatever its mass.

Its kinetic energy at the end, over its weight and radius, is ½ Ω² (D / m + r²) / g r.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import design
from jaxball.design.perturbations import perturbed_system
from tests.support.paper import paper_ball, paper_disk

D, T, PLACE, COUNT, SHARE = 0.4, 2.0, 2.0, 5, 0.5
PROBLEM = f"""
format = 1

[scenario]
format = 1
kind = "ball"
body = {{ mass = 1.0, radius = 1.0, inertia = [{D}, {D}, {D}], gravity = 1.0 }}
initial = {{ Omega = [0.0, 0.3, 0.0] }}
time = {{ start = 0.0, end = {T}, saves = 5 }}
solve = {{ solver = "tsit5", rtol = 1e-9, atol = 1e-9 }}

[[variables]]
path = "initial.Omega[1]"

[[objectives]]
kind = "reach-place"
place = [{PLACE}, 0.0]

[[objectives]]
kind = "stop-at-rest"
weight = 3.0

[[constraints]]
kind = "within"
low = [-9.0, -9.0]
high = [9.0, 9.0]

[[constraints]]
kind = "normal-force"
least = 0.25

[robust]
count = {COUNT}
masses = {SHARE}
offset = 0.0
seed = 4

[search]
starts = 1
steps = 0
rounds = 2
stationary = 1e-8
"""


@functools.cache
def problem():
    return design.read_problem(PROBLEM)


@pytest.fixture(scope="module")
def optimiser():
    return design.Optimiser(problem().problem, problem().settings)


def masses():
    """Those of the perturbed balls."""
    found = problem().problem
    assert found.perturbations is not None
    system = found.space.scenario.system
    assert isinstance(system, jaxball.Ball)
    return 1.0 + np.asarray(found.perturbations.errors(system).shell)


def test_objectives_are_means_over_the_balls(optimiser):
    looked = optimiser.look(np.array([[0.3]]), optimiser.penalised(1))
    rolling = 0.5 * 0.3**2 * (D / masses() + 1)
    expected = np.asarray([(0.3 * T - PLACE) ** 2, np.mean(rolling)])
    np.testing.assert_allclose(looked.at.terms[0], expected, rtol=1e-8)
    assert np.ptp(rolling) > 0.01


def test_optimum_of_the_mean(optimiser):
    """(T Ω − a)² + 3 c Ω², with c = ½ (D ⟨1/m⟩ + 1), is least at Ω = T a / (T² + 3 c)."""
    found = optimiser.run(optimiser.begin(), lambda progress: None)
    c = 0.5 * (D * np.mean(1 / masses()) + 1)
    np.testing.assert_allclose(found.best, [T * PLACE / (T**2 + 3 * c)], rtol=1e-7)


def test_constraints_are_counted_for_each_ball(optimiser):
    looked, found = optimiser.look(np.array([[0.3]]), optimiser.penalised(1)), problem().problem
    parts = found.by_constraint(looked.at.violations[0])
    assert {name: part.shape for name, part in parts.items()} == {
        "within": (COUNT * 5 * 4,),
        "normal-force": (COUNT * 5,),
    }
    np.testing.assert_allclose(parts["normal-force"], 0.25 - 1.0, rtol=1e-8)
    np.testing.assert_allclose(np.max(parts["within"]), 0.3 * T - 9.0, rtol=1e-8)
    np.testing.assert_allclose(np.sum(found.shares), 2.0, rtol=1e-12)


@pytest.mark.parametrize("system", [paper_ball(), paper_disk()], ids=["ball", "disk"])
def test_errors_are_as_large_as_was_said(system):
    given = design.Perturbations(400, 0.02, 0.03, seed=2)
    found = jax.vmap(lambda one: perturbed_system(system, one))(given.errors(system))
    flat = isinstance(system, jaxball.Disk)
    shares = [found.mass / system.mass - 1, *(a.mass / b.mass[None] - 1 for a, b in _groups(found, system))]
    for share in shares:
        assert 0.019 < float(jnp.max(jnp.abs(share))) <= 0.02 + 1e-15
    shift = np.asarray((found.offset - system.offset[None]) / system.radius)
    assert np.all(np.max(np.abs(shift), axis=0) <= 0.03 + 1e-15)
    np.testing.assert_array_equal(np.max(np.abs(shift), axis=0) > 0.029, [True, not flat, True])


def _groups(found, system):
    return zip(found.groups, system.groups, strict=True)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("count = 5", "count = 0"), r"robust\.count"),
        (("masses = 0.5", "masses = 1.0"), "Key `robust`: Argument `masses` must be"),
        (("offset = 0.0", "offset = -0.1"), r"robust\.offset"),
        (("seed = 4", "sead = 4"), "did you mean `seed`"),
    ],
)
def test_sets_of_balls_that_cannot_be_are_told(change, words):
    with pytest.raises(jaxball.ScenarioError, match=words):
        design.read_problem(PROBLEM.replace(*change))
