"""Initial configurations: the centre of mass exactly above or below the geometric centre."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Circle, ConstantRate, Driven, Fixed, FunctionLaw, OnRail, PointMass, Tube, balance
from jaxball.paper.systems import ball as paper_ball


@pytest.fixture(scope="module")
def paper():
    return balance(paper_ball(), free=[1, 2])


def test_the_angles_that_the_paper_rounded(paper):
    """The root to 18 digits, found outside this library."""
    assert paper.found
    assert paper.above
    np.testing.assert_allclose(paper.theta, [2.03688467177819188, 0.704424483412206587], atol=1e-13)
    assert paper.residual < 1e-13


def test_every_solution_is_found_and_is_one(paper):
    """Two unit circles' worth of vectors sum to a given one in two ways; here one is above, one below."""
    assert paper.solutions_above.tolist() == [True, False]
    for theta in np.asarray(paper.solutions):
        moved = jaxball.with_angles(paper_ball(), [1, 2], theta)
        centre = jaxball.observe(moved.prepare(), jnp.asarray(0.0), BallState()).centre_of_mass_space
        np.testing.assert_allclose(centre[:2], 0, atol=1e-13)


def test_only_below_when_asked():
    found = balance(paper_ball(), free=[1, 2], above=False)
    assert found.found
    assert not found.above
    assert "exactly below" in found.message


def test_no_solution_says_so_and_how_near():
    """One mass on a circle in the plane of E1 and E3 cannot undo an offset along E2."""
    ball = Ball(
        mass=1.0,
        inertia=(1.0, 1.0, 1.0),
        offset=(0.0, 0.3, 0.0),
        masses=[PointMass(1.0, OnRail(Circle(0.5), ConstantRate(0.1)))],
    )
    answer = balance(ball, free=[0])
    assert not answer.found
    assert answer.residual == pytest.approx(0.15, abs=1e-9)
    assert answer.solutions.shape == (0, 1)
    assert answer.message.startswith("No angles of these masses put the centre of mass exactly above or below")


def test_a_tube_balances_inside_the_shell_only():
    def ball(weight):
        along = PointMass(weight, OnRail(Tube((1.0, 0.0, 0.0)), ConstantRate(0.0)))
        return Ball(mass=1.0, inertia=(1.0, 1.0, 1.0), masses=[along, PointMass(1.0, Fixed((0.4, 0.0, -0.2)))])

    inside = balance(ball(1.0), free=[0])
    assert inside.found
    assert float(inside.theta[0]) == pytest.approx(-0.4, abs=1e-12)
    assert not balance(ball(0.2), free=[0]).found


def test_the_angle_of_a_driven_mass():
    ball = Ball(
        mass=1.0,
        inertia=(1.0, 1.0, 1.0),
        masses=[PointMass(0.5, Driven(Circle(0.7)))],
        law=FunctionLaw(lambda t, state, parameters: 0 * state.theta),
    )
    found = balance(ball, free=[0], above=False, state=BallState(theta=[-1.0], thetadot=[0.0]))
    assert found.found
    assert float(found.theta[0]) == pytest.approx(-np.pi / 2, abs=1e-12)


@pytest.mark.parametrize(
    ("free", "guess", "sentence"),
    [
        ([], None, "must name at least one mass"),
        ([7], None, "must name masses on a rail, from 0 to 2, but it names 7"),
        ([1, 2], [0.0], "must have 2 entries"),
    ],
)
def test_wrong_arguments(free, guess, sentence):
    with pytest.raises(ValueError, match=sentence):
        balance(paper_ball(), free=free, guess=guess)
