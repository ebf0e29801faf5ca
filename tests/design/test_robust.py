"""Designs for many balls at once, beside closed forms of a uniform ball, which rolls alike whatever its mass."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.studies import design
from jaxball.studies.design.problem.problem import perturb_system
from jaxball.studies.design.report import write_report
from jaxball.studies.design.search.optimise import Optimiser
from jaxball.studies.design.search.program import Shooting
from tests.support.paper import paper_ball, paper_disk
from tests.support.sentences import refuses

T, PLACE, COUNT, SHARE = 2.0, 2.0, 5, 0.5
PROBLEM = f"""
format = 1

[scenario]
format = 1
kind = "ball"
body = {{ mass = 1.0, radius = 1.0, inertia = [0.4, 0.4, 0.4], gravity = 1.0 }}
initial = {{ Omega = [0.0, 0.2, 0.0] }}
time = {{ start = 0.0, end = {T}, saves = 5 }}
solve = {{ solver = "tsit5", rtol = 1e-9, atol = 1e-9 }}

[[variables]]
path = "initial.Omega[1]"

[[objectives]]
kind = "reach-place"
place = [{PLACE}, 0.0]

[[constraints]]
kind = "within"
lower = [-9.0, -9.0]
upper = [9.0, 9.0]

[[constraints]]
kind = "within"
lower = [-1.0, -1.0]
upper = [1.0, 1.0]

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


class LightAndFar(design.AbstractObjective):
    """z₁² / m at the end."""

    def __call__(self, run):
        return run.z[-1, 0] ** 2 / run.system.mass


@functools.cache
def problem():
    found = design.read_problem(PROBLEM)
    objectives = {**found.problem.objectives, "light and far": LightAndFar(weight=3.0)}
    return found._replace(problem=dataclasses.replace(found.problem, objectives=objectives))


@pytest.fixture(scope="module")
def optimiser():
    return Optimiser(Shooting(problem().problem), problem().settings)


def lightness():
    """⟨1 / m⟩ over the perturbed balls."""
    found = problem().problem
    system = found.space.scenario.system
    assert found.perturbations is not None
    assert isinstance(system, jaxball.Ball)
    masses = 1.0 + np.asarray(found.perturbations.errors(system).shell)
    assert np.ptp(masses) > 0.1
    return np.mean(1 / masses)


@pytest.mark.long
def test_objectives_are_means_over_the_balls(optimiser):
    looked = optimiser.evaluate(np.array([[0.3]]), optimiser.first_multipliers(1))
    expected = np.asarray([(0.3 * T - PLACE) ** 2, (0.3 * T) ** 2 * lightness()])
    np.testing.assert_allclose(looked.at.terms[0], expected, rtol=1e-8)


@pytest.mark.long
def test_optimum_of_the_mean(optimiser):
    """(T Ω − a)² + 3 ⟨1/m⟩ (T Ω)² is least where T Ω = a / (1 + 3 ⟨1/m⟩)."""
    found = optimiser.run(optimiser.begin(), lambda progress: None)
    np.testing.assert_allclose(T * found.best, [PLACE / (1 + 3 * lightness())], rtol=1e-7)


@pytest.mark.thorough
def test_constraints_are_counted_for_each_ball(optimiser):
    looked, found = optimiser.evaluate(np.array([[0.3]]), optimiser.first_multipliers(1)), problem().problem
    parts = found.layout.by_constraint(looked.at.violations[0])
    assert {name: part.shape for name, part in parts.items()} == {"within": (COUNT * 20,), "within 2": (COUNT * 20,)}
    np.testing.assert_allclose([np.max(part) for part in parts.values()], [0.3 * T - 9.0, 0.3 * T - 1.0], rtol=1e-8)
    np.testing.assert_allclose(np.sum(found.layout.shares), 2.0, rtol=1e-12)


@pytest.mark.slow
def test_a_robust_design_is_verified_and_shown_on_balls_that_it_has_not_seen(tmp_path):
    found = problem()
    done = found.problem.optimise(found.settings)
    assert done.feasible
    assert done.verified.apart < 1e-7
    place = PLACE / (1 + 3 * lightness())
    np.testing.assert_allclose(done.verified.violation, place - 1.0, rtol=1e-6)
    np.testing.assert_allclose(done.perturbed.terms[:, 0], (place - PLACE) ** 2, rtol=1e-6)
    assert done.perturbed.terms.shape == (1000, 2)
    write_report(done, "Robust", tmp_path)
    assert "The 1000 perturbed balls have errors of up to 50.0% in masses" in (tmp_path / "report.md").read_text()


@pytest.mark.parametrize("system", [paper_ball(), paper_disk()], ids=["ball", "disk"])
def test_errors_are_as_large_as_was_said(system):
    given = design.Perturbations(400, 0.02, 0.03, seed=2)
    found = jax.vmap(lambda one: perturb_system(system, one))(given.errors(system))
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
    ("change", "named"),
    [
        (("count = 5", "count = 0"), "robust.count"),
        (("masses = 0.5", "masses = 1.0"), "robust"),
        (("offset = 0.0", "offset = -0.1"), "robust.offset"),
        (("seed = 4", "sead = 4"), "seed"),
    ],
)
def test_sets_of_balls_that_cannot_be_are_told(change, named):
    with refuses(jaxball.ScenarioError, named):
        design.read_problem(PROBLEM.replace(*change))
