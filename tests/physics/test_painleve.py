"""Dry rolling friction so large that the normal force has no solution: Painlevé's paradox."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from tests.support.sentences import said

# With s from the contact point to the one heavy mass, friction N μ r against rolling lowers N by μ N times
# m r (p × Γ)·B⁻¹e2: no solution where that is 1 or more.
MASS, PLACE = 2.0, 0.9


def critical():
    """The coefficient at which 1 = μ r (p × Γ)₂ / B₂₂, of a light shell with one mass beside its centre."""
    B = 0.01 + 0.1 + MASS * (1 + PLACE**2)
    return B / (MASS * PLACE)


def rolling(dry, rate, place=(PLACE, 0.0, 0.0), end=1e-3):
    ball = jaxball.Ball(
        mass=0.1,
        inertia=(0.01, 0.01, 0.01),
        masses=[jaxball.PointMass(MASS, jaxball.Fixed(place))],
        resistance=jaxball.Resistance(dry=dry, smoothing=1e-8),
    )
    return jaxball.simulate(ball, [0.0, end], jaxball.BallState(Omega=(0.0, rate, 0.0)))


@pytest.mark.thorough
@pytest.mark.parametrize(("share", "solvable"), [(0.99, True), (1.01, False)])
def test_what_has_no_solution_at_the_start_is_refused(share, solvable):
    run = rolling(share * critical(), 2.0)
    assert run.ok == solvable
    if not solvable:
        assert run.status == jaxball.Status.IMPOSSIBLE
        said(run.message, "resistance.dry")
        assert np.all(np.isnan(run.state.Omega[-1]))
    assert (jaxball.problems(run.system, run.start) == []) == solvable


@pytest.mark.thorough
def test_where_a_run_comes_to_have_no_solution_it_fails():
    """The mass starts above the contact point, where friction does not change N, and comes ahead of it."""
    run = rolling(1.2 * critical(), 4.0, (0.0, 0.0, PLACE), end=1.0)
    assert run.status == jaxball.Status.NOT_FINITE
    assert 0.0 < run.reached < 1.0
    assert "dry friction" in run.message


@pytest.mark.long
def test_free_joints_have_a_part_in_it():
    """N(μ) = N(0) / (1 − μ / μ₀), from the normal force of two small μ, says where the start is refused."""
    start = jaxball.BallState(Omega=(0.0, 2.0, 0.0), theta=[0.4], thetadot=[0.5])

    def robot(dry):
        return jaxball.Ball(
            mass=0.1,
            inertia=(0.01, 0.01, 0.01),
            masses=[jaxball.PointMass(MASS, jaxball.Fixed((PLACE, 0.0, 0.0)))],
            mechanisms=[jaxball.planar_pendulum(1.0, 0.5)],
            resistance=jaxball.Resistance(dry=dry, smoothing=1e-8),
        )

    N = [float(jaxball.observe(robot(dry).prepare(), jnp.array(0.0), start).normal_force) for dry in (0.0, 0.01)]
    critical = 0.01 / (1 - N[0] / N[1])
    assert jaxball.problems(robot(0.9999 * critical), start) == []
    (problem,) = jaxball.problems(robot(1.0001 * critical), start)
    said(problem, "resistance.dry")


def test_the_other_way_has_one():
    """Friction is then raised by what it raises: N(μ) = N(0) / (1 + μ / μ₀), to the smoothing's 1e-8 of the speed."""
    free, braked = (rolling(share * critical(), -0.5) for share in (0.0, 1.01))
    assert braked.ok
    normal = [float(run.observables.normal_force[0]) for run in (free, braked)]
    assert normal[1] == pytest.approx(normal[0] / 2.01, rel=1e-7)
