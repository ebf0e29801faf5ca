"""Versors by the axioms of their group, and against SciPy's rotations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.spatial.transform import Rotation

from jaxball.numerics import versor
from tests.support.precision import scaled

pytestmark = pytest.mark.any_precision

product, conjugate = jax.jit(versor.product), jax.jit(versor.conjugate)
rotation_matrix, from_rotation_matrix = jax.jit(versor.rotation_matrix), jax.jit(versor.from_rotation_matrix)
vertical_in_body, derivative = jax.jit(versor.vertical_in_body), jax.jit(versor.derivative)
exponential = jax.jit(versor.exponential)

number = st.floats(-1, 1, allow_subnormal=False)
vector = st.tuples(number, number, number).map(np.array)


@st.composite
def versors(draw):
    q = np.array(draw(st.tuples(number, number, number, number)))
    assume(np.linalg.norm(q) > 1e-3)
    return q / np.linalg.norm(q)


def as_scipy(q):
    return Rotation.from_quat(np.roll(np.asarray(q), -1))


ROUNDING = scaled(1e-14)


def close(found, expected, atol=ROUNDING):
    np.testing.assert_allclose(np.asarray(found), np.asarray(expected), rtol=0, atol=atol)


@given(versors(), versors(), versors())
def test_the_product_is_associative(a, b, c):
    close(product(product(a, b), c), product(a, product(b, c)))


@given(versors())
def test_identity_and_inverse(q):
    one = jnp.array([1.0, 0.0, 0.0, 0.0])
    close(product(one, q), q)
    close(product(q, one), q)
    close(product(q, conjugate(q)), one)
    close(product(conjugate(q), q), one)


@given(versors(), versors())
def test_products_of_versors_are_versors_and_products_of_rotations(a, b):
    close(np.linalg.norm(product(a, b)), 1)
    close(rotation_matrix(product(a, b)), np.asarray(rotation_matrix(a)) @ np.asarray(rotation_matrix(b)))


@given(versors())
def test_the_matrix_of_a_versor_is_a_rotation(q):
    Lambda = np.asarray(rotation_matrix(q))
    close(Lambda @ Lambda.T, np.eye(3))
    close(np.linalg.det(Lambda), 1)
    close(Lambda, as_scipy(q).as_matrix())
    close(vertical_in_body(q), Lambda[2])


@given(versors())
def test_a_versor_and_its_negative_are_one_rotation(q):
    close(rotation_matrix(-q), rotation_matrix(q), atol=0)


@given(versors())
def test_round_trip_through_the_matrix(q):
    back = np.asarray(from_rotation_matrix(rotation_matrix(q)))
    assert np.max(back) == np.max(np.abs(back))
    close(back * np.sign(back @ q), q)


def test_round_trip_at_half_turns():
    """Where the trace is −1, the scalar part is zero and other components must lead."""
    for q in (
        *np.eye(4),
        np.array([0, 0.6, 0.8, 0]),
        np.array([0, 0, -0.6, 0.8]),
        np.array([0, -0.6, 0, -0.8]),
    ):
        back = np.asarray(from_rotation_matrix(rotation_matrix(q)))
        close(back * np.sign(back @ q), q)


@given(vector)
def test_a_rotation_vector_is_the_axis_times_the_angle(rotation):
    close(rotation_matrix(exponential(rotation)), Rotation.from_rotvec(rotation).as_matrix())


@given(versors(), vector)
def test_the_derivative_turns_at_the_body_angular_velocity(q, Omega):
    """Central differences along exp(Ωt): the error is of third order in the step."""
    h = 1e-5
    turned = [(as_scipy(q) * Rotation.from_rotvec(step * Omega)).as_matrix() for step in (-h, h)]
    _, rate = jax.jvp(versor.rotation_matrix, (jnp.asarray(q),), (derivative(q, Omega),))
    close(rate, (turned[1] - turned[0]) / (2 * h), atol=max(1e-9, ROUNDING))


def test_normalisation():
    close(versor.normalize(jnp.asarray([3.0, 0.0, -4.0, 0.0])), [0.6, 0, -0.8, 0])
