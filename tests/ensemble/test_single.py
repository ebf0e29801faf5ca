"""A run by the engine is the run that `simulate` makes, with its derivatives."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import Disk, DiskState, Fixed, PointMass, Status, simulate
from jaxball.ensemble import simulate_one

TIMES, FINE = [0.0, 1.0, 2.0], 1e-12


def rocking(radius):
    """A disk that rocks on an eccentric mass; within its shell for radii below 1."""
    return Disk(mass=1.0, inertia=1.0, masses=[PointMass(1.0, Fixed((0.0, 0.0, -radius)))])


def test_runs_and_their_derivatives():
    """To 1e-10: between steps, which rounding moves, the interpolation is off by up to eighty times the tolerance."""

    def ends(simulate, radius, **settings):
        return simulate(rocking(radius), TIMES, DiskState(phi=1.0), rtol=FINE, atol=FINE, **settings).state.z

    direction = (jnp.array(0.5),), (jnp.array(1.0),)
    found = jax.jvp(lambda radius: ends(simulate_one, radius), *direction)
    wanted = jax.jvp(lambda radius: ends(simulate, radius, adjoint=diffrax.ForwardMode()), *direction)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-10)
    np.testing.assert_allclose(np.asarray(found)[:, -1], np.asarray(wanted)[:, -1], rtol=1e-10)
    assert np.all(np.asarray(wanted)[:, 1:] != 0)


def test_a_run_that_is_not_possible_has_its_status():
    run = simulate_one(rocking(1.5), TIMES, DiskState(phi=1.0), rtol=FINE, atol=FINE)
    assert int(run.status) == Status.IMPOSSIBLE
    assert np.all(np.isnan(run.state.z))


@pytest.mark.parametrize(
    ("times", "sentence"), [([0.0], r"but its shape is \(1,\)"), ([0.0, 2.0, 1.0], "must be increasing and finite")]
)
def test_wrong_times_are_named(times, sentence):
    with pytest.raises(ValueError, match=sentence):
        simulate_one(rocking(0.5), times)


def test_other_solvers_are_named():
    with pytest.raises(TypeError, match="must be an explicit Runge-Kutta method"):
        simulate_one(rocking(0.5), TIMES, solver=diffrax.Kvaerno5())
