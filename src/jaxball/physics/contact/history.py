"""What a run of a body with modes shows: its modes at the saved times, and when and why they changed."""

import dataclasses
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...interface.printing import format_value, is_single
from ...interface.wording import all_of
from ..body import AbstractBody
from ..dynamics.sticking import Stops, describe_joints, sides, sticking_slots
from ..hybrid import SLOW_ROLLING, STIFF, AbstractHistory, Record, Switches
from . import over_surface as over
from .law import Contact
from .modes import ContactState, Mode, SwitchCause
from .released import slip_velocity
from .slide import slide_of
from .window import Beginning

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane

NOWHERE = -1  # the mode at times to which a solve did not come
OF_JOINTS = (
    SwitchCause.JOINT_STOPS,
    SwitchCause.JOINT_BREAKS_LOOSE,
    SwitchCause.JOINT_STRIKES,
    SwitchCause.JOINT_LEAVES_STOP,
)


class HeldSwitches(Switches):
    """The times at which a body or a joint comes to rest, breaks loose or turns back; ``event`` is the
    ``jaxball.physics.SwitchCause`` of each.

    - ``before``, ``after``: the states of the body, with a leading axis.
    - ``rolls_before``, ``rolls_after``: 1 where it rolls, 0 where it rests, shape (max_switches,).
    - ``spin_before``, ``spin_after``: the sign of its spinning, 0 where that is held, shape (max_switches,).
    - ``directions_before``, ``directions_after``: in which each joint with dry friction slips, 0 where it sticks,
      shape (max_switches, joints). A joint without friction has hard stops: 1 where it is free, 0 where it is held.
    - ``stops_before``, ``stops_after``: at which hard stop each joint rests, 1 for the upper, −1 for the lower one, 0
      for none, shape (max_switches, joints). ``struck``: which one it strikes.
    - ``joints``: what these joints are called.

    All but the first of these are None where friction cannot hold the body, or nothing has a joint to hold; those of
    stops also without HardStops.
    """

    rolls_before: Float[Array, "*batch switches"] | None
    rolls_after: Float[Array, "*batch switches"] | None
    spin_before: Float[Array, "*batch switches"] | None
    spin_after: Float[Array, "*batch switches"] | None
    directions_before: Float[Array, "*batch switches joints"] | None
    directions_after: Float[Array, "*batch switches joints"] | None
    stops_before: Float[Array, "*batch switches joints"] | None
    stops_after: Float[Array, "*batch switches joints"] | None
    struck: Float[Array, "*batch switches joints"] | None
    joints: tuple[str, ...] = eqx.field(static=True)

    @property
    def cause(self) -> Int[Array, "*batch switches"]:
        """The ``jaxball.physics.SwitchCause`` of each, shape (max_switches,); −1 where there are fewer."""
        return self.event

    def words(self, k: int) -> str:
        return ", ".join([*self._turns(k), *self._changes(k)]) or "nothing changed"

    def _changes(self, k: int) -> list[str]:
        """Describes what joints do at switch ``k``."""
        directions, stops = (self.directions_before, self.directions_after), (self.stops_before, self.stops_after)
        return describe_joints(self.joints, *directions, *stops, self.struck, k)

    def _turns(self, k: int) -> list[str]:
        if self.rolls_before is None:
            return []
        sides = self.rolls_before, self.rolls_after, self.spin_before, self.spin_after
        rolled, rolls, spun, spins = (float(np.asarray(side)[k]) for side in sides)
        said = []
        if rolled != rolls:
            said.append("the body rolls" if rolls else "the body comes to rest")
        elif rolled and int(np.asarray(self.event)[k]) == int(SwitchCause.ROLLING_ENDS):
            said.append("the body rolls back")
        if spun != spins:
            said.append("its spinning ends" if spins == 0 else "it begins to spin" if spun == 0 else "it spins back")
        return said


class HeldHistory(AbstractHistory):
    """When dry friction held a body and its joints, and hard stops joints, at the saved times of a run, and the
    switches.

    - ``switches``: the ``HeldSwitches``.
    - ``rests``: whether it held the body against rolling, shape (T,); a body that slips may be held, too.
    - ``spin``: the sign of ω₃ as friction against spinning has it, 0 where that is held or there is none, shape (T,).
    - ``rolling``: the direction of ω_h of a body that rolls, a unit vector, also where that begins; else 0,
      shape (T, 2).
    - ``directions``: in which each joint with dry friction slips, 1 or −1, and 0 where it sticks, shape (T, joints). A
      joint without friction has hard stops: 1 where it is free, 0 where it rests against one.
    - ``stops``: at which hard stop each of these joints rests, 1 for the upper, −1 for the lower one, 0 for none,
      shape (T, joints).
    - ``stop_loss``: the energy dissipated so far where joints strike their stops, mass length²/time², shape (T,).

    ``rests``, ``spin`` and ``rolling`` are None without exact dry resistance, ``directions`` without joints that stick
    or have stops, ``stops`` and ``stop_loss`` without HardStops.
    """

    switches: HeldSwitches
    rests: Bool[Array, "*batch T"] | None
    spin: Float[Array, "*batch T"] | None
    rolling: Float[Array, "*batch T 2"] | None
    directions: Float[Array, "*batch T joints"] | None
    stops: Float[Array, "*batch T joints"] | None
    stop_loss: Float[Array, "*batch T"] | None

    @property
    def described(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        return f"{all_of(self._parts)}, with which forces jump"

    @property
    def _parts(self) -> list[str]:
        of_joints = "joints that stick" if self.stops is None else "joints with hard stops"
        parts = {"exact dry resistance": self.rests, of_joints: self.directions}
        return [name for name, held in parts.items() if held is not None]

    @property
    def sticks(self) -> Bool[Array, "*batch T joints"] | None:
        """Whether each joint sticks at the saved times."""
        return None if self.directions is None else self.directions == 0

    @property
    def lines(self) -> list[str]:
        if int(self.switches.count) == 0:
            return ["nothing came to rest or broke loose"]
        who = "it" if self.directions is None else "joints" if self.rests is None else "it or its joints"
        changed = "came to rest, broke loose or turned back"
        if self.stops is not None:
            changed = "came to rest, broke loose, turned back or met a stop"
        return [f"{who} {changed} {self.switches.how_often}", *self.switches.first_lines, *self._losses]

    @property
    def _losses(self) -> list[str]:
        if self.stop_loss is None:
            return []
        reached = np.asarray(self.stop_loss)[np.isfinite(self.stop_loss)]
        return [f"strikes on stops dissipated the energy {float(reached[-1]):.10g}"] if reached.size else []

    @property
    def advice(self) -> str:
        return "" if self.rests is None else SLOW_ROLLING

    def at_rows(self, rows: slice) -> Any:
        return dataclasses.replace(self, **{name: array[rows] for name, array in self.over_time.items()})

    def states_of(self, system: AbstractBody, states: Any) -> ContactState:
        """Returns the states that were solved for, where the body itself had the ``states``: with what was held."""
        return self._with_held(ContactState(states))

    def _with_held(self, solved: ContactState) -> ContactState:
        """Returns the states with what was held then, which the rates, 0 but for rounding, do not tell everywhere."""
        solved = dataclasses.replace(solved, slips=self.directions, stop_loss=self.stop_loss)
        if self.rests is None or self.rolling is None:
            return solved
        rolls = jnp.where(self.rests, 0.0, 1.0).astype(self.rolling.dtype)
        ever = jnp.full_like(rolls, jnp.finfo(rolls.dtype).max)
        return dataclasses.replace(solved, rolls=rolls, spin=self.spin, rolling=Beginning.along(ever, self.rolling))

    @property
    def over_time(self) -> dict[str, Array]:
        names = ("rests", "spin", "rolling", "directions", "stops", "stop_loss")
        values = {name: getattr(self, name) for name in names}
        return {name: value for name, value in values.items() if value is not None}


class ContactSwitches(HeldSwitches):
    """The switches of a body from one mode to another; ``event`` is the ``jaxball.physics.SwitchCause`` of each.

    - ``source``, ``target``: the :class:`~jaxball.physics.Mode` before and after it, shape (capacity,).
    - ``before``, ``after``: the :class:`~jaxball.physics.ReleasedState` before and after it, with a leading axis.
    - ``lost``: the energy lost in an impact, or in the strike of a joint, mass length²/time², shape (capacity,).

    Besides these it has what :class:`HeldSwitches` have.
    """

    source: Int[Array, "*batch capacity"]
    target: Int[Array, "*batch capacity"]
    lost: Float[Array, "*batch capacity"]

    def words(self, k: int) -> str:
        changed = self._changes(k)
        source, target, cause = (int(np.asarray(column)[k]) for column in (self.source, self.target, self.event))
        if changed and source == target and cause in OF_JOINTS:
            return ", ".join(changed)
        modes = " to ".join(Mode(mode).name.lower() for mode in (source, target))
        return ", ".join([f"from {modes}, as {SwitchCause(cause).sentence}", *changed])

    @property
    def remedy(self) -> str:
        return "which a larger `capacity` of the Contact would keep"


class ContactHistory(HeldHistory):
    """The modes of a run with a law of contact, at its saved times.

    - ``switches``: the ``ContactSwitches``.
    - ``law``: the :class:`~jaxball.Contact`.
    - ``mode``: the :class:`~jaxball.physics.Mode` at each time, shape (T,); −1 at times that the solve did not reach.
    - ``V``: the velocity of the geometric centre, space axes, length/time, shape (T, 3).
    - ``height``: of the body above the ground, length, shape (T,).
    - ``slip``: v_s, the velocity of the body's lowest point relative to the ground, length/time, shape (T, 3), in space
      axes; on a surface p along ∂p/∂u1, across, and along the normal.
    - ``sigma``: the direction of the slip, a unit vector, shape (T, 2), also where the slip begins; 0 before the first.
      With a :class:`~jaxball.physics.LimitSurface` that of (v_s, ρ ω₃), shape (T, 3).
    - ``friction_loss``, ``impact_loss``: the energy dissipated so far by sliding friction and by impacts,
      mass length²/time², shape (T,) each.

    Besides these it has what a ``HeldHistory`` has: ``rests``, ``spin``, ``rolling``, ``directions``, ``stops``,
    ``stop_loss``.
    """

    switches: ContactSwitches  # pyright: ignore[reportIncompatibleVariableOverride]
    law: Contact
    mode: Int[Array, "*batch T"]
    V: Float[Array, "*batch T 3"]
    height: Float[Array, "*batch T"]
    slip: Float[Array, "*batch T 3"]
    sigma: Float[Array, "*batch T n"]
    friction_loss: Float[Array, "*batch T"]
    impact_loss: Float[Array, "*batch T"]

    @property
    def described(self) -> str:
        return all_of(["a law of contact", *self._parts])

    @property
    def holds_more(self) -> bool:
        """Whether dry friction may hold more than the contact: the body against rolling or spinning, or joints."""
        return bool(self._parts)

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
        return [f"{changing} {changed}, and {end}", *self.switches.first_lines, dissipation, *self._losses]

    @property
    def advice(self) -> str:
        modes = np.asarray(self.mode)
        reached = np.flatnonzero(modes >= 0)
        if not reached.size or modes[reached[-1]] != Mode.SLIDING:
            return super().advice
        slip = float(np.linalg.norm(np.asarray(self.slip)[reached[-1]]))
        return f"The body slides, at {slip:.3g} at the last saved time that was reached. A slow slip is stiff: {STIFF}"

    @property
    def over_time(self) -> dict[str, Array]:
        names = ("mode", "V", "height", "slip", "sigma", "friction_loss", "impact_loss")
        return {name: getattr(self, name) for name in names} | super().over_time

    @property
    def coefficients(self) -> dict[str, Array]:
        return {"friction": self.law.friction, "static_friction": self.law.static_friction}

    def states_of(self, system: AbstractBody, states: Any) -> ContactState:
        """Returns the states that were solved for, where the body itself had the ``states``."""
        # A saved state has its directions beside it, also where a slip or rolling begins: they hold at any time.
        ever = jnp.full_like(self.height, jnp.finfo(self.height.dtype).max)
        # Rest is a mode to those who read a run; to the equations it is rolling with ``rolls`` = 0.
        mode = jnp.where(self.mode == int(Mode.REST), int(Mode.ROLLING), self.mode).astype(self.height.dtype)
        begun, near = Beginning.along(ever, self.sigma), over.near_to(system, states.z, self.height)
        losses = self.friction_loss, self.impact_loss
        return self._with_held(ContactState(states, self.V, self.height, *losses, mode, begun, near))


def history_of(plane: "BodyOnPlane", times: Float[Array, " T"], states: ContactState, record: Record) -> HeldHistory:
    """Returns the history of a run, from the states at its saved times and its switches; ``plane`` is prepared."""
    before, after = record.before, record.after
    switches: dict[str, Any] = {
        f"{name}_{side}": getattr(of_side, field)
        for name, field in (("rolls", "rolls"), ("spin", "spin"), ("directions", "slips"))
        for side, of_side in (("before", before), ("after", after))
    }
    switches |= {"before": before.motion, "after": after.motion, "joints": plane.body.sticking}
    saved: dict[str, Any] = {"rests": None, "spin": states.spin, "rolling": None, "directions": states.slips}
    saved |= {"stops": _stops_of(plane, states), "stop_loss": states.stop_loss}
    switches |= {"stops_before": _stops_of(plane, before), "stops_after": _stops_of(plane, after)}
    switches["struck"] = None if before.stop_loss is None else _find_struck(plane, before)
    if states.rolls is not None:
        rests, rolling = states.rolls == 0, jax.lax.map(lambda row: plane.direction(*row), (times, states))
        saved |= {"rests": rests, "rolling": jnp.where(rests[..., None], 0.0, rolling)}
    if plane.contact is None:
        return HeldHistory(switches=HeldSwitches.of(record, **switches), **saved)
    lost = after.impact_loss - before.impact_loss
    if before.stop_loss is not None:
        lost = lost + after.stop_loss - before.stop_loss
    of_contact = ContactSwitches.of(record, **switches, source=_modes_of(before), target=_modes_of(after), lost=lost)
    saved |= {name: getattr(states, name) for name in ("V", "height", "friction_loss", "impact_loss")}
    slip, sigma = slips_of(plane, times, states)
    return ContactHistory(
        switches=of_contact, law=plane.contact, mode=_modes_of(states), slip=slip, sigma=sigma, **saved
    )


def _stops_of(plane: "BodyOnPlane", states: ContactState) -> Float[Array, "rows joints"] | None:
    """Returns at which stop each joint rests; None without stops."""
    if states.stop_loss is None:
        return None
    slots = sticking_slots(plane.body)
    return jax.lax.map(lambda row: sides(plane.body, row.slips, row.body.theta[slots]), states)


def _find_struck(plane: "BodyOnPlane", before: ContactState) -> Float[Array, "rows joints"]:
    """Returns which stop each joint is about to strike."""
    stops, slots = Stops.of(plane.body), sticking_slots(plane.body)
    return jax.lax.map(lambda row: stops.find_closing(row.body.theta[slots], row.body.thetadot[slots]), before)


def slips_of(
    plane: "BodyOnPlane", times: Float[Array, " T"], states: ContactState
) -> tuple[Float[Array, "T 3"], Float[Array, "T n"]]:
    """Computes the slip velocities, exactly 0 for a body that rolls, and their directions, 0 unless it slides."""

    def slip(t: Float[Array, ""], state: ContactState) -> tuple[Float[Array, "3"], Float[Array, " n"]]:
        velocity = jnp.where(state.is_in(Mode.ROLLING), 0.0, slip_velocity(plane.body, t, state.released))
        sigma = state.direction(t, slide_of(plane, velocity, t, state))
        return velocity, jnp.where(state.is_in(Mode.SLIDING), sigma, 0.0)

    return jax.lax.map(lambda row: slip(*row), (times, states))


def _modes_of(states: ContactState) -> Int[Array, "*rows"]:
    """Returns the modes, with rest in place of rolling where dry resistance holds the body."""
    assert states.mode is not None
    mode = jnp.where(jnp.isfinite(states.mode), states.mode, NOWHERE).astype(int)
    if states.rolls is None:
        return mode
    return jnp.where((mode == int(Mode.ROLLING)) & (states.rolls == 0), int(Mode.REST), mode)
