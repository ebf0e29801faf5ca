"""Sliding and flying bodies: closed forms, balances of momentum, Jellett's integral, and the disk in the ball."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.physics.contact import friction
from jaxball.physics.contact.released import (
    Motion,
    ReleasedState,
    Response,
    energy_of_released,
    rates,
    response,
    slip_velocity,
)
from jaxball.physics.dynamics.equations import angles_in_state
from jaxball.physics.dynamics.moments import moments
from tests.support.differences import slope
from tests.support.precision import differences_need_float64
from tests.support.systems import ball_state, disk_state, random_cases, random_disks, stacked

ROUNDING = 1e-12
E3 = np.array([0.0, 0.0, 1.0])
D, M, R, G = 0.6, 1.3, 0.9, 2.0
K = D / (M * R**2)
MU = 0.3


def sliding_rates(system, t, state, mu):
    """The force of the plane and the rates, where the body slips."""
    found = response(system, t, state)
    interaction = friction.sliding(found, mu, friction.slip_direction(slip_velocity(system, t, state), jnp.zeros(2)))
    return interaction, rates(system, state, found, interaction.amounts)


def flying_rates(system, t, state):
    found = response(system, t, state, jnp.asarray(False))
    interaction = friction.flight(found)
    return interaction, rates(system, state, found, interaction.amounts)


def momenta(system, t, state):
    """Linear momentum, and angular momentum about the origin, in space; both mass by mass through moments."""
    body = state.body
    at = moments(system, t, angles_in_state(system, t, body))
    Lambda, Omega = body.Lambda, body.Omega
    P = at.M * state.V + Lambda @ (jnp.cross(Omega, at.p) + at.pdot)
    centre = jnp.append(body.z, state.height)
    L = Lambda @ (at.J @ Omega + at.l) + jnp.cross(Lambda @ at.p, state.V) + jnp.cross(centre, P)
    return P, L


def along(function, t, state, changes):
    return jax.jvp(function, (t, state), (jnp.ones_like(t), changes))


@jax.jit
@jax.vmap
def balances(system, t, state, mu):
    """The momenta's rates while it slides and while it flies, the forces, and what they must be."""
    place = jnp.append(state.body.z, state.height)
    at = moments(system, t, angles_in_state(system, t, state.body))
    weight = -system.gravity * jnp.asarray(E3)
    of_weight = jnp.cross(at.M * place + state.body.Lambda @ at.p, weight)
    found = []
    for interaction, changes in (sliding_rates(system, t, state, mu), flying_rates(system, t, state)):
        rate = along(lambda t, x: momenta(system, t, x), t, state, changes)[1]
        F, touched = system.force(t), place - system.radius * jnp.asarray(E3)
        torque = jnp.cross(place, F) + jnp.cross(touched, interaction.R) + of_weight
        found.append((rate, (interaction.R + F + at.M * weight, torque), interaction))
    return found


@functools.cache
def balanced():
    system, t, states = random_cases("driven", seed=41)
    rng = np.random.default_rng(42)
    V = jnp.asarray(rng.normal(size=(t.size, 3)))
    state = ReleasedState(states, V, jnp.asarray(rng.normal(size=t.size)))
    mu = jnp.asarray(rng.uniform(0.1, 0.5, t.size))
    return balances(system, t, state, mu), mu


@pytest.mark.long
def test_momenta_change_by_all_forces():
    """Newton's and Euler's laws for the whole, of bodies with masses on rails, on the plane and in flight."""
    for found, expected, _ in balanced()[0]:
        for x, y in zip(found, expected, strict=True):
            np.testing.assert_allclose(x, y, rtol=ROUNDING, atol=ROUNDING * np.max(np.abs(y)))


@pytest.mark.long
def test_friction_is_on_the_edge_of_the_cone_and_none_acts_in_flight():
    (slides, flies), mu = balanced()
    R = np.asarray(slides[2].R)
    np.testing.assert_allclose(np.hypot(R[:, 0], R[:, 1]), mu * np.abs(R[:, 2]), rtol=1e-12)
    assert np.all(slides[2].slip_acceleration[:, 2] == 0)
    assert np.all(flies[2].R == 0)


def homogeneous(**changes):
    return jaxball.Ball(mass=M, inertia=(D, D, D), radius=R, gravity=G, **changes)


def sliding_state(V, Omega, q=(0.6, 0.0, 0.8, 0.0), z=(0.0, 0.0)):
    return ReleasedState(jaxball.BallState(q=q, Omega=Omega, z=z), jnp.asarray(V), jnp.zeros(()))


@jax.jit
def seen(ball, state, mu):
    """The slip, D, and what slides, flies and rolls."""
    t = jnp.zeros(())
    found = response(ball, t, state)
    return (
        slip_velocity(ball, t, state),
        found,
        sliding_rates(ball, t, state, mu),
        friction.rolling(found),
        friction.first_slip(found, mu),
    )


def test_homogeneous_ball_on_a_level_plane():
    """D = diag(1 + 1/k, 1 + 1/k, 1)/M, and v̇ = −μ g σ, ω̇ = μ M g r/d e3 × σ: σ stays, and the path is a parabola."""
    state = sliding_state((0.7, -0.2, 0.0), (0.3, 0.5, -0.4))
    slip, found, (interaction, changes), rolling, _ = seen(homogeneous(), state, jnp.asarray(MU))
    omega = np.asarray(state.body.Lambda) @ np.asarray(state.body.Omega)
    np.testing.assert_allclose(slip, state.V - R * np.cross(omega, E3), atol=1e-15)
    sigma = np.asarray(slip / np.linalg.norm(slip))
    np.testing.assert_allclose(found.delassus, np.diag([1 + 1 / K, 1 + 1 / K, 1]) / M, atol=1e-14)
    np.testing.assert_allclose(changes.V, -MU * G * sigma, atol=1e-14)
    omegadot = np.asarray(state.body.Lambda) @ changes.body.Omega
    np.testing.assert_allclose(omegadot, MU * M * G * R / D * np.cross(E3, sigma), atol=1e-14)
    np.testing.assert_allclose(interaction.R, M * G * (E3 - MU * sigma), atol=1e-14)
    np.testing.assert_allclose(interaction.slip_acceleration, -MU * G * (1 + 1 / K) * sigma, atol=1e-14)
    np.testing.assert_allclose(interaction.solvability, 1, atol=1e-15)
    np.testing.assert_allclose(rolling.R, M * G * E3, atol=1e-14)


def test_a_state_with_a_rotation_matrix_slides_alike():
    V = jnp.asarray((0.7, -0.2, 0.0))
    body = sliding_state(V, (0.3, 0.5, -0.4)).body
    ball = homogeneous(offset=(0.1, -0.2, 0.1))
    rotation = jaxball.physics.RotationState(body.Lambda, body.Omega, body.z)
    found, expected = (
        jax.jit(sliding_rates)(ball, jnp.zeros(()), ReleasedState(x, V, jnp.zeros(())), jnp.asarray(MU))[1]
        for x in (rotation, body)
    )
    for x, y in ((found.V, expected.V), (found.body.Omega, expected.body.Omega), (found.body.z, expected.body.z)):
        np.testing.assert_allclose(x, y, atol=1e-14)


@pytest.mark.thorough
def test_ball_on_a_slope_rolls_if_friction_is_more_than_k_over_1_plus_k_of_the_tangent():
    """And slides down with g (sin a − μ cos a) if it is less."""
    a, b = 0.4, 0.7
    state = sliding_state((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    brink = np.tan(a) * K / (1 + K)
    down = np.array([np.cos(b), np.sin(b), 0.0])
    ball = homogeneous(ground=jaxball.Ground(a, b))
    for share in (0.5, 1 - 1e-9, 1 + 1e-9):
        _, found, _, rolling, first = seen(ball, state, jnp.asarray(share * brink))
        assert (friction.margin(rolling.R, jnp.asarray(share * brink)) < 0) == (share < 1)
        assert (first.growth > 0) == (share < 1)
        np.testing.assert_allclose(first.sigma, down[:2], atol=1e-14)
        slides = friction.sliding(found, jnp.asarray(share * brink), first.sigma)
        changes = rates(ball, state, found, slides.amounts)
        np.testing.assert_allclose(changes.V, G * (np.sin(a) - share * brink * np.cos(a)) * down, atol=1e-14)


def test_first_slip_of_an_anisotropic_contact_solves_the_secular_equation():
    """Where D has no coupling with the normal and R₀ = N e3 + f: (κ D⁻¹ + μN) σ = −f, |σ| = 1, has one root κ > 0."""
    S, f, N, mu = np.diag([0.4, 1.7]), np.array([0.9, 0.6]), 2.0, 0.2
    lower, upper = 0.0, 100.0
    for _ in range(200):
        kappa = (lower + upper) / 2
        sigma = -f / (kappa * np.diag(S) + mu * N)
        lower, upper = (kappa, upper) if np.linalg.norm(sigma) > 1 else (lower, kappa)
    free = -np.linalg.solve(S, f)

    def pull(free, s):
        return free - jnp.asarray(np.linalg.inv(S)) @ (mu * N * s), jnp.ones(())

    found = jax.jit(lambda guess: friction.diverging(pull, jnp.asarray(free), guess))(-jnp.asarray(f))
    np.testing.assert_allclose(found.sigma, sigma, atol=1e-14)
    np.testing.assert_allclose(found.growth, kappa, rtol=1e-13)


@jax.jit
@jax.vmap
def begun(S, R, mu):
    """The first slip at a contact with D⁻¹ = S and the reaction R of rolling; what it pulls across itself."""
    none = jnp.zeros(3)
    rows = Motion(jnp.zeros((3, 3)), jnp.zeros((3, 0)), S)
    found = Response(Motion(none, jnp.zeros(0), R), rows, None, none)
    first = friction.first_slip(found, mu)
    pull = friction.sliding(found, mu, first.sigma).slip_acceleration
    return first, first.sigma[0] * pull[1] - first.sigma[1] * pull[0], friction.margin(R, mu)


@pytest.mark.thorough
def test_a_slip_can_begin_just_where_friction_cannot_hold():
    """At any contact, coupled as it may be: one of the two goes on, and never both."""
    rng, count = np.random.default_rng(45), 500
    A = rng.uniform(0, 1, (count, 1, 1)) * rng.normal(size=(count, 3, 3))
    D = A @ np.swapaxes(A, 1, 2) + np.diag([2.0, 2.0, 1.0])
    R = rng.normal(size=(count, 3)) * np.array([0.2, 0.2, 1.0])
    R[:, 2] = np.abs(R[:, 2])
    first, across, margin = begun(*map(jnp.asarray, (np.linalg.inv(D), R, rng.uniform(0.02, 0.5, count))))
    np.testing.assert_array_equal(first.growth > 0, margin < 0)
    assert 50 < np.sum(margin > 0) < count - 50
    np.testing.assert_allclose(across, 0.0, atol=1e-13)


@jax.jit
@jax.vmap
def jellett_rate(ball, state, mu):
    """Jellett's integral d1c r (Ω₁Γ₁ + Ω₂Γ₂) + d3 Ω₃ (rΓ₃ + ℓ) of a Routh sphere, and its rate."""
    t = jnp.zeros(())

    def jellett(t, x):
        at, Omega, Gamma, r = moments(ball, t, (x.body.theta,) * 3), x.body.Omega, x.body.Gamma, ball.radius
        l = at.p[2] / at.M
        across = at.J[0, 0] - at.M * l**2
        return across * r * (Omega[0] * Gamma[0] + Omega[1] * Gamma[1]) + at.J[2, 2] * Omega[2] * (r * Gamma[2] + l)

    return along(jellett, t, state, sliding_rates(ball, t, state, mu)[1])


def test_jellett_is_constant_under_sliding_friction():
    def routh_sphere(rng):
        d = rng.uniform(0.4, 1.0)
        return jaxball.Ball(mass=rng.uniform(0.5, 2), inertia=(d, d, 0.7), offset=(0, 0, rng.uniform(-0.5, 0.5)))

    def state(rng):
        return ReleasedState(ball_state(rng), jnp.asarray(np.append(rng.normal(size=2), 0.0)), jnp.zeros(()))

    value, rate = jellett_rate(stacked(routh_sphere, 20, 1), stacked(state, 20, 2), jnp.linspace(0.1, 1.0, 20))
    assert np.max(np.abs(value)) > 0.5
    np.testing.assert_allclose(rate, 0.0, atol=1e-13)


@jax.jit
@jax.vmap
def disks(disk, t, state, mu):
    """What slides and rolls, of a disk and of the ball that it is in."""
    ball = disk.embed()
    in_space = ReleasedState(state.body.in_space(), state.V, state.height)
    found = []
    for system, start in ((disk, state), (ball, in_space)):
        of = response(system, t, start)
        first = friction.first_slip(of, mu)
        found.append(
            (
                sliding_rates(system, t, start, mu),
                flying_rates(system, t, start),
                friction.rolling(of).R,
                first,
                slip_velocity(system, t, start),
                energy_of_released(system, t, start),
            )
        )
    return found


@pytest.mark.long
def test_the_disk_slides_and_flies_as_the_ball_that_it_is_in():
    system, t, body = random_disks(seed=43)
    rng = np.random.default_rng(44)
    V = rng.normal(size=(t.size, 3)) * np.array([1.0, 0.0, 1.0])
    state = ReleasedState(body, jnp.asarray(V), jnp.zeros(t.size))
    flat, spatial = disks(system, t, state, jnp.full(t.size, 0.03))
    for (of_disk, disk_changes), (of_ball, changes) in zip(flat[:2], spatial[:2], strict=True):
        np.testing.assert_allclose(of_disk.R, of_ball.R, rtol=1e-12, atol=1e-11)
        np.testing.assert_allclose(-disk_changes.body.phidot, changes.body.Omega[:, 1], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(disk_changes.body.z, changes.body.z[:, 0], atol=1e-15)
        np.testing.assert_allclose(disk_changes.V, changes.V, rtol=1e-12, atol=1e-12)
        assert np.all(disk_changes.V[:, 1] == 0)
    (R, first, *others), (spatial_R, spatial_first, *spatial_others) = flat[2:], spatial[2:]
    for x, y in zip((R, *others), (spatial_R, *spatial_others), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-11, atol=1e-11)
    held, slips = R[:, 2] > 0, np.hypot(R[:, 0], R[:, 1]) > 0.03 * R[:, 2]
    assert 5 < np.sum(held & slips) < np.sum(held)
    np.testing.assert_array_equal(first.growth[held] > 0, slips[held])
    np.testing.assert_allclose(first.growth[held & slips], spatial_first.growth[held & slips], rtol=1e-11)
    np.testing.assert_allclose(first.sigma[held & slips], spatial_first.sigma[held & slips], atol=1e-13)
    np.testing.assert_allclose(first.sigma[held & slips, 1], 0, atol=1e-13)


def test_what_holds_a_disk_upright_takes_forces_across_it():
    """A force along e2 changes nothing of a disk that slides or rolls."""
    disk = jaxball.Disk(mass=M, inertia=D, radius=R, gravity=G, offset=(0.1, 0.0, -0.2))
    pushed = jaxball.Disk(**{**disk.arguments, "force": jaxball.physics.HarmonicForce([0.0, 0.7, 0.0])})
    state = ReleasedState(disk_state(np.random.default_rng(3)), jnp.asarray([0.4, 0.0, 0.0]), jnp.zeros(()))
    found = [jax.jit(sliding_rates)(system, jnp.zeros(()), state, jnp.asarray(MU)) for system in (disk, pushed)]
    for x, y in zip(*map(jax.tree.leaves, found), strict=True):
        np.testing.assert_allclose(x, y, atol=1e-15)


@pytest.mark.thorough
@differences_need_float64
def test_derivatives_of_sliding():
    """Of the rates by V and μ, against differences over four points of 1e-3, with errors of about 1e-11."""
    ball = homogeneous(offset=(0.1, -0.05, 0.15), mechanisms=[jaxball.spherical_pendulum(0.4, 0.5)])
    body = jaxball.BallState(Omega=(0.3, 0.5, -0.4), theta=[0.3, -0.2], thetadot=[0.4, 0.6])
    V = jnp.asarray([0.7, -0.2, 0.0])

    @jax.jit
    def rate(V, mu):
        changes = sliding_rates(ball, jnp.zeros(()), ReleasedState(body, V, jnp.zeros(())), mu)[1]
        return jnp.concatenate([changes.V, changes.body.Omega, changes.body.thetadot])

    by_V, by_mu = jax.jit(jax.jacrev(rate, argnums=(0, 1)))(V, jnp.asarray(MU))
    for k in range(2):
        found = slope(lambda h, k=k: rate(V.at[k].add(h), jnp.asarray(MU)), 0.0, 1e-3)
        np.testing.assert_allclose(by_V[:, k], found, atol=1e-9)
    np.testing.assert_allclose(by_mu, slope(lambda mu: rate(V, jnp.asarray(mu)), MU, 1e-3), atol=1e-9)


def test_derivatives_where_nothing_slips_are_numbers():
    """Of sliding without friction, and of sliding in a direction that is given, at v_s = 0."""
    ball, body = homogeneous(offset=(0.1, -0.05, 0.15)), jaxball.BallState()

    def rate(V, mu, sigma):
        state = ReleasedState(body, V, jnp.zeros(()))
        found = response(ball, jnp.zeros(()), state)
        direction = friction.slip_direction(slip_velocity(ball, jnp.zeros(()), state), sigma)
        return friction.sliding(found, mu, direction).slip_acceleration

    derivatives = jax.jit(jax.jacrev(rate, argnums=(0, 1, 2)))(jnp.zeros(3), jnp.asarray(MU), jnp.asarray([0.6, 0.8]))
    assert all(np.all(np.isfinite(x)) for x in derivatives)
    assert np.max(np.abs(derivatives[2])) > 0.1
