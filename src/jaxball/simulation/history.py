"""The history of the contact between a body and its plane in a run: its modes, and when it switched between them."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..interface.printing import Printed, is_single, shown
from ..physics.body import AbstractBody
from ..physics.body_on_plane import BodyOnPlane
from ..physics.contact_law import Contact
from ..physics.modes import Cause, ContactState, Mode
from ..physics.released import ReleasedState, slip_velocity
from ..physics.slip import Beginning

NOWHERE = -1  # the mode at times to which a solve did not come

MOST_SHOWN = 8  # switches in a summary; `Switches.lines` has all


class Switches(Printed):
    """The switches from one mode to another, in the order of time.

    - ``count``: how many there were. The arrays hold the first ``room`` of them; where there are fewer, the rest is NaN
      or −1.
    - ``times``: when, shape (room,).
    - ``cause``: the ``jaxball.Cause`` of each, shape (room,).
    - ``source``, ``target``: the :class:`~jaxball.Mode` before and after it, shape (room,).
    - ``before``, ``after``: the :class:`~jaxball.ReleasedState` before and after it, with a leading axis.
    - ``lost``: the energy lost in an impact, mass length²/time², shape (room,).
    - ``grazing``: whether the function that ended the mode touched zero rather than crossing it, so that derivatives
      mean little, shape (room,).

    Times and states are differentiable.
    """

    count: Int[Array, "*batch"]
    times: Float[Array, "*batch room"]
    cause: Int[Array, "*batch room"]
    source: Int[Array, "*batch room"]
    target: Int[Array, "*batch room"]
    before: ReleasedState
    after: ReleasedState
    lost: Float[Array, "*batch room"]
    grazing: Bool[Array, "*batch room"]

    def __repr__(self) -> str:
        return "\n".join(["Switches", *(f"  {line}" for line in self.lines)]) if is_single(self.count) else shown(self)

    @property
    def lines(self) -> list[str]:
        """A line for each switch that was kept. For one trajectory, not for a batch."""
        count, kept = int(self.count), self.times.shape[-1]
        columns = self.times, self.source, self.target, self.cause, self.grazing
        lines = []
        for t, source, target, cause, grazing in zip(*(np.asarray(column)[:count] for column in columns), strict=True):
            modes = " to ".join(Mode(int(mode)).name.lower() for mode in (source, target))
            touched = ", grazing" if grazing else ""
            lines.append(f"t = {float(t):.10g}: from {modes}, as {Cause(int(cause)).sentence}{touched}")
        if count > kept:
            lines.append(f"{count - kept} more, which a larger `room` of the Contact would keep")
        return lines or ["none"]


class ContactHistory(Printed):
    """The modes of a run with a law of contact, at its saved times.

    - ``law``: the :class:`~jaxball.Contact`.
    - ``mode``: the :class:`~jaxball.Mode` at each time, shape (T,); −1 at times that the solve did not reach.
    - ``V``: the velocity of the geometric centre, space axes, length/time, shape (T, 3).
    - ``height``: of the body above the plane, length, shape (T,).
    - ``slip``: v_s, the velocity of the body's lowest point relative to the plane, space axes, length/time,
      shape (T, 3).
    - ``sigma``: the direction of the slip, a unit vector, shape (T, 2), also where the slip begins; 0 before the first.
    - ``rubbed``, ``struck``: the energy dissipated so far by sliding friction and by impacts, mass length²/time²,
      shape (T,) each.
    - ``switches``: the :class:`Switches`.
    """

    law: Contact
    mode: Int[Array, "*batch T"]
    V: Float[Array, "*batch T 3"]
    height: Float[Array, "*batch T"]
    slip: Float[Array, "*batch T 3"]
    sigma: Float[Array, "*batch T 2"]
    rubbed: Float[Array, "*batch T"]
    struck: Float[Array, "*batch T"]
    switches: Switches

    def __repr__(self) -> str:
        single = is_single(self.switches.count)
        return "\n".join(["ContactHistory", *(f"  {line}" for line in self.lines)]) if single else shown(self)

    @property
    def lines(self) -> list[str]:
        """How the body moved on its plane, and the energy that this dissipated. For one trajectory, not for a batch."""
        count, switches, modes = int(self.switches.count), self.switches.lines, np.asarray(self.mode)
        known = np.flatnonzero(modes >= 0)
        if not known.size:
            return []
        last = known[-1]
        when = "is {} at the end" if last == modes.size - 1 else "was {} at the last saved time that was reached"
        end = when.format(Mode(int(modes[last])).name.lower())
        changed = "never changed" if count == 0 else "changed once" if count == 1 else f"changed {count:,} times"
        shown = switches[:MOST_SHOWN] if count else []
        rest = [f"  and {count - len(shown):,} more"] if count > len(shown) else []
        rubbed, struck = (float(np.asarray(taken)[last]) for taken in (self.rubbed, self.struck))
        taken = f"sliding friction dissipated the energy {rubbed:.10g}, and impacts {struck:.10g}"
        return [f"the mode of contact {changed}, and {end}", *(f"  {line}" for line in shown), *rest, taken]

    def at_rows(self, rows: slice) -> "ContactHistory":
        """The history at some of the saved times, with all switches."""
        saved = ("mode", "V", "height", "slip", "sigma", "rubbed", "struck")
        return dataclasses.replace(self, **{name: getattr(self, name)[rows] for name in saved})

    def on_plane(self, body: AbstractBody, states: Any) -> tuple[BodyOnPlane, ContactState]:
        """The system on its plane, with its states, of whose bodies these are the ``states``."""
        mode, ever = self.mode.astype(self.height.dtype), jnp.full_like(self.height, jnp.finfo(self.height.dtype).max)
        begun = Beginning.along(ever, self.sigma)
        return BodyOnPlane(body, self.law), ContactState(
            states, self.V, self.height, self.rubbed, self.struck, mode, begun
        )


def slips(system: BodyOnPlane, times: Array, states: ContactState) -> tuple[Array, Array]:
    """The slip velocities, exactly 0 for a body that rolls, and their directions, 0 without slip."""
    prepared = system.prepare()

    def slip(t: Array, state: ContactState) -> tuple[Array, Array]:
        velocity = jnp.where(state.is_in(Mode.ROLLING), 0.0, slip_velocity(prepared.body, t, state.released))
        return velocity, jnp.where(state.is_in(Mode.SLIDING), state.direction(t, velocity), 0.0)

    return jax.lax.map(lambda at: slip(*at), (times, states))
