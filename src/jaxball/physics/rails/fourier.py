"""Closed space curves given by their Fourier coefficients."""

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.arrays import numbers
from ...numerics.trigonometry import sine_cosine
from .base import AbstractRail


class FourierRail(AbstractRail):
    """ζ(θ) = centre + Σ_k ( cosine_k cos kθ + sine_k sin kθ ), k = 1 … K.

    **Arguments:**

    - ``cosine``, ``sine``: a row for each harmonic, length, shape (K, 3).
    - ``centre``: length, shape (3,); the geometric centre if not given.

    **Raises:** ``ValueError`` when ``cosine`` and ``sine`` do not have one shape (K, 3).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import FourierRail
    >>> rail = FourierRail(cosine=[(0.5, 0.0, 0.0)], sine=[(0.0, 0.3, 0.0)])  # an ellipse
    >>> print(rail.points(jnp.array([0.0, jnp.pi / 2])).round(3))
    [[0.5 0.  0. ]
     [0.  0.3 0. ]]
    """

    cosine: Float[Array, "*group K 3"] = eqx.field(converter=numbers("cosine", ("K", 3)))
    sine: Float[Array, "*group K 3"] = eqx.field(converter=numbers("sine", ("K", 3)))
    centre: Float[Array, "*group 3"] = eqx.field(converter=numbers("centre", (3,)), default=(0.0, 0.0, 0.0))

    def __check_init__(self):
        if self.cosine.shape != self.sine.shape or self.cosine.shape[-1:] != (3,) or self.cosine.ndim < 2:
            raise ValueError(
                "Arguments `cosine` and `sine` must have one shape (K, 3), a row for each harmonic, "
                f"but their shapes are {self.cosine.shape} and {self.sine.shape}."
            )

    def __call__(self, theta: Float[Array, ""]) -> Float[Array, "3"]:
        k = jnp.arange(1, self.cosine.shape[0] + 1, dtype=self.cosine.dtype)
        sine, cosine = sine_cosine(k * theta)
        return self.centre + jnp.sum(self.cosine * cosine[:, None] + self.sine * sine[:, None], axis=0)

    @property
    def period(self) -> float:
        return 2 * math.pi

    @property
    def samples(self) -> int:
        return 32 * self.cosine.shape[-2]
