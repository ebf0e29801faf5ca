"""Bodies with mechanisms side by side are single runs, and have their derivatives."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.simulation.ensemble import simulate_ensemble

TIMES = np.array([0.0, 1.0, 3.0])
STIFFNESS = np.linspace(0.5, 2.0, 6)


def robot(stiffness):
    """A disk with a pendulum on a spring, which a motor's torque turns until it jumps."""
    motor = jaxball.Motor(jaxball.PiecewiseSignal([0.0, 0.7], [0.2]))
    arm = jaxball.planar_pendulum(0.5, 0.6, drive=jaxball.Spring(stiffness) + motor)
    resistance = jaxball.Resistance(rolling=0.1)
    disk = jaxball.Disk(mass=1.0, inertia=0.5, mechanisms=[arm], ground=jaxball.Ground(0.1), resistance=resistance)
    return disk, jaxball.DiskState(theta=[0.3], thetadot=[0.0])


@pytest.mark.thorough
def test_runs_are_single_runs_with_their_derivatives():
    def ends(stiffness):
        disks, starts = jax.vmap(robot)(stiffness)
        return simulate_ensemble(disks, TIMES, starts, lanes=3, max_steps=200).trajectory

    found, change = jax.jvp(lambda x: ends(x).state, (jnp.asarray(STIFFNESS),), (jnp.ones(6),))

    def single(stiffness):
        disk, start = robot(stiffness)
        return jaxball.simulate(disk, TIMES, start, max_steps=200, adjoint=diffrax.ForwardMode()).state

    one = jnp.asarray(STIFFNESS[4])
    wanted, slope = jax.jvp(single, (one,), (jnp.ones(()),))
    for name in ("phi", "phidot", "z", "theta", "thetadot"):
        np.testing.assert_allclose(getattr(found, name)[4], getattr(wanted, name), rtol=0, atol=1e-9)
        np.testing.assert_allclose(getattr(change, name)[4], getattr(slope, name), rtol=0, atol=1e-7)
