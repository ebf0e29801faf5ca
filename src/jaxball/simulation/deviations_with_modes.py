"""A run whose modes change and small deviations from it: what chaos and stability of hybrid systems are computed from.

Such a run has no field to follow deviations along. So the run itself is differentiated, through its events: its
derivatives are products of those of the flow within modes and of saltation matrices, which say what an event does to a
deviation that comes to it earlier or later, the time between two events having derivatives as well (M. di Bernardo, C.
J. Budd, A. R. Champneys & P. Kowalczyk, Piecewise-smooth dynamical systems, Springer 2008, section 2.5).

States are points of one space whatever the mode: place and motion, of a body with a law of contact those of a
``ReleasedState``. Where a mode holds something, deviations of it are lost: the run has a derivative of 0 along them.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from ..physics import packing
from ..physics.contact.body_on_plane import BodyOnPlane, has_contact
from ..physics.contact.law import Contact
from ..physics.contact.modes import Mode
from ..physics.contact.released import ReleasedState
from ..physics.rolling import AbstractRollingSystem
from ..physics.state import DiskState, RotationState
from ..physics.system import AbstractSystem, require_system
from .arguments import require_kind_of_state, require_single, system_to_solve
from .deviations import Advanced, Field, Monitor, Normal, Steps, count_of_constraints, generic_vectors
from .events import Detachment
from .simulate import Method, at_rest, solve

LOST = 0.75  # the power of rounding: a deviation with no more of its length left beside others has become one of them
LIFTS = "lifts"


def point_of_run(
    system: AbstractSystem, state: Any, contact: Contact | None, t: Float[Array, ""]
) -> tuple[AbstractSystem, Any]:
    """Returns the system that is solved, and the point of its phase space that ``state`` is; at rest if not given.

    **Raises:** ``TypeError`` for other kinds of systems and states, and for a hybrid system whose state says in which
    mode it is, which is no number that a deviation may change.
    """
    require_system(system)
    state = at_rest(system) if state is None else state
    if contact is None and not system.is_hybrid:
        require_kind_of_state(system, state)
        return system, packing.phase_point(system, state)
    solved = system_to_solve(system, contact)
    if solved is system:
        raise TypeError(
            f"Argument `system` must be a body, a LagrangianSystem, or smooth, but a {type(system).__name__} has "
            "guards or time events, between whose modes there is no small deviation; "
            "derivatives of a run of jaxball.simulate go through its events."
        )
    require_single(solved, state)
    if isinstance(state, RotationState):
        state = state.in_space()
    elif isinstance(state, ReleasedState) and isinstance(state.body, RotationState):
        state = ReleasedState(state.body.in_space(), state.V, state.height)
    return solved, solved.start(t, state).motion  # pyright: ignore[reportAttributeAccessIssue]


def normal_of(state: Any) -> Normal | None:
    """Returns the normal, at a vector of such states, of the surface on which they are; None where they fill the space.

    As :func:`jaxball.physics.packing.normal_of` does; a disk that is released has no velocity across its plane.
    """
    if not isinstance(state, ReleasedState):
        return packing.normal_of(state)
    if isinstance(state.body, DiskState):
        return _across(ravel_pytree(state.body)[0].size + 1)
    return packing.normal_of(state.body)


@functools.cache
def _across(index: int) -> Normal:
    """Returns one function for all states of a kind, so that programs made for it are found again."""

    def across(x: Float[Array, " size"]) -> Float[Array, " size"]:
        return jnp.zeros_like(x).at[index].set(1.0)

    return across


def dimension(state: Any) -> int:
    """Returns the dimension of the phase space of a state, where a normal takes away one, whatever a mode holds."""
    return ravel_pytree(state)[0].size - (normal_of(state) is not None)


def projected(state: Any) -> Any:
    """Returns the nearest possible state; a body is not below its ground."""
    if not isinstance(state, ReleasedState):
        return state.projected()
    return ReleasedState(state.body.projected(), state.V, jnp.maximum(state.height, 0.0))


class Run(NamedTuple):
    """A run from one vector to another.

    - ``x``, ``rate``: the vector at its end, and its rate there.
    - ``status``, ``reached``, ``steps``, ``accepted``, ``least``: as in :class:`Advanced`.
    """

    x: Float[Array, " size"]
    rate: Float[Array, " size"]
    status: Int[Array, ""]
    reached: Float[Array, ""]
    steps: Int[Array, ""]
    accepted: Int[Array, ""]
    least: Float[Array, ""]


class FlowWithModes(NamedTuple):
    """The motion of a hybrid system, of vectors of its points; a ``Flow`` whose deviations pass events.

    - ``unravel``: from a vector to a point of the phase space.
    - ``monitor``: as a ``Flow`` has it; of a body with a law of contact there is none, because it may leave its ground.
    """

    system: AbstractSystem
    unravel: Callable[[Float[Array, " size"]], Any]
    args: None
    monitor: Monitor | None
    constraints: Field | None

    @classmethod
    def of(cls, system: AbstractSystem, state: Any) -> "FlowWithModes":
        """Returns the flow of points like ``state``."""
        unravel = ravel_pytree(state)[1]

        def residuals(t: Float[Array, ""], x: Float[Array, " size"], _: None) -> Float[Array, " residuals"]:
            return system.shown.residuals(t, unravel(x))  # pyright: ignore[reportAttributeAccessIssue]

        def infinity(t: Float[Array, ""], x: Float[Array, " size"], _: None) -> Float[Array, ""]:
            return jnp.full_like(t, jnp.inf)  # known of runs alone, with their start

        rolls = isinstance(system.shown, AbstractRollingSystem) and not has_contact(system)
        constraints = residuals if count_of_constraints(system.shown) else None
        return cls(system, unravel, None, infinity if rolls else None, constraints)

    def monitor_value(self, t: Float[Array, ""], x: Float[Array, " size"]) -> Float[Array, ""]:
        """Returns what the monitor knows before the first run."""
        return jnp.full_like(t, jnp.inf)

    def run(self, steps: Steps, t0: Float[Array, ""], t1: Float[Array, ""], x: Float[Array, " size"]) -> Run:
        """Follows the motion from a vector, whose mode is decided anew; differentiable in forward mode."""
        events: Any = {} if self.monitor is None else {LIFTS: Detachment(terminal=False, capacity=1)}
        method = Method.of(steps.solver, diffrax.ForwardMode(), steps.max_steps)
        times = jnp.stack([t0, t1])
        solved = solve(method, self.system, times, self.unravel(x), steps.rtol, steps.atol, events)
        states, reached, status, number, rejected, _, occurrences, *_ = solved
        end = jax.tree.map(lambda leaf: leaf[1], states)
        rate = self.system.prepare().field(t1, end)
        if has_contact(self.system):
            # Also from one that was put a little higher, a body comes to touch its ground.
            height = jnp.where(end.is_in(Mode.FLIGHT), end.height, jax.lax.stop_gradient(end.height))
            end = dataclasses.replace(end, height=height)
        x, velocity = (ravel_pytree(state.motion)[0] for state in (end, rate))
        least = jnp.full_like(t0, jnp.inf) if self.monitor is None else occurrences[LIFTS].least
        return Run(x, velocity, status, reached, number, number - rejected, least)

    def run_with_deviations(
        self, steps: Steps, t0: Float[Array, ""], t1: Float[Array, ""], rows: Float[Array, "rows size"]
    ) -> tuple[Float[Array, "k size"], Run]:
        """Follows the motion from the first of ``rows``, and the deviations from it that are the others."""

        def end(x: Float[Array, " size"]) -> tuple[Float[Array, " size"], Run]:
            run = self.run(steps, t0, t1, x)
            return run.x, run

        def push(deviation: Float[Array, " size"]) -> tuple[Float[Array, " size"], Run]:
            _, pushed, run = jax.jvp(end, (rows[0],), (deviation,), has_aux=True)
            return pushed, run

        return jax.vmap(push, out_axes=(0, None))(rows[1:])

    def advance(
        self,
        steps: Steps,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        rows: Float[Array, "rows size"],
        first_step: Float[Array, ""],
        alive: Bool[Array, ""],
    ) -> Advanced:
        """Advances x, the first of ``rows``, and the deviations from it; where not ``alive``, nothing is solved."""
        # A run of no length does not start.
        pushed, run = self.run_with_deviations(steps, t0, jnp.where(alive, t1, t0), rows)
        after = jnp.concatenate([run.x[None], pushed])
        return Advanced(after, run.status, run.reached, run.steps, run.accepted, run.least)

    def orthonormalise(self, vectors: Float[Array, "k size"]) -> tuple[Float[Array, "k size"], Float[Array, " k"]]:
        """Computes orthonormal rows as :func:`orthonormalise` does, and their lengths; 0 for a row that is lost.

        That is one that an event has made 0, or a sum of others up to rounding. Any other direction takes its place.
        """
        spare, rows, lengths = jnp.asarray(generic_vectors(*vectors.shape), vectors.dtype), [], []
        for vector, other in zip(vectors, spare, strict=True):
            size, (rest, other) = jnp.sqrt(jnp.sum(vector**2)), (_beside(rows, x) for x in (vector, other))
            length = jnp.sqrt(jnp.sum(rest**2))
            # NaN is no length that is lost.
            lost = (length <= rounding(vectors.dtype) * size) | (size == 0)
            direction = jnp.where(lost, other / jnp.sqrt(jnp.sum(other**2)), rest / jnp.where(lost, 1.0, length))
            rows.append(direction)
            lengths.append(jnp.where(lost, 0.0, length))
        return jnp.stack(rows), jnp.stack(lengths)

    def signs(self, t: Float[Array, ""], x: Float[Array, " size"]) -> Float[Array, " numbers"]:
        """Computes numbers that show on what the motion depends: rates in each mode of contact, and guards."""
        prepared, state = self.system.prepare(), self.system.start(t, self.unravel(x))
        states = [state]
        if isinstance(prepared, BodyOnPlane) and has_contact(prepared):
            states.append(prepared.on_ground(state))
        rates: list[Any] = [prepared.field(t, mode) for mode in states]
        numbers = [*(ravel_pytree(rate.motion)[0] for rate in rates), prepared.guards(t, state)]
        # What is not known in a mode that the state is not in, such as beyond an edge, tells nothing.
        return jnp.nan_to_num(jnp.concatenate(numbers), posinf=0.0, neginf=0.0)


def rounding(dtype: Any) -> float:
    """Returns the part of a deviation that is taken for rounding; 1.8e-12 in float64."""
    return float(jnp.finfo(dtype).eps) ** LOST


def _beside(rows: list[Array], vector: Float[Array, " size"]) -> Float[Array, " size"]:
    """Returns a vector without its components along orthonormal rows; twice, because what is left may be rounding."""
    for row in [*rows, *rows]:
        vector = vector - jnp.sum(vector * row) * row
    return vector
