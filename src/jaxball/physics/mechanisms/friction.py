"""Dry friction of joints: a joint that sticks and slips exactly, and smooth laws."""

from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import require
from ...numerics.arrays import AnyArray
from ...numerics.declare import DAMPING, EFFORT, FROM_0, FROM_1, POSITIVE, RATE, number, number_or_none
from ..conditions import Condition, positive
from .forces import AbstractJointForce


class JointFriction(AbstractJointForce):
    """Dry friction of a joint, Q = −level(|θ̇|) sign θ̇ − viscous θ̇, which sticks where θ̇ = 0.

    level(v) is ``kinetic``, or, with the Stribeck effect, kinetic + (static − kinetic) exp(−(v / stribeck)^exponent).
    Where θ̇ falls to zero the joint sticks, exactly: θ̈ = 0, with the friction Q that this needs, until |Q| exceeds
    ``static``. So a body with it is a hybrid system, and ``trajectory.switches`` says when its joints stick and break
    loose. With ``smoothing``, Q has θ̇ / √(θ̇² + smoothing²) in place of sign θ̇ instead, and a loaded joint creeps.

    **Arguments:**

    - ``kinetic``: a torque about a hinge, or a force along a slider, 0 or positive.
    - ``static``: the largest friction of a joint at rest, positive, ``kinetic`` or more; ``kinetic`` if not given.
    - ``viscous``: torque or force per rate, 0 or positive.
    - ``stribeck``: the rate at which most of the difference between static and kinetic friction is gone; without it,
      friction falls to ``kinetic`` at once as the joint breaks loose.
    - ``exponent``: of the Stribeck effect, a positive whole number: 1 for Tustin's law, 2 for a Gaussian.
    - ``smoothing``: a rate, for a smooth law that never sticks.

    **Raises:** ``TypeError`` or ``ValueError`` for an exponent that is not a positive whole number.

    **Source:** Armstrong-Hélouvry, Dupont and Canudas de Wit, *A survey of models, analysis tools and compensation
    methods for the control of machines with friction*, Automatica 30 (1994), 1083.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, JointFriction
    >>> friction = JointFriction(kinetic=0.5, static=0.8, viscous=0.1)
    >>> float(friction(jnp.array(0.0), jnp.array(0.0), jnp.array(2.0), BallState()))
    -0.7
    """

    kinetic: Float[Array, "*group"] = eqx.field(converter=number(EFFORT, FROM_0))
    static: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(EFFORT), default=None)
    viscous: Float[Array, "*group"] = eqx.field(converter=number(DAMPING, FROM_0), default=0.0)
    stribeck: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(RATE, POSITIVE), default=None)
    exponent: int = eqx.field(static=True, default=2)
    smoothing: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(RATE, POSITIVE), default=None)
    # Of a solve, which knows in which direction the joint moves, 1 or −1, and whether it is held, 0.
    direction: Float[Array, "*group"] | None = eqx.field(init=False)

    def __post_init__(self):
        self.direction = None

    def __check_init__(self):
        require("exponent", self.exponent, int, "a positive whole number")
        if isinstance(self.exponent, bool) or self.exponent < 1:
            raise ValueError(f"Argument `exponent` must be a positive whole number, but it is {self.exponent}.")

    @property
    def largest(self) -> Float[AnyArray, "*group"]:
        """The largest friction of a joint at rest."""
        return self.kinetic if self.static is None else self.static

    @property
    def sticking(self) -> "tuple[JointFriction, ...]":
        return () if self.smoothing is not None else (self,)

    @property
    def dissipating(self) -> tuple[AbstractJointForce, ...]:
        return (self,)

    def slipping(self, direction: Float[Array, "*group"]) -> "JointFriction":
        return eqx.tree_at(lambda friction: friction.direction, self, direction, is_leaf=lambda x: x is None)

    def __call__(self, t, theta, thetadot, state):
        if self.smoothing is not None:
            size = jnp.sqrt(thetadot**2 + self.smoothing**2)
            return -self._level(size) * thetadot / size - self.viscous * thetadot
        # In a solve the direction is that of the mode, also where a step goes on beyond θ̇ = 0: the field is smooth
        # there.
        direction = jnp.sign(thetadot) if self.direction is None else self.direction
        return -direction * self._level(direction * thetadot) - self.viscous * thetadot

    def _level(self, speed: Float[Array, "*rates"]) -> Float[Array, "*rates"]:
        if self.stribeck is None:
            return self.kinetic
        return self.kinetic + (self.largest - self.kinetic) * jnp.exp(-((speed / self.stribeck) ** self.exponent))

    def conditions(self, name: str) -> Iterator[Condition]:
        yield from super().conditions(name)
        holds = positive(self.largest) & (self.largest >= self.kinetic)
        yield Condition(holds, f"{name}.static", self.largest, "a positive number, not less than `kinetic`")


class MajdSimaanFriction(AbstractJointForce):
    """Q = −viscous θ̇ − (kinetic + peak e^(−v) − (peak + kinetic) e^(−steepness v)) sign θ̇, with v = |θ̇| / rate.

    A smooth law that imitates stiction: it rises from 0 at rest to its largest value at a small rate, if ``steepness``
    is greater than 1, and falls to ``kinetic``. With a steepness of 1, ``peak`` has no effect, and friction only rises.

    **Arguments:**

    - ``viscous``: f_w, torque or force per rate, 0 or positive.
    - ``kinetic``: f_c, torque or force, 0 or positive.
    - ``peak``: σ, torque or force, 0 or positive.
    - ``rate``: ω_c, the rate over which friction changes, positive.
    - ``steepness``: n, 1 or more.

    **Source:** V. J. Majd and M. A. Simaan, *A continuous friction model for servo systems with stiction*,
    International Conference on Control Applications, 1995, 296.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, MajdSimaanFriction
    >>> friction = MajdSimaanFriction(viscous=0.0, kinetic=0.5, peak=0.2, rate=0.01, steepness=10.0)
    >>> rates = jnp.array([0.001, 0.004, 1.0])
    >>> friction(jnp.array(0.0), jnp.array(0.0), rates, BallState()).round(3)
    Array([-0.423, -0.621, -0.5  ], dtype=float64)
    """

    viscous: Float[Array, "*group"] = eqx.field(converter=number(DAMPING, FROM_0))
    kinetic: Float[Array, "*group"] = eqx.field(converter=number(EFFORT, FROM_0))
    peak: Float[Array, "*group"] = eqx.field(converter=number(EFFORT, FROM_0))
    rate: Float[Array, "*group"] = eqx.field(converter=number(RATE, POSITIVE))
    steepness: Float[Array, "*group"] = eqx.field(converter=number(rule=FROM_1))

    @property
    def dissipating(self) -> tuple[AbstractJointForce, ...]:
        return (self,)

    def __call__(self, t, theta, thetadot, state):
        speed = jnp.abs(thetadot) / self.rate
        rising = (self.peak + self.kinetic) * jnp.exp(-self.steepness * speed)
        level = self.kinetic + self.peak * jnp.exp(-speed) - rising
        return -self.viscous * thetadot - level * jnp.sign(thetadot)
