"""What a rail is: the contract that every rail family fulfils."""

import abc

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.printing import Printed
from ...numerics.calculus import Furthest, furthest, two_derivatives


class AbstractRail(Printed):
    """A curve ζ(θ) fixed in the ball, relative to the geometric centre (section 3.3, ``eq_1d_param``).

    A family implements ``__call__`` and ``period``. A rail whose shape is costly to compute (a spline's coefficients, a
    frame's matrix) overrides ``prepare``, which is called once per solve; one whose wiggles are known overrides
    ``samples``, and one whose furthest point is known, ``furthest``.
    """

    @abc.abstractmethod
    def __call__(self, theta: Float[Array, ""]) -> Float[Array, "3"]:
        """The point ζ(θ), a body vector from the geometric centre."""

    @property
    @abc.abstractmethod
    def period(self) -> float | None:
        """The increase of θ after which a closed rail repeats itself; None for an open one."""

    @property
    def samples(self) -> int:
        """How many evenly spaced θ resolve every bend of the curve."""
        return 512

    def prepare(self) -> "AbstractRail":
        """The same rail, ready to be evaluated many times."""
        return self

    def derivatives(self, theta: Float[Array, ""]) -> tuple[Float[Array, "3"], Float[Array, "3"], Float[Array, "3"]]:
        """ζ(θ), ζ′(θ) and ζ″(θ), the derivatives by forward mode."""
        return two_derivatives(self, theta)

    def furthest(self) -> Furthest:
        """The θ (as ``x``) at which a closed rail is furthest from the geometric centre, and its distance there."""
        assert self.period is not None
        theta = jnp.linspace(0.0, self.period, self.samples, endpoint=False)
        return furthest(self, theta, jax.vmap(self)(theta))

    def points(self, theta: Float[Array, " n"]) -> Float[Array, "n 3"]:
        """ζ at many θ, for drawing."""
        return jax.vmap(self.prepare())(theta)
