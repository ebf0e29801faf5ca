"""Dry rolling friction so large that the normal force has no solution: Painlevé's paradox."""

import numpy as np
import pytest

import jaxball

# With s from the contact point to the one heavy mass, friction N μ r against rolling lowers N by μ N times
# m r (p × Γ)·B⁻¹e2: no solution where that is 1 or more.
MASS, PLACE = 2.0, 0.9


def critical():
    """The coefficient at which 1 = μ r (p × Γ)₂ / B₂₂, of a light shell with one mass beside its centre."""
    B = 0.01 + 0.1 + MASS * (1 + PLACE**2)
    return B / (MASS * PLACE)


def rolling(dry, rate):
    ball = jaxball.Ball(
        mass=0.1,
        inertia=(0.01, 0.01, 0.01),
        masses=[jaxball.PointMass(MASS, jaxball.Fixed((PLACE, 0.0, 0.0)))],
        resistance=jaxball.Resistance(dry=dry, smoothing=1e-8),
    )
    return jaxball.simulate(ball, [0.0, 1e-3], jaxball.BallState(Omega=(0.0, rate, 0.0)))


@pytest.mark.parametrize(("share", "solvable"), [(0.99, True), (1.01, False)])
def test_what_has_no_solution_is_refused(share, solvable):
    run = rolling(share * critical(), 2.0)
    assert run.ok == solvable
    if not solvable:
        assert run.status == jaxball.Status.NOT_FINITE
        assert "dry friction" in run.message
        assert np.all(np.isnan(run.state.Omega[-1]))


def test_the_other_way_has_one():
    assert rolling(1.01 * critical(), -2.0).ok
