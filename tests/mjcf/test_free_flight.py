"""Exported robots in MuJoCo: masses, inertias, and the equations of motion in free flight."""

import dataclasses

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxball import Circle, OnRail, Tube
from jaxball.files.mjcf import to_mjcf
from jaxball.physics.prescribed.schedules import AbstractSchedule
from tests.mjcf.robots import (
    free_ball,
    free_disk,
    in_flight,
    loaded,
    of_shell,
    prescribed_ball,
    random_state,
    scenario,
    sensors,
)

ROUNDING = 1e-12  # some hundred operations with numbers of about 1 to 10; links weigh 1e-15


@pytest.fixture(scope="module", params=[(free_ball, sensors()), (free_disk, {})], ids=["ball", "disk"])
def flight(request):
    """A robot with free joints alone at random states in flight: MuJoCo's model and data, our rates and readings."""
    make, its_sensors = request.param
    system, rng = make(), np.random.default_rng(1)
    found = []
    for _ in range(3):
        state = random_state(rng, system)
        case = dataclasses.replace(scenario(system, state), sensors=its_sensors)
        model, data = loaded(to_mjcf(case).text)
        mujoco.mj_forward(model, data)
        found.append((model, data, *in_flight(system, jnp.asarray(0.0), state, its_sensors)))
    return system, found


@pytest.mark.long
def test_masses_and_inertias_have_their_numbers(flight):
    system, found = flight
    model = found[0][0]
    total = float(system.total_mass)
    assert abs(model.body_mass.sum() - total) <= ROUNDING * total
    for index, mechanism in enumerate(system.mechanisms):
        for i, mass in enumerate(mechanism.mass):
            assert model.body(f"mechanisms[{index}].masses[{i}]").mass[0] == float(mass)
    assert np.array_equal(model.body("shell").inertia, np.broadcast_to(np.asarray(system.inertia), 3))


@pytest.mark.long
def test_accelerations_are_those_of_mujoco(flight):
    system, found = flight
    for _, data, rates, _ in found:
        expected = np.concatenate([of_shell(system, rates), rates.body.thetadot])
        assert np.max(np.abs(data.qacc - expected)) <= ROUNDING * np.max(np.abs(expected))


@pytest.mark.long
def test_sensors_read_what_mujoco_reads(flight):
    system, found = flight
    for _, data, _, read in found:
        for name, expected in read.items():
            rise = (
                np.array([0.0, 0.0, float(system.radius)]) if name == "seen" else 0.0
            )  # its height is that of the centre
            assert np.max(np.abs(data.sensor(name).data - expected - rise)) <= 100 * ROUNDING, name


@pytest.mark.long
def test_prescribed_motions_take_no_other_forces_than_their_servos():
    """With our accelerations, mj_inverse finds no force on the shell and on free joints but the springs'."""
    system, rng = prescribed_ball(), np.random.default_rng(2)
    for t in (0.2, 1.3):
        state = random_state(rng, system)
        case = dataclasses.replace(scenario(system, state), times=np.array([t, t + 1]))
        model, data = loaded(to_mjcf(case).text)
        rates, _ = in_flight(system, jnp.asarray(t), state, {})
        data.qacc[:6] = of_shell(system, rates)
        prescribed = dict(accelerations(system, t))
        own = dict(zip(system.coordinates, np.asarray(rates.body.thetadot), strict=True))
        for name, value in (prescribed | own).items():
            data.joint(name).qacc[:] = value
        mujoco.mj_inverse(model, data)
        free = [*range(6), *(model.joint(name).dofadr[0] for name in own)]
        scale = np.max(np.abs(data.qfrc_inverse))
        assert np.max(np.abs(data.qfrc_inverse[free])) <= ROUNDING * scale
        assert scale > 0.1  # of the prescribed ones


def accelerations(system, t):
    """The accelerations of MuJoCo's joints that move by schedules, by name."""
    t = jnp.asarray(t)
    for index, item in enumerate(system.point_masses):
        on_guide = isinstance(item.motion, OnRail) and isinstance(item.motion.rail, Circle | Tube)
        if on_guide:
            yield f"masses[{index}]", float(item.motion.schedule.derivatives(t)[2])
        else:
            yield from zip(
                (f"masses[{index}].{x}" for x in "xyz"), np.asarray(item.motion.kinematics(t)[2]), strict=True
            )
    for index, mechanism in enumerate(system.mechanisms):
        for a, drive in enumerate(mechanism.drives):
            if isinstance(drive, AbstractSchedule):
                yield f"mechanisms[{index}].joints[{a}]", float(drive.derivatives(t)[2])
