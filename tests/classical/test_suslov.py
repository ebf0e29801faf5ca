"""Suslov's problem: closed forms for a constant and for a moving ξ, and the laws off and on the constraint.

Runs are at tolerance 1e-12, and drift by a few hundred times that.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.physics import classical

TIMES = np.linspace(0.0, 8.0, 33)
TOLERANCES = {"rtol": 1e-12, "atol": 1e-12}
MOMENTS = np.array([1.0, 1.6, 2.1])


def axis(constant, amplitude=((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), frequency=(1.0, 1.0), phase=(0.0, 0.0)):
    """Two sinusoids always, so that all runs share a program."""
    return classical.HarmonicAxis(constant, amplitude, frequency, phase)


def run(inertia, xi, Omega):
    problem = classical.SuslovProblem(inertia=inertia, xi=xi)
    start = classical.RigidBodyState([0.9, 0.3, -0.3, 0.1], Omega)
    return jaxball.simulate(problem, TIMES, start, **TOLERANCES).raise_if_failed()


def plane(xi):
    """Two unit vectors that make a right-handed frame with ξ."""
    n = xi / np.linalg.norm(xi)
    e = np.cross(n, [1.0, 0.0, 0.0])
    e /= np.linalg.norm(e)
    return np.stack([e, np.cross(n, e)], axis=1), n


def closed_form(inertia, xi, Omega0, t):
    """Ω for a constant ξ.

    In the plane across ξ, G ω̇ = (a·ω) J ω with the inertia G there, the products of inertia a with ξ, and
    J a quarter turn. So u = G^½ ω keeps its length √(2E) and turns at a rate (b·u) / √(det G), b = G^−½ a:
    the sine of its angle from b is a hyperbolic tangent of t.
    """
    E, n = plane(xi)
    tensor = np.diag(inertia)
    G, a = E.T @ tensor @ E, E.T @ tensor @ n
    values, vectors = np.linalg.eigh(G)
    root = vectors @ np.diag(np.sqrt(values)) @ vectors.T
    u0, b = root @ E.T @ Omega0, np.linalg.solve(root, a)
    size, unit = np.linalg.norm(u0), b / np.linalg.norm(b)
    across = np.array([-unit[1], unit[0]])
    rate = np.linalg.norm(b) * size / np.sqrt(np.linalg.det(G))
    angle = np.arctanh(across @ u0 / size) + rate * t
    u = size * (np.sign(unit @ u0) / np.cosh(angle)[:, None] * unit + np.tanh(angle)[:, None] * across)
    return np.linalg.solve(root, u.T).T @ E.T


def test_a_constant_xi():
    """From near one of the two steady rotations to the other, which the motion reaches only as t → ∞."""
    xi = np.array([0.5, -0.4, 0.7])
    E, _ = plane(xi)
    Omega0 = E @ np.array([0.9, -0.8])
    trajectory = run(MOMENTS, axis(xi), Omega0)
    expected = closed_form(MOMENTS, xi, Omega0, TIMES)
    np.testing.assert_allclose(expected[0], Omega0, rtol=0, atol=3e-15)
    np.testing.assert_allclose(trajectory.state.Omega, expected, rtol=0, atol=2e-10)
    assert np.max(np.ptp(expected, axis=0)) > 0.5


def test_a_principal_axis_leaves_omega_as_it_is():
    trajectory = run(MOMENTS, axis([0.0, 2.0, 0.0]), [0.4, 0.0, -0.9])
    np.testing.assert_allclose(trajectory.state.Omega - jnp.array([[0.4, 0.0, -0.9]]), 0.0, atol=1e-14)


def test_parallel_transport():
    """For equal moments Ω̇ is along ξ: Ω is carried along ξ on the sphere without turning about it.

    On a cone of half-angle α one turn leaves Ω rotated in its plane by 2π cos α.
    """
    alpha = 0.7
    cone = axis(
        [0.0, 0.0, np.cos(alpha)],
        np.sin(alpha) * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
        [2 * np.pi / TIMES[-1]] * 2,
        [np.pi / 2, 0.0],
    )
    start, end = np.asarray(run((1.5, 1.5, 1.5), cone, [0.0, 0.8, 0.0]).state.Omega)[[0, -1]]
    np.testing.assert_allclose(start @ end / (start @ start), np.cos(2 * np.pi * np.cos(alpha)), rtol=0, atol=1e-11)
    np.testing.assert_allclose(np.linalg.norm(end), np.linalg.norm(start), rtol=4e-13)


@pytest.fixture(scope="module")
def moving():
    xi = axis([0.5, -0.4, 0.7], [[0.3, 0.0, -0.2], [0.0, 0.5, 0.3]], [1.3, 2.1], [0.2, 0.5])
    at_start = np.asarray(xi(jnp.asarray(0.0)))
    E, _ = plane(at_start)
    return run(MOMENTS, xi, E @ np.array([0.9, -0.8]))


def test_laws_while_xi_moves(moving):
    laws = moving.laws
    np.testing.assert_allclose(laws.constraint, 0.0, atol=2e-10)
    np.testing.assert_allclose(laws.energy, laws.energy[0], rtol=2e-10)
    np.testing.assert_allclose(laws.versor_squared, 1.0, rtol=0, atol=5e-11)
    momentum = jax.vmap(moving.system.spatial_momentum)(moving.state)
    assert np.min(np.ptp(momentum, axis=0)) > 0.1, "the reaction turns the momentum, and changes its length"


@jax.jit
@jax.vmap
def balances(t, q, Omega):
    """Ė, d/dt (Λ𝕀Ω) and d/dt ⟨Ω, ξ⟩ by forward mode, each with what it must be; Ω is off the constraint."""
    problem = classical.SuslovProblem(
        inertia=MOMENTS, xi=axis([0.5, -0.4, 0.7], [[0.3, 0.0, -0.2], [0.0, 0.5, 0.3]], [1.3, 2.1])
    )
    state = classical.RigidBodyState(q, Omega)
    rates = jnp.ones_like(t), problem.field(t, state)
    _, change = jax.jvp(problem.laws, (t, state), rates)
    _, turning = jax.jvp(problem.spatial_momentum, (state,), rates[1:])
    reaction = problem.reaction(t, state)
    power = problem.multiplier(t, state) * problem.laws(t, state).constraint
    return (change.energy, power), (turning, state.Lambda @ reaction), (change.constraint, jnp.zeros_like(t))


def test_balances_of_energy_and_momentum():
    """The reaction λξ has the power λ⟨Ω, ξ⟩ and is the torque; nothing else acts."""
    rng = np.random.default_rng(4)
    q = rng.normal(size=(20, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    found = balances(jnp.asarray(rng.uniform(0, 5, 20)), jnp.asarray(q), jnp.asarray(rng.normal(size=(20, 3))))
    for rate, expected in found:
        np.testing.assert_allclose(rate, expected, rtol=0, atol=2e-14)
    assert np.min(np.abs(found[0][1])) > 1e-4


def bent(t, bend):
    """ξ turns about E1, and from ``bend`` on about E2 as well: its rate jumps there."""
    late = jnp.maximum(t - bend, 0.0)
    return jnp.stack([jnp.sin(late), jnp.sin(0.6 * t), jnp.cos(0.6 * t)])


@pytest.mark.thorough
def test_a_bend_of_xi_is_stepped_to():
    """The rate of ξ jumps at an irrational time, which is found in its trace where it is not told."""
    bend = np.sqrt(7.0)
    runs = []
    for kinks in ([bend], [1e9]):
        problem = classical.SuslovProblem(
            inertia=MOMENTS, xi=classical.FunctionAxis(bent, jnp.asarray(bend), kink_times=kinks)
        )
        start = classical.RigidBodyState(Omega=[0.7, 0.5, 0.0])
        runs.append(jaxball.simulate(problem, TIMES, start, rtol=1e-10, atol=1e-10).raise_if_failed())
    told, untold = runs
    assert int(told.rejected) == int(untold.rejected)
    np.testing.assert_allclose(untold.state.Omega, told.state.Omega, rtol=0, atol=1e-12)
    np.testing.assert_allclose(told.laws.constraint, 0.0, atol=5e-9)
    np.testing.assert_allclose(told.laws.energy, told.laws.energy[0], rtol=1e-8)
