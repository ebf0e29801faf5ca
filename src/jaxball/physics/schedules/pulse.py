"""The paper's actuation: a short push, then coasting."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.arrays import numbers
from ...numerics.piecewise import PiecewisePolynomial
from .base import AbstractSchedule
from .piecewise import PiecewiseSchedule


class Pulse(AbstractSchedule):
    """θ̈ = height until ``hold``, then falling linearly to zero at ``end``; zero before ``start``.

    The defaults are ``eq_prescribed_u_ball``: u = 1 on [0, .1] and 2 − 10 t on [.1, .2]. Section 4
    gives the disk's odd masses ``height`` −1, ``eq_prescribed_u_disk``.

    **Arguments:**

    - ``theta``, ``rate``: θ and θ̇ at ``start``, rad and rad/time, or length and length/time in a tube.
    - ``height``: of θ̈, rad/time².
    - ``start``, ``hold``, ``end``: times.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Pulse
    >>> theta, rate, acceleration = Pulse(0.0, height=2.0).derivatives(jnp.array(0.1))
    >>> round(float(theta), 6), round(float(rate), 6), round(float(acceleration), 6)
    (0.01, 0.2, 2.0)
    """

    theta: Float[Array, "*group"] = eqx.field(converter=numbers("theta"))
    height: Float[Array, "*group"] = eqx.field(converter=numbers("height"), default=1.0)
    rate: Float[Array, "*group"] = eqx.field(converter=numbers("rate"), default=0.0)
    start: Float[Array, "*group"] = eqx.field(converter=numbers("start"), default=0.0)
    hold: Float[Array, "*group"] = eqx.field(converter=numbers("hold"), default=0.1)
    end: Float[Array, "*group"] = eqx.field(converter=numbers("end"), default=0.2)

    def prepare(self) -> PiecewiseSchedule:
        held, fall = self.hold - self.start, self.end - self.hold
        zero = jnp.zeros_like(self.theta)
        u = self.height
        theta_hold = self.theta + self.rate * held + u * held**2 / 2
        rate_hold = self.rate + u * held
        theta_end = theta_hold + rate_hold * fall + u * fall**2 / 3
        rate_end = rate_hold + u * fall / 2
        pieces = [
            [self.theta, self.rate, zero, zero],
            [self.theta, self.rate, u / 2, zero],
            [theta_hold, rate_hold, u / 2, -u / (6 * fall)],
            [theta_end, rate_end, zero, zero],
        ]
        return PiecewiseSchedule(
            PiecewisePolynomial(
                breaks=self.kinks(),
                origins=jnp.stack([self.start, self.start, self.hold, self.end]),
                coefficients=jnp.stack([jnp.stack(piece) for piece in pieces]),
            )
        )

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.prepare()(t)

    def advanced(self, by: Float[Array, ""]) -> "Pulse":
        return eqx.tree_at(lambda s: s.theta, self, self.theta + by)

    def kinks(self) -> Float[Array, " kinks"]:
        return jnp.stack([self.start, self.hold, self.end])
