"""Own systems from a Lagrangian, with or without constraints: JAX forms the equations of motion.

The user's functions are those of a book: L(t, q, q̇), constraints that are 0, and generalised forces. Everything else is
derived (module ``multipliers``).
"""

import abc
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from .. import programs
from ..interface.arguments import (
    call_with,
    describe,
    refusal,
    require_callable_with,
    require_value,
    takes_parameters,
    traceable,
)
from ..interface.printing import format_value
from ..numerics.arrays import Numbers, default_dtype, numbers, to_array
from ..numerics.kinks import Traced, kinks_of_functions, kinks_seen
from ..physics.conditions import Condition
from .constraints_at_start import ALLOWED_RESIDUAL, Constraints, start_conditions
from .multipliers import Equations, equations, nearest_place, nearest_velocity, rate_along
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

    >>> from jaxball.classical import LagrangianState
    >>> LagrangianState([0.0, 0.0, 0.5])
    LagrangianState(q=(0.0, 0.0, 0.5), qdot=(0.0, 0.0, 0.0))
    """

    q: Float[Array, "*batch n"]
    qdot: Float[Array, "*batch n"]

    sized = ("q", "qdot")

    def __init__(self, q: Numbers = (), qdot: Numbers | None = None):
        self.q = numbers("q", ("n",), batch=True)(q)
        self.qdot = jnp.zeros_like(self.q) if qdot is None else numbers("qdot", ("n",), batch=True)(qdot)


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
        value = _vector("forces", self.forces(t, q, qdot), q.dtype)
        require_value("forces", value, q.shape)
        return value

    def _of_velocity(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Float[Array, " m"]:
        return _vector("constraints", self.constraints(t, q, qdot), q.dtype)

    def _of_place(self, t: Float[Array, ""], q: Float[Array, " n"]) -> Float[Array, " k"]:
        return _vector("holonomic", self.holonomic(t, q), q.dtype)

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

    def start_conditions(self, t: Float[Array, ""], state: LagrangianState) -> Iterator[Condition]:
        self.require_state(state)
        v, k = self._counts()
        names = (*(f"constraints[{j}]" for j in range(v)), *(f"holonomic[{j}]" for j in range(k)))
        mass, measured = _measure(self, t, state)
        yield from start_conditions(mass, Constraints(names, v, *measured))

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
        q, qdot = state.q, state.qdot
        _, explicit = jax.jvp(lambda t: self._energy(t, q, qdot), (t,), (jnp.ones_like(t),))
        free = self._rates(t, q, jnp.zeros_like(qdot))
        work = jnp.sum(self._forces(t, q, qdot) * qdot)
        return {"energy": work - explicit - jnp.sum(self.multipliers(t, state) * free)}


@programs.filter_jit
def _move_from_afar(system: AbstractLagrangianSystem, t: Array, state: LagrangianState) -> LagrangianState:
    return system._move(t, state, FROM_AFAR)


@programs.filter_jit
def _measure(system: AbstractLagrangianSystem, t: Array, state: LagrangianState) -> tuple[Array, tuple[Array, ...]]:
    return system._compute_constraints(t, state)


class LagrangianSystem(AbstractLagrangianSystem):
    """A system from functions: a Lagrangian, and whatever constrains and drives it.

    Each is a function of the time t, the coordinates q and their rates q̇, arrays of shape (n,), from which ``x, y = q``
    takes the numbers, and last, if it takes one more, of ``parameters``. They are written with ``jax.numpy``.

    **Arguments:**

    - ``lagrangian``: L(t, q, q̇), a number; T − V of a natural system.
    - ``coordinates``: the names of the coordinates.
    - ``constraints``: of (t, q, q̇), to what is 0 along every motion: a number, or a list of them. It is written as in
      a book, ẋ sin θ − ẏ cos θ, must be affine in q̇, A q̇ + b, and A and b are its derivatives.
    - ``holonomic``: of (t, q), to φ, which is 0 along every motion: a number, or a list of them. Steps end on φ = 0.
    - ``forces``: of (t, q, q̇), to the generalised forces Q, shape (n,), that L does not contain, such as friction.
    - ``parameters``: numbers in any PyTree, passed to all functions; they can be swept and differentiated.
    - ``kink_times``: times, shape (kinks,), at which a function jumps; comparisons of the time alone are found.
    - ``always_projected``: whether steps end on the constraints where some are holonomic. False shows how far the
      equations for q̈ alone drift away from them.

    Constraints must be independent, and the start must keep them: :func:`jaxball.problems` names each that does not
    fit, and ``consistent(t, state)`` is the nearest start that keeps them. The mass matrix ∂²L/∂q̇² may be singular
    along what constraints fix.

    **Raises:** ``TypeError`` for functions that do not take these arguments, and ``ValueError`` for coordinates without
    names or with the same.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> import jax.numpy as jnp
    >>> from jaxball import simulate
    >>> from jaxball.classical import LagrangianState, LagrangianSystem
    >>> def lagrangian(t, q, qdot):
    ...     return 0.5 * jnp.sum(qdot**2)
    >>> def constraint(t, q, qdot):  # ż = y ẋ
    ...     return qdot[2] - q[1] * qdot[0]
    >>> particle = LagrangianSystem(lagrangian, ("x", "y", "z"), constraints=constraint)
    >>> particle
    LagrangianSystem(lagrangian, coordinates=('x', 'y', 'z'), constraints=constraint)
    >>> start = LagrangianState([0.0, 0.0, 0.0], [1.0, 1.0, 0.0])
    >>> run = simulate(particle, [0.0, 1.0, 2.0], start, throw=True)
    >>> print(run.state.qdot[:, 0].round(6))  # 1 / √(1 + t²)
    [1.       0.707107 0.447214]
    >>> print(jax.vmap(particle.multipliers)(run.times, run.state).round(6))
    [[1.      ]
     [0.353553]
     [0.089443]]
    """

    functions: "Functions" = eqx.field(static=True)
    coordinates: tuple[str, ...] = eqx.field(static=True)  # pyright: ignore
    parameters: PyTree
    kink_times: Float[Array, " kinks"] | None
    projects: bool = eqx.field(static=True)

    def __init__(
        self,
        lagrangian: Callable[..., Any],
        coordinates: Sequence[str],
        *,
        constraints: Callable[..., Any] | None = None,
        holonomic: Callable[..., Any] | None = None,
        forces: Callable[..., Any] | None = None,
        parameters: PyTree = None,
        kink_times: Numbers | None = None,
        always_projected: bool = True,
    ):
        self.coordinates = _check_names(coordinates)  # pyright: ignore[reportIncompatibleVariableOverride]
        self.functions = Functions(lagrangian, constraints, holonomic, forces)
        for (name, function), takes in zip(self.functions._asdict().items(), TAKES.values(), strict=True):
            if function is not None or name == "lagrangian":
                require_callable_with(name, function, None, *takes)
        functions = zip(self.functions, TAKES.values(), strict=True)
        if not any(takes_parameters(function, len(takes), parameters) for function, takes in functions if function):
            require_callable_with("lagrangian", lagrangian, parameters, *OF_MOTION)
        self.parameters = jax.tree.map(_as_number, parameters)
        # None takes no part where systems are stacked.
        self.kink_times = None if kink_times is None else numbers("kink_times", ("kinks",))(kink_times)
        self.projects = always_projected

    def lagrangian(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Float[Array, ""]:
        return self._call("lagrangian", t, q, qdot)

    def constraints(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Any:
        return self._call("constraints", t, q, qdot)

    def holonomic(self, t: Float[Array, ""], q: Float[Array, " n"]) -> Any:
        return self._call("holonomic", t, q)

    def forces(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Any:
        return self._call("forces", t, q, qdot)

    def _call(self, name: str, *arguments: Array) -> Any:
        function = getattr(self.functions, name)
        if function is None:
            return getattr(super(), name)(*arguments)
        with traceable(name, function):
            return call_with(function, *arguments, parameters=self.parameters)

    @property
    def always_projected(self) -> bool:
        """Whether steps end on the constraints in any case: with holonomic ones, unless the user says no."""
        return self.projects and super().always_projected

    def driving_kinks(self) -> Float[Array, " kinks"]:
        q = self.default_state().q
        seen = []
        for (name, function), takes in zip(self.functions._asdict().items(), TAKES.values(), strict=True):
            if function is not None:

                def evaluate(system: "LagrangianSystem", t: Array, *arguments: Array, name: str = name) -> Any:
                    # `name` is a default, because each of these functions must keep its own.
                    return system._call(name, t, *arguments)

                seen.append(Traced(function, evaluate, (q,) * (len(takes) - 1)))
        return kinks_of_functions(self, seen, jnp.zeros((0,), q.dtype) if self.kink_times is None else self.kink_times)

    def __repr__(self) -> str:
        first, *others = (
            (name, function) for name, function in self.functions._asdict().items() if function is not None
        )
        parts = [format_value(first[1]), f"coordinates={self.coordinates}"]
        parts += [f"{name}={format_value(function)}" for name, function in others]
        parts += [] if self.parameters is None else [f"parameters={format_value(self.parameters)}"]
        parts += [f"kink_times={format_value(self.kink_times)}"] if self.kink_times is not None else []
        parts += [] if self.projects else ["always_projected=False"]
        return f"LagrangianSystem({', '.join(parts)})"


class Functions(NamedTuple):
    """The functions of a :class:`LagrangianSystem`."""

    lagrangian: Callable[..., Any]
    constraints: Callable[..., Any] | None
    holonomic: Callable[..., Any] | None
    forces: Callable[..., Any] | None


OF_MOTION = ("t", "q", "qdot")
TAKES = {"lagrangian": OF_MOTION, "constraints": OF_MOTION, "holonomic": ("t", "q"), "forces": OF_MOTION}


def _check_names(coordinates: Sequence[str]) -> tuple[str, ...]:
    if not isinstance(coordinates, list | tuple) or not all(isinstance(name, str) for name in coordinates):
        raise refusal("coordinates", 'the names of the coordinates, such as ("x", "y", "theta")', coordinates)
    names = tuple(coordinates)
    if not names or len(set(names)) < len(names):
        raise ValueError(f"Argument `coordinates` must be one or more different names, but it is {names}.")
    return names


def _as_number(leaf: Any) -> Any:
    """Converts numbers to arrays, which can be swept; whatever else a user passes stays as it is."""
    return to_array(leaf, "parameters") if isinstance(leaf, int | float | np.ndarray) else leaf


def _vector(name: str, value: Any, dtype: Any) -> Float[Array, " m"]:
    """Converts the return value of a function, one number or several, to a vector."""
    if isinstance(value, list | tuple):
        for k, item in enumerate(value):
            require_value(f"{name}[{k}]", item, ())
        return jnp.stack([jnp.asarray(item, dtype) for item in value]) if value else jnp.zeros((0,), dtype)
    if np.ndim(value) > 1 or not isinstance(value, jax.Array | np.ndarray | np.generic | int | float):
        raise TypeError(f"Argument `{name}` must give a number, or a list of numbers, but it gives {describe(value)}.")
    return jnp.atleast_1d(jnp.asarray(value, dtype))
