"""What a run of a body on its ground shows: its modes at the saved times, and when and why they changed."""

import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...interface.printing import format_value, is_single
from ...interface.wording import all_of
from ..body import AbstractBody
from ..dynamics.sticking import describe_changes
from ..hybrid import SLOW_ROLLING, STIFF, AbstractHistory, Switches
from . import over_surface as over
from .law import Contact
from .modes import ContactState, Mode, SwitchCause
from .window import Beginning

NOWHERE = -1  # the mode at times to which a solve did not come
OF_JOINTS = SwitchCause.JOINT_STOPS, SwitchCause.JOINT_BREAKS_LOOSE


class ContactSwitches(Switches):
    """The switches of a body from one mode to another; ``event`` is the ``jaxball.SwitchCause`` of each.

    - ``source``, ``target``: the :class:`~jaxball.Mode` before and after it, shape (capacity,).
    - ``before``, ``after``: the :class:`~jaxball.ReleasedState` before and after it, with a leading axis.
    - ``lost``: the energy lost in an impact, mass length²/time², shape (capacity,).
    - ``directions_before``, ``directions_after``: in which each joint with dry friction slips, 0 where it sticks,
      shape (capacity, joints); None where no joint has dry friction, and in a run that was loaded.
    - ``joints``: what these joints are called.
    """

    source: Int[Array, "*batch capacity"]
    target: Int[Array, "*batch capacity"]
    lost: Float[Array, "*batch capacity"]
    directions_before: Float[Array, "*batch capacity joints"] | None = None
    directions_after: Float[Array, "*batch capacity joints"] | None = None
    joints: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def cause(self) -> Int[Array, "*batch capacity"]:
        """The ``jaxball.SwitchCause`` of each, shape (capacity,); −1 where there are fewer."""
        return self.event

    def words(self, k: int) -> str:
        changed = describe_changes(self.joints, self.directions_before, self.directions_after, k)
        source, target, cause = (int(np.asarray(column)[k]) for column in (self.source, self.target, self.event))
        if changed and source == target and cause in OF_JOINTS:
            return ", ".join(changed)
        modes = " to ".join(Mode(mode).name.lower() for mode in (source, target))
        return ", ".join([f"from {modes}, as {SwitchCause(cause).sentence}", *changed])

    @property
    def remedy(self) -> str:
        return "which a larger `capacity` of the Contact would keep"


class ContactHistory(AbstractHistory):
    """The modes of a run with a law of contact, at its saved times.

    - ``switches``: the ``ContactSwitches``.
    - ``law``: the :class:`~jaxball.Contact`.
    - ``mode``: the :class:`~jaxball.Mode` at each time, shape (T,); −1 at times that the solve did not reach.
    - ``V``: the velocity of the geometric centre, space axes, length/time, shape (T, 3).
    - ``height``: of the body above the ground, length, shape (T,).
    - ``slip``: v_s, the velocity of the body's lowest point relative to the ground, length/time, shape (T, 3), in space
      axes; on a surface p along ∂p/∂u1, across, and along the normal.
    - ``sigma``: the direction of the slip, a unit vector, shape (T, 2), also where the slip begins; 0 before the first.
    - ``friction_loss``, ``impact_loss``: the energy dissipated so far by sliding friction and by impacts,
      mass length²/time², shape (T,) each.

    Under exact dry resistance, and else None,

    - ``rests``: whether it held the body against rolling, shape (T,); a body that slips may be held, too.
    - ``spin``: the sign of ω₃ as friction against spinning has it, 0 where that is held or there is none, shape (T,).
    - ``rolling``: the direction of ω_h of a body that rolls, a unit vector, also where that begins; else 0,
      shape (T, 2).

    With joints that dry friction may hold, and else None,

    - ``directions``: in which each of them slips, 1 or −1, and 0 where it sticks, shape (T, joints).
    """

    switches: ContactSwitches
    law: Contact
    mode: Int[Array, "*batch T"]
    V: Float[Array, "*batch T 3"]
    height: Float[Array, "*batch T"]
    slip: Float[Array, "*batch T 3"]
    sigma: Float[Array, "*batch T 2"]
    friction_loss: Float[Array, "*batch T"]
    impact_loss: Float[Array, "*batch T"]
    rests: Bool[Array, "*batch T"] | None = None
    spin: Float[Array, "*batch T"] | None = None
    rolling: Float[Array, "*batch T 2"] | None = None
    directions: Float[Array, "*batch T joints"] | None = None

    @property
    def described(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        parts = ["a law of contact", *(["exact dry resistance"] if self.rests is not None else [])]
        return all_of([*parts, *(["joints that stick"] if self.directions is not None else [])])

    @property
    def holds_more(self) -> bool:
        """Whether dry friction may hold more than the contact: the body against rolling or spinning, or joints."""
        return self.rests is not None or self.directions is not None

    @property
    def sticks(self) -> Bool[Array, "*batch T joints"] | None:
        """Whether each joint with dry friction sticks at the saved times; None without such joints."""
        return None if self.directions is None else self.directions == 0

    def __repr__(self) -> str:
        single = is_single(self.switches.count)
        return "\n".join(["ContactHistory", *(f"  {line}" for line in self.lines)]) if single else format_value(self)

    @property
    def lines(self) -> list[str]:
        """How the body moved on its plane, and the energy that this dissipated. For one trajectory, not for a batch."""
        modes = np.asarray(self.mode)
        indices = np.flatnonzero(modes >= 0)
        if not indices.size:
            return []
        last = indices[-1]
        when = "is {} at the end" if last == modes.size - 1 else "was {} at the last saved time that was reached"
        changed = f"changed {self.switches.how_often}" if int(self.switches.count) else "never changed"
        friction_loss, impact_loss = (
            float(np.asarray(dissipation)[last]) for dissipation in (self.friction_loss, self.impact_loss)
        )
        dissipation = f"sliding friction dissipated the energy {friction_loss:.10g}, and impacts {impact_loss:.10g}"
        end = when.format(Mode(int(modes[last])).name.lower())
        changing = f"the mode of contact{'' if self.directions is None else ' or of a joint'}"
        return [f"{changing} {changed}, and {end}", *self.switches.first_lines, dissipation]

    @property
    def advice(self) -> str:
        modes = np.asarray(self.mode)
        reached = np.flatnonzero(modes >= 0)
        if not reached.size or modes[reached[-1]] != Mode.SLIDING:
            return "" if self.rests is None else SLOW_ROLLING
        slip = float(np.linalg.norm(np.asarray(self.slip)[reached[-1]]))
        return f"The body slides, at {slip:.3g} at the last saved time that was reached. A slow slip is stiff: {STIFF}"

    @property
    def over_time(self) -> dict[str, Array]:
        always = ("mode", "V", "height", "slip", "sigma", "friction_loss", "impact_loss")
        values = {name: getattr(self, name) for name in (*always, "rests", "spin", "rolling", "directions")}
        return {name: value for name, value in values.items() if value is not None}

    @property
    def coefficients(self) -> dict[str, Array]:
        return {"friction": self.law.friction, "static_friction": self.law.static_friction}

    def at_rows(self, rows: slice) -> "ContactHistory":
        return dataclasses.replace(self, **{name: array[rows] for name, array in self.over_time.items()})

    def states_of(self, system: AbstractBody, states: Any) -> ContactState:
        """Returns the states that were solved for, where the body itself had the ``states``."""
        # A saved state has its directions beside it, also where a slip or rolling begins: they hold at any time.
        ever = jnp.full_like(self.height, jnp.finfo(self.height.dtype).max)
        # Rest is a mode to those who read a run; to the equations it is rolling with ``rolls`` = 0.
        mode = jnp.where(self.mode == int(Mode.REST), int(Mode.ROLLING), self.mode).astype(self.height.dtype)
        begun, near = Beginning.along(ever, self.sigma), over.near_to(system, states.z, self.height)
        losses = self.friction_loss, self.impact_loss
        solved = ContactState(states, self.V, self.height, *losses, mode, begun, near, slips=self.directions)
        if self.rests is None or self.rolling is None:
            return solved
        rolls = jnp.where(self.rests, 0.0, 1.0).astype(mode.dtype)
        return dataclasses.replace(solved, rolls=rolls, spin=self.spin, rolling=Beginning.along(ever, self.rolling))
