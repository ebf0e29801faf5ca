"""Orthonormal frames in which the rails of a ball are drawn.

A planar rail lies in the plane of the first and third columns of its frame's matrix B, as the
circle ζ(θ) = r B (cos θ, 0, sin θ) of section 5 does.
"""

import abc
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...interface.compat import is_traced
from ...interface.printing import Printed
from ...numerics.declare import ANGLE, FULL_TURN, NOT_ALL_ZERO, QUARTER_TURN, number
from ...numerics.versor import normalize, rotation_matrix


def frisvad(n: Float[Array, "3"]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Computes two unit vectors b1(n), b2(n) that complete the unit vector ``n`` to an orthonormal basis.

    Source: Frisvad, *Building an orthonormal basis from a 3D unit vector without normalization*
    (Journal of Graphics Tools 16, 2012), section 4 and listing 2.
    """
    near_south_pole = n[2] < -0.9999999
    a = 1 / (1 + jnp.where(near_south_pole, 0.0, n[2]))
    b = -n[0] * n[1] * a
    b1 = jnp.stack([1 - n[0] ** 2 * a, b, -n[0]])
    b2 = jnp.stack([b, 1 - n[1] ** 2 * a, -n[1]])
    b1 = jnp.where(near_south_pole, jnp.array([0.0, -1.0, 0.0]), b1)
    b2 = jnp.where(near_south_pole, jnp.array([-1.0, 0.0, 0.0]), b2)
    return b1, b2


def spherical_direction(azimuth: Float[Array, ""], elevation: Float[Array, ""]) -> Float[Array, "3"]:
    """Computes the unit vector ς of section 5 at ``azimuth`` and ``elevation`` (radians)."""
    return jnp.stack(
        [
            jnp.cos(elevation) * jnp.cos(azimuth),
            jnp.cos(elevation) * jnp.sin(azimuth),
            jnp.sin(elevation),
        ]
    )


class AbstractFrame(Printed):
    """An orientation of a rail within the ball. A frame gives its rotation matrix."""

    @abc.abstractmethod
    def matrix(self) -> Float[Array, "3 3"]:
        """Returns the rotation matrix B whose columns are the frame's axes in the body."""


class MatrixFrame(AbstractFrame):
    """A frame given by its rotation matrix, by default the identity.

    **Arguments:**

    - ``B``: a rotation matrix, whose columns are the frame's axes in the body, shape (3, 3).

    **Example:**

    >>> from jaxball import MatrixFrame
    >>> print(MatrixFrame().matrix())
    [[1. 0. 0.]
     [0. 1. 0.]
     [0. 0. 1.]]
    """

    B: Float[Array, "*group 3 3"] = eqx.field(
        converter=number(), default=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    )

    def matrix(self) -> Float[Array, "3 3"]:
        return self.B


class VersorFrame(AbstractFrame):
    """A frame given by a quaternion, which is normalised: four numbers that may vary freely.

    **Arguments:**

    - ``q``: a quaternion of any nonzero length, the real part first, shape (4,).

    **Example:**

    >>> from jaxball.physics import VersorFrame
    >>> print(VersorFrame((1.0, 0.0, 0.0, 1.0)).matrix().round(12))  # a quarter of a turn about E3
    [[ 0. -1.  0.]
     [ 1.  0.  0.]
     [ 0.  0.  1.]]
    """

    q: Float[Array, "*group 4"] = eqx.field(converter=number(rule=NOT_ALL_ZERO))

    def matrix(self) -> Float[Array, "3 3"]:
        return rotation_matrix(normalize(self.q))


class SphericalFrame(AbstractFrame):
    """The paper's rule: B(n) = [n, b2, −b1] for the direction n at spherical angles, in radians.

    The order of the columns is not stated in the paper; of the possible orders, this one puts the
    centre of mass above the geometric centre at the start of section 5's run, as the text says.

    **Arguments:**

    - ``azimuth``: the angle from E1 towards E2, rad.
    - ``elevation``: the angle over the plane of E1 and E2, rad.

    **Raises:** ``ValueError`` for an angle beyond a full turn, which must be in degrees. An elevation between a quarter
    and a full turn, which a search may reach, is taken by its sine and cosine.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import SphericalFrame
    >>> frame = SphericalFrame(azimuth=0.0, elevation=jnp.pi / 6)
    >>> print(frame.matrix()[:, 0].round(3))  # the direction n
    [0.866 0.    0.5  ]
    """

    azimuth: Float[Array, "*group"] = eqx.field(converter=number(ANGLE, FULL_TURN))
    elevation: Float[Array, "*group"] = eqx.field(converter=number(ANGLE, QUARTER_TURN))

    def __check_init__(self):
        for name in ("azimuth", "elevation"):
            angle = getattr(self, name)
            if not is_traced(angle) and np.any(np.abs(angle) > 2 * math.pi):
                raise ValueError(
                    f"Argument `{name}` must be in radians, from -2π to 2π, but it is {angle}; from degrees, use "
                    "numpy.deg2rad."
                )

    def matrix(self) -> Float[Array, "3 3"]:
        n = spherical_direction(self.azimuth, self.elevation)
        b1, b2 = frisvad(n)
        return jnp.stack([n, b2, -b1], axis=1)


def principal_angles(azimuth: float, elevation: float) -> tuple[float, float]:
    """Returns the angles of the same direction whose elevation is from −π/2 to π/2 and whose azimuth is from −π to π.

    Angles that are already in these ranges are unchanged.
    """
    if abs(elevation) <= math.pi / 2 and abs(azimuth) <= 2 * math.pi:
        return azimuth, elevation
    wrapped = math.remainder(elevation, 2 * math.pi)
    if abs(wrapped) > math.pi / 2:
        azimuth, wrapped = azimuth + math.pi, math.copysign(math.pi, wrapped) - wrapped
    return math.remainder(azimuth, 2 * math.pi), wrapped
