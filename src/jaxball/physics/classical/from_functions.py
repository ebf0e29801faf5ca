"""Own systems from functions: a Lagrangian, constraints and forces, and what may hold them for a while."""

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ...interface.arguments import call_with, refusal, require_callable_with, takes_parameters, traceable
from ...interface.printing import format_value
from ...numerics.arrays import Numbers, default_dtype, numbers, to_array
from ...numerics.kinks import Traced, kinks_of_functions
from ...numerics.vectors import apply
from ..conditions import Condition, ExplainedCondition
from ..system import AbstractSystem
from .lagrangian import AbstractLagrangianSystem, LagrangianState, as_vector
from .multipliers import ALLOWED_RESIDUAL, Equations, Open, independent_beyond, rate_along
from .rows import (
    DryFriction,
    UnilateralContact,
    check_determined,
    mode_at_rest,
    row_forces,
    size_of_gaps,
    to_contacts,
    to_frictions,
)
from .with_rows import LagrangianWithRows


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
    - ``unilateral``: contacts with one side, each a function g(t, q) ≥ 0 or a :class:`UnilateralContact` with a
      restitution, one or several: the system strikes where g falls to 0, rebounds or stays there, and leaves again.
    - ``dry``: a :class:`DryFriction` or several, which hold velocities at 0 where they can.
    - ``parameters``: numbers in any PyTree, passed to all functions; they can be swept and differentiated.
    - ``kink_times``: the times at which a function jumps; comparisons of the time alone are found, shape (kinks,).
    - ``always_projected``: whether steps end on the constraints where some are holonomic. False shows how far the
      equations for q̈ alone drift away from them.

    Constraints must be independent, and the start must keep them: :func:`jaxball.problems` names each that does not
    fit, and ``consistent(t, state)`` is the nearest start that keeps them. The mass matrix ∂²L/∂q̇² may be singular
    along what constraints fix. With contacts or dry friction a run has modes: ``run.switches`` says when they change,
    and ``run.history`` what is held. All contacts and frictions that are held at once must be independent.

    **Raises:** ``TypeError`` for functions that do not take these arguments, and ``ValueError`` for coordinates without
    names or with the same.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> import jax.numpy as jnp
    >>> from jaxball import simulate
    >>> from jaxball.physics.classical import LagrangianState, LagrangianSystem
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
    unilateral: tuple[UnilateralContact, ...]
    dry: tuple[DryFriction, ...]
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
        unilateral: Callable[..., Any] | UnilateralContact | Sequence[Any] | None = None,
        dry: DryFriction | Sequence[Any] | None = None,
        parameters: PyTree = None,
        kink_times: Numbers | None = None,
        always_projected: bool = True,
    ):
        self.coordinates = _check_names(coordinates)  # pyright: ignore[reportIncompatibleVariableOverride]
        self.functions = Functions(lagrangian, constraints, holonomic, forces)
        self.unilateral, self.dry = to_contacts(unilateral), to_frictions(dry)
        require_callable_with("lagrangian", lagrangian, None, *OF_MOTION)
        for name, function, takes in self._list_functions():
            require_callable_with(name, function, None, *takes)
        if not any(takes_parameters(function, len(takes), parameters) for _, function, takes in self._list_functions()):
            require_callable_with("lagrangian", lagrangian, parameters, *OF_MOTION)
        self.parameters = jax.tree.map(_as_number, parameters)
        # None takes no part where systems are stacked.
        self.kink_times = None if kink_times is None else numbers("kink_times", ("kinks",))(kink_times)
        self.projects = always_projected

    def _list_functions(self) -> Iterator[tuple[str, Callable[..., Any], tuple[str, ...]]]:
        """Yields the user's functions: the name of each, and of its arguments."""
        for (name, function), takes in zip(self.functions._asdict().items(), TAKES.values(), strict=True):
            if function is not None:
                yield name, function, takes
        yield from ((f"unilateral[{k}].gap", contact.gap, OF_PLACE) for k, contact in enumerate(self.unilateral))
        yield from ((f"dry[{k}].velocity", friction.velocity, OF_MOTION) for k, friction in enumerate(self.dry))

    def lagrangian(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Float[Array, ""]:
        return self._call("lagrangian", t, q, qdot)

    def constraints(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Any:
        return self._call("constraints", t, q, qdot)

    def holonomic(self, t: Float[Array, ""], q: Float[Array, " n"]) -> Any:
        return self._call("holonomic", t, q)

    def forces(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Any:
        return self._call("forces", t, q, qdot)

    def _call(self, name: str, *arguments: Array) -> Any:
        function = {written: function for written, function, _ in self._list_functions()}.get(name)
        if function is None:
            return getattr(super(), name)(*arguments)
        with traceable(name, function):
            return call_with(function, *arguments, parameters=self.parameters)

    # Rows, which a law may hold for a while.

    @property
    def is_hybrid(self) -> bool:
        """Whether it has contacts or dry friction, so that a run has modes."""
        return bool(self.unilateral or self.dry)

    @property
    def with_modes(self) -> AbstractSystem:
        return LagrangianWithRows(self) if self.is_hybrid else self

    def gaps(self, t: Float[Array, ""], q: Float[Array, " n"]) -> Float[Array, " contacts"]:
        """Computes g(t, q) of all contacts with one side, which is positive where they are open."""
        of_each = (self._gaps_of(k, t, q) for k in range(len(self.unilateral)))
        return jnp.concatenate([jnp.zeros((0,), q.dtype), *of_each])

    def _gaps_of(self, k: int, t: Float[Array, ""], q: Float[Array, " n"]) -> Float[Array, " contacts"]:
        name = f"unilateral[{k}].gap"
        return as_vector(name, self._call(name, t, q), q.dtype)

    def _velocities_of(
        self, k: int, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]
    ) -> Float[Array, " frictions"]:
        name = f"dry[{k}].velocity"
        return as_vector(name, self._call(name, t, q, qdot), q.dtype)

    def row_rates(self, t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Float[Array, " rows"]:
        """Computes the velocities of all rows: the rates of the gaps, then what dry friction acts against."""
        of_each = (self._velocities_of(k, t, q, qdot) for k in range(len(self.dry)))
        return jnp.concatenate([rate_along(self.gaps)(t, q, qdot), *of_each])

    @property
    def rows(self) -> tuple[str, ...]:
        """The names of the rows, ``unilateral[0]`` and ``dry[0]``; of several of one function ``dry[0][1]``."""
        names = []
        for kind, sizes in zip(("unilateral", "dry"), self.row_sizes(), strict=True):
            for k, size in enumerate(sizes):
                names += [f"{kind}[{k}]"] if size == 1 else [f"{kind}[{k}][{j}]" for j in range(size)]
        return tuple(names)

    def row_sizes(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Counts the rows of each contact, and of each friction."""
        t, q = (jax.ShapeDtypeStruct(shape, default_dtype()) for shape in ((), (len(self.coordinates),)))

        def count(function: Callable[..., Any], *arguments: Any) -> int:
            return eqx.filter_eval_shape(function, *arguments).size

        return (
            tuple(count(functools.partial(self._gaps_of, k), t, q) for k in range(len(self.unilateral))),
            tuple(count(functools.partial(self._velocities_of, k), t, q, q) for k in range(len(self.dry))),
        )

    def row_forces(self, t: Float[Array, ""], state: LagrangianState) -> Float[Array, " rows"]:
        """Computes what acts on each row, in the order of ``rows``: the reaction of a contact, the dry friction.

        As the state alone tells: a gap that is 0 and does not change is closed, and what has no velocity sticks, if
        something can hold them so.
        """
        return row_forces(self, t, state)

    def equations(self, t: Float[Array, ""], state: LagrangianState) -> Equations:
        terms = super().equations(t, state)
        if not self.is_hybrid:
            return terms
        acting = apply(jax.jacfwd(self.row_rates, argnums=2)(t, state.q, state.qdot).T, self.row_forces(t, state))
        return terms._replace(force=terms.force + acting)

    def law_rates(self, t: Float[Array, ""], state: LagrangianState) -> Mapping[str, Float[Array, "..."]]:
        rates = super().law_rates(t, state)
        if not self.is_hybrid:
            return rates
        at_rest = self.row_rates(t, state.q, jnp.zeros_like(state.qdot))
        moved = self.row_rates(t, state.q, state.qdot) - at_rest
        return {"energy": rates["energy"] + jnp.sum(self.row_forces(t, state) * moved)}

    def conditions(self) -> Iterator[Condition]:
        for kind in ("unilateral", "dry"):
            for k, row in enumerate(getattr(self, kind)):
                yield from row.conditions(f"{kind}[{k}]")

    def start_conditions(self, t: Float[Array, ""], state: LagrangianState) -> Iterator[Condition | ExplainedCondition]:
        yield from self.conditions_of_rows(t, state)
        if self.is_hybrid:
            yield check_determined(mode_at_rest(self, t, state), self.rows)

    def conditions_of_rows(
        self, t: Float[Array, ""], state: LagrangianState
    ) -> Iterator[Condition | ExplainedCondition]:
        """Yields all that an initial state must meet, but that it is known what is held there."""
        yield from super().start_conditions(t, state)
        contacts = sum(self.row_sizes()[0])
        if contacts:
            gaps, allowed = self.gaps(t, state.q), size_of_gaps(self, t, state.q, ALLOWED_RESIDUAL)
            yield Open(gaps >= -allowed, self.rows[:contacts], gaps, "state.q")
        if self.dry:
            always = self.constraint_names
            by_rates = functools.partial(jax.jacfwd, argnums=2)
            rows = [
                by_rates(self._rates)(t, state.q, state.qdot),
                by_rates(self.row_rates)(t, state.q, state.qdot)[contacts:],
            ]
            yield independent_beyond(len(always), jnp.concatenate(rows), (*always, *self.rows[contacts:]))

    @property
    def always_projected(self) -> bool:
        """Whether steps end on the constraints in any case: with holonomic ones, unless the user says no."""
        return self.projects and super().always_projected

    def driving_kinks(self) -> Float[Array, " kinks"]:
        q = self.default_state().q
        seen = []
        for name, function, takes in self._list_functions():

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
        for kind in ("unilateral", "dry"):
            rows = getattr(self, kind)
            parts += [f"{kind}={format_value(rows[0] if len(rows) == 1 else list(rows))}"] if rows else []
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


OF_MOTION, OF_PLACE = ("t", "q", "qdot"), ("t", "q")
TAKES = {"lagrangian": OF_MOTION, "constraints": OF_MOTION, "holonomic": OF_PLACE, "forces": OF_MOTION}


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
