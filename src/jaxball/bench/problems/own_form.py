"""The paper's systems as jaxball itself integrates them."""

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar, cast

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...numerics.arrays import to_array
from ...paper.systems import END, START
from ...physics.body import System
from ...physics.packing import Packing
from ...physics.state import BallState, DiskState
from ..problem import Form

AnyState = TypeVar("AnyState", BallState, DiskState)


def own_form(system: System, start: AnyState, whole: Callable[[AnyState], Float[np.ndarray, " state"]]) -> Form:
    """The equations that :func:`jaxball.simulate` solves, with θ(t) in closed form and the locked angular velocity.

    ``whole`` converts jaxball's state at the end to a state of the problem.
    """
    packing = Packing.of(system.prepare(), start)

    def field(t: Float[Array, ""], x: Float[Array, " form"], args: Any) -> Float[Array, " form"]:
        return packing.field(t, x)

    def final(x: Float[np.ndarray, " form"]) -> Float[np.ndarray, " state"]:
        return whole(cast(AnyState, packing.unpack(to_array(END), to_array(x))))

    return Form(field, tuple(map(float, packing.pack(to_array(START), start))), final)


def own_dae_form(system: System, start: BallState, whole: Callable[[BallState], Float[np.ndarray, " state"]]) -> Form:
    """:func:`own_form` as ``jaxball.simulate(dae=True)`` solves it, with the largest component of q algebraic."""
    form = own_form(system, start, whole)
    packing, initial = Packing.of(system.prepare(), start), jnp.asarray(form.initial)
    return dataclasses.replace(
        form,
        field=lambda t, x, component: packing.dae_field(t, x, component),
        mass=lambda component: packing.mass_diagonal(initial, component),
        choose=lambda t, x, args: packing.algebraic_component(x),
    )
