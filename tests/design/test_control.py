"""Optimal controls known in closed form, by direct collocation."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
from jaxtyping import Array, Float

from jaxball.studies.design import optimal_control
from jaxball.studies.design.optimal_control.solution import solve_near
from tests.support.differences import slope

from .double_integrator import Double, Timed, still


class Regulator(Timed):
    """ẋ = u from 1, with the least mean of x² + u² and a free end: x = cosh(T − t) / cosh T, u = −sinh(T − t) / cosh T.

    The mean is tanh(T) / T, from Riccati's equation Ṗ = P² − 1.
    """

    @property
    def initial(self):
        return jnp.ones(1)

    def rate(self, t, x, u):
        return u

    def cost(self, t, x, u):
        return x[0] ** 2 + u[0] ** 2

    def conditions(self, x):
        return jnp.zeros((0,))


class Pendulum(Timed):
    """θ̈ + sin θ = u, from hanging to ``end_angle`` at rest, with the least mean of u²: not linear."""

    angle: Float[Array, ""]

    @property
    def initial(self):
        return jnp.zeros(2)

    def rate(self, t, x, u):
        return jnp.stack([x[1], u[0] - jnp.sin(x[0])])

    def cost(self, t, x, u):
        return u[0] ** 2

    def conditions(self, x):
        return x - jnp.stack([self.angle, jnp.zeros(())])


def double(far=2.0):
    return Double(jnp.asarray(0.0), jnp.asarray(1.0), jnp.asarray(far))


def test_the_least_effort_from_rest_to_rest_is_exact():
    """States of degree 3 are what collocation with three nodes has."""
    collocation = optimal_control.Collocation(double(), np.array([0.0, 0.3, 1.0]), 3)
    found = solve_near(collocation, still(collocation))
    t = np.linspace(0.0, 1.0, 41)
    np.testing.assert_allclose(found.path.inputs(t)[:, 0], 2 * (6 - 12 * t), atol=1e-11)
    np.testing.assert_allclose(found.path.states(t)[:, 0], 2 * (3 * t**2 - 2 * t**3), atol=1e-12)
    np.testing.assert_allclose(found.path.rates(t)[:, 0], found.path.states(t)[:, 1], atol=1e-12)
    assert abs(collocation.cost(found.y, 0.0) - 48.0) < 1e-10
    assert np.max(found.errors) < 1e-12
    assert abs(found.least_curvature() - 2.0) < 1e-10


def test_the_regulator_converges_with_order_twice_the_stages():
    T = 3.0
    problem = Regulator(jnp.asarray(0.0), jnp.asarray(T))
    errors = []
    for intervals in (4, 8):
        collocation = optimal_control.Collocation(problem, np.linspace(0.0, T, intervals + 1), 2)
        found = solve_near(collocation, still(collocation), tolerance=np.inf)
        knots = found.path.knots[:, 0]
        errors.append(np.max(np.abs(knots - np.cosh(T - collocation.mesh) / np.cosh(T))))
        cost = collocation.cost(found.y, 0.0)
    assert 3.5 < np.log2(errors[0] / errors[1]) < 4.5
    assert abs(cost - np.tanh(T) / T) < 1e-5


@pytest.fixture(scope="module")
def pendulum():
    """A pendulum's mesh refined to 1e-8."""
    problem = Pendulum(jnp.asarray(0.0), jnp.asarray(6.0), jnp.asarray(2.5))
    collocation = optimal_control.Collocation(problem, np.linspace(0.0, 6.0, 7), 3)
    return solve_near(collocation, still(collocation), tolerance=1e-8)


def test_the_pendulum_obeys_pontryagin(pendulum):
    """u = −λ2 / 2 with λ̇1 = λ2 cos θ and λ̇2 = −λ1: a boundary-value problem, solved by another program."""

    def rates(t, y):
        angle, speed, u, slope = y
        return np.stack([speed, u - np.sin(angle), slope, -u * np.cos(angle)])

    def ends(a, b):
        return np.array([a[0], a[1], b[0] - 2.5, b[1]])

    t = np.linspace(0.0, 6.0, 61)
    states, u = pendulum.path.states(t), pendulum.path.inputs(t)
    guess = np.vstack([states.T, u.T, np.gradient(u[:, 0], t)])
    found = scipy.integrate.solve_bvp(rates, ends, t, guess, tol=1e-10, max_nodes=20000)
    assert found.success
    assert np.max(pendulum.errors) <= 1e-8
    np.testing.assert_allclose(states, found.sol(t)[:2].T, atol=1e-6)
    np.testing.assert_allclose(u[:, 0], found.sol(t)[2], atol=1e-4)


@pytest.mark.thorough
def test_the_pendulum_is_at_a_minimum(pendulum):
    assert pendulum.least_curvature() > 0.1


@pytest.mark.thorough
def test_derivatives_against_differences():
    problem = Pendulum(jnp.asarray(0.0), jnp.asarray(6.0), jnp.asarray(2.5))
    collocation = optimal_control.Collocation(
        problem, np.array([0.0, 2.0, 6.0]), 2, lambda p, k: eqx.tree_at(lambda p: p.angle, p, k)
    )
    random = np.random.default_rng(0)
    y, along = random.normal(size=(2, collocation.size))
    by_y, by_parameter = collocation.jacobian(y, 1.0)
    expected = slope(lambda s: collocation.residual(y + s * along, 1.0), 0.0, 1e-5, points=2)
    np.testing.assert_allclose(by_y @ along, expected, atol=1e-8)
    assert abs(by_y - by_y.T).max() == 0
    np.testing.assert_allclose(
        by_parameter, slope(lambda p: collocation.residual(y, p), 1.0, 1e-5, points=2), atol=1e-8
    )
