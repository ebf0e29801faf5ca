"""Fifty files as MuJoCo compiles and saves them: masses, forces, and accelerations of rolling."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxball import BallState, observe
from jaxball.files.mjcf import read_mjcf
from tests.mjcf.corpus import KINDS, VARIANTS, robot
from tests.mjcf.robots import rotation

START = jnp.array(0.0)
HIGH = 9.0  # above the plane in MuJoCo, where nothing touches: neither masses nor forces depend on the height
# Of the largest: MuJoCo finds the principal axes of inertias by iteration, to 1e-10 of the moments.
ROUNDING = 1e-9


@jax.jit
def energy_and_rates(system, state):
    """The kinetic energy and the rates of rolling states."""
    one = lambda body: (observe(system, START, body).kinetic_energy, type(system).field(system, START, body))  # noqa: E731
    return jax.vmap(one)(state)


def as_mujoco_has_them(model, data, scenario):
    """What takes the velocities (Ω, θ̇) of our rolling ball to those of MuJoCo's free body, and its quaternion."""
    mujoco.mj_forward(model, data)
    element = data.xmat[1].reshape(3, 3).copy()
    start = getattr(scenario.state, "body", scenario.state)  # in most files the sphere does not touch the plane
    axes = element.T @ rotation(start.q)  # of the ball in those of the element
    arm = element.T @ (data.geom_xpos[1] - data.xpos[1])
    return axes, arm


def check(text, seed):
    """A file as read here, compared with MuJoCo's model of it, at a random configuration with some velocities."""
    read = read_mjcf(text)
    scenario, system = read.scenario, read.scenario.system
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    axes, arm = as_mujoco_has_them(model, data, scenario)
    rng, n = np.random.default_rng(seed), model.nv - 6
    q, theta = rng.normal(size=4), 0.5 * rng.normal(size=n)
    turn = rotation(q)
    # As many as a quadratic form of them has coefficients.
    velocities = rng.normal(size=((3 + n) * (4 + n) // 2, 3 + n))
    count = len(velocities)
    states = BallState(
        q=np.tile(q / np.linalg.norm(q), (count, 1)),
        Omega=velocities[:, :3],
        z=np.zeros((count, 2)),
        theta=np.tile(theta, (count, 1)),
        thetadot=velocities[:, 3:],
    )
    energies, rates = energy_and_rates(system, states)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[:] = [0.0, 0.0, HIGH, *np.roll(Rotation.from_matrix(turn @ axes.T).as_quat(), 1), *theta]
    to_free = np.zeros((model.nv, 3 + n))  # v of MuJoCo by (Ω, θ̇), for a ball that rolls
    centre = np.cross(turn.T, [0.0, 0.0, float(system.radius)])  # ω × r e3 by each component of Ω
    lever = turn @ axes.T @ arm
    to_free[:3, :3] = (centre - np.cross(turn.T, lever)).T
    to_free[3:6, :3] = axes
    to_free[6:, 3:] = np.eye(n)
    for k in range(count):
        omega = turn @ velocities[k, :3]
        data.qvel[:] = to_free @ velocities[k]
        mujoco.mj_forward(model, data)
        assert data.ncon == 0
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        energy = data.qvel @ M @ data.qvel / 2
        assert abs(energies[k] - energy) <= ROUNDING * energy
        acceleration = np.concatenate([rates.Omega[k], rates.thetadot[k]])
        moved = to_free @ acceleration
        # The lever turns with the ball, and the centre of the ball moves straight on.
        moved[:3] -= np.cross(omega, np.cross(omega, lever))
        forces = data.qfrc_bias - data.qfrc_passive - data.qfrc_actuator
        # What holds the ball on the plane does no work on any motion that rolls.
        left = to_free.T @ (M @ moved + forces)
        scale = np.max(np.abs(to_free.T @ forces)) + np.max(np.abs(to_free.T @ M @ moved))
        assert np.max(np.abs(left)) <= ROUNDING * scale
    return read


def saved_by_mujoco(text, path):
    """The file as MuJoCo writes it: numbers have six digits then."""
    mujoco.mj_saveLastXML(str(path), mujoco.MjModel.from_xml_string(text))
    return path.read_text()


@pytest.mark.long
@pytest.mark.parametrize(("tree", "forces"), KINDS)
def test_files_have_the_masses_forces_and_accelerations_of_mujoco(tree, forces, tmp_path):
    """For all of (Ω, θ̇), of which the kinetic energy is a quadratic form: M, what it is at rates of 1, and forces.

    A file that MuJoCo has read and saved, in its own way of writing, is compared with its model of that, and is the
    same robot here: with the same parts and the same notes.
    """
    for seed in range(VARIANTS):
        text = robot(tree, forces, seed)
        saved = saved_by_mujoco(text, tmp_path / "saved.xml")
        inertias = [mujoco.MjModel.from_xml_string(version).dof_M0 for version in (text, saved)]
        np.testing.assert_allclose(*inertias, rtol=1e-4)  # six digits of everything that they are computed from
        read, again = (check(version, seed) for version in (text, saved))
        assert jax.tree.structure(read.scenario.system) == jax.tree.structure(again.scenario.system)
        assert read.notes == again.notes
        assert type(read.scenario.state) is type(again.scenario.state)
