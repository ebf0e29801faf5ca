"""The result of a simulation."""

from collections.abc import Callable
from typing import Any, Generic

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from ._arrays import to_array
from .classical import AbstractClassicalSystem
from .masks import differentiated_where
from .observables import Observables, observe
from .occurrences import Occurrences
from .packing import Packing
from .simulable import AnySimulableState, AnySimulableSystem, SimulableSystem
from .state import BallState, DiskState, ReducedState, RotationState
from .status import SolveError, Status


class Interpolant(eqx.Module, Generic[AnySimulableState]):
    """The states between the saved times, by the solver's own interpolation."""

    solution: diffrax.Solution
    packing: Packing[Any, AnySimulableState]


class Trajectory(eqx.Module, Generic[AnySimulableSystem, AnySimulableState]):
    """States of a system at saved times, and how the solve ended.

    - ``times``: the saved times, shape (T,).
    - ``state``: the states there; each of its arrays has T as leading axis. NaN where the solve did
      not come, or all of it where the solve could not start.
    - ``status``: a :class:`~jaxball.Status`; ``ok`` and ``message`` read it.
    - ``reached``: the time to which the solve came.
    - ``steps``, ``rejected``: how many steps were taken in all, and how many of them were rejected.
    - ``events``: the :class:`~jaxball.Occurrences` of each event, by name.
    """

    system: AnySimulableSystem
    times: Float[Array | np.ndarray, "*batch T"]
    state: AnySimulableState
    reached: Float[Array, "*batch"]
    status: Int[Array, "*batch"]
    steps: Int[Array, "*batch"]
    rejected: Int[Array, "*batch"]
    interpolant: Interpolant[AnySimulableState] | None = None
    events: dict[str, Occurrences] = eqx.field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether the solve reached its end, or an event that it was to end at. For one trajectory, not for a batch."""
        return int(self.status) in (Status.SUCCESS, Status.EVENT)

    @property
    def message(self) -> str:
        """A sentence that says how the solve ended."""
        return Status(int(self.status)).sentence(float(self.reached), float(self.times[-1]))

    def raise_if_failed(self) -> "Trajectory[AnySimulableSystem, AnySimulableState]":
        """The trajectory itself, or a :class:`~jaxball.SolveError` with the message."""
        if not self.ok:
            raise SolveError(self.message)
        return self

    def at(self, t: ArrayLike) -> AnySimulableState:
        """The state at any time ``t`` of the run, a number or an array, from dense output.

        NaN before the start and after the time to which the solve came.

        **Raises:** ``ValueError`` when the trajectory was made without ``dense=True``.
        """
        if self.interpolant is None:
            raise ValueError("Method `at` needs dense output; call simulate(..., dense=True).")
        return _evaluate(self.interpolant, to_array(t), self.times[0], self.reached, self.status)

    @property
    def observables(self) -> Observables:
        """Positions, energies and forces at every saved time.

        **Raises:** ``ValueError`` for a reduced trajectory, which does not know where the ball is, and for
        one of a classical system, which has ``laws``.
        """
        if isinstance(self.system, AbstractClassicalSystem):
            raise ValueError(
                "The observables are those of a ball or a disk, but this trajectory is of a "
                f"{type(self.system).__name__}; its `laws` say what is constant in it."
            )
        if isinstance(self.state, ReducedState):
            raise ValueError(
                "The observables need the full state, but this trajectory is of a ReducedState; simulate "
                "with a BallState."
            )
        return _observe_all(self.system, self.times, self.state)

    @property
    def laws(self) -> Any:
        """The laws of a classical system at every saved time: a named tuple, each entry with T as leading axis.

        **Raises:** ``ValueError`` for a ball or a disk, for which they are functions of a state.
        """
        if not isinstance(self.system, AbstractClassicalSystem):
            raise ValueError(
                "The laws are those of a classical system, but this trajectory is of a "
                f"{type(self.system).__name__}; the modules jaxball.laws and jaxball.momentum have its integrals."
            )
        return _laws_of_all(self.system, self.times, self.state)

    @property
    def friction_needed(self) -> Float[Array, ""]:
        """The largest |f| / N at the saved times; :func:`~jaxball.contact_extremes` finds μ_min of the whole run."""
        return jnp.max(self.observables.friction_ratio)

    def __str__(self) -> str:
        lines = [
            f"Trajectory of a {_described(self.system)}",
            f"  {self.times.size} times from {float(self.times[0]):g} to {float(self.times[-1]):g}",
            f"  {int(self.steps)} steps, {int(self.rejected)} of them rejected",
            f"  {self.message}",
        ]
        if isinstance(self.state, BallState | DiskState):
            z = np.atleast_1d(np.asarray(self.state.z[-1]))
            lines.append("  z at the end: " + ", ".join(f"{value:.12g}" for value in z))
        return "\n".join(lines)


@eqx.filter_jit
def _observe_all(system, times, state) -> Observables:
    def observed(system, t, x):
        return observe(system, t, x.in_space() if isinstance(x, RotationState) else x)

    return _at_each(observed, system.prepare(), times, state)


@eqx.filter_jit
def _laws_of_all(system, times, state) -> Any:
    return _at_each(lambda system, t, x: system.laws(t, x), system.prepare(), times, state)


def _at_each(function: Callable[..., Any], system: Any, times: Array, state: Any) -> Any:
    """``function(system, t, state)`` at each time, without derivatives where the solve did not come."""

    def one(t, x):
        known = jnp.all(jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(x)]))
        return function(*differentiated_where(known, (system, t, x)))

    return jax.vmap(one)(times, state)


def _described(system: SimulableSystem) -> str:
    if isinstance(system, AbstractClassicalSystem):
        return system.title
    return f"{type(system).__name__.lower()} with {system.n_masses} point masses"


@eqx.filter_jit
def _evaluate(interpolant, t, start, reached, status) -> Any:
    def one(t):
        inside = jnp.clip(t, start, reached)
        x = interpolant.solution.evaluate(inside)
        known = (t == inside) & jnp.all(jnp.isfinite(x)) & (status != Status.IMPOSSIBLE)
        return interpolant.packing.unpack_where(known, inside, x)

    return jax.vmap(one)(t) if t.ndim else one(t)
