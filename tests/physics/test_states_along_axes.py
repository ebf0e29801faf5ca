"""What is read off many states at once is what is read off each, along any leading axes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxball import Ball, BallState, Disk, DiskState, observe, problems, simulate
from jaxball.physics import ReducedState, RotationState, vector_field
from jaxball.physics.classical import FreeRigidBody, RigidBodyState
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.sentences import refuses

AXES = [(), (4,), (3, 4), (2, 3, 4)]  # (4,) once was a versor's own


def random(*shape):
    return np.random.default_rng(0).normal(size=shape)


def versors(shape):
    q = random(*shape, 4)
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def rotations(q):
    """Λ of versors, by SciPy."""
    return Rotation.from_quat(q.reshape(-1, 4), scalar_first=True).as_matrix().reshape(*q.shape[:-1], 3, 3)


def agrees(found, expected, within=1e-14):
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected, rtol=0, atol=within)


@pytest.mark.thorough
@pytest.mark.parametrize("shape", AXES)
@pytest.mark.parametrize("kind", [BallState, RigidBodyState])
def test_versors(kind, shape):
    q = versors(shape)
    state, expected = kind(q=q, Omega=random(*shape, 3)), rotations(q)
    agrees(state.Lambda, expected)
    agrees(state.Gamma, expected[..., 2, :])
    agrees(kind(q=3 * q, Omega=state.Omega).projected().q, q)


@pytest.mark.thorough
@pytest.mark.parametrize("shape", AXES)
def test_rotation_matrices(shape):
    expected = rotations(versors(shape))
    state = RotationState(Lambda=expected, Omega=random(*shape, 3), z=random(*shape, 2))
    agrees(state.Gamma, expected[..., 2, :])
    agrees(state.reduce().Gamma, expected[..., 2, :])
    agrees(rotations(np.asarray(state.in_space().q)), expected)
    nearby = RotationState(Lambda=expected * (1 + 1e-9), Omega=state.Omega, z=state.z)
    agrees(nearby.projected().Lambda, expected)


@pytest.mark.thorough
@pytest.mark.parametrize("shape", AXES)
def test_angles_of_disks(shape):
    phi, phidot = random(*shape), random(*shape) + 1
    state = DiskState(phi=phi, phidot=phidot, z=random(*shape))
    expected = Rotation.from_rotvec(np.stack([0 * phi, -phi, 0 * phi], -1).reshape(-1, 3)).as_matrix()
    expected = expected.reshape(*shape, 3, 3)
    agrees(state.Lambda, expected)
    agrees(state.Gamma, expected[..., 2, :])
    agrees(state.Omega, np.stack([0 * phi, -phidot, 0 * phi], -1))
    agrees(state.in_space().Lambda, expected)
    agrees(state.with_Omega(2 * state.Omega).phidot, 2 * phidot)


def test_unit_vectors():
    Gamma = versors((3, 5))[..., :3]
    unit = Gamma / np.linalg.norm(Gamma, axis=-1, keepdims=True)
    agrees(ReducedState(Omega=np.zeros((3, 5, 3)), Gamma=Gamma).projected().Gamma, unit)


@pytest.mark.thorough
def test_the_states_of_a_trajectory_and_of_its_batch():
    times, body = np.linspace(0.0, 1.0, 4), FreeRigidBody(inertia=(1.0, 2.0, 3.0))
    run = simulate(body, times, RigidBodyState(Omega=(0.3, 0.1, 1.0)))
    agrees(run.state.Lambda, rotations(np.asarray(run.state.q)), within=1e-8)
    states = RigidBodyState(q=versors((2,)), Omega=random(2, 3))
    batch = jax.vmap(lambda state: simulate(body, times, state))(states)
    assert batch.state.Lambda.shape == (2, 4, 3, 3)
    for k in range(2):
        one = simulate(body, times, jax.tree.map(lambda leaf, k=k: leaf[k], states))
        for name, found in batch.laws._asdict().items():
            np.testing.assert_allclose(found[k], getattr(one.laws, name), rtol=0, atol=1e-8)


@pytest.mark.long
def test_the_observables_of_an_ensemble_are_those_of_its_runs():
    times = np.linspace(0.0, 1.0, 3)

    def rolling(inertia, offset):
        disk = Disk(mass=1.0, inertia=inertia, offset=jnp.stack([offset, 0 * offset, 0 * offset]))
        return disk, DiskState(phidot=-1.0)

    inertia, offset = np.array([0.5, 0.7, 0.9]), np.array([0.1, 0.2, 0.3])  # as many runs as times
    disks, starts = jax.vmap(rolling)(inertia, offset)
    ensemble = simulate_ensemble(disks, times, starts).trajectory
    found = ensemble.observables
    assert found.normal_force.shape == (3, 3)
    assert ensemble.friction_needed.shape == (3,)
    for k in range(3):
        one = simulate(*rolling(jnp.asarray(inertia[k]), jnp.asarray(offset[k]))[:1], times, DiskState(phidot=-1.0))
        for name in ("normal_force", "friction", "energy", "contact_point"):
            np.testing.assert_allclose(getattr(found, name)[k], getattr(one.observables, name), rtol=0, atol=1e-8)
        np.testing.assert_allclose(ensemble.friction_needed[k], one.friction_needed, atol=1e-8)


THREE = np.zeros((3, 3))  # as many as a vector has components


@pytest.mark.usefixtures("no_type_checks")
@pytest.mark.parametrize("use", [vector_field, observe, lambda system, t, state: problems(system, state, t)])
@pytest.mark.parametrize(
    ("body", "states"),
    [
        (Ball(mass=1.0, inertia=(0.5, 0.6, 0.7)), BallState(q=versors((3,)), Omega=THREE, z=THREE[:, :2])),
        (Ball(mass=1.0, inertia=(0.5, 0.6, 0.7)), RotationState(Lambda=rotations(versors((3,))), Omega=THREE)),
        (Disk(mass=1.0, inertia=0.5, offset=(0.1, 0.0, 0.0)), DiskState(phi=THREE[0], phidot=THREE[0], z=THREE[0])),
        (FreeRigidBody(inertia=(1.0, 2.0, 3.0)), RigidBodyState(q=versors((3,)), Omega=THREE)),
    ],
)
def test_what_is_of_one_state_refuses_many(use, body, states):
    if use is observe and isinstance(body, FreeRigidBody):
        pytest.skip("observe is of balls and disks")
    with refuses(ValueError, "state"):
        use(body, jnp.array(0.0), states)


@pytest.mark.usefixtures("no_type_checks")
def test_what_is_of_a_place_refuses_a_state_that_knows_none():
    with refuses(TypeError, "state"):
        observe(Ball(mass=1.0, inertia=(0.5, 0.6, 0.7)), jnp.array(0.0), ReducedState())


@pytest.mark.thorough
def test_what_is_of_one_trajectory_refuses_many():
    body, times = FreeRigidBody(inertia=(1.0, 2.0, 3.0)), np.linspace(0.0, 1.0, 4)
    batch = jax.vmap(lambda q: simulate(body, times, RigidBodyState(q=q)))(versors((1,)))  # of one alone, too
    for name in ("ok", "message", "problems", "raise_if_failed"):
        with refuses(ValueError, name):
            getattr(batch, name)()


@pytest.mark.long
def test_a_batch_is_evaluated_within_vmap():
    ball, times = Ball(mass=1.0, inertia=(0.5, 0.6, 0.7)), np.array([0.0, 1.0])
    batch = jax.vmap(lambda q: simulate(ball, times, BallState(q=q, Omega=(1.0, 0.2, 0.1)), dense=True))(versors((2,)))
    with refuses(ValueError):
        batch.at(0.5)
    halfway = jax.vmap(lambda run: run.at(0.5))(batch)
    assert halfway.Lambda.shape == (2, 3, 3)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "state", [BallState(), RotationState(), ReducedState((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), DiskState()]
)
def test_rates_of_many_states_are_refused(state):
    """Three of them most of all, whose axis has the length of a vector."""
    many, angles = jax.tree.map(lambda leaf: jnp.stack([leaf] * 3), state), (jnp.zeros(0),) * 3
    with refuses(ValueError, "state"):
        many.rates(jnp.asarray(1.0), jnp.zeros(3), angles, None)
    jax.vmap(lambda state: state.rates(jnp.asarray(1.0), jnp.zeros(3), angles, None))(many)
