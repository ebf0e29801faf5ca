"""The surface of a smooth convex body, by its support function.

A body that touches a plane does so where the plane's normal is that of its surface. With Γ the upward normal of the
plane in body axes, h(Γ) is the height of the body's centre over the plane. Continued as a function of degree 1, so that
h(aΓ) = a h(Γ), it is the support function of the surface reflected in the centre, and its gradient is the arm: the
vector from the contact to the centre, in body axes. Of a ball h = r and the arm is rΓ.
"""

import abc
from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interface.arguments import call_with, require_function
from ..interface.printing import Printed
from ..numerics.arrays import a_vector, to_array
from ..numerics.declare import ANGLE, FINITE, LENGTH, POSITIVE, number
from ..numerics.functions import OfFunction
from ..numerics.vectors import root, sine_cosine
from .conditions import Condition, on_numbers

LOOKS = 512  # in which a surface is looked at


class AbstractShape(Printed):
    """The surface of a convex body."""

    @abc.abstractmethod
    def height(self, Gamma: Float[Array, "3"]) -> Float[Array, ""]:
        """Computes h, the height of the centre over a plane whose upward normal is Γ in body axes, length; asked for
        unit vectors only.
        """

    def arm(self, Gamma: Float[Array, "3"]) -> Float[Array, "3"]:
        """Computes a = ∇h(Γ), from the contact point to the centre, body axes, length."""

        def of_degree_one(Gamma: Float[Array, "3"]) -> Float[Array, ""]:
            size = root(jnp.sum(Gamma**2))
            return size * self.height(Gamma / size)

        return jax.grad(of_degree_one)(Gamma)

    def curvature(self, Gamma: Float[Array, "3"]) -> Float[Array, "3 3"]:
        """Computes ∇²h(Γ), whose eigenvalues across Γ are the radii of curvature at the contact, length."""
        return jax.jacfwd(self.arm)(Gamma)

    def extent(self) -> Float[Array, ""]:
        """Computes how far the surface gets from the centre, length, to a part in a thousand."""
        return jnp.max(root(jnp.sum(jax.vmap(self.arm)(_directions()) ** 2, axis=-1)))

    def conditions(self) -> Iterator[Condition]:
        """Yields what must hold of the numbers: a surface around the centre that is convex and smooth."""
        directions = _directions()
        heights = jax.vmap(self.height)(directions)
        yield Condition(jnp.min(heights) > 0, "shape", jnp.min(heights), "a surface around the centre, with h > 0")
        curvatures = jax.vmap(self.curvature)(directions)
        # Along Γ itself ∇²h is 0.
        across = curvatures + heights[:, None, None] * directions[:, :, None] * directions[:, None, :]
        least = jnp.min(jnp.linalg.eigvalsh(across))
        yield Condition(least > 0, "shape", least, "convex, with positive radii of curvature")


class Ellipsoid(AbstractShape):
    """The surface of an ellipsoid: h = √(Γ·A²Γ).

    **Arguments:**

    - ``semiaxes``: A, the semi-axes, along the body axes, length, shape (3,).
    - ``turn``: by how much the first two are turned about E3 against the body axes, which are those of the principal
      moments of inertia, rad. That makes a rattleback.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics import Ellipsoid
    >>> Ellipsoid((1.0, 1.0, 1.5)).arm(jnp.array([0.0, 0.0, 1.0]))
    Array([0. , 0. , 1.5], dtype=float64)
    """

    semiaxes: Float[Array, "*group 3"] = eqx.field(converter=number(LENGTH, POSITIVE))
    turn: Float[Array, "*group"] = eqx.field(converter=number(ANGLE, FINITE), default=0.0)

    def height(self, Gamma: Float[Array, "3"]) -> Float[Array, ""]:
        sine, cosine = sine_cosine(self.turn)
        along = jnp.stack([cosine * Gamma[0] + sine * Gamma[1], cosine * Gamma[1] - sine * Gamma[0], Gamma[2]])
        return jnp.sqrt(jnp.sum((self.semiaxes * along) ** 2))

    def conditions(self) -> Iterator[Condition]:
        yield from on_numbers(self, "shape.")


class SupportFunction(OfFunction, AbstractShape):
    """The surface with the support function h = function(Γ, parameters).

    ``function`` is compiled into programs: one that is written anew compiles again unless it only uses equal numbers.

    **Arguments:**

    - ``function``: a function of (Γ, parameters), to h, the height of the centre over the plane, length. Γ is the
      upward normal of the plane, a unit vector in body axes, shape (3,). It must be smooth, and the surface convex.
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics import SupportFunction
    >>> def egg(Gamma, sharpness):
    ...     return jnp.sqrt(1.0 + 0.5 * Gamma[2] ** 2) + sharpness * Gamma[2] ** 3
    >>> round(float(SupportFunction(egg, 0.1).height(jnp.array([0.0, 0.0, 1.0]))), 6)
    1.324745
    """

    def __check_init__(self):
        require_function("function", self.function, (), Gamma=a_vector(), parameters=self.parameters)

    def height(self, Gamma: Float[Array, "3"]) -> Float[Array, ""]:
        return jnp.asarray(call_with(self.function, Gamma, parameters=self.parameters), Gamma.dtype)


def _directions() -> Float[Array, "n 3"]:
    """Returns directions that are spread evenly, along a spiral."""
    k = np.arange(LOOKS)
    z, azimuth = 1 - (2 * k + 1) / LOOKS, k * np.pi * (3 - np.sqrt(5))
    across = np.sqrt(1 - z**2)
    return to_array(np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1))
