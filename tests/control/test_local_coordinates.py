"""Local coordinates of states: the exponential against SciPy's rotations, and retraction against its inverse."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

import jaxball
from jaxball.control.sampled import SampledSystem
from jaxball.numerics import versor
from tests.support.precision import scaled
from tests.support.sentences import refuses

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
    yield jaxball.physics.RotationState(turn, **moving)
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
    with refuses(TypeError, "state"):
        _ = jaxball.physics.ReducedState().directions


PLATE = jaxball.physics.TiltingPlane(jaxball.ConstantRate(0.0))


@pytest.mark.parametrize("state", [state for state in states() if not isinstance(state, jaxball.DiskState)], ids=type)
@pytest.mark.parametrize("inertia", [(0.4, 0.4, 0.4), (0.4, 0.4, 0.5)])
def test_of_a_uniform_ball_no_attitude_counts(state, inertia):
    """The deviation of one that has only been turned, with its axes, is 0; of other balls it is the local coordinates.

    That of Ω is the difference of ω, and a state that is displaced has the deviation by which it is.
    """
    sampled = SampledSystem.of(jaxball.Ball(mass=1.0, inertia=inertia, ground=PLATE), 0.1)
    turn = RANDOM.normal(size=3)
    turned = state.retract(jnp.zeros(10).at[:3].set(turn))
    turned = turned.with_Omega(jnp.asarray(Rotation.from_rotvec(turn).inv().apply(np.array(state.Omega))))
    xi = jnp.asarray(0.5 * RANDOM.normal(size=10))
    if inertia[2] != inertia[0]:
        np.testing.assert_array_equal(sampled.deviation(state, turned), state.difference(turned))
        np.testing.assert_array_equal(sampled.displace(state, xi).Omega, state.retract(xi).Omega)
        return
    np.testing.assert_allclose(sampled.deviation(state, turned), 0.0, atol=10 * ROUNDING)
    other = sampled.displace(turned, xi)
    omega = [np.asarray(one.Lambda) @ np.asarray(one.Omega) for one in (state, other)]
    np.testing.assert_allclose(omega[1] - omega[0], xi[3:6], rtol=0, atol=10 * ROUNDING)
    np.testing.assert_allclose(sampled.deviation(state, other), xi.at[:3].set(0.0), rtol=0, atol=10 * ROUNDING)
