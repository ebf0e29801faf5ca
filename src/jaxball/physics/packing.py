"""States as vectors, with their rates: what a solver advances, and the phase space of a smooth system.

The phase space is the part of a state that the motion depends on. ``simulation`` solves with a ``Packing``, and optimal
control and verification evaluate with one; ``stability`` and ``chaos`` use points of the phase space as well.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, Generic, NamedTuple, overload

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from ..numerics.arrays import default_dtype
from ..programs.derivatives.differentiation import differentiate_where, keep_if_known
from .body import System
from .dae import algebraic_component, constrain, mass_diagonal
from .state import State
from .system import AbstractState, AbstractSystem, AnyState, AnySystem, require_state

Normal = Callable[[Float[Array, " size"]], Float[Array, " size"]]


class Packing(eqx.Module, Generic[AnySystem, AnyState]):
    """How the state of a system becomes a vector, and back: its packed state, one array after the other."""

    system: AnySystem
    unravel: Callable[[Float[Array, " size"]], AnyState] = eqx.field(static=True)

    @staticmethod
    def of(system: AbstractSystem, state: AbstractState) -> "Packing[Any, Any]":
        """Returns the packing of states of the kind of ``state``; ``system`` is prepared.

        **Raises:** ``TypeError`` for integers where a state has numbers with a rate.
        """
        _require_numbers_with_rates(state)
        return Packing(system, ravel_state(state)[1])

    def pack(self, t: Float[Array, ""], state: AnyState) -> Float[Array, " size"]:
        """Converts a state to its vector."""
        return ravel_state(self.system.to_packed(t, state))[0]

    def unpack(self, t: Float[Array, ""], x: Float[Array, " size"]) -> AnyState:
        """Converts a vector to its state."""
        return self.system.from_packed(t, self.unravel(x))

    def unpack_where(self, used: Bool[Array, ""], t: Float[Array, ""], x: Float[Array, " size"]) -> AnyState:
        """Converts a vector to its state; NaN, and nothing that has derivatives, where it is not ``used``."""
        packing, t, x = differentiate_where(used, (self, t, x))
        return jax.tree.map(lambda leaf: keep_if_known(used, leaf), packing.unpack(t, x))

    def rates(self, t: Float[Array, ""], x: Float[Array, " size"]) -> AnyState:
        """Computes the rates of the variables in the vector, not yet packed."""
        return self.system.field_of_packed(t, self.unravel(x))

    def field(self, t: Float[Array, ""], x: Float[Array, " size"]) -> Float[Array, " size"]:
        """Computes the rate of the vector."""
        return ravel_state(self.rates(t, x))[0]

    def dae_field(
        self, t: Float[Array, ""], x: Float[Array, " size"], component: Int[Array, ""]
    ) -> Float[Array, " size"]:
        """Computes the right-hand side of the differential-algebraic form: M ẋ of the vector."""
        return ravel_pytree(constrain(self.rates(t, x), self.unravel(x), component))[0]

    def mass_diagonal(self, x: Float[Array, " size"], component: Int[Array, ""]) -> Float[Array, " size"]:
        """Returns the diagonal of M."""
        return ravel_pytree(mass_diagonal(self.unravel(x), component))[0]

    def algebraic_component(self, x: Float[Array, " size"]) -> Int[Array, ""]:
        """Finds the component that is algebraic in a step that starts at ``x``."""
        return algebraic_component(self.unravel(x))

    def projected(self, t: Float[Array, ""], x: Float[Array, " size"]) -> Float[Array, " size"]:
        """Returns the vector of the nearest state on the constraints, such as |q| = 1."""
        return ravel_state(self.system.projected(t, self.unravel(x)))[0]


class _Unravelling(NamedTuple):
    """The state of a vector in which some entries stand for integers, such as a mode."""

    unravel: Callable[[Float[Array, " size"]], Any]
    dtypes: tuple[Any, ...]

    def __call__(self, x: Float[Array, " size"]) -> Any:
        leaves, structure = jax.tree.flatten(self.unravel(x))
        whole = (
            leaf if leaf.dtype == dtype else jnp.round(leaf).astype(dtype)
            for leaf, dtype in zip(leaves, self.dtypes, strict=True)
        )
        return jax.tree.unflatten(structure, whole)


def ravel_state(state: Any) -> tuple[Float[Array, " size"], Callable[[Float[Array, " size"]], Any]]:
    """Ravels a state to a vector, in which integers are numbers like all others, and returns the way back."""
    leaves, structure = jax.tree.flatten(state)
    dtypes = tuple(jnp.result_type(leaf) for leaf in leaves)
    numbers = [dtype for dtype in dtypes if jnp.issubdtype(dtype, jnp.inexact)]
    if len(numbers) == len(dtypes):
        return ravel_pytree(state)
    # A solve advances one vector of floating-point numbers; a mode among them is an integer whose rate is 0.
    number = numbers[0] if numbers else default_dtype()
    cast = (
        x if jnp.issubdtype(k, jnp.inexact) else jnp.asarray(x, number) for x, k in zip(leaves, dtypes, strict=True)
    )
    vector, unravel = ravel_pytree(jax.tree.unflatten(structure, cast))
    return vector, _Unravelling(unravel, dtypes)


def _require_numbers_with_rates(state: Any) -> None:
    """Raises a ``TypeError`` for integers in a field of a state that is not annotated as one of integers.

    They would be taken for a mode, and every number on their way would be rounded to the next integer.
    """
    for field in dataclasses.fields(state):
        value = getattr(state, field.name)
        if dataclasses.is_dataclass(value):
            _require_numbers_with_rates(value)
            continue
        dtypes = [jnp.result_type(leaf) for leaf in jax.tree.leaves(value)]
        if all(jnp.issubdtype(dtype, jnp.inexact) for dtype in dtypes) or _holds_integers(field.type):
            continue
        raise TypeError(
            f"Argument `state.{field.name}` must be floating-point numbers, because they change at a rate, but they "
            f"are of the type {dtypes[0]}; write 1.0 for 1. A mode that only changes at events is annotated as "
            'Int[Array, ""].'
        )


def _holds_integers(annotation: Any) -> bool:
    """Returns whether an annotation of a field, which may be a text, is one of integers."""
    name = str(getattr(annotation, "__name__", annotation))  # such as int, or Int[Array, ""]
    return name.partition("[")[0].rpartition(".")[2].lower().startswith(("int", "uint", "bool"))


@overload
def phase_point(system: System, state: State) -> State: ...


@overload
def phase_point(system: AbstractSystem, state: AbstractState) -> AbstractState: ...


def phase_point(system: AbstractSystem, state: AbstractState) -> AbstractState:
    """Returns ``state`` as a point of the phase space: for a ball (Ω, Γ), unless a force acts, which they cannot
    express.

    **Raises:** ``TypeError`` when the system has no state of that kind, and for a hybrid one, whose motion jumps.
    """
    require_state(system, state)
    if system.is_hybrid:
        raise TypeError(
            "Argument `system` must be smooth, because its field is linearised here, but a "
            f"{type(system).__name__} has modes that end; `lyapunov_spectrum`, `periodic_motion` and "
            "`poincare_map` follow its runs through them."
        )
    return system.phase_point(state)


def normal_of(state: AbstractState) -> Normal | None:
    """Returns the normal, at a packed state, of the sphere on which its unit vector stays; None where it has none."""
    if state.unit_vector is None:
        return None
    before = 0
    for path, leaf in jax.tree_util.tree_leaves_with_path(state):
        if jax.tree_util.keystr(path) == f".{state.unit_vector}":
            return _along(before, before + np.size(leaf))
        before += np.size(leaf)
    return None


@functools.cache
def _along(start: int, end: int) -> Normal:
    """Returns one function for all states of a kind, so that programs made for it are found again."""

    def along(x: Float[Array, " size"]) -> Float[Array, " size"]:
        return jnp.zeros_like(x).at[start:end].set(x[start:end])

    return along
