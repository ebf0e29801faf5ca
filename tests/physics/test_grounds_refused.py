"""What is not built for grounds that are no planes is refused in a sentence, as is a ground that a ball cannot fit."""

import jax.numpy as jnp
import pytest

from jaxball import Ball, BallState, Bowl, ConstantRate, HeightField, Status, problems, simulate
from jaxball.physics import Cylinder, MovingFrame, Paraboloid, ParametricSurface, SphereOutside, TiltingPlane, Turn
from jaxball.physics.grounds.surface import AbstractSurface
from tests.support.sentences import refuses, said

SHELL = {"mass": 1.0, "inertia": (0.4, 0.4, 0.4)}


def rolling(**others):
    return Ball(**SHELL, ground=Bowl(3.0), **others)


def test_fit_of_a_ball():
    """1 − r κ for the largest curvature κ towards the ball, from that of each surface."""
    t, r, u = jnp.array(0.0), jnp.array(0.5), jnp.array([0.7, -0.4])
    across = Cylinder(2.0, outside=True, start=(0.0, 0.0, 1.0))
    slope = 1 + 0.3**2 * 0.7**2 + 0.2**2 * 0.4**2
    gauss, mean = -0.06 / slope**2, (0.3 * (1 + 0.2**2 * 0.4**2) - 0.2 * (1 + 0.3**2 * 0.7**2)) / (2 * slope**1.5)
    saddle = mean + jnp.sqrt(mean**2 - gauss)
    curvatures = [(Bowl(3.0), 1 / 3), (SphereOutside(3.0), -1 / 3), (Cylinder(2.0), 1 / 2), (across, 0.0)]
    curvatures.append((TiltingPlane(about_e1=ConstantRate(0.3, 0.2)), 0.0))
    for ground, kappa in [*curvatures, (Paraboloid((0.3, -0.2)), saddle)]:
        assert jnp.abs(ground.fit(t, r, u) - (1 - r * kappa)) < 1e-9, ground


@pytest.mark.parametrize("ground", [Bowl(3.0), SphereOutside(3.0), TiltingPlane(about_e2=ConstantRate(0.3, 0.2))])
@pytest.mark.parametrize("u", [[0.7, -0.4], 0.7], ids=["ball", "disk"])
def test_fit_in_closed_form_is_that_of_the_derivatives_of_the_ground(ground, u):
    t, r, u = jnp.array(0.6), jnp.array(0.5), jnp.array(u)
    assert jnp.abs(ground.fit(t, r, u) - AbstractSurface.fit(ground, t, r, u)) < 1e-14  # some roundings of numbers of 1


@pytest.mark.thorough
def test_ground_more_curved_than_the_ball():
    ball = Ball(**SHELL, ground=Bowl(0.9))
    (sentence,) = problems(ball, BallState())
    said(sentence, "ground")
    assert simulate(ball, [0.0, 1.0]).status == Status.IMPOSSIBLE


@pytest.mark.thorough
def test_ground_that_folds_on_the_way():
    """A valley x⁴ is flat where the ball starts; where its curvature reaches that of the ball, the run ends."""
    ball = Ball(**SHELL, ground=HeightField(lambda t, x, y, _: x**4))
    run = simulate(ball, [0.0, 0.5, 3.0], BallState(Omega=(0.0, 1.0, 0.0)))
    assert not run.ok
    assert not jnp.any(jnp.isfinite(run.state.z[-1]))


@pytest.mark.parametrize(
    ("make", "error", "named"),
    [
        (lambda: HeightField(lambda x, y: x), TypeError, "function"),
        (lambda: ParametricSurface(lambda t, u1, u2, _: u1), TypeError, "function"),
    ],
)
def test_refused(make, error, named):
    with refuses(error, named):
        make()


@pytest.mark.parametrize(
    ("ground", "name"),
    [
        (Bowl(-1.0), "ground.radius"),
        (Cylinder(2.0, axis=(0.0, 0.0, 0.0)), "ground.axis"),
        (Cylinder(2.0, axis=(0.0, 0.0, 1.0)), "ground.start"),
        (Bowl(3.0, motion=MovingFrame([Turn((0.0, 0.0, 0.0), ConstantRate(0.0))])), "ground.motion.turns[0].axis"),
    ],
)
def test_impossible_numbers_are_named(ground, name):
    assert any(f"`{name}` must" in sentence for sentence in problems(Ball(**SHELL, ground=ground)))


@pytest.mark.thorough
def test_figures_of_a_run_on_a_surface():
    """Figures over time and paths are those of space."""
    run = simulate(rolling(), [0.0, 0.5, 1.0], BallState(z=(2.0, 0.0)))
    V = run.plot("centre_velocity")
    assert max(abs(line.get_ydata()).max() for line in V.lines) > 0.1
