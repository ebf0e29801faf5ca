"""Derivatives through switches, forward and reverse, against differences of tightly converged runs.

The parameters are a mass, coefficients of the law and the throw. With h = 1e-4 a difference over six points errs by
rounding over h, some 2e-9, as with 3e-5; with 3e-4 by 5e-8, because what follows five switches has large derivatives.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Contact
from jaxball.physics import Mode, ReleasedState
from tests.support.differences import jacobian

H = 1e-4
BOUND = 1e-8
END = jnp.array([0.0, 7.0])
REVERSE, FORWARD = diffrax.RecursiveCheckpointAdjoint(), diffrax.ForwardMode()
# Comes down, bounces once, slides, rolls, breaks away and rolls again.
START = jnp.array([0.6, 0.12, 0.5, 0.2, 0.3, 1.5, 0.4])
SWITCHES = 5


def run(p, adjoint=REVERSE, tolerance=1e-12):
    """A disk with a mass beside its centre, thrown."""
    mass, mu, e, height, speed, spin, place = p
    disk = jaxball.Disk(
        mass=1.0, inertia=0.5, masses=[jaxball.PointMass(mass, jaxball.Fixed(jnp.stack([place, 0.0 * mass, -place])))]
    )
    thrown = ReleasedState(jaxball.DiskState(phidot=spin), jnp.stack([speed, 0.0 * mass, 0.0 * mass]), height)
    return jaxball.simulate(
        disk,
        END,
        thrown,
        contact=Contact(mu, 1.1 * mu, e, slowest=0.2),
        adjoint=adjoint,
        rtol=tolerance,
        atol=tolerance,
    )


def read(p, adjoint=REVERSE, tolerance=1e-12):
    """The state at the end, the energies taken, and the times of the first switches."""
    done = run(p, adjoint, tolerance)
    end = jax.tree.leaves(jax.tree.map(lambda leaf: leaf[-1], done.state))
    history = done.contact
    return jnp.concatenate(
        [
            *(jnp.ravel(leaf) for leaf in end),
            history.V[-1],
            jnp.stack([history.friction_loss[-1], history.impact_loss[-1]]),
            history.switches.times[:SWITCHES],
        ]
    )


@pytest.fixture(scope="module")
def differences():
    return jacobian(jaxball.jit(lambda p: read(p, tolerance=1e-13)), START, H, points=6)


@pytest.mark.thorough
def test_the_run_has_modes_of_all_kinds():
    done = run(START)
    switches = done.contact.switches
    assert done.ok
    assert int(switches.count) >= SWITCHES
    assert set(np.asarray(switches.source)[: int(switches.count)]) == {Mode.ROLLING, Mode.SLIDING, Mode.FLIGHT}


@pytest.mark.long
@pytest.mark.parametrize("mode", ["forward", pytest.param("reverse", marks=pytest.mark.slow)])
def test_derivatives_are_those_of_converged_runs(differences, mode):
    if mode == "forward":
        found = jaxball.jit(jax.jacfwd(lambda p: read(p, FORWARD)))(START)
    else:
        found = jaxball.jit(jax.jacrev(read))(START)
    scale = np.max(np.abs(differences), axis=1, keepdims=True)
    error = np.abs(np.asarray(found) - differences) / np.maximum(scale, 1.0)
    assert np.max(error) < BOUND
