"""Frames are rotations, and the paper's rule is Frisvad's basis in the order [n, b2, −b1]."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

import jaxball
from jaxball.physics.prescribed.frames import frisvad, principal_angles, spherical_direction
from tests.support.precision import scaled
from tests.support.sentences import refuses

pytestmark = pytest.mark.any_precision

basis = jax.jit(frisvad)
spherical = jax.jit(lambda azimuth, elevation: jaxball.SphericalFrame(azimuth, elevation).matrix())
number = st.floats(-1, 1, allow_subnormal=False)
angle = st.floats(-np.pi, np.pi, allow_subnormal=False)


def check_basis(n, atol):
    b1, b2 = basis(jnp.asarray(n))
    B = np.stack([n, b2, -np.asarray(b1)], axis=1)
    np.testing.assert_allclose(B.T @ B, np.eye(3), atol=atol)
    np.testing.assert_allclose(np.linalg.det(B), 1, atol=atol)


@pytest.mark.thorough
@given(st.tuples(number, number, number).map(np.array))
def test_the_basis_is_orthonormal_and_right_handed(n):
    """Frisvad's formula loses digits as n nears −e3: to 1e-16 / (1 + n3)."""
    assume(np.linalg.norm(n) > 1e-3)
    n = n / np.linalg.norm(n)
    assume(n[2] > -0.99)
    check_basis(n, scaled(1e-12))


@pytest.mark.parametrize("n", [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)])
def test_the_basis_along_the_axes(n):
    check_basis(np.array(n), scaled(1e-15))


def test_the_basis_at_the_south_pole_is_frisvads():
    b1, b2 = basis(jnp.asarray([0.0, 0.0, -1.0]))
    np.testing.assert_array_equal(b1, [0, -1, 0])
    np.testing.assert_array_equal(b2, [-1, 0, 0])


def test_derivatives_at_the_south_pole_are_finite():
    slopes = jax.jit(jax.jacfwd(frisvad))(jnp.asarray([0.0, 0.0, -1.0]))
    assert all(np.all(np.isfinite(slope)) for slope in slopes)


@given(angle, angle)
def test_a_spherical_frame_points_along_its_angles(azimuth, elevation):
    n = np.asarray(spherical_direction(jnp.asarray(azimuth), jnp.asarray(elevation)))
    np.testing.assert_allclose(
        n,
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        atol=scaled(1e-15),
    )
    np.testing.assert_array_equal(np.asarray(spherical(azimuth, elevation))[:, 0], n)


def test_the_first_rails_of_the_paper_are_drawn_in_known_planes():
    """v_1: n = e1 with b1 = −e3, b2 = e2. v_2: n = e2 with b1 = e1, b2 = −e3."""
    e1, e2, e3 = np.eye(3)
    np.testing.assert_allclose(spherical(0.0, 0.0), np.stack([e1, e2, e3], axis=1), atol=scaled(1e-15))
    np.testing.assert_allclose(spherical(np.pi / 2, 0.0), np.stack([e2, -e3, -e1], axis=1), atol=scaled(1e-15))


@pytest.mark.parametrize("angles", [(0.3, 90.0), (-45.0, 0.2)])
def test_angles_in_degrees_are_refused(angles):
    with refuses(ValueError, "azimuth" if angles[0] < 0 else "elevation"):
        jaxball.SphericalFrame(*angles)
    traced = jax.eval_shape(jaxball.SphericalFrame, *[jax.ShapeDtypeStruct((), jnp.result_type(float))] * 2)
    assert isinstance(traced, jaxball.SphericalFrame)


@pytest.mark.parametrize("elevation", [1.7, -1.7, 3.5, -4.0, 6.5, 1.5])
def test_principal_angles_are_those_of_the_same_direction(elevation):
    azimuth, principal = principal_angles(0.4, elevation)
    assert abs(principal) <= np.pi / 2
    wanted = spherical_direction(jnp.asarray(0.4), jnp.asarray(elevation))
    found = spherical_direction(jnp.asarray(azimuth), jnp.asarray(principal))
    np.testing.assert_allclose(found, wanted, atol=scaled(1e-14))
    if elevation == 1.5:
        assert (azimuth, principal) == (0.4, 1.5)
