"""Initial configurations: the centre of mass exactly above or below the geometric centre."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import (
    Ball,
    BallState,
    Bowl,
    Circle,
    ConstantRate,
    Disk,
    DiskState,
    Driven,
    Fixed,
    FunctionLaw,
    Ground,
    HarmonicSeries,
    HeightField,
    OnRail,
    Oscillating,
    PointMass,
    Tube,
    Turntable,
    balance,
)
from jaxball.paper.systems import ball as paper_ball
from jaxball.physics import Cylinder, MovingFrame, SphereOutside, TiltingPlane, Turn
from tests.support.precision import enable_x64
from tests.support.sentences import refuses, said


@pytest.fixture(scope="module")
def paper():
    return balance(paper_ball(), free=[1, 2])


@pytest.mark.thorough
def test_the_angles_that_the_paper_rounded(paper):
    """The root to 18 digits, found outside this library."""
    assert paper.ok
    assert paper.above
    np.testing.assert_allclose(paper.theta, [2.03688467177819188, 0.704424483412206587], atol=1e-13)
    assert paper.residual < 1e-13


@pytest.mark.thorough
def test_every_solution_is_found_and_is_one(paper):
    """Two unit circles' worth of vectors sum to a given one in two ways; here one is above, one below."""
    assert paper.solutions_above.tolist() == [True, False]
    for theta in np.asarray(paper.solutions):
        moved = jaxball.simulation.with_angles(paper_ball(), [1, 2], theta)
        centre = jaxball.observe(moved.prepare(), jnp.asarray(0.0), BallState()).centre_of_mass_space
        np.testing.assert_allclose(centre[:2], 0, atol=1e-13)


@pytest.mark.thorough
def test_only_below_when_asked():
    found = balance(paper_ball(), free=[1, 2], above=False)
    assert found.ok
    assert not found.above
    assert "exactly below" in found.message


@pytest.mark.thorough
def test_in_float32_a_solution_is_one_up_to_rounding():
    """The same two as in float64, the angles found outside this library, and no copy of either."""
    with enable_x64(False):
        answer = balance(paper_ball(), free=[1, 2])
        assert answer.ok
        assert answer.solutions_above.tolist() == [True, False]
        np.testing.assert_allclose(answer.theta, [2.03688467177819188, 0.704424483412206587], atol=1e-5)
        off = Ball(mass=1.0, inertia=(1.0, 1.0, 1.0), offset=(0.0, 1e-4, 0.0), masses=paper_ball().point_masses[:1])
        assert not balance(off, free=[0]).ok  # by 1e-4, which is no rounding


@pytest.mark.thorough
def test_no_solution_says_so_and_how_near():
    """One mass on a circle in the plane of E1 and E3 cannot undo an offset along E2."""
    ball = Ball(
        mass=1.0,
        inertia=(1.0, 1.0, 1.0),
        offset=(0.0, 0.3, 0.0),
        masses=[PointMass(1.0, OnRail(Circle(0.5), ConstantRate(0.1)))],
    )
    answer = balance(ball, free=[0])
    assert not answer.ok
    assert answer.residual == pytest.approx(0.15, abs=1e-9)
    assert answer.solutions.shape == (0, 1)
    said(answer.message, "0.15")


@pytest.mark.thorough
def test_a_tube_balances_inside_the_shell_only():
    def ball(weight):
        along = PointMass(weight, OnRail(Tube((1.0, 0.0, 0.0)), ConstantRate(0.0)))
        return Ball(mass=1.0, inertia=(1.0, 1.0, 1.0), masses=[along, PointMass(1.0, Fixed((0.4, 0.0, -0.2)))])

    inside = balance(ball(1.0), free=[0])
    assert inside.ok
    assert float(inside.theta[0]) == pytest.approx(-0.4, abs=1e-12)
    assert not balance(ball(0.2), free=[0]).ok


@pytest.mark.thorough
def test_the_angle_of_a_driven_mass():
    ball = Ball(
        mass=1.0,
        inertia=(1.0, 1.0, 1.0),
        masses=[PointMass(0.5, Driven(Circle(0.7)))],
        law=FunctionLaw(lambda t, state, parameters: 0 * state.theta),
    )
    found = balance(ball, free=[0], above=False, state=BallState(theta=[-1.0], thetadot=[0.0]))
    assert found.ok
    assert float(found.theta[0]) == pytest.approx(-np.pi / 2, abs=1e-12)


def disk_on_a_slope(angle, mass=0.5, ground=None):
    """A disk with one mass on a circle of radius 0.6."""
    return Disk(
        mass=1.0,
        inertia=0.5,
        ground=Ground(angle) if ground is None else ground,
        masses=[PointMass(mass, OnRail(Circle(0.6), ConstantRate(-1.0, rate=0.0)))],
    )


@pytest.mark.parametrize("angle", [0.1, -0.15])
def test_on_a_slope_the_mass_takes_up_the_moment_of_the_weight(angle):
    """m ρ cos(θ − a) = −M r sin a, about the contact point."""
    answer = balance(disk_on_a_slope(angle), [0], above=False)
    away = np.arccos(-1.5 * np.sin(angle) / 0.3)
    np.testing.assert_allclose(answer.theta, [angle - away], atol=1e-12)
    said(answer.message)
    upper = balance(disk_on_a_slope(angle), [0], above=True)
    np.testing.assert_allclose(np.exp(1j * np.asarray(upper.theta)), [np.exp(1j * (angle + away))], atol=1e-12)
    assert answer.solutions_above.tolist() == [False]


def test_a_slope_can_be_too_steep():
    """The vertical through the contact point is r sin a from the centre, and the centre of mass at most 0.2."""
    answer = balance(disk_on_a_slope(0.5), [0])
    assert not answer.ok
    assert answer.residual == pytest.approx(np.sin(0.5) - 0.2, abs=1e-9)
    said(answer.message)


@pytest.mark.thorough
def test_a_balanced_ball_on_a_slope_has_no_acceleration():
    """By the equations of motion, however the ball is turned, the slope heads, and its shell is out of balance."""
    frame = jaxball.SphericalFrame(1.4, 0.2)
    still = ConstantRate(0.4, rate=0.0)
    ball = Ball(
        mass=1.0,
        inertia=(0.9, 1.0, 1.1),
        offset=(0.05, -0.02, 0.1),
        gravity=2.0,
        masses=[PointMass(0.7, OnRail(Circle(0.9), still)), PointMass(0.8, OnRail(Circle(0.8, frame=frame), still))],
        ground=Ground(0.2, 0.7),
    )
    state = BallState(q=np.array([0.9, 0.3, 0.3, -0.1]))
    answer = balance(ball, [0, 1], state=state)
    assert len(answer.solutions) >= 2
    for theta in np.asarray(answer.solutions):
        moved = jaxball.simulation.with_angles(ball, [0, 1], theta)
        np.testing.assert_allclose(jaxball.physics.vector_field(moved, jnp.array(0.0), state).Omega, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("ground", "part"),
    [
        (Ground(0.1, motion=Oscillating(HarmonicSeries((0.0, 0.0, 0.0)))), "motion"),
        (Ground(turntable=Turntable(ConstantRate(0.0))), "turntable"),
    ],
)
def test_nothing_rests_on_a_plane_that_moves(ground, part):
    ball = Ball(mass=1.0, inertia=(1.0, 1.0, 1.0), ground=ground)
    with refuses(ValueError, "system"):
        balance(ball, [0])


@pytest.mark.parametrize(
    ("free", "guess", "named"),
    [
        ([], None, "free"),
        ([7], None, "free"),
        ([1, 2], [0.0], "guess"),
    ],
)
def test_wrong_arguments(free, guess, named):
    with refuses(ValueError, named):
        balance(paper_ball(), free=free, guess=guess)


def in_a_pipe(angle):
    """A disk of radius 1 in a pipe of radius 5, at an angle from the lowest line, as `disk_on_a_slope` otherwise."""
    pipe = Cylinder(5.0, axis=(0.0, 1.0, 0.0), centre=(0.0, 0.0, 5.0))
    return disk_on_a_slope(angle, ground=pipe), DiskState(z=5.0 * angle)


@pytest.mark.usefixtures("no_type_checks")
@pytest.mark.parametrize(
    ("free", "theta", "error", "named"),
    [
        ([5], [0.0], ValueError, "free"),
        ([0, 1], [0.0], ValueError, "theta"),
        ([0], 0.0, ValueError, "theta"),
        (1, [0.0], TypeError, "free"),
    ],
)
def test_angles_of_masses_that_there_are_not(free, theta, error, named):
    with refuses(error, named):
        jaxball.simulation.with_angles(paper_ball(), free, theta)


@pytest.mark.parametrize("angle", [0.1, -0.15])
def test_on_a_curve_the_mass_takes_up_the_moment_of_the_weight(angle):
    """The centre of mass is over the contact point, which is r sin φ beside the centre: m ρ cos θ = M r sin φ.

    An angle of a Circle is from e1 to e3, and so it is in space, where the disk is not turned.
    """
    disk, state = in_a_pipe(angle)
    answer = balance(disk, [0], above=False, state=state)
    away = np.arccos(1.5 * np.sin(angle) / 0.3)
    np.testing.assert_allclose(answer.theta, [-away], atol=1e-12)
    said(answer.message)
    moved = jaxball.simulation.with_angles(disk, [0], answer.theta)
    np.testing.assert_allclose(jaxball.physics.vector_field(moved, jnp.array(0.0), state).phidot, 0.0, atol=1e-12)


@pytest.mark.thorough
def test_a_balanced_ball_on_a_hill_has_no_acceleration():
    """By the equations of motion; at the lowest point of a bowl the centre of mass is exactly below the centre."""
    still = ConstantRate(0.4, rate=0.0)
    frame = jaxball.SphericalFrame(1.4, 0.2)
    masses = [PointMass(0.7, OnRail(Circle(0.9), still)), PointMass(0.8, OnRail(Circle(0.8, frame=frame), still))]
    state = BallState(q=np.array([0.9, 0.3, 0.3, -0.1]), z=(0.4, -0.2))
    shell = {"mass": 1.0, "inertia": (0.9, 1.0, 1.1), "offset": (0.05, -0.02, 0.1), "masses": masses}
    ball = Ball(**shell, ground=SphereOutside(4.0))
    answer = balance(ball, [0, 1], state=state)
    assert len(answer.solutions) >= 2
    for theta in np.asarray(answer.solutions):
        moved = jaxball.simulation.with_angles(ball, [0, 1], theta)
        np.testing.assert_allclose(jaxball.physics.vector_field(moved, jnp.array(0.0), state).Omega, 0.0, atol=1e-12)
    bottom = balance(Ball(**shell, ground=Bowl(4.0)), [0, 1], above=False)
    said(bottom.message)


@pytest.mark.parametrize(
    ("ground", "named"),
    [
        (TiltingPlane(about_e2=ConstantRate(0.1, rate=0.2)), "system"),
        (Bowl(3.0, motion=MovingFrame([Turn((0.0, 0.0, 1.0), ConstantRate(0.0, rate=1.0))])), "system"),
        (HeightField(lambda t, x, y, _: 2.0 + 0.0 * x + 0.1 * t**2), "system"),
        (HeightField(lambda t, x, y, _: jnp.sqrt(x - 1.0)), "state"),
    ],
)
def test_nothing_rests_on_a_surface_that_moves_or_ends(ground, named):
    masses = [PointMass(0.5, OnRail(Circle(0.5), ConstantRate(0.0)))]
    ball = Ball(mass=1.0, inertia=(1.0, 1.0, 1.0), masses=masses, ground=ground)
    with refuses(ValueError, named):
        balance(ball, [0])
