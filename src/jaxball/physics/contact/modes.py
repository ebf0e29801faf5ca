"""The modes of a body on or above its ground, why they end, and the state of a body that may switch between them."""

import dataclasses
import enum
from collections.abc import Iterator
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..conditions import Condition
from ..hybrid import NONE
from ..system import AbstractState
from .friction import slip_direction
from .released import ReleasedState
from .window import Beginning


class Mode(enum.IntEnum):
    """How a body moves on its ground.

    ``REST``: exact dry resistance holds one that does not slip against rolling.

    **Example:**

    >>> from jaxball.physics import Mode
    >>> Mode(1).name
    'SLIDING'
    """

    ROLLING = 0
    SLIDING = 1
    FLIGHT = 2
    REST = 3


class SwitchCause(enum.IntEnum):
    """Why a mode ends: friction gives way, a slip ends, the normal force falls to zero, the body lands.

    ``JAMS``: friction is so large that the normal force of a sliding body has no solution. Under exact dry resistance,
    also: rolling or spinning ends, or the friction against one of them gives way. Where dry friction may hold joints,
    also: one of them comes to rest, or breaks loose; where they have hard stops, strikes one or leaves it.

    **Example:**

    >>> from jaxball.physics import SwitchCause
    >>> SwitchCause.LANDS.sentence
    'the body came down'
    """

    GIVES_WAY = 1
    STOPS = 2
    LIFTS = 3
    LANDS = 4
    JAMS = 5
    ROLLING_ENDS = 6
    BREAKS_LOOSE = 7
    SPINNING_ENDS = 8
    BEGINS_TO_SPIN = 9
    JOINT_STOPS = 10
    JOINT_BREAKS_LOOSE = 11
    JOINT_STRIKES = 12
    JOINT_LEAVES_STOP = 13

    @property
    def sentence(self) -> str:
        """What happened, as a clause."""
        return _CLAUSES[self]


_CLAUSES = {
    SwitchCause.GIVES_WAY: "friction gave way",
    SwitchCause.STOPS: "the slip ended",
    SwitchCause.LIFTS: "the normal force fell to zero",
    SwitchCause.LANDS: "the body came down",
    SwitchCause.JAMS: "the normal force had no solution",
    SwitchCause.ROLLING_ENDS: "its rolling ended",
    SwitchCause.BREAKS_LOOSE: "rolling friction gave way",
    SwitchCause.SPINNING_ENDS: "its spinning ended",
    SwitchCause.BEGINS_TO_SPIN: "the friction against spinning gave way",
    SwitchCause.JOINT_STOPS: "a joint came to rest",
    SwitchCause.JOINT_BREAKS_LOOSE: "a joint broke loose",
    SwitchCause.JOINT_STRIKES: "a joint struck its stop",
    SwitchCause.JOINT_LEAVES_STOP: "a joint left its stop",
}


# For each mode, the cause that each guard stands for; NONE for a guard that it does not have.
CAUSES = (
    (SwitchCause.GIVES_WAY, SwitchCause.LIFTS, NONE),
    (SwitchCause.STOPS, SwitchCause.LIFTS, SwitchCause.JAMS),
    (SwitchCause.LANDS, NONE, NONE),
)


def cause_of(mode: Float[Array, ""], guard: Int[Array, ""]) -> Int[Array, ""]:
    """Returns the cause that a guard of a mode stands for; ``NONE`` for none."""
    cause = jnp.full_like(guard, NONE)
    for of_mode, causes in enumerate(CAUSES):
        for k, switch_cause in enumerate(causes):
            cause = jnp.where((mode == of_mode) & (guard == k), int(switch_cause), cause)
    return cause


class ContactState(AbstractState):
    """The variables of a body with modes that a solve advances. Each part of them is None where it has no such modes.

    - ``body``: the state of the body; θ̇ of a joint that sticks is 0.

    With a law of contact,

    - ``V``, ``height``: as in a :class:`ReleasedState`. A solve advances the slip velocity instead of ``V``, except in
      flight, so that it is exactly zero where the body rolls. In flight over a surface it advances the place of the
      centre in space instead of ``z`` and ``height``.
    - ``friction_loss``, ``impact_loss``: the energy dissipated by sliding friction and by impacts.
    - ``mode``: a :class:`Mode`, as a number.
    - ``begun``: the direction of a slip that has just begun, which cannot be computed from its velocity.
    - ``near``: coordinates of a piece of a surface that was the nearest to the body in flight; none on a plane.

    Under exact dry resistance, where a solve advances ω relative to the ground, in contact axes (in flight, and on a
    plane, those of space), instead of Ω, so that it is exactly 0 at rest,

    - ``rolls``: 0 where it holds the body against rolling, else 1.
    - ``spin``: the sign of ω₃ where friction acts against spinning; 0 where it holds it, and where there is none.
    - ``rolling``: the direction in which a ball has just begun to roll; that in which a disk rolls.

    With joints that dry friction or hard stops may hold,

    - ``slips``: for each of them, 1 or −1 where it slips in that direction, 0 where it sticks or is held at a stop; of
      one without friction 1 where it is free.
    - ``stop_loss``: the energy dissipated where joints strike their stops, also by friction then; None without stops.
    """

    body: Any
    V: Float[Array, "*batch 3"] | Any = None
    height: Float[Array, "*batch"] | Any = None
    friction_loss: Float[Array, "*batch"] | Any = None
    impact_loss: Float[Array, "*batch"] | Any = None
    mode: Float[Array, "*batch"] | Any = None
    begun: Beginning | Any = None
    near: Float[Array, "*batch coordinates"] | Any = None
    rolls: Float[Array, "*batch"] | Any = None
    spin: Float[Array, "*batch"] | Any = None
    rolling: Beginning | Any = None
    slips: Float[Array, "*batch sticking"] | Any = None
    stop_loss: Float[Array, "*batch"] | Any = None

    def projected(self) -> "ContactState":
        return dataclasses.replace(self, body=self.body.projected())

    def conditions(self) -> Iterator[Condition]:
        yield from self.body.conditions()
        for name in ("V", "height"):
            if (value := getattr(self, name)) is not None:
                yield Condition(jnp.all(jnp.isfinite(value)), f"state.{name}", value, "finite")
        if self.height is not None:
            yield Condition(self.height >= 0, "state.height", self.height, "0 or positive, the body over the plane")

    @property
    def released(self) -> ReleasedState:
        """Where the body is, and how it moves, with a law of contact."""
        return ReleasedState(self.body, self.V, self.height)

    @property
    def lost(self) -> Float[Array, "*batch"] | float:
        """The energy dissipated so far by sliding friction, impacts and strikes on stops."""
        losses = (self.friction_loss, self.impact_loss, self.stop_loss)
        return sum((loss for loss in losses if loss is not None), 0.0)

    @property
    def motion(self) -> Any:
        """Where the body is, and how it moves."""
        return self.body if self.V is None else self.released

    def move(self, to: Any) -> "ContactState":
        """Returns the state with another place and motion of the body."""
        if self.V is None:
            return dataclasses.replace(self, body=to)
        return dataclasses.replace(self, body=to.body, V=to.V, height=to.height)

    def direction(self, t: Float[Array, ""], slide: Float[Array, " n"]) -> Float[Array, " n"]:
        """Returns σ of a body with a slide s; 0 without."""
        if self.begun is None:
            return slip_direction(slide, jnp.zeros_like(slide))
        # Where a slip begins, v_s is zero and has no direction.
        begins = t <= self.begun.until
        return jnp.where(begins, self.begun.direction(t), slip_direction(slide, jnp.zeros_like(slide)))

    def is_in(self, mode: Mode) -> Bool[Array, ""]:
        """Returns whether the state is in this mode; without a law of contact a body always rolls."""
        return jnp.asarray(mode == Mode.ROLLING) if self.mode is None else self.mode == int(mode)
