"""What a run of a body that dry friction may hold shows: when it, or a joint, came to rest or broke loose."""

import dataclasses

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from ...interface.wording import all_of
from ..dynamics.sticking import describe_changes
from ..hybrid import SLOW_ROLLING, AbstractHistory, Switches

ROLLING, SPINNING = 0, 1  # the guards of turning, and the events where they fall to zero


class HeldSwitches(Switches):
    """The times at which a body or a joint comes to rest, breaks loose or turns back.

    - ``before``, ``after``: the states of the body, with a leading axis.
    - ``rolls_before``, ``rolls_after``: 1 where it rolls, 0 where it rests, shape (max_switches,).
    - ``spin_before``, ``spin_after``: the sign of its spinning, 0 where that is held, shape (max_switches,).
    - ``directions_before``, ``directions_after``: in which each joint with dry friction slips, 0 where it sticks,
      shape (max_switches, joints).
    - ``joints``: what these joints are called.

    They are None where friction cannot hold the body, or has no joint to hold.
    """

    rolls_before: Float[Array, "*batch switches"] | None
    rolls_after: Float[Array, "*batch switches"] | None
    spin_before: Float[Array, "*batch switches"] | None
    spin_after: Float[Array, "*batch switches"] | None
    directions_before: Float[Array, "*batch switches joints"] | None
    directions_after: Float[Array, "*batch switches joints"] | None
    joints: tuple[str, ...] = eqx.field(static=True)

    def words(self, k: int) -> str:
        changes = [*self._turns(k), *describe_changes(self.joints, self.directions_before, self.directions_after, k)]
        return ", ".join(changes) or "nothing changed"

    def _turns(self, k: int) -> list[str]:
        if self.rolls_before is None:
            return []
        sides = self.rolls_before, self.rolls_after, self.spin_before, self.spin_after
        rolled, rolls, spun, spins = (float(np.asarray(side)[k]) for side in sides)
        said = []
        if rolled != rolls:
            said.append("the body rolls" if rolls else "the body comes to rest")
        elif rolled and int(np.asarray(self.event)[k]) == ROLLING:
            said.append("the body rolls back")
        if spun != spins:
            said.append("its spinning ends" if spins == 0 else "it begins to spin" if spun == 0 else "it spins back")
        return said


class HeldHistory(AbstractHistory):
    """When dry friction held a body and its joints at the saved times of a run, and the switches.

    - ``switches``: the ``HeldSwitches``.
    - ``rests``: whether it held the body against rolling, shape (T,).
    - ``spin``: the sign of ω₃ as friction against spinning has it, 0 where that is held or there is none, shape (T,).
    - ``directions``: in which each joint with dry friction slips, 1 or −1, and 0 where it sticks, shape (T, joints).

    ``rests`` and ``spin`` are None without exact dry resistance, ``directions`` without joints that stick.
    """

    switches: HeldSwitches
    rests: Bool[Array, "*batch T"] | None
    spin: Float[Array, "*batch T"] | None
    directions: Float[Array, "*batch T joints"] | None

    @property
    def described(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        parts = [*([] if self.rests is None else ["exact dry resistance"])]
        parts += [*([] if self.directions is None else ["joints that stick"])]
        return f"{all_of(parts)}, with which forces jump"

    @property
    def sticks(self) -> Bool[Array, "*batch T joints"] | None:
        """Whether each joint sticks at the saved times."""
        return None if self.directions is None else self.directions == 0

    @property
    def lines(self) -> list[str]:
        if int(self.switches.count) == 0:
            return ["nothing came to rest or broke loose"]
        who = "it" if self.directions is None else "joints" if self.rests is None else "it or its joints"
        return [f"{who} came to rest, broke loose or turned back {self.switches.how_often}", *self.switches.first_lines]

    @property
    def advice(self) -> str:
        return "" if self.rests is None else SLOW_ROLLING

    def at_rows(self, rows: slice) -> "HeldHistory":
        saved = {name: getattr(self, name) for name in ("rests", "spin", "directions")}
        return dataclasses.replace(self, **{name: None if x is None else x[rows] for name, x in saved.items()})
