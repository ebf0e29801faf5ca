"""A robot with sampled inputs: the exact flow over one sample, its derivatives, and combinations that no input changes.

Controllers, filters and environments advance a robot by it.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..interface.compat import is_traced
from ..interface.printing import Printed
from ..numerics.arrays import Numbers, default_dtype
from ..numerics.declare import number
from ..numerics.vectors import apply
from ..physics.body import Ball, System
from ..physics.contact.body_on_plane import BodyOnPlane
from ..physics.contact.law import Contact
from ..physics.contact.modes import ContactState
from ..physics.contact.released import ReleasedState
from ..physics.forces.force import HarmonicForce, Push, Wrenches
from ..physics.forces.resistance import Resistance
from ..physics.hybrid import START, Accuracy
from ..physics.state import DiskState, PlacedState
from ..simulation import DEFAULT_TOLERANCE
from ..simulation.extremes import most_steps_of_sample
from ..simulation.simulate import simulate
from .inputs import Place, hold_inputs, limits_of, places_of, with_inputs

ANY_ORDER = 5.0  # of a method: the mode in which a body starts does not depend on it
LEAST_REACHED = 1e-8  # of the largest singular value of the reachable subspace's factor; below it is rounding
ROUNDING = 1e-6  # of the largest entry of a combination


class Linear(NamedTuple):
    """The flow over one sample near a motion: ξ⁺ = A ξ + B δu + c in local coordinates ξ around its states.

    - ``A``, ``B``: shapes (n, n) and (n, m).
    - ``c``: what the motion itself misses its next state by, shape (n,).
    """

    A: Float[Array, "*samples n n"]
    B: Float[Array, "*samples n m"]
    c: Float[Array, "*samples n"]


class SampledSystem(Printed):
    """A body whose inputs are set at each sample and held until the next one: a zero-order hold.

    Its inputs are efforts of joints, which add to passive forces there, and accelerations θ̈ of masses on rails, of
    :class:`~jaxball.Accelerated` joints, and of angles of a :class:`~jaxball.physics.TiltingPlane`. What moved these, a
    schedule, a law or a :class:`~jaxball.Motor`, is gone, and θ and θ̇ of each belong to the state.

    - ``system``: the body, with every input 0.
    - ``places``: where the inputs act.
    - ``limits``: the largest magnitude of each input, that of its motor; infinite where there is none, shape (m,).
    - ``sample``: the time between samples.
    - ``rtol``, ``atol``: tolerances of the solve of a sample.
    - ``contact``: the law of contact of a body that may slip; None for one that always rolls.
    """

    system: System
    limits: Float[Array, " m"]
    sample: Float[Array, ""] = eqx.field(converter=number())
    rtol: Float[Array, ""] = eqx.field(converter=number())
    atol: Float[Array, ""] = eqx.field(converter=number())
    places: tuple[Place, ...] = eqx.field(static=True)
    contact: Contact | None = None

    def __check_init__(self):
        if not is_traced(self.sample) and not np.all(np.asarray(self.sample) > 0):
            raise ValueError(f"Argument `sample` must be a positive time, but it is {self.sample:g}.")

    @classmethod
    def of(
        cls,
        system: System,
        sample: Numbers,
        inputs: Sequence[str] | None = None,
        rtol: Numbers = DEFAULT_TOLERANCE,
        atol: Numbers = DEFAULT_TOLERANCE,
    ) -> "SampledSystem":
        """Builds the sampled system of a body.

        **Arguments:**

        - ``system``: a :class:`~jaxball.Ball` or a :class:`~jaxball.Disk`.
        - ``sample``: the time between samples.
        - ``inputs``: names of the coordinates that are set, as in ``coordinates`` of a body, such as
          ``"mechanisms[0].joints[0]"`` or ``"masses[1]"``; by default all that a schedule, a law or a motor moves.
        - ``rtol``, ``atol``: tolerances of the solve of a sample.

        **Raises:** ``ValueError`` for unknown names, where there is nothing to set, and for a ``sample`` that is not
        positive; ``TypeError`` for other systems.
        """
        places = places_of(system, inputs)
        return cls(with_inputs(system, places), limits_of(system, places), sample, rtol, atol, places)

    @classmethod
    def without_inputs(
        cls, system: System, sample: Numbers, rtol: Numbers = DEFAULT_TOLERANCE, atol: Numbers = DEFAULT_TOLERANCE
    ) -> "SampledSystem":
        """Builds the sampled system of a body that nobody steers: whatever moves it stays. Arguments as for
        :meth:`of`.
        """
        return cls(system, jnp.zeros((0,), default_dtype()), sample, rtol, atol, ())

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of the inputs, in the order of u."""
        return tuple(place.name for place in self.places)

    @property
    def directions(self) -> tuple[str, ...]:
        """The names of the local coordinates of a state."""
        return self.system.upright_state().directions

    def hold(self, u: Float[Array, " m"]) -> System:
        """Returns the body while its inputs are ``u``."""
        return hold_inputs(self.system, self.places, u) if self.places else self.system

    def begin(self, system: System, t: Float[Array, ""], state: PlacedState | ReleasedState) -> Any:
        """Returns what :meth:`advance` takes for a body in a state: with a law of contact, also its mode."""
        if self.contact is None:
            return state
        plane = self.as_solved(system).prepare()
        accuracy = Accuracy(self.rtol, self.atol, ANY_ORDER, 1.0)
        after = plane.transition(t, plane.start(t, state), jnp.asarray(START), accuracy).after
        # Of the same kind as after a sample, for a scan.
        return jax.tree.map(lambda x: jnp.asarray(x, t.dtype), after)

    def as_solved(self, system: System) -> Any:
        """Returns what a solve advances the state of: with a law of contact, the body on its plane."""
        return system if self.contact is None else BodyOnPlane(system, self.contact)

    def body_state(self, state: Any) -> PlacedState:
        """Returns the state of the body in what :meth:`advance` takes and gives."""
        return state if self.contact is None else state.body

    def flow(
        self,
        t: Float[Array, ""],
        state: Any,
        u: Float[Array, " m"],
        adjoint: diffrax.AbstractAdjoint | None = None,
    ) -> Any:
        """Computes the state a sample after ``t``, from ``state``, with the inputs ``u`` held: NaN where the solve
        fails.

        It can be traced, within ``jax.lax.scan`` and ``jax.lax.map`` too. ``adjoint`` as for :func:`jaxball.simulate`,
        and states as for :meth:`advance`.
        """
        # The flow of a versor keeps its length up to the error of the solve, which would grow over many samples.
        return self.advance(self.hold(u), t, state, adjoint)[0].projected()

    def advance(
        self,
        system: System,
        t: Float[Array, ""],
        state: Any,
        adjoint: diffrax.AbstractAdjoint | None = None,
    ) -> tuple[Any, Int[Array, ""]]:
        """Advances a body with held inputs by a sample from ``t``: its state, as the solve leaves it, and its status.

        With a law of contact, states are as :meth:`begin` returns them; the first may also be a ``ReleasedState``.
        Traceable; ``adjoint`` as for :meth:`flow`.
        """
        run = simulate(
            system,
            jnp.stack([t, t + self.sample]),
            state.released if isinstance(state, ContactState) else state,
            contact=self.contact,
            rtol=self.rtol,
            atol=self.atol,
            adjoint=adjoint,
            max_steps=most_steps_of_sample(self.contact),
            inside=False,
        )
        states = run.state if run.contact is None else run.contact.states_of(system, run.state)
        return jax.tree.map(lambda leaf: leaf[-1], states), run.status

    def deviation(self, state: PlacedState, other: PlacedState) -> Float[Array, " n"]:
        """Computes ξ of ``other`` around ``state``, as feedback counts it: the local coordinates.

        The attitude of a uniform ball tells nothing, and its coordinates are 0. Those of Ω are the difference of
        ω = ΛΩ, in space axes, because Ω is in other body axes where the ball has rolled to another place.
        """
        xi = state.difference(other)
        if not self._may_be_uniform(state):
            return xi
        omega = apply(other.Lambda, other.Omega) - apply(state.Lambda, state.Omega)
        return jnp.where(self._is_uniform(), jnp.concatenate([jnp.zeros_like(xi[:3]), omega, xi[6:]]), xi)

    def displace(self, state: PlacedState, xi: Float[Array, " n"]) -> PlacedState:
        """Returns the state with the :meth:`deviation` ``xi`` from ``state``; for a uniform ball, its attitude is
        turned too.
        """
        moved = state.retract(xi)
        if not self._may_be_uniform(state):
            return moved
        # Inverts `deviation`: ω is displaced in space and taken back to the body axes after the turn.
        omega = apply(state.Lambda, state.Omega) + xi[3:6]
        Omega = apply(moved.Lambda.T, omega)
        return moved.with_Omega(jnp.where(self._is_uniform(), Omega, moved.Omega))

    def _may_be_uniform(self, state: PlacedState) -> bool:
        """Returns whether nothing but its inertia and offset can tell one attitude of the body from another."""
        system = self.system
        terms = system.force.terms if isinstance(system.force, Wrenches) else (system.force,)
        return (
            isinstance(system, Ball)
            and not isinstance(state, DiskState)
            and not system.point_masses
            and not system.mechanisms
            and all(isinstance(term, HarmonicForce | Push | None) for term in terms)
            and isinstance(system.resistance, Resistance | None)
        )

    def _is_uniform(self) -> Bool[Array, ""]:
        inertia, offset = self.system.inertia, self.system.offset
        return jnp.all(inertia == inertia[0]) & jnp.all(offset == 0)

    def linearise_deviation(
        self, t: Float[Array, ""], state: PlacedState, u: Float[Array, " m"], following: PlacedState
    ) -> Linear:
        """Linearises the flow from ``state`` with inputs ``u``, in the coordinates of :meth:`deviation` there and
        around ``following``.
        """
        n = len(state.directions)

        def flow_from(v: Float[Array, " n_plus_m"]) -> Float[Array, " n"]:
            after = self.flow(t, self.displace(state, v[:n]), u + v[n:], diffrax.ForwardMode())
            return self.deviation(following, after)

        c, columns = columns_at_0(flow_from, n + u.size, u.dtype)
        return Linear(columns[:, :n], columns[:, n:], c)


def columns_at_0(function: Callable[[Array], Any], size: int, dtype: Any) -> Any:
    """Computes what a function of ``size`` numbers gives at 0, and its derivative by them, which are the last axis."""
    zero = jnp.zeros(size, dtype)
    # One direction after the other: side by side, the program would take several times as long to compile.
    values, columns = jax.lax.map(lambda v: jax.jvp(function, (zero,), (v,)), jnp.eye(size, dtype=dtype))
    # The values are the same in every direction.
    return jax.tree.map(lambda x: x[0], values), jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1), columns)


def uncontrollable(linear: Linear, names: Sequence[str]) -> tuple[str, ...]:
    """Lists the combinations of deviations at the end of a linear flow that no input changes, by name.

    Those that are 0 in every flow, such as the attitude of a uniform ball, are left out.
    """
    A, B = np.asarray(linear.A), np.asarray(linear.B)
    # Directions that stay 0 in each flow would count as unreachable.
    indices = np.flatnonzero(np.any(A != 0, axis=(0, 2)))
    rows = null_space(reachability_factor(A[:, indices[:, None], indices], B[:, indices]))
    return in_words(rows, [names[int(k)] for k in indices])


def reachability_factor(
    A: Float[np.ndarray, "samples n n"], B: Float[np.ndarray, "samples n m"]
) -> Float[np.ndarray, "n rank"]:
    """Computes a factor of the reachability Gramian, Σ Φ B Bᵀ Φᵀ, kept small by a QR factorisation at each sample."""
    n = A.shape[1]
    factor = np.zeros((n, n))
    for step, effect in zip(A, B, strict=True):
        # The rows of both, taken together, have the Gramian of the sum.
        triangle = np.asarray(np.linalg.qr(np.concatenate([(step @ factor).T, effect.T]), mode="r"))
        factor = triangle.T
    return factor


def null_space(factor: Float[np.ndarray, "n rank"]) -> Float[np.ndarray, "rows n"]:
    """Computes an orthonormal basis of the null space of a Gramian with this factor."""
    columns, sizes, _ = np.linalg.svd(factor)
    sizes = np.append(sizes, np.zeros(len(factor) - len(sizes)))
    return columns.T[sizes <= LEAST_REACHED * np.max(sizes, initial=0.0)]


def in_words(rows: Float[np.ndarray, "rows n"], names: Sequence[str]) -> tuple[str, ...]:
    """Returns the combinations that span the same space, each of as few names as possible."""
    return tuple(_in_words(row, names) for row in _reduce_rows(rows))


def _reduce_rows(rows: Float[np.ndarray, "rows n"]) -> Float[np.ndarray, "rows n"]:
    """Computes the reduced row echelon form, by Gauss and Jordan with the largest pivots."""
    rows, done = rows.copy(), 0
    for column in range(rows.shape[1]):
        if done == len(rows):
            break
        pivot = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[pivot, column]) <= ROUNDING:
            continue
        rows[[done, pivot]] = rows[[pivot, done]]
        rows[done] /= rows[done, column]
        others = np.arange(len(rows)) != done
        rows[others] -= rows[others, column, None] * rows[done]
        done += 1
    return rows


def _in_words(row: Float[np.ndarray, " n"], names: Sequence[str]) -> str:
    words, largest = "", np.max(np.abs(row))
    for value, name in zip(row, names, strict=True):
        if abs(value) <= ROUNDING * largest:
            continue
        size = "" if abs(abs(value) - 1) < ROUNDING else f"{abs(value):.4g} "
        sign = ("−" if value < 0 else "") if not words else (" − " if value < 0 else " + ")
        words += f"{sign}{size}{name}"
    return words
