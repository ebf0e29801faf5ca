"""Local coordinates of states: the exponential against SciPy's rotations, and retraction against its inverse."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

import jaxball
from jaxball.numerics import versor
from tests.support.precision import scaled

pytestmark = pytest.mark.any_precision

ROUNDING = scaled(2e-15)  # of numbers up to π, after a dozen operations
exponential, logarithm = jax.jit(versor.exponential), jax.jit(versor.logarithm)
sizes = st.sampled_from([0.0, 1e-12, 1e-6, 5e-3, 9.9e-3, 1.01e-2, 0.3, 2.0, 3.1])
directions = st.tuples(*[st.floats(0.1, 1.0)] * 3)
RANDOM = np.random.default_rng(2)


@pytest.mark.thorough
@given(sizes, directions)
def test_the_exponential_is_that_of_rotations(size, direction):
    vector = size * np.array(direction) / np.linalg.norm(direction)
    expected = np.roll(Rotation.from_rotvec(vector).as_quat(), 1)
    found = np.asarray(exponential(jnp.asarray(vector)))
    np.testing.assert_allclose(found * np.sign(found @ expected), expected, rtol=0, atol=ROUNDING)


@given(sizes, directions)
def test_the_logarithm_is_its_inverse_for_both_versors_of_a_rotation(size, direction):
    """Where the angle is near π, an error of a versor is doubled."""
    vector = jnp.asarray(size * np.array(direction) / np.linalg.norm(direction))
    q = exponential(vector)
    for one in (q, -q):
        np.testing.assert_allclose(logarithm(one), vector, rtol=0, atol=2 * ROUNDING)


def states():
    q = RANDOM.normal(size=4)
    turn = Rotation.from_rotvec(RANDOM.normal(size=3)).as_matrix()
    moving = {"Omega": RANDOM.normal(size=3), "z": RANDOM.normal(size=2), "theta": [0.3], "thetadot": [-1.0]}
    yield jaxball.BallState(q / np.linalg.norm(q), **moving)
    yield jaxball.RotationState(turn, **moving)
    yield jaxball.DiskState(0.4, -1.2, 2.0, [0.3], [-1.0])


@pytest.mark.thorough
@pytest.mark.parametrize("state", list(states()), ids=lambda state: type(state).__name__)
@pytest.mark.parametrize("size", [1e-9, 1e-3, 0.5])
def test_retraction_and_difference_are_inverses_with_unit_slope(state, size):
    """Each number is rounded once when it is added to the state, and once when that is subtracted again."""
    n = len(state.directions)
    xi = jnp.asarray(size * RANDOM.normal(size=n))
    np.testing.assert_allclose(state.difference(state.retract(xi)), xi, rtol=0, atol=2 * ROUNDING)
    slope = jax.jacfwd(lambda xi: state.difference(state.retract(xi)))(jnp.zeros(n))
    np.testing.assert_allclose(slope, np.eye(n), rtol=0, atol=2 * ROUNDING)


def test_directions_are_named_in_their_order():
    state = jaxball.BallState(theta=[0.0], thetadot=[0.0])
    attitude = tuple(f"attitude[{k}]" for k in range(3))
    rates = tuple(f"Omega[{k}]" for k in range(3))
    assert state.directions == (*attitude, *rates, "z[0]", "z[1]", "theta[0]", "thetadot[0]")


def test_a_unit_vector_without_an_attitude_is_refused():
    with pytest.raises(TypeError, match="must have an attitude where local coordinates around it are"):
        _ = jaxball.ReducedState().directions
