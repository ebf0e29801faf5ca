"""Base classes of the classical systems and their states; a system has laws, quantities that its motions conserve."""

import abc
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from ...numerics.arrays import Numbers, to_array
from ...numerics.declare import LENGTH, RATE, VELOCITY, number
from ...numerics.versor import rotation_matrix, vertical_in_body
from ..system import AbstractState, AbstractSystem, AnyState


class AbstractClassicalState(AbstractState):
    """The state that a solve of a classical system advances: arrays, at rest by default."""


class AbstractClassicalSystem(AbstractSystem[AnyState]):
    """Parameters of a classical system, with its equations of motion and the laws that these imply.

    It fulfils the contract of :class:`~jaxball.AbstractSystem`, of which it implements ``field`` and ``laws``.
    """

    @abc.abstractmethod
    def laws(self, t: Float[Array, ""], state: AnyState) -> Any:
        """Returns a named tuple of quantities that are conserved along every motion, or when its entries say so."""


class OrientedState(AbstractClassicalState):
    """(q, Ω), which states of rigid bodies begin with: ``q`` of shape (4,), ``Omega`` of shape (3,)."""

    q: Float[Array, "*batch 4"] = eqx.field(converter=number(), default=(1.0, 0.0, 0.0, 0.0))
    Omega: Float[Array, "*batch 3"] = eqx.field(converter=number(RATE), default=(0.0, 0.0, 0.0))

    unit_vector = "q"

    @property
    def Lambda(self) -> Float[Array, "*batch 3 3"]:
        """The rotation matrix Λ from body to space."""
        return rotation_matrix(self.q)

    @property
    def Gamma(self) -> Float[Array, "*batch 3"]:
        """Γ = Λ⁻¹ e3."""
        return vertical_in_body(self.q)


class RigidBodyState(OrientedState):
    """(q, Ω) of a rigid body with a fixed point; at rest and upright by default.

    ``q`` is a versor, whose rotation Λ maps body vectors to space vectors, and ``Omega`` the body
    angular velocity, in radians per unit time.

    **Arguments:**

    - ``q``: the real part first, shape (4,).
    - ``Omega``: body axes, rad/time, shape (3,).

    **Example:**

    >>> from jaxball.physics.classical import RigidBodyState
    >>> RigidBodyState(Omega=(0.0, 0.0, 2.0))
    RigidBodyState(q=(1.0, 0.0, 0.0, 0.0), Omega=(0.0, 0.0, 2.0))
    """


class ParticleState(AbstractClassicalState):
    """(x, y, z, ẋ, ẏ) of a particle with ż = y ẋ; at rest at the origin by default.

    **Arguments:**

    - ``x``, ``y``, ``z``: a coordinate of the position, length.
    - ``xdot``, ``ydot``: a component of the velocity, length/time.

    **Example:**

    >>> from jaxball.physics.classical import ParticleState
    >>> float(ParticleState(y=2.0, xdot=3.0).zdot)  # the constraint, ż = y ẋ
    6.0
    """

    x: Float[Array, "*batch"] = eqx.field(converter=number(LENGTH), default=0.0)
    y: Float[Array, "*batch"] = eqx.field(converter=number(LENGTH), default=0.0)
    z: Float[Array, "*batch"] = eqx.field(converter=number(LENGTH), default=0.0)
    xdot: Float[Array, "*batch"] = eqx.field(converter=number(VELOCITY), default=0.0)
    ydot: Float[Array, "*batch"] = eqx.field(converter=number(VELOCITY), default=0.0)

    @property
    def zdot(self) -> Float[Array, "*batch"]:
        """ż = y ẋ, the constraint ``eq_part_constraint``."""
        return self.y * self.xdot


class VakonomicState(AbstractClassicalState):
    """(x, y, z, ẋ, ẏ, λ) of the vakonomic particle, whose multiplier λ has a rate and an initial value.

    **Arguments:**

    - ``x``, ``y``, ``z``: a coordinate of the position, length.
    - ``xdot``, ``ydot``: a component of the velocity, length/time.
    - ``multiplier``: λ, a momentum, mass length/time; by default λ = −y ẋ, the paper's choice for a particle of unit
      mass, with which its constant c̃ = ż + λ is 0.
    """

    x: Float[Array, "*batch"]
    y: Float[Array, "*batch"]
    z: Float[Array, "*batch"]
    xdot: Float[Array, "*batch"]
    ydot: Float[Array, "*batch"]
    multiplier: Float[Array, "*batch"]

    def __init__(
        self,
        x: Numbers = 0.0,
        y: Numbers = 0.0,
        z: Numbers = 0.0,
        xdot: Numbers = 0.0,
        ydot: Numbers = 0.0,
        multiplier: Numbers | None = None,
    ):
        self.x, self.y, self.z = to_array(x, "x"), to_array(y, "y"), to_array(z, "z")
        self.xdot, self.ydot = to_array(xdot, "xdot"), to_array(ydot, "ydot")
        self.multiplier = -self.y * self.xdot if multiplier is None else to_array(multiplier, "multiplier")

    @property
    def zdot(self) -> Float[Array, "*batch"]:
        """ż = y ẋ, the constraint ``eq_part_constraint``."""
        return self.y * self.xdot
