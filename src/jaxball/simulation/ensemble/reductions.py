"""Results found in a run while it is computed, so that only a few numbers of it are kept."""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.printing import Printed
from ...numerics.vectors import cross, root
from ...physics.body import AbstractBody, System
from ...physics.contact.body_on_plane import has_contact
from ...physics.contact.modes import ContactState
from ...physics.contact.over_surface import has_surface
from ...physics.contact.released import energy_of_released
from ...physics.dynamics.footing import arm_of, footing, velocity_of_centre
from ...physics.observables import observe
from ...physics.rolling import AbstractRollingSystem
from ...physics.state import State
from ..quantities import friction, half_tangent, normal_force, takes_modes, tangent

# From a system, a time and a state to a number.
Quantity = Callable[[Any, Float[Array, ""], Any], Float[Array, ""]]


class Observed(NamedTuple):
    """Observations of a quantity: its value at the start, its extreme values and their times, its integral."""

    start: Float[Array, "*runs"]
    extremes: tuple[Float[Array, "*runs"], ...]
    times: tuple[Float[Array, "*runs"], ...]
    integral: Float[Array, "*runs"]


class AbstractReduction(Printed):
    """A number derived from a quantity over a run.

    ``quantity(system, t, state)`` is compiled into programs; a lambda that is written anew is known again if it uses
    numbers and parts of JAX alone, as is that of an event. An implementer supplies ``quantity``, a static field or a
    method, ``result``, and what ``result`` needs:

    - ``signs``: the factors of the quantity in the searches for its largest value, one per search: 1 for a maximum, −1
      for a minimum.
    - ``is_integral``: whether it needs the integral.
    - ``ends``: the suffixes of the names of its results.
    """

    quantity: eqx.AbstractVar[Quantity]
    signs: ClassVar[tuple[float, ...]] = ()
    is_integral: ClassVar[bool] = False
    ends: ClassVar[tuple[str, ...]] = ("",)

    @abc.abstractmethod
    def result(self, observed: Observed) -> dict[str, Float[Array, "*runs"]]:
        """Returns the results, by the suffixes of their names, each with the shape of the observed quantity.

        **Arguments:**

        - ``observed``: the values at the start, the extreme values and their times, one for each of ``signs``, and the
          integral, NaN if it is not asked for.
        """


def _as_it_is(value: Array) -> Array:
    return value


class Maximum(AbstractReduction):
    """The largest value within the steps of a run, not just at their ends, and when it occurs, ``…_time``.

    ``then`` is an increasing function that is applied to the value: the maximum of a smooth quantity is easier to find.

    **Arguments:**

    - ``quantity``: of (system, t, state), to one number.
    """

    quantity: Quantity = eqx.field(static=True)
    then: Callable[[Array], Array] = eqx.field(static=True, default=_as_it_is)
    signs: ClassVar[tuple[float, ...]] = (1.0,)
    ends: ClassVar[tuple[str, ...]] = ("", "_time")

    def result(self, observed: Observed) -> dict[str, Float[Array, "*runs"]]:
        return {"": self.then(observed.extremes[0]), "_time": observed.times[0]}


class Minimum(AbstractReduction):
    """The smallest value within the steps of a run, not just at their ends, and when it occurs, ``…_time``.

    **Arguments:**

    - ``quantity``: of (system, t, state), to one number.
    """

    quantity: Quantity = eqx.field(static=True)
    signs: ClassVar[tuple[float, ...]] = (-1.0,)
    ends: ClassVar[tuple[str, ...]] = ("", "_time")

    def result(self, observed: Observed) -> dict[str, Float[Array, "*runs"]]:
        return {"": observed.extremes[0], "_time": observed.times[0]}


class Drift(AbstractReduction):
    """The largest distance of the quantity from its value at the start.

    **Arguments:**

    - ``quantity``: of (system, t, state), to one number.
    """

    quantity: Quantity = eqx.field(static=True)
    signs: ClassVar[tuple[float, ...]] = (1.0, -1.0)

    def result(self, observed: Observed) -> dict[str, Float[Array, "*runs"]]:
        most, least = observed.extremes
        return {"": jnp.maximum(most - observed.start, observed.start - least)}


class Integral(AbstractReduction):
    """The integral over time, to the tolerances of the run, also where the quantity has kinks within a step.

    The absolute tolerance matters where the quantity is next to zero: it is integrated to a thousandth of it. Where the
    quantity jumps within a step, the derivative of the integral lacks what the jump moves.

    **Arguments:**

    - ``quantity``: of (system, t, state), to one number.
    """

    quantity: Quantity = eqx.field(static=True)
    is_integral: ClassVar[bool] = True

    def result(self, observed: Observed) -> dict[str, Float[Array, "*runs"]]:
        return {"": observed.integral}


def angular_speed_squared(system: System, t: Float[Array, ""], state: State) -> Float[Array, ""]:
    """Computes |Ω|²."""
    return jnp.sum(state.Omega**2)


@takes_modes
def speed(system: Any, t: Float[Array, ""], state: Any) -> Float[Array, ""]:
    """Computes |ż|, how fast the geometric centre moves along the plane, with what a belt or a turntable carries.

    On a surface |ċ|, how fast the geometric centre moves in space.
    """
    if has_contact(system):
        return root(jnp.sum((state.V if has_surface(system.shown) else state.V[:2]) ** 2))
    system, state = system.shown, system.state_to_show(state)
    under = footing(system, t, state)
    if under.axes is not None or under.velocity is not None:
        velocity = velocity_of_centre(system, state, under)
        return root(jnp.sum((velocity[:2] if under.axes is None else velocity) ** 2))
    # By Γ alone, all that a ReducedState has.
    velocity = system.radius * cross(state.Omega, arm_of(system, state.Gamma))
    if system.shape is not None:  # only a sphere keeps its centre at one height
        velocity = velocity - jnp.sum(velocity * state.Gamma) * state.Gamma
    return root(jnp.sum(velocity**2))


@takes_modes
def energy(system: Any, t: Float[Array, ""], state: Any) -> Float[Array, ""]:
    """Computes E, kinetic and potential; with a law of contact, plus the energy dissipated by friction and impacts,
    and in any case what strikes of joints have dissipated.
    """
    if has_contact(system):
        return energy_of_released(system.shown, t, state.released) + state.lost
    seen = observe(system.shown, t, system.state_to_show(state)).energy
    return seen + state.lost if isinstance(state, ContactState) else seen


CONTACT: dict[str, AbstractReduction] = {
    "least_normal_force": Minimum(normal_force),
    "friction_needed": Maximum(half_tangent, tangent),
    "largest_friction": Maximum(friction),
}
REDUCTIONS: dict[str, AbstractReduction] = {
    **CONTACT,
    "largest_angular_speed": Maximum(angular_speed_squared, jnp.sqrt),
    "distance": Integral(speed),
    "energy_drift": Drift(energy),
}


def reductions_of(system: Any) -> dict[str, AbstractReduction]:
    """Returns the ``REDUCTIONS`` that a system has: all for a ball or a disk, else the ones of the contact force if it
    rolls.

    **Arguments:**

    - ``system``: any :class:`~jaxball.AbstractSystem`.
    """
    if isinstance(system, AbstractBody):
        return REDUCTIONS
    return CONTACT if isinstance(system, AbstractRollingSystem) else {}
