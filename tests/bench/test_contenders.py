"""Every solver of the benchmark on problems with closed solutions: kinks, constraints that change, counts."""

import math

import numpy as np
import pytest
from comparison.contenders import ALL
from comparison.problem import Piece, Problem

TOLERANCE = 1e-8


def problem(**parts):
    common = {"title": "", "source": "closed form", "relative": False, "stiff": False, "atol_over_rtol": 1.0}
    return Problem(**common, **parts)


# x' = p x and y' = −p y: the parameter changes at kinks that no solver would meet by itself.
KINKED = problem(
    name="kinked",
    pieces=(Piece(0.0, 0.3, (1.0,)), Piece(0.3, 1.7, (-0.5,)), Piece(1.7, 2.0, (2.0,))),
    initial=(1.0, 1.0),
    rates=lambda t, x, p, functions: [p[0] * x[0], -p[0] * x[1]],
    exact=(math.exp(0.3 - 0.5 * 1.4 + 2.0 * 0.3), math.exp(-0.3 + 0.5 * 1.4 - 2.0 * 0.3)),
    measured=(0, 1),
)
# x'' = -x without parameters.
CIRCLE = problem(
    name="circle",
    pieces=(Piece(0.0, 2.5),),
    initial=(1.0, 0.0),
    rates=lambda t, x, p, functions: [-x[1], x[0]],
    exact=(math.cos(2.5), math.sin(2.5)),
    measured=(0, 1),
)
# The same with |x|² = 1 for the rate of a component that is not zero: the first, then the second.
CIRCLE_DAE = problem(
    name="circle-dae",
    pieces=(Piece(0.0, 0.7, algebraic=0), Piece(0.7, 2.5, algebraic=1)),
    initial=(1.0, 0.0),
    rates=lambda t, x, p, functions: [-x[1], x[0]],
    constraint=lambda x: x[0] * x[0] + x[1] * x[1] - 1.0,
    exact=(math.cos(2.5), math.sin(2.5)),
    measured=(0, 1),
)
PEERS = [name for name, contender in ALL.items() if contender.family.packages]
ONE_OF_A_KIND = ["Adams", "RadauIIA 3", "diffrax Dopri5"]


def outcome(name, problem, tolerance=TOLERANCE):
    contender = ALL[name]
    for package in contender.family.packages:
        pytest.importorskip(package)
    assert contender.refusal(problem) is None
    run = contender.program(problem).run(tolerance)
    run.solve()  # a second solve must not go on from the first
    return run.outcome()


@pytest.mark.long
@pytest.mark.parametrize("name", [*PEERS, *ONE_OF_A_KIND])
def test_kinks_are_met_exactly(name):
    """A solver that smeared a kink over a step would be off by far more than its tolerance."""
    ended = outcome(name, KINKED)
    assert ended.failure == ""
    assert KINKED.error(ended.state) <= 300 * TOLERANCE


@pytest.mark.parametrize("name", PEERS)
def test_problems_without_parameters(name):
    ended = outcome(name, CIRCLE)
    assert ended.failure == ""
    assert CIRCLE.error(ended.state) <= 300 * TOLERANCE


@pytest.mark.long
@pytest.mark.parametrize("name", ["CasADi IDAS", "RadauIIA 3"])
def test_the_algebraic_component_may_change(name):
    """And the constraint holds at the end far better than the solution, because the last component follows from it."""
    ended = outcome(name, CIRCLE_DAE)
    assert ended.failure == ""
    assert CIRCLE_DAE.error(ended.state) <= 300 * TOLERANCE
    assert abs(np.sum(ended.state**2) - 1) <= 10 * TOLERANCE


@pytest.mark.parametrize("name", [name for name in PEERS if name != "heyoka Taylor"])
def test_evaluations_are_reported_and_grow_with_the_tolerance(name):
    coarse, fine = outcome(name, CIRCLE, 1e-4).work.evaluations, outcome(name, CIRCLE, 1e-10).work.evaluations
    assert 0 < coarse < fine


def test_compiling_leaves_no_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    outcome("CasADi CVODES BDF", CIRCLE)
    assert list(tmp_path.iterdir()) == []


def test_explicit_methods_report_neither_jacobians_nor_decompositions():
    work = outcome("SciPy RK45", CIRCLE).work
    assert (work.jacobians, work.decompositions) == (None, None)
    assert work.evaluations >= 6 * work.steps  # the stages of Dormand and Prince's pair that are evaluated anew


def test_a_solve_that_cannot_go_on_fails():
    """x' = x² from 1 has a pole at t = 1."""
    pole = problem(
        name="pole",
        pieces=(Piece(0.0, 2.0),),
        initial=(1.0,),
        rates=lambda t, x, p, functions: [x[0] * x[0]],
        exact=(0.0,),
        measured=(0,),
    )
    assert outcome("diffrax Dopri5", pole).failure != ""
