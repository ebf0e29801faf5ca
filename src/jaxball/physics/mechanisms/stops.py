"""Hard end stops of a joint, which it strikes, rests against and leaves."""

import math
from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.declare import ANGLE, BETWEEN_0_AND_1, FROM_0, number
from ..conditions import Condition
from .forces import AbstractJointForce


class HardStops(AbstractJointForce):
    """Rigid stops at the ends of a joint's range, with an impact by Newton's restitution: θ̇⁺ = −e θ̇⁻.

    A joint that strikes a stop changes all velocities at once, by an impulse at this joint. Where the rebound would be
    too slow to matter, the joint rests against its stop, exactly, until a force takes it off. So a body with stops is a
    hybrid system, and ``trajectory.switches`` says when its joints strike, rest and leave. ``EndStops`` are springs
    instead, without modes. With a ``JointFriction`` besides, that also holds the joint at a stop.

    **Arguments:**

    - ``lower``, ``upper``: θ at the stops; −inf or inf, which are the defaults, where there is none.
    - ``restitution``: e, from 0 to 1.
    - ``slowest``: rebounds slower than this times √(g r) count as none, as the masses that the joint moves have them;
      without gravity, the acceleration to the stop takes the place of g.

    **Source:** Brogliato, *Nonsmooth Mechanics*, 3rd ed., Springer 2016, chapter 4.

    **Example:**

    >>> from jaxball import Disk, DiskState, HardStops, mass_in_tube, simulate
    >>> tube = mass_in_tube(0.5, (0.0, 0.0, 1.0), drive=HardStops(-0.5, 0.5))
    >>> disk = Disk(mass=1.0, inertia=0.5, mechanisms=[tube])
    >>> run = simulate(disk, [0.0, 2.0], DiskState(theta=[0.0], thetadot=[0.0]))
    >>> run.switches.lines
    ['t = 1: mechanisms[0].joints[0] comes to rest against its lower stop']
    """

    lower: Float[Array, "*group"] = eqx.field(converter=number(ANGLE), default=-math.inf)
    upper: Float[Array, "*group"] = eqx.field(converter=number(ANGLE), default=math.inf)
    restitution: Float[Array, "*group"] = eqx.field(converter=number(rule=BETWEEN_0_AND_1), default=0.0)
    slowest: Float[Array, "*group"] = eqx.field(converter=number(rule=FROM_0), default=1e-6)
    # Of a solve, which knows in which direction the joint moves, 1 or −1, and whether it is held, 0.
    direction: Float[Array, "*group"] | None = eqx.field(init=False)

    def __post_init__(self):
        self.direction = None

    @property
    def stopping(self) -> "tuple[HardStops, ...]":
        return (self,)

    def slipping(self, direction: Float[Array, "*group"]) -> "HardStops":
        return eqx.tree_at(lambda stops: stops.direction, self, direction, is_leaf=lambda x: x is None)

    def __call__(self, t, theta, thetadot, state):
        return jnp.zeros_like(theta)  # what holds a joint at its stop is in the matrix of the equations

    def conditions(self, name: str) -> Iterator[Condition]:
        yield Condition(self.lower < self.upper, f"{name}.lower", self.lower, "less than `upper`")
        yield from super().conditions(name)
