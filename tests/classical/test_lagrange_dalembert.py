"""The equations of motion from the Lagrangians alone, in coordinates: Euler's angles, and x, y, z.

Only the energies and the constraints are written down here. Angles keep away from the poles of the
coordinates, and the accelerations agree to a few roundings, 1e-14 of their size.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.numerics import versor
from jaxball.physics import classical
from tests.classical.mechanics import (
    body_rates,
    constrained_accelerations,
    euler_lagrange,
    free_accelerations,
    rotation,
)

CASES = 20


def random_bodies(seed):
    """Moments, a vector, and Euler's angles with their rates."""
    rng = np.random.default_rng(seed)
    angles = np.stack([rng.uniform(-3, 3, CASES), rng.uniform(0.4, 2.7, CASES), rng.uniform(-3, 3, CASES)], axis=1)
    return (
        jnp.asarray(rng.uniform(1.0, 1.9, (CASES, 3))),
        jnp.asarray(rng.normal(size=(CASES, 3))),
        jnp.asarray(angles),
        jnp.asarray(rng.normal(size=(CASES, 3))),
        jnp.asarray(rng.uniform(0.0, 5.0, CASES)),
    )


def state_of(angles, rates):
    return classical.RigidBodyState(versor.from_rotation_matrix(rotation(angles)), body_rates(angles) @ rates)


def acceleration_of(angles, rates, accelerations):
    """Ω̇ from the second derivatives of Euler's angles."""
    _, turning = jax.jvp(body_rates, (angles,), (rates,))
    return body_rates(angles) @ accelerations + turning @ rates


@jax.jit
@jax.vmap
def heavy_tops(inertia, chi, angles, rates, t):
    top = classical.HeavyTop(mass=1.3, inertia=inertia, chi=chi, gravity=2.1)

    def lagrangian(t, angles, rates):
        Omega = body_rates(angles) @ rates
        return 0.5 * jnp.sum(inertia * Omega**2) - 1.3 * 2.1 * rotation(angles)[2] @ chi

    accelerations = free_accelerations(lagrangian, t, angles, rates)
    expected = acceleration_of(angles, rates, accelerations)
    return jaxball.physics.vector_field(top, t, state_of(angles, rates)).Omega, expected


@pytest.mark.thorough
def test_the_heavy_top_in_eulers_angles():
    found, expected = heavy_tops(*random_bodies(1))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14 * np.max(np.abs(expected)))


@jax.jit
@jax.vmap
def suslov_problems(inertia, xi, angles, rates, t):
    axis = classical.HarmonicAxis(xi, [[0.3, -0.2, 0.5]], [1.7], [0.4])
    problem = classical.SuslovProblem(inertia=inertia, xi=axis)
    # Rates that keep the constraint: the part of Ω along ξ is taken away.
    along = axis(t) @ body_rates(angles) @ rates / (axis(t) @ axis(t))
    rates = rates - jnp.linalg.solve(body_rates(angles), along * axis(t))

    def lagrangian(t, angles, rates):
        return 0.5 * jnp.sum(inertia * (body_rates(angles) @ rates) ** 2)

    def constraint(t, angles):
        return axis(t) @ body_rates(angles)

    accelerations, multiplier = constrained_accelerations(lagrangian, constraint, t, angles, rates)
    state = state_of(angles, rates)
    return (
        (jaxball.physics.vector_field(problem, t, state).Omega, acceleration_of(angles, rates, accelerations)),
        (problem.multiplier(t, state), multiplier),
        problem.laws(t, state).constraint,
    )


@pytest.mark.thorough
def test_suslovs_problem_in_eulers_angles():
    accelerations, multipliers, constraint = suslov_problems(*random_bodies(2))
    for found, expected in (accelerations, multipliers):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14 * np.max(np.abs(expected)))
        assert np.min(np.max(np.abs(expected), axis=-1)) > 1e-2
    np.testing.assert_allclose(constraint, 0.0, atol=5e-15)


@jax.jit
@jax.vmap
def particles(place, xdot, ydot):
    particle = classical.NonholonomicParticle(mass=1.3)
    state = classical.ParticleState(*place, xdot, ydot)

    def lagrangian(t, place, velocity):
        return 0.5 * 1.3 * velocity @ velocity

    def constraint(t, place):
        return jnp.stack([-place[1], jnp.zeros_like(t), jnp.ones_like(t)])

    t, velocity = jnp.asarray(0.0), jnp.stack([xdot, ydot, state.zdot])
    expected, multiplier = constrained_accelerations(lagrangian, constraint, t, place, velocity)
    rates = particle.field(t, state)
    _, zddot = jax.jvp(lambda s: s.zdot, (state,), (rates,))
    return jnp.stack([rates.xdot, rates.ydot, zddot, particle.multiplier(t, state)]), jnp.append(expected, multiplier)


@jax.jit
@jax.vmap
def vakonomic_residuals(place, xdot, ydot, pull):
    """The Euler-Lagrange equations of l + λ (ż − y ẋ) for x, y, z and λ."""
    particle = classical.VakonomicParticle(mass=1.3)
    state = classical.VakonomicState(*place, xdot, ydot, multiplier=pull)

    def lagrangian(place, velocity):
        free = 0.5 * 1.3 * velocity[:3] @ velocity[:3]
        return free + place[3] * (velocity[2] - place[1] * velocity[0])

    rates = particle.field(jnp.asarray(0.0), state)
    _, zddot = jax.jvp(lambda s: s.zdot, (state,), (rates,))
    return euler_lagrange(
        lagrangian,
        jnp.append(place, pull),
        jnp.stack([xdot, ydot, state.zdot, rates.multiplier]),
        jnp.stack([rates.xdot, rates.ydot, zddot, jnp.zeros_like(xdot)]),
    )


@pytest.fixture(scope="module")
def places():
    rng = np.random.default_rng(3)
    return [jnp.asarray(x) for x in (rng.normal(size=(CASES, 3)), *rng.normal(size=(3, CASES)))]


def test_the_particle(places):
    found, expected = particles(*places[:3])
    np.testing.assert_allclose(found, expected, rtol=0, atol=3e-15)


def test_the_vakonomic_particle(places):
    np.testing.assert_allclose(vakonomic_residuals(*places), 0.0, atol=5e-15)
