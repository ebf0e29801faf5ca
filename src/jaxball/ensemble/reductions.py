"""Results found in a run while it is computed, so that only a few numbers of it are kept."""

import abc
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.arguments import traceable
from ..interface.printing import Printed
from ..numerics.vectors import cross, root
from ..physics.body import AbstractBody, System
from ..physics.contact.body_on_plane import BodyOnPlane, has_contact
from ..physics.contact.modes import ContactState, Mode
from ..physics.contact.over_surface import has_surface
from ..physics.contact.released import energy_of_released, slip_velocity
from ..physics.dynamics.footing import arm_of, footing
from ..physics.observables import observe
from ..physics.rolling import AbstractRollingSystem
from ..physics.state import BallState, DiskState, State
from ..physics.system import AbstractState

Held = AbstractRollingSystem | BodyOnPlane  # what a plane holds, and so has a contact force
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


def normal_force(system: Held, t: Float[Array, ""], state: AbstractState) -> Float[Array, ""]:
    """Returns N, the normal force; with a law of contact, in the mode that the body is in."""
    return system.plane_reaction(t, state).normal


def friction(system: Held, t: Float[Array, ""], state: AbstractState) -> Float[Array, ""]:
    """Returns |f|, the friction."""
    return system.plane_reaction(t, state).friction


def half_tangent(system: Held, t: Float[Array, ""], state: AbstractState) -> Float[Array, ""]:
    """Computes tan(α/2) for the angle α of the reaction from the vertical, which grows with |f| / N, smoothly past N =
    0.

    This avoids the arctangent, which takes as long as half of the equations of motion. With a law of contact, 0 in
    flight, and that of the coefficient of friction while the body slides.
    """
    R = system.plane_reaction(t, state)
    whole = R.normal + root(R.normal**2 + R.friction_squared)
    # Without friction a ground that would have to pull has α = π, where the quotient is 0/0.
    pulls = whole <= 0
    half = jnp.where(pulls, jnp.inf, R.friction / jnp.where(pulls, 1.0, whole))
    if not isinstance(state, ContactState):
        return half
    # Where a sliding body lifts, N is the error of that time, of either sign, and the ratio of both forces is lost.
    mu = system.coefficient(slip_velocity(system.body, t, state.released))  # pyright: ignore
    slides, flies = state.is_in(Mode.SLIDING), state.is_in(Mode.FLIGHT)
    return jnp.where(slides, mu / (1 + jnp.sqrt(1 + mu**2)), jnp.where(flies, 0.0, half))


def tangent(half: Float[Array, "*runs"]) -> Float[Array, "*runs"]:
    """Computes |f| / N = tan α from tan(α/2); infinite where N ≤ 0."""
    held = ~(half >= 1)
    return jnp.where(held, 2 * half / jnp.where(held, 1 - half**2, 1.0), jnp.inf)


def angular_speed_squared(system: System, t: Float[Array, ""], state: State) -> Float[Array, ""]:
    """Computes |Ω|²."""
    return jnp.sum(state.Omega**2)


def speed(system: System | BodyOnPlane, t: Float[Array, ""], state: State | ContactState) -> Float[Array, ""]:
    """Computes |ż|, how fast the geometric centre moves over the plane: where it rolls, r times the horizontal part of
    ω.

    On a surface |ċ|, how fast the geometric centre moves in space.
    """
    if isinstance(system, BodyOnPlane) or isinstance(state, ContactState):
        V: Any = state.V  # pyright: ignore
        curved = isinstance(system, BodyOnPlane) and has_surface(system.body)
        return root(jnp.sum((V if curved else V[:2]) ** 2))
    under = footing(system, t, state)
    if under is not None:
        return root(jnp.sum(under.centre_velocity**2))
    velocity = system.radius * cross(state.Omega, arm_of(system, state.Gamma))
    if system.shape is not None:  # only a sphere keeps its centre at one height
        velocity = velocity - jnp.sum(velocity * state.Gamma) * state.Gamma
    return root(jnp.sum(velocity**2))


def energy(
    system: System | BodyOnPlane, t: Float[Array, ""], state: BallState | DiskState | ContactState
) -> Float[Array, ""]:
    """Computes E, kinetic and potential; with a law of contact, plus the energy dissipated by friction and impacts."""
    if isinstance(system, BodyOnPlane) or isinstance(state, ContactState):
        return energy_of_released(system.body, t, state.released) + state.friction_loss + state.impact_loss  # pyright: ignore
    return observe(system, t, state).energy


def values(
    quantities: Sequence[Callable[..., Any]], system: Any, t: Float[Array, ""], state: Any
) -> Float[Array, " k"]:
    """Returns the quantities at one time; with a law of contact those of the body, except for quantities that depend on
    the law.
    """
    body = system.shown, system.state_to_show(state)
    # A user's quantity is written for a body, whatever the contact; those of ON_PLANE need the mode.
    whole = (system, state) if has_contact(system) else body

    def value(quantity: Callable[..., Any]) -> Float[Array, ""]:
        with traceable("quantity", quantity):
            model, model_state = whole if quantity in ON_PLANE else body
            return quantity(model, t, model_state)

    return jnp.stack([value(quantity) for quantity in quantities])


# Quantities that, with a law of contact, take a body on its plane and its state, not just the body.
ON_PLANE = (normal_force, friction, half_tangent, speed, energy)
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
