"""Parameters recovered from paths that were simulated with noise."""

import functools
import sys
import tomllib

import numpy as np
import pytest

from jaxball.files.scenario import read_document
from jaxball.studies.design import DesignError, DesignSpace, Variable
from jaxball.studies.design.problem.run import run_of
from tests.design.documents import builtin
from tests.support.sentences import refuses

NOISE = 1e-3
PATHS = ("masses[0].mass", "masses[2].rail.radius", "body.offset[2]")


@functools.cache
def recorded():
    """The paper's ball to t = 10, the truth, and its path without noise."""
    document = builtin("ball", start=0.0, end=10.0, saves=201)
    document["solve"] = {"rtol": 1e-9, "atol": 1e-9}
    truth = DesignSpace(document, [Variable((path,)) for path in PATHS])
    return document, np.asarray([truth.start]).ravel(), np.asarray(truth.scenario.simulate().state.z)


@functools.cache
def found(seed):
    """What is found from a path with noise, from a start that is some percent off."""
    document, _, path = recorded()
    values = (1.06, 0.87, -0.04)
    space = DesignSpace(document, [Variable((p,), start=x) for p, x in zip(PATHS, values, strict=True)])
    return space.identify(path + NOISE * np.random.default_rng(seed).normal(size=path.shape))


@pytest.mark.long
def test_the_truth_lies_in_the_intervals():
    truth = np.array([1.0, 0.85, -0.05])
    result = found(1)
    assert result.ok
    assert result.alike == [], str(result)
    # Of three intervals of 99.9 %, all hold the truth in 299 of 300 cases.
    low, high = result.intervals(0.999).T
    assert np.all((low < truth) & (truth < high)), str(result)
    assert np.all(result.deviations < 0.01)


@pytest.mark.long
def test_the_noise_is_found():
    # The relative deviation of an estimate from 399 degrees of freedom is 3.5 %.
    assert abs(found(1).noise / NOISE - 1) < 0.15


@pytest.mark.slow
def test_masses_at_the_centre_cannot_be_told_from_the_shell():
    """With the shell's centre of mass in the geometric centre, both are seen through their sum alone."""
    document = builtin("disk", start=0.0, end=3.0, saves=61)
    document["masses"] = [document["masses"][0], {"mass": 0.5, "position": [0.0, 0.0, 0.0]}]
    space = DesignSpace(document, [Variable((p,)) for p in ("body.mass", "masses[1].mass", "masses[0].rail.radius")])
    path = np.asarray(space.scenario.simulate().state.z)
    result = space.identify(path + NOISE * np.random.default_rng(2).normal(size=path.shape))
    assert result.alike == [("body.mass", "masses[1].mass")]
    assert np.all(np.isinf(result.deviations[:2]))
    assert result.deviations[2] < 0.01
    assert "cannot tell apart body.mass and masses[1].mass" in str(result)


BLOCK = """
format = 1
kind = "disk"
body = { mass = 1.0, radius = 1.0, inertia = 0.5, gravity = 0.0 }
time = { start = 0.0, end = 4.0, saves = 101 }
initial = { theta = [0.62], thetadot = [0.0] }

[[mechanisms]]
masses = [{ mass = 0.5 }]

[[mechanisms.joints]]
kind = "slider"
axis = [0.0, 0.0, 1.0]
force = [{ kind = "spring", stiffness = 8.0 }, { kind = "joint-friction", kinetic = 0.3, static = 0.45 }]
"""
ON_BLOCK = ("mechanisms[0].joints[0].force[0].stiffness", "mechanisms[0].joints[0].force[1].kinetic")


def joint_position(run):
    return run.state.theta


@pytest.mark.slow
def test_a_spring_and_friction_are_found_from_the_motion_of_a_joint():
    """Of a block that turns back five times; without noise, to what 1e-9 of the sum of squares leaves."""
    document = tomllib.loads(BLOCK)
    path = np.asarray(read_document(document).simulate().state.theta)
    space = DesignSpace(document, [Variable((p,), start=x) for p, x in zip(ON_BLOCK, (8.2, 0.33), strict=True)])
    result = space.identify(path, joint_position)
    np.testing.assert_allclose(result.estimates, (8.0, 0.3), atol=1e-4)
    assert result.alike == []


@pytest.mark.long
def test_what_differs_in_numbers_is_compiled_once(monkeypatch):
    """A scenario with another mass, another path and another start are traced no more; what is found is theirs."""
    module, traced = sys.modules["jaxball.studies.design.identify"], []
    monkeypatch.setattr(module, "run_of", lambda *run: traced.append(None) or run_of(*run))
    for mass, radius in ((1.0, 0.8), (1.2, 0.7)):
        before = len(traced)
        document = builtin("disk", start=0.0, end=2.0, saves=21)
        document["body"]["mass"] = mass
        truth = DesignSpace(document, [Variable(("masses[0].rail.radius",), start=radius)])
        path = np.asarray(truth.scenario_of(np.array([radius])).simulate().state.z)
        space = DesignSpace(document, [Variable(("masses[0].rail.radius",), start=radius + 0.02)])
        np.testing.assert_allclose(space.identify(path).estimates, [radius], atol=1e-6)
        assert (len(traced) > before) == (before == 0)


@pytest.mark.thorough
def test_a_path_of_another_shape_than_the_quantity_is_told():
    space = DesignSpace(tomllib.loads(BLOCK), [Variable((ON_BLOCK[0],))])
    with refuses(DesignError, "path"):
        space.identify(np.zeros(101), joint_position)


@pytest.mark.thorough
def test_a_path_of_another_length_is_told():
    document, *_ = recorded()
    with refuses(DesignError, "path"):
        DesignSpace(document, [Variable(("masses[0].mass",))]).identify(np.zeros((3, 2)))


@pytest.mark.thorough
def test_the_first_place_of_a_path_that_is_not_known_is_told():
    document, *_ = recorded()
    path = np.zeros((201, 2))
    path[[7, 9], 1] = np.nan
    with refuses(DesignError, "path[7]"):
        DesignSpace(document, [Variable(("masses[0].mass",))]).identify(path)
