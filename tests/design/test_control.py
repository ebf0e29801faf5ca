"""Optimal controls known in closed form, by direct collocation."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
from jaxtyping import Array, Float

from jaxball.design import optimal_control

from .double_integrator import Double, Timed


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


def still(collocation):
    """The path that stays at the start."""
    initial = np.asarray(collocation.problem.initial)
    knots, nodes, controls = collocation.shapes[:3]
    return optimal_control.Path(
        collocation.mesh, np.broadcast_to(initial, knots), np.broadcast_to(initial, nodes), np.zeros(controls)
    )


def double(far=2.0):
    return Double(jnp.asarray(0.0), jnp.asarray(1.0), jnp.asarray(far))


def test_the_least_effort_from_rest_to_rest_is_exact():
    """States of degree 3 are what collocation with three nodes has."""
    collocation = optimal_control.Collocation(double(), np.array([0.0, 0.3, 1.0]), 3)
    found = optimal_control.solve_near(collocation, still(collocation))
    t = np.linspace(0.0, 1.0, 41)
    np.testing.assert_allclose(found.path.inputs(t)[:, 0], 2 * (6 - 12 * t), atol=1e-11)
    np.testing.assert_allclose(found.path.states(t)[:, 0], 2 * (3 * t**2 - 2 * t**3), atol=1e-12)
    np.testing.assert_allclose(found.path.rates(t)[:, 0], found.path.states(t)[:, 1], atol=1e-12)
    assert abs(collocation.cost(found.y, 0.0) - 48.0) < 1e-10
    assert np.max(found.errors) < 1e-12
    assert abs(optimal_control.least_curvature(found) - 2.0) < 1e-10


def test_the_regulator_converges_with_order_twice_the_stages():
    T = 3.0
    problem = Regulator(jnp.asarray(0.0), jnp.asarray(T))
    errors = []
    for intervals in (4, 8):
        collocation = optimal_control.Collocation(problem, np.linspace(0.0, T, intervals + 1), 2)
        found = optimal_control.solve_near(collocation, still(collocation), tolerance=np.inf)
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
    return optimal_control.solve_near(collocation, still(collocation), tolerance=1e-8)


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
    assert optimal_control.least_curvature(pendulum) > 0.1


@pytest.mark.thorough
def test_derivatives_against_differences():
    problem = Pendulum(jnp.asarray(0.0), jnp.asarray(6.0), jnp.asarray(2.5))
    collocation = optimal_control.Collocation(
        problem, np.array([0.0, 2.0, 6.0]), 2, lambda p, k: eqx.tree_at(lambda p: p.angle, p, k)
    )
    random = np.random.default_rng(0)
    y, along, h = *random.normal(size=(2, collocation.size)), 1e-5
    by_y, by_parameter = collocation.jacobian(y, 1.0)
    difference = (collocation.residual(y + h * along, 1.0) - collocation.residual(y - h * along, 1.0)) / (2 * h)
    np.testing.assert_allclose(by_y @ along, difference, atol=1e-8)
    assert abs(by_y - by_y.T).max() == 0
    difference = (collocation.residual(y, 1.0 + h) - collocation.residual(y, 1.0 - h)) / (2 * h)
    np.testing.assert_allclose(by_parameter, difference, atol=1e-8)
