"""States of one's own beside a body: of a drive, a battery, a controller, whatever has a rate that its motion gives."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.arguments import call_with, refusal, require_callable_with, require_value, traceable
from ..interface.wording import all_of, number_of
from ..numerics.arrays import Numbers, to_array
from ..numerics.functions import OfKinkedFunctionOfState
from ..numerics.kinks import kinks_of_function
from ..numerics.vectors import cross, dot, root
from .state import State


def _to_names(given: Any) -> tuple[str, ...]:
    names = (given,) if isinstance(given, str) else given
    if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names):
        raise refusal("names", "the names of the states, such as ('charge', 'temperature')", given)
    repeated = sorted({name for name in names if names.count(name) > 1})
    if not names or repeated or not all(names):
        raise ValueError(f"Argument `names` must have one name or more, each of them once, but it is {given!r}.")
    return tuple(names)


def _to_units(given: Any) -> tuple[str, ...] | None:
    units = (given,) if isinstance(given, str) else given
    if units is None or (isinstance(units, list | tuple) and all(isinstance(unit, str) for unit in units)):
        return units if units is None else tuple(units)
    raise refusal("units", "the unit or dimension of each state, such as ('A s', 'energy')", given)


class OwnStates(OfKinkedFunctionOfState):
    """States x beside those of a body, solved together with them: ẋ = function(t, state, parameters).

    The current of a drive, the charge of a battery, the temperature of a motor, the integral of an error, a filter.
    They are ``own`` of the body's state, which the function is given whole, as are the forces of joints, the law and
    events; a :class:`~jaxball.FunctionWrench` finds them in its ``motion``. They may depend on anything in the state,
    but not on accelerations or on the reaction of the plane, and nothing jumps in them: an impact leaves them as they
    are.

    ``function`` is compiled into programs: one that is written anew compiles again unless it only uses equal numbers.

    **Arguments:**

    - ``function``: a function of (t, state, parameters), to their rates ẋ, in the order of ``names``, shape (own,).
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``kink_times``: the times at which it jumps or has a kink, besides those found in its trace, shape (kinks,).
    - ``names``: what they are called in files and figures, one each.
    - ``units``: the dimension of each in words, such as ``"energy"`` or ``"length/time"``, or a unit of its own, such
      as ``"A"``, or ``""`` for a number; all numbers if not given. A dimension becomes a unit where a scenario states
      its units.

    **Raises:** ``TypeError`` and ``ValueError`` for names and units that are none, or not one each.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Disk, DiskState, simulate
    >>> from jaxball.physics import OwnStates
    >>> def odometer(t, state):
    ...     return jnp.abs(state.phidot)[None]
    >>> disk = Disk(mass=1.0, inertia=0.5, own_states=OwnStates(odometer, names="turned"))
    >>> run = simulate(disk, [0.0, 1.0, 2.0], DiskState(phidot=-1.5, own=[0.25]))
    >>> print(run.state.own[:, 0])
    [0.25 1.75 3.25]
    """

    names: tuple[str, ...] = eqx.field(static=True, kw_only=True, converter=_to_names)
    units: tuple[str, ...] | None = eqx.field(static=True, kw_only=True, converter=_to_units, default=None)

    def __check_init__(self):
        if self.units is not None and len(self.units) != len(self.names):
            raise ValueError(
                f"Argument `units` must have {number_of(len(self.names), 'entry', 'entries')}, one for each of "
                f"`names`, but it is {self.units!r}."
            )
        require_callable_with("function", self.function, self.parameters, "t", "state")

    def __call__(self, t: Float[Array, ""], state: State) -> Float[Array, " own"]:
        """Computes ẋ."""
        with traceable("function", self.function):
            rates = call_with(self.function, t, state, parameters=self.parameters)
        require_value("function", rates, (len(self.names),))
        return rates

    def units_in(self, unit_of: Callable[[str], str]) -> tuple[str, ...]:
        """Returns the unit of each state; ``unit_of`` returns that of a dimension."""
        return tuple(map(unit_of, self.units or ("",) * len(self.names)))

    def kinks_with(self, state: State) -> Float[Array, " kinks"]:
        """Returns the kinks for such a state, those in ``kink_times`` and those seen in the trace of the function."""
        return kinks_of_function(self, state)


def odometer(t: Float[Array, ""], state: State, axis: Numbers = (0.0, 1.0, 0.0)) -> Float[Array, "2"]:
    """Computes the rates of two angles of a rolling body, a function for :class:`~jaxball.physics.OwnStates`.

    The first, Ω·``axis``, is that of the angle by which the body has turned about an axis of its own, as a counter on
    it would read: φ of a disk has the opposite sign. It is not limited to a whole turn. The second, |Ω × Γ|, is that of
    the angle by which it has rolled, forwards or backwards: the radius times this is the length of the contact point's
    path over the body and, on a level plane at rest without slip, over the plane. Spinning about the vertical does not
    count.

    **Arguments:**

    - ``t``, ``state``: time, and the state of the body.
    - ``axis``: body axes, of length 1, shape (3,); E2 if not given, about which a body rolls along e1 from its default
      state. These are the ``parameters`` of the :class:`~jaxball.physics.OwnStates`.

    **Example:**

    >>> from jaxball import Ball, BallState, simulate
    >>> from jaxball.physics import OwnStates, odometer
    >>> counted = OwnStates(odometer, names=("turned", "rolled"))
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), radius=0.5, own_states=counted)
    >>> run = simulate(ball, [0.0, 10.0], BallState(Omega=(0.0, -3.0, 0.0), own=(0.0, 0.0)))
    >>> print(run.state.own[-1].round(9), round(float(run.state.z[-1, 0]), 9))
    [-30.  30.] -15.0
    """
    across = cross(state.Omega, state.Gamma)
    return jnp.stack([dot(state.Omega, to_array(axis, "axis")), root(jnp.sum(across**2))])


def require_own(states: OwnStates | None, state: State) -> None:
    """Refuses a state, or a batch of them, whose ``own`` does not fit the states of one's own that a body has.

    **Raises:** ``ValueError``.
    """
    if states is None and state.own is None:
        return
    count = None if state.own is None else state.own.shape[-1]
    names = () if states is None else states.names
    if count != len(names):
        must = f"have {len(names)} entries, {all_of(names)}" if names else "be None, because there are no `own_states`"
        got = "it is None" if count is None else f"it has {count}"
        raise ValueError(f"Argument `state.own` must {must}, but {got}.")
