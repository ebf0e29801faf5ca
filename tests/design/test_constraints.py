"""Constraints of bodies whose distances and forces are known."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, strategies as st

import jaxball
from jaxball.studies import design
from jaxball.studies.design.constraints import distance
from jaxball.studies.design.problem.run import Run
from tests.support.paper import paper_ball

TIMES = np.linspace(0.0, 2.0, 101)
R, G = 0.5, 2.0
UP = jaxball.physics.VersorFrame((np.cos(np.pi / 4), np.sin(np.pi / 4), 0.0, 0.0))


def on(rail, theta=0.0, rate=0.0):
    return jaxball.PointMass(1.0, jaxball.OnRail(rail, jaxball.ConstantRate(theta, rate)))


@functools.cache
def held():
    """A shell too heavy to be moved: two level rings one above the other, a third hanging in the lower, and a tube."""
    rings = [jaxball.Circle(0.2, (0.0, 0.0, h), UP) for h in (0.1, -0.1)]
    linked = jaxball.Circle(0.1, (0.2, 0.0, -0.1))
    tube = jaxball.PointMass(1.0, jaxball.OnRail(jaxball.Tube((1.0, 0.0, 0.0)), jaxball.Sinusoids(0.0, (0.3,), (2.0,))))
    masses = [on(rings[0], 0.0, 3.0), on(rings[1], np.pi), on(linked, np.pi / 2), tube]
    ball = jaxball.Ball(mass=1e12, inertia=(1e12, 1e12, 1e12), radius=R, gravity=G, masses=masses)
    trajectory = jaxball.simulate(ball, TIMES, rtol=1e-11, atol=1e-11)
    return Run(ball, jnp.asarray(TIMES), trajectory.state, trajectory.status)


WEIGHT = (1e12 + 4) * G
SECOND = np.sqrt(R / G)


def places():
    """Where the masses are, shape (t, 4, 3)."""
    still = np.zeros_like(TIMES)
    first = [0.2 * np.cos(3 * TIMES), -0.2 * np.sin(3 * TIMES), still + 0.1]
    return np.stack(
        [np.stack(first, axis=1)]
        + [np.broadcast_to(place, (len(TIMES), 3)) for place in ([-0.2, 0.0, -0.1], [0.2, 0.0, 0.0])]
        + [np.stack([0.3 * np.sin(2 * TIMES), still, still], axis=1)],
        axis=1,
    )


def expected():
    """The largest violation of each constraint."""
    theta = np.linspace(0.0, 2 * np.pi, 100001)
    linked = np.hypot(0.2 + 0.1 * np.cos(theta), 0.1 * np.sin(theta) - 0.1)
    first, second = np.triu_indices(4, 1)
    apart = np.min(np.linalg.norm(places()[:, first] - places()[:, second], axis=-1))
    return {
        "inside": (design.RailsInside(0.05), (np.max(linked) + 0.05) / R - 1),
        # The upper rings are 0.2 apart; the third, whose centre is on the second, is 0.1 from both.
        "rails apart": (design.RailsApart(0.12), (0.12 - 0.1) / R),
        "regular": (design.RegularRails(0.15), (0.15 - 0.1) / R),
        "masses apart": (design.MassesApart(0.1), (0.1 - apart) / R),
        "speed": (design.SpeedLimit(0.25), (0.6 - 0.25) * SECOND / R),
        "acceleration": (design.AccelerationLimit(1.0), (0.2 * 9.0 - 1.0) / G),
        "force": (design.ForceLimit(0.0), np.max(1.2 * np.abs(np.sin(2 * TIMES))) / WEIGHT),
        "normal": (design.NormalForce(0.3), 0.3 - 1.0),
        "obstacles": (design.ClearOfObstacles([[0.3, 0.4]], [0.2]), (0.2 - 0.5) / R),
        "rectangle": (design.Within((-1.0, -0.25), (2.0, 2.0)), -0.25 / R),
    }


@functools.cache
def violations():
    """The constraints, computed together."""
    found = {name: constraint for name, (constraint, _) in expected().items()}
    return eqx.filter_jit(lambda run, found: {name: one(run) for name, one in found.items()})(held(), found)


@pytest.mark.long
@pytest.mark.parametrize("name", expected())
def test_violation_in_closed_form(name):
    # Rails are seen as polygons of 48 chords, whose sagitta is 0.2 % of the radius.
    bound = 1e-3 if name in ("inside", "rails apart") else 0.0
    np.testing.assert_allclose(float(jnp.max(violations()[name])), expected()[name][1], rtol=1e-8, atol=bound)


def test_more_chords_leave_more_between_rails():
    """Level rings of radii a and b about one centre, as polygons of n chords, are (a − b) cos(π/n) apart."""
    a, b, least = 0.45, 0.35, 0.05
    rings = [on(jaxball.Circle(radius, (0.0, 0.0, 0.0), UP)) for radius in (a, b)]
    ball = jaxball.Ball(mass=1.0, inertia=(1.0, 1.0, 1.0), radius=R, gravity=G, masses=rings)
    state = jaxball.BallState()
    for chords in (48, 480):
        run = Run(ball, jnp.zeros(1), state, jnp.asarray(0), chords)
        margin = -jnp.max(eqx.filter_jit(design.RailsApart(least))(run))
        np.testing.assert_allclose(margin, ((a - b) * np.cos(np.pi / chords) - least) / R, rtol=1e-12)


def limits():
    """Constraints, and the limit b of each in its units, negative where it is a least one."""
    return {
        "masses apart": (design.MassesApart(0.25), -0.25 / R),
        "speed": (design.SpeedLimit(0.5), 0.5 * SECOND / R),
        "acceleration": (design.AccelerationLimit(1.0), 1.0 / G),
        "force": (design.ForceLimit(0.6), 0.6 / WEIGHT),
        "normal": (design.NormalForce(0.3), np.inf),
        "obstacles": (design.ClearOfObstacles([[0.3, 0.4]], [0.2]), -0.2 / R),
        "rectangle": (design.Within((-1.0, 0.25), (2.0, 2.0)), np.inf),
    }


@functools.cache
def sides():
    """Violations and margins, computed together."""
    found = {name: constraint for name, (constraint, _) in limits().items()}
    return eqx.filter_jit(lambda run, found: {name: (one(run), one.margins(run)) for name, one in found.items()})(
        held(), found
    )


@pytest.mark.long
@pytest.mark.parametrize("name", limits())
def test_margins_are_smooth_violations(name):
    """Where |x| ≤ b is violated by v, (b² − |x|²) / (2 b) = −v (1 + v / (2 b))."""
    violation, margin = map(np.asarray, sides()[name])
    expected = -violation * (1 + violation / (2 * limits()[name][1]))
    np.testing.assert_allclose(margin, expected, rtol=0, atol=1e-13 * np.max(np.abs(violation)))


@pytest.mark.thorough
def test_margins_of_the_shell_are_those_of_the_masses():
    margin = eqx.filter_jit(design.RailsInside(0.05).margins)(held())
    reach = R - 0.05
    np.testing.assert_allclose(margin, (reach**2 - np.sum(places() ** 2, axis=-1)) / (2 * reach * R), atol=1e-14)


@pytest.mark.thorough
def test_contact_of_the_papers_ball():
    """The extremes of its contact force are N = 3.517427 and |f|/N = 0.190594, at t = 6.438."""
    times = np.linspace(0.0, 20.0, 2001)
    trajectory = jaxball.simulate(paper_ball(), times)
    run = Run(paper_ball(), jnp.asarray(times), trajectory.state, trajectory.status)
    least, mu = design.Friction(0.190594), 0.15
    normal, friction, violation, margin, N = eqx.filter_jit(
        lambda run: (
            design.NormalForce(3.517427 / 4)(run),
            least(run),
            design.Friction(mu)(run),
            design.Friction(mu).margins(run),
            run.observables.normal_force / run.weight,
        )
    )(run)
    assert abs(float(jnp.max(normal))) < 3e-6
    assert abs(float(jnp.max(friction))) < 3e-6
    assert abs(times[int(jnp.argmax(friction))] - 6.438) < 0.01
    # With |f| = mu N + v, (mu N² − |f|² / mu) / 2 = −v (N + v / (2 mu)).
    assert np.min(violation) < 0 < np.max(violation)
    np.testing.assert_allclose(margin, -violation * (N + violation / (2 * mu)), atol=1e-13)


@functools.cache
def compiled_distance():
    return jax.jit(distance)


POINT = st.tuples(*(st.floats(-1, 1).map(lambda x: round(x, 3)),) * 3)


@given(a=POINT, to_a=POINT, b=POINT, to_b=POINT)
def test_distance_of_segments_is_the_least_over_their_points(a, to_a, b, to_b):
    """Beside the least over points of one of the distance from the other, by its projection."""
    found = float(compiled_distance()(*(jnp.asarray(x) for x in (a, to_a, b, to_b))))
    a, to_a, b, to_b = (np.asarray(x) for x in (a, to_a, b, to_b))
    points = a + np.linspace(0.0, 1.0, 2001)[:, None] * (to_a - a)
    along = to_b - b
    share = np.clip((points - b) @ along / max(along @ along, 1e-300), 0.0, 1.0)
    least = np.min(np.linalg.norm(points - b - share[:, None] * along, axis=1))
    assert least - 2e-3 < found < least + 1e-9


def test_distance_has_derivatives_where_segments_touch():
    a, b = jnp.asarray([0.0, 0.0, 0.0]), jnp.asarray([1.0, 0.0, 0.0])
    found = jax.grad(lambda a, to_a, b, to_b: distance(a, to_a, b, to_b), argnums=(0, 1, 2, 3))(a, b, a, b)
    assert all(bool(jnp.all(jnp.isfinite(x))) for x in found)
