"""Numbers by their paths, as functions of unbounded variables: beside the scenario reader, which is not traced."""

import math
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tomli_w
from hypothesis import given, strategies as st

from jaxball import load_scenario
from jaxball.files.scenario.sources import builtin_text
from jaxball.studies.design import DesignError, DesignSpace, Variable
from jaxball.studies.design.files import read_problem
from jaxball.studies.design.problem.space import Bounds
from tests.design.documents import builtin
from tests.support import corpus
from tests.support.sentences import refuses

PATHS = (
    "masses[2].rail.radius",
    "masses[2].schedule.theta",
    "masses[1].mass",
    "body.offset[2]",
    "masses[1].rail.frame.azimuth",
    "initial.Omega[1]",
    "initial.z[0]",
    "time.end",
)


def with_versor():
    document = builtin("ball", start=0.0, end=5.0, step=0.1)
    document["initial"]["versor"] = [0.5, 0.5, -0.5, 0.5]
    return document, [f"initial.versor[{k}]" for k in range(4)]


def with_axis():
    document = builtin("ball", start=0.0, end=5.0, saves=11)
    document["initial"] = {"axis": [0.3, -0.4, 0.5], "angle": 0.7}
    return document, ["initial.axis[0]", "initial.axis[2]", "initial.angle", "time.start"]


def with_servo():
    document = builtin("ball", start=0.0, end=5.0, saves=11)
    document["actuation"] = {"form": "integrated"}
    return document, ["masses[0].schedule.theta", "masses[1].schedule.theta"]


def with_a_mechanism():
    numbers = ("masses[0].mass", "masses[0].place[2]", "joints[0].force[0].stiffness")
    paths = ["ground.angle", "resistance.rolling", "initial.theta[0]", *(f"mechanisms[0].{path}" for path in numbers)]
    return tomllib.loads(builtin_text("pendulum-on-a-slope")), paths


def with_a_linear_law():
    document = tomllib.loads(corpus.EVERY_MECHANISM)
    return document, ["actuation.theta[0][1]", "actuation.z[0][0]", "actuation.signals[0]"]


def assert_same(candidate, scenario, bound):
    found, read = jax.tree.leaves(candidate), jax.tree.leaves((scenario.system, scenario.state, scenario.times))
    for a, b in zip(found, read, strict=True):
        np.testing.assert_allclose(a, b, rtol=bound, atol=bound)


@pytest.mark.long
@pytest.mark.parametrize(
    ("document", "paths"),
    [
        (builtin("ball", start=0.0, end=5.0, saves=11), list(PATHS)),
        with_versor(),
        with_axis(),
        with_servo(),
        with_a_mechanism(),
        with_a_linear_law(),
    ],
    ids=["ball", "versor", "axis", "driven", "mechanism", "linear law"],
)
def test_candidate_is_what_the_reader_reads(document, paths):
    space = DesignSpace(document, [Variable((path,)) for path in paths])
    assert_same(space.candidate(jnp.asarray(space.start)), space.scenario, 1e-15)
    z = jnp.asarray(space.start + 0.02 * np.random.default_rng(3).normal(size=space.size))
    x = np.asarray(space.numbers(z))
    assert_same(jax.jit(space.candidate)(z), space.scenario_of(x), 1e-14)


def test_a_number_shared_by_several_places():
    paths = ("masses[0].rail.radius", "masses[1].rail.radius", "masses[2].rail.radius")
    shared = Variable(paths, factors=(1.0, 0.9, -0.5), start=0.8)
    space = DesignSpace(builtin("disk"), [shared])
    radii = [item.motion.rail.radius for item in space.candidate(jnp.asarray(space.start)).system.point_masses[:3]]
    np.testing.assert_allclose(radii, [0.8, 0.72, -0.4], rtol=1e-15)


def test_stars_stand_for_every_number_of_a_list():
    space = DesignSpace(builtin("ball"), [Variable(("body.inertia[*]",)), Variable(("masses[*].mass",))])
    assert space.names == tuple([f"body.inertia[{k}]" for k in range(3)] + [f"masses[{k}].mass" for k in range(3)])


SIDES = {
    "free": (-math.inf, math.inf),
    "above": (0.5, math.inf),
    "below": (-math.inf, 2.0),
    "between": (0.5, 2.0),
}


@given(z=st.floats(-20, 20), side=st.sampled_from(sorted(SIDES)))
def test_numbers_stay_within_their_bounds(z, side):
    lower, upper = SIDES[side]
    bounds = Bounds(np.array([lower]), np.array([upper]), np.array([0.3]))
    x = np.asarray(bounds.numbers(jnp.array([z])))
    assert lower <= x[0] <= upper
    if lower + 1e-3 < x[0] < upper - 1e-3:
        np.testing.assert_allclose(bounds.numbers(jnp.asarray(bounds.variables(x))), x, rtol=1e-12)


@pytest.mark.parametrize("side", sorted(SIDES))
def test_a_start_on_a_bound_can_leave_it(side):
    lower, upper = SIDES[side]
    bounds = Bounds(np.array([lower]), np.array([upper]), np.array([0.3]))
    for x in (bound for bound in (lower, upper) if math.isfinite(bound)):
        z = jnp.asarray(bounds.variables(np.array([x])))
        assert abs(float(bounds.numbers(z)[0]) - x) < 1e-3
        assert abs(float(jax.grad(lambda z: bounds.numbers(z)[0])(z)[0])) > 1e-3


@pytest.mark.parametrize(
    ("variables", "named"),
    [
        ([], "A design"),
        ([Variable(("masses[0].mass",))] * 2, "masses[0].mass"),
        ([Variable(("masses[0].mass",), lower=2.0)], "masses[0].mass"),
        ([Variable(("solve.rtol",))], "solve.rtol"),
        ([Variable(("masses[0].mas",))], "variables[0].path"),
        ([Variable(("masses[*].mas",))], "masses[*].mas"),
    ],
)
def test_what_cannot_be_varied_is_told(variables, named):
    with refuses(ValueError, named):
        DesignSpace(builtin("ball"), variables)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"lower": 2.0, "upper": 1.0}, "masses[0].mass"),
        ({"scale": 0.0}, "masses[0].mass"),
        ({"factors": (1.0, 2.0)}, "masses[0].mass"),
    ],
)
def test_variables_that_make_no_sense_are_told(arguments, named):
    with refuses(DesignError, named):
        Variable(("masses[0].mass",), **arguments)


@pytest.mark.thorough
def test_angles_found_by_balance_cannot_be_varied():
    document = builtin("ball")
    document["initial"]["balance"] = {"masses": [1, 2]}
    with refuses(DesignError, "initial.balance"):
        DesignSpace(document, [Variable(("masses[0].rail.radius",))])


def test_an_elevation_over_the_pole_is_written_as_the_same_direction():
    """A search may take an elevation past π/2, where a file's must not be."""
    document = builtin("ball", start=0.0, end=5.0, saves=11)
    space = DesignSpace(document, [Variable(("masses[2].rail.frame.elevation",))])
    x = np.array([1.7])
    written = space.document_of(x)["masses"][2]["rail"]["frame"]
    assert written["elevation"] == pytest.approx(math.pi - 1.7)
    systems = (space.candidate_of(jnp.asarray(x)).system, space.scenario_of(x).system)
    found, read = (system.groups[0].motion.rail.frame for system in systems)
    for k in range(3):
        one, other = (jax.tree.map(lambda leaf, k=k: leaf[k], frame).matrix() for frame in (found, read))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("paths", "named"),
    [
        (("body.inertia",), "variables[1].path"),
        (("body.mass", "masses[0].rail"), "variables[1].path[1]"),
        (("body.mas",), "variables[1].path"),
    ],
)
def test_a_path_that_is_none_of_a_number_is_the_variables_and_not_the_scenarios(paths, named):
    with refuses(DesignError, named):
        DesignSpace(builtin("ball"), [Variable(("masses[0].mass",)), Variable(paths)])
    file = {"scenario": "ball", "variables": [{"path": "masses[0].mass"}, {"path": list(paths)}]}
    with refuses(DesignError, named) as caught:
        read_problem(tomli_w.dumps({"format": 1, **file, "objectives": [{"kind": "go-far"}]}))
    assert "The scenario of the problem" not in str(caught.value)


def test_a_number_left_to_its_default_is_a_variable():
    """The space is that of the document in which the number is written by hand."""
    document = builtin("ball")
    document["body"].pop("offset")
    by_hand = builtin("ball")
    by_hand["body"]["offset"] = [0.0, 0.0, 0.0]
    variables = [Variable(("body.offset[*]",), lower=-0.5, upper=0.5)]
    space, expected = (DesignSpace(item, variables) for item in (document, by_hand))
    assert space.names == expected.names == tuple(f"body.offset[{k}]" for k in range(3))
    x = np.array([0.1, -0.2, 0.3])
    assert_same(space.candidate_of(jnp.asarray(x)), expected.scenario_of(x), 0.0)


def test_a_variable_of_one_path_and_a_document_that_is_a_scenario():
    assert Variable("body.mass", lower=0.1) == Variable(("body.mass",), lower=0.1)
    named = "document"
    with refuses(TypeError, named):
        DesignSpace(load_scenario("disk"), [Variable("body.mass")])  # pyright: ignore[reportArgumentType]
