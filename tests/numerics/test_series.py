"""Constants plus sinusoids and powers of the time, against the formula written out."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import HarmonicSeries, Oscillating
from jaxball.physics import HarmonicForce
from tests.support.sentences import refuses

CONSTANT, AMPLITUDE, POWERS = (0.1, 0.2, 0.3), [(0.2, 0.0, -0.1)], [(1.0, 2.0, 3.0), (0.0, -0.5, 0.25)]


def written_out(t):
    sine = np.sin(2.0 * t + 0.3)
    return (
        np.asarray(CONSTANT)
        + sine * np.asarray(AMPLITUDE[0])
        + np.asarray(POWERS[0]) * t
        + np.asarray(POWERS[1]) * t**2
    )


@pytest.mark.parametrize("t", [0.0, 0.7, -1.3])
def test_motions_and_forces_with_powers(t):
    series = HarmonicSeries(CONSTANT, AMPLITUDE, [2.0], [0.3], POWERS)
    for function in (series, Oscillating(series), HarmonicForce(CONSTANT, AMPLITUDE, [2.0], [0.3], POWERS)):
        np.testing.assert_allclose(function(jnp.array(t)), written_out(t), rtol=1e-14, atol=1e-15)


def test_acceleration_of_a_parabola():
    """χ = 1 + t²/2 has χ̈ = 1 and nothing else."""
    motion = Oscillating(HarmonicSeries((1.0, 0.0, 0.0), powers=[(0.0, 0.0, 0.0), (0.5, 0.0, 0.0)]))
    chi, chidot, chiddot = motion.kinematics(jnp.array(3.0))
    np.testing.assert_array_equal(np.stack([chi, chidot, chiddot])[:, 0], [5.5, 3.0, 1.0])


def test_without_powers_nothing_is_computed_for_them():
    equations = [
        len(jax.make_jaxpr(HarmonicSeries(CONSTANT, AMPLITUDE, [2.0], None, powers))(1.0).eqns)
        for powers in (None, POWERS)
    ]
    assert len(jax.tree.leaves(HarmonicSeries(CONSTANT, AMPLITUDE, [2.0]))) == 4
    assert equations[0] < equations[1]


@pytest.mark.parametrize("powers", [1.0, (1.0, 2.0, 3.0), [(1.0, 2.0)]])
def test_powers_of_another_shape(powers):
    with refuses(ValueError, "powers"):
        HarmonicSeries(CONSTANT, powers=powers)
