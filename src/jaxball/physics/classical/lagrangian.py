"""Own systems from a Lagrangian, with or without constraints: JAX forms the equations of motion.

The user's functions are those of a book: L(t, q, q̇), constraints that are 0, and generalised forces. Everything else is
derived (module ``multipliers``).
"""

import abc
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import programs
from ...interface.arguments import (
    describe,
    require_value,
)
from ...numerics.arrays import Numbers, default_dtype, to_array
from ...numerics.declare import number
from ...numerics.kinks import kinks_seen
from ..conditions import Condition, ExplainedCondition
from .multipliers import (
    ALLOWED_RESIDUAL,
    Constraints,
    Equations,
    equations,
    nearest_place,
    nearest_velocity,
    rate_along,
    start_conditions,
)
from .state import AbstractClassicalState, AbstractClassicalSystem

FROM_AFAR = 30  # Newton steps to the constraints from any state; each doubles the digits once it is near
IN_STEP = 2  # from the end of a step, which is as near as its error
BESIDE_THE_START = 1e-3  # of the size of the coordinates: how far beside the start constraints are looked at again
LEAST_COUNTED = 1e-3  # below this a coordinate or a rate counts as 0, in the user's units, where the start is checked


class LagrangianState(AbstractClassicalState):
    """(q, q̇) of a system with a Lagrangian, in the order of its ``coordinates``.

    **Arguments:**

    - ``q``: generalised coordinates, in units of the user's, shape (n,).
    - ``qdot``: their rates, shape (n,); at rest if not given.

    **Example:**

    >>> from jaxball.physics.classical import LagrangianState
    >>> LagrangianState([0.0, 0.0, 0.5])
    LagrangianState(q=(0.0, 0.0, 0.5), qdot=(0.0, 0.0, 0.0))
    """

    q: Float[Array, "*batch n"] = eqx.field(converter=number())
    qdot: Float[Array, "*batch n"] = eqx.field(converter=number())

    sized = ("q", "qdot")

    def __init__(self, q: Numbers = (), qdot: Numbers | None = None):
        self.q = to_array(q, "q")
        self.qdot = jnp.zeros_like(self.q) if qdot is None else to_array(qdot, "qdot")


class LagrangianLaws(NamedTuple):
    """What is known of every motion of a system without constraints.

    - ``energy``: q̇·∂L/∂q̇ − L, which is T + V of a natural system. Its rate is Q·q̇ − ∂L/∂t − λ·b, and 0 of a natural
      system without forces whose constraints do not depend on time.
    """

    energy: Float[Array, ""]


class NonholonomicLaws(NamedTuple):
    """The same with constraints of velocities.

    - ``energy``: see :class:`LagrangianLaws`.
    - ``velocity_constraints``: A q̇ + b = 0, shape (m,), those of holonomic constraints after the others.
    """

    energy: Float[Array, ""]
    velocity_constraints: Float[Array, " m"]


class HolonomicLaws(NamedTuple):
    """The same with holonomic constraints.

    - ``energy``: see :class:`LagrangianLaws`.
    - ``velocity_constraints``: see :class:`NonholonomicLaws`, shape (m,).
    - ``position_constraints``: φ(t, q) = 0, shape (k,).
    """

    energy: Float[Array, ""]
    velocity_constraints: Float[Array, " m"]
    position_constraints: Float[Array, " k"]


class AbstractLagrangianSystem(AbstractClassicalSystem[LagrangianState]):
    """A system whose equations of motion are Lagrange's, with multipliers where it has constraints.

    An implementer supplies

    - ``coordinates``: the names of the coordinates, in their order;
    - ``lagrangian(t, q, qdot)``.

    These have defaults, which are none:

    - ``constraints(t, q, qdot)``: functions that are 0 along every motion and affine in q̇, such as ẋ sin θ − ẏ cos θ;
    - ``holonomic(t, q)``: functions of the place that are 0;
    - ``forces(t, q, qdot)``: generalised forces Q.

    Steps of a system with holonomic constraints end on all constraints, unless ``always_projected`` is overridden to
    say False; with constraints of velocities alone they do with ``project=True`` of :func:`jaxball.simulate`, and
    otherwise leave A q̇ + b as an error that ``laws`` report.
    """

    coordinates: ClassVar[tuple[str, ...]]

    title: ClassVar[str] = "Lagrangian system"
    state_type: ClassVar[type[LagrangianState]] = LagrangianState

    @abc.abstractmethod
    def lagrangian(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Float[Array, ""]:
        """Returns L(t, q, q̇), an energy."""

    def constraints(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Any:
        """Returns A(t, q) q̇ + b(t, q), which is 0: a number, a list of numbers, or an array, shape (m,)."""
        return jnp.zeros((0,), q.dtype)

    def holonomic(self, t: Float[Array, ""], q: Float[Array, " n"]) -> Any:
        """Returns φ(t, q), which is 0: a number, a list of numbers, or an array, shape (k,)."""
        return jnp.zeros((0,), q.dtype)

    def forces(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Any:
        """Returns Q(t, q, q̇), whose power is Q·q̇: a list of numbers or an array, shape (n,)."""
        return jnp.zeros_like(q)

    # The equations of motion.

    def field(self, t: Float[Array, ""], state: LagrangianState) -> LagrangianState:
        """Solves [M −Aᵀ; A 0] (q̈, λ) = (f, −Ȧ q̇ − ḃ) for q̈."""
        return LagrangianState(state.qdot, self.accelerations(t, state))

    def accelerations(self, t: Float[Array, ""], state: LagrangianState) -> Float[Array, " n"]:
        """Returns q̈, shape (n,)."""
        return self.equations(t, state).solve()[0]

    def multipliers(self, t: Float[Array, ""], state: LagrangianState) -> Float[Array, " m"]:
        """Returns λ of each constraint, shape (m,), with the holonomic constraints after the others.

        λ_k is the force, or torque, by which constraint k acts: across a blade, for ẋ sin θ − ẏ cos θ. Its unit is
        energy over the unit of φ, or power over the unit of A q̇ + b.
        """
        return self.equations(t, state).solve()[1]

    def reactions(self, t: Float[Array, ""], state: LagrangianState) -> Float[Array, " n"]:
        """Computes Aᵀλ, the generalised forces of all constraints on each coordinate, shape (n,)."""
        terms = self.equations(t, state)
        return jnp.sum(terms.rows * terms.solve()[1][:, None], axis=0)

    def equations(self, t: Float[Array, ""], state: LagrangianState) -> Equations:
        """Returns M, f, A and Ȧ q̇ + ḃ in one state."""
        return equations(self._energy, self._forces, self._rates, t, state.q, state.qdot)

    # The user's functions, as arrays.

    def _energy(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Float[Array, ""]:
        value = self.lagrangian(t, q, qdot)
        require_value("lagrangian", value, ())
        return jnp.asarray(value, q.dtype)

    def _forces(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Float[Array, " n"]:
        value = as_vector("forces", self.forces(t, q, qdot), q.dtype)
        require_value("forces", value, q.shape)
        return value

    def _of_velocity(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Float[Array, " m"]:
        return as_vector("constraints", self.constraints(t, q, qdot), q.dtype)

    def _of_place(self, t: Float[Array, ""], q: Float[Array, " n"]) -> Float[Array, " k"]:
        return as_vector("holonomic", self.holonomic(t, q), q.dtype)

    def _rates(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Float[Array, " m"]:
        """Returns A q̇ + b of all constraints."""
        return jnp.concatenate([self._of_velocity(t, q, qdot), rate_along(self._of_place)(t, q, qdot)])

    def residuals(self, t: Float[Array, ""], state: LagrangianState) -> Float[Array, " residuals"]:
        """Returns the residuals that constraints keep at 0: A q̇ + b of all of them, and φ(t, q) of the
        holonomic ones.
        """
        return jnp.concatenate([self._rates(t, state.q, state.qdot), self._of_place(t, state.q)])

    @property
    def count_of_residuals(self) -> int:
        """How many residuals there are: by as much the admissible states have fewer dimensions."""
        of_velocity, of_place = self._counts()
        return of_velocity + 2 * of_place

    def _counts(self) -> tuple[int, int]:
        """Counts the constraints of velocities and the holonomic ones."""
        t, q = (jax.ShapeDtypeStruct(shape, default_dtype()) for shape in ((), (len(self.coordinates),)))
        return tuple(
            eqx.filter_eval_shape(f, *arguments).size
            for f, arguments in ((self._of_velocity, (t, q, q)), (self._of_place, (t, q)))
        )

    # What keeps the constraints.

    @property
    def always_projected(self) -> bool:
        """Whether steps end on the constraints in any case: with holonomic ones."""
        return self._counts()[1] > 0

    def projected(self, t: Float[Array, ""], packed: LagrangianState) -> LagrangianState:
        """Returns the nearest state that keeps all constraints, for a state that is as near as the end of a step."""
        return self._move(t, packed, IN_STEP)

    def consistent(self, t: Numbers, state: LagrangianState) -> LagrangianState:
        """Returns the nearest state that keeps all constraints: first q, then q̇, in the metric M of the kinetic
        energy.

        Newton's method finds q from any state that is not too far away; :func:`jaxball.problems` says whether it did.
        """
        self.require_state(state)
        return _move_from_afar(self, to_array(t, "t"), state)

    def _move(self, t: Float[Array, ""], state: LagrangianState, steps: int) -> LagrangianState:
        q, qdot = state.q, state.qdot
        mass = self.equations(t, state).mass
        if self.always_projected:
            q = nearest_place(mass, self._of_place, t, q, steps)
        rows = jax.jacfwd(self._rates, argnums=2)(t, q, qdot)
        return LagrangianState(q, nearest_velocity(mass, rows, self._rates(t, q, qdot), qdot))

    # What is possible.

    def describe(self) -> str:
        return f"{self.title} in {', '.join(self.coordinates)}"

    def default_state(self) -> LagrangianState:
        """Returns the state with all coordinates 0, at rest."""
        return LagrangianState(jnp.zeros(len(self.coordinates), default_dtype()))

    def require_state(self, state: LagrangianState) -> None:
        super().require_state(state)
        n = len(self.coordinates)
        for name in ("q", "qdot"):
            shape = np.shape(getattr(state, name))
            if shape[-1:] != (n,):
                raise ValueError(
                    f"Argument `state.{name}` must have {n} numbers, of {', '.join(self.coordinates)}, but its shape "
                    f"is {shape}."
                )

    def start_conditions(self, t: Float[Array, ""], state: LagrangianState) -> Iterator[Condition | ExplainedCondition]:
        self.require_state(state)
        mass, measured = _measure(self, t, state)
        yield from start_conditions(mass, Constraints(self.constraint_names, self._counts()[0], *measured))

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """The names of the constraints in sentences, those of holonomic ones after the others."""
        v, k = self._counts()
        return (*(f"constraints[{j}]" for j in range(v)), *(f"holonomic[{j}]" for j in range(k)))

    def _compute_constraints(self, t: Float[Array, ""], state: LagrangianState) -> tuple[Array, tuple[Array, ...]]:
        """Computes M, and the fields of :class:`Constraints` from ``rows`` on."""
        q, qdot = state.q, state.qdot
        terms, places = self.equations(t, state), self._of_place(t, q)
        free, residual = self._rates(t, q, jnp.zeros_like(qdot)), self._rates(t, q, qdot)
        # Away from the start's own rates, at which a higher power of q̇ may have no second derivative.
        curvatures = jax.hessian(lambda qdot: self._of_velocity(t, q, qdot))(qdot + 1.0).reshape(-1, q.size**2)
        second = jnp.take_along_axis(curvatures, jnp.argmax(jnp.abs(curvatures), axis=1)[:, None], axis=1)[:, 0]
        # Beside the start, by a step in no special direction: there, what is singular in one place alone is regular.
        beside = q + BESIDE_THE_START * (1.0 + jnp.abs(q)) * jnp.asarray(np.sqrt(2.0 + np.arange(q.size)), q.dtype)
        rows_beside = jax.jacfwd(self._rates, argnums=2)(t, beside, qdot)
        # Relative to the size of the terms, so that constraints in any units are judged alike.
        near = ALLOWED_RESIDUAL * jnp.sqrt(jnp.sum(terms.rows**2, axis=1))
        allowed = near * (LEAST_COUNTED + jnp.sqrt(jnp.sum(qdot**2))) + ALLOWED_RESIDUAL * jnp.abs(free)
        places_allowed = near[near.size - places.size :] * (LEAST_COUNTED + jnp.sqrt(jnp.sum(q**2)))
        return terms.mass, (terms.rows, rows_beside, residual, allowed, second, places, places_allowed)

    def driving_kinks(self) -> Float[Array, " kinks"]:
        return kinks_seen(self, type(self).field, self.default_state(), method="driving_kinks")

    # What is known of the motion.

    def laws(self, t: Float[Array, ""], state: LagrangianState) -> Any:
        q, qdot = state.q, state.qdot
        value, momentum = jax.value_and_grad(self._energy, argnums=2)(t, q, qdot)
        energy, (v, k) = jnp.sum(momentum * qdot) - value, self._counts()
        if not v + k:
            return LagrangianLaws(energy)
        rates = self._rates(t, q, qdot)
        return HolonomicLaws(energy, rates, self._of_place(t, q)) if k else NonholonomicLaws(energy, rates)

    def law_rates(self, t: Float[Array, ""], state: LagrangianState) -> Mapping[str, Float[Array, "..."]]:
        """Computes Ė = Q·q̇ − ∂L/∂t − λ·b."""
        return {"energy": self.power(t, state, self.multipliers(t, state))}

    def power(self, t: Float[Array, ""], state: LagrangianState, multipliers: Float[Array, " m"]) -> Float[Array, ""]:
        """Computes Ė with the λ of all constraints."""
        q, qdot = state.q, state.qdot
        _, explicit = jax.jvp(lambda t: self._energy(t, q, qdot), (t,), (jnp.ones_like(t),))
        free = self._rates(t, q, jnp.zeros_like(qdot))
        work = jnp.sum(self._forces(t, q, qdot) * qdot)
        return work - explicit - jnp.sum(multipliers * free)


@programs.filter_jit
def _move_from_afar(system: AbstractLagrangianSystem, t: Array, state: LagrangianState) -> LagrangianState:
    return system._move(t, state, FROM_AFAR)


@programs.filter_jit
def _measure(system: AbstractLagrangianSystem, t: Array, state: LagrangianState) -> tuple[Array, tuple[Array, ...]]:
    return system._compute_constraints(t, state)


def as_vector(name: str, value: Any, dtype: Any) -> Float[Array, " m"]:
    """Converts the return value of a function, one number or several, to a vector."""
    if isinstance(value, list | tuple):
        for k, item in enumerate(value):
            require_value(f"{name}[{k}]", item, ())
        return jnp.stack([jnp.asarray(item, dtype) for item in value]) if value else jnp.zeros((0,), dtype)
    if np.ndim(value) > 1 or not isinstance(value, jax.Array | np.ndarray | np.generic | int | float):
        raise TypeError(f"Argument `{name}` must give a number, or a list of numbers, but it gives {describe(value)}.")
    return jnp.atleast_1d(jnp.asarray(value, dtype))
