"""The problems of rail shapes that are shipped: what they ask for, what was found, and a shorter search."""

import dataclasses
import tomllib
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.studies import design
from jaxball.studies.design.search.optimise import Optimiser
from jaxball.studies.design.search.program import Shooting

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = ("problem_rail_shape", "problem_rail_shape_circles", "problem_robust_rails")


@pytest.mark.parametrize("name", NAMES)
def test_problem_asks_for_what_a_robot_could_drive(name):
    found = design.load_problem(EXAMPLES / f"{name}.toml").problem
    following, system = found.objectives["follow-curve"], found.space.scenario.system
    assert isinstance(following, design.FollowCurve)
    assert isinstance(system, jaxball.Ball)
    points, radius = np.asarray(following.curve.points(201)), float(system.radius)
    assert np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)) > 6 * radius
    limits = {name: next(iter(vars(one).values())) for name, one in found.constraints.items()}
    assert {name: float(x) for name, x in limits.items()} == {
        "normal-force": 0.3,
        "friction": 0.4,
        "rails-inside": 0.05,
        "rails-apart": 0.05,
        "regular-rails": 0.1,
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES[:2])
def test_a_short_search_follows_the_curve_to_a_tenth_of_a_radius(name):
    file = design.load_problem(EXAMPLES / f"{name}.toml")
    settings = dataclasses.replace(file.settings, starts=8, rounds=8)
    optimiser = Optimiser(Shooting(file.problem), settings)
    found = optimiser.run(optimiser.begin(), lambda progress: None)
    assert found.merit.violation <= settings.tolerance
    following = file.problem.objectives["follow-curve"]
    assert isinstance(following, design.FollowCurve)
    assert float(following.farthest(file.problem.run(jnp.asarray(found.best)))) < 0.1


@pytest.mark.slow
def test_the_designed_rails_hold_to_what_was_asked_for():
    """Looked at again by another solver, and between the samples."""
    document = tomllib.loads((EXAMPLES / "designed_rails.toml").read_text(encoding="utf-8"))
    space = design.DesignSpace(document, [design.Variable(("masses[0].mass",))])
    found = dataclasses.replace(design.load_problem(EXAMPLES / f"{NAMES[0]}.toml").problem, space=space)
    seen = found.verify(space.start)
    assert seen.violation < 1e-3
    assert seen.apart < 1e-5
    following = found.objectives["follow-curve"]
    assert isinstance(following, design.FollowCurve)
    assert float(following.farthest(found.run(jnp.asarray(space.start)))) < 0.1
