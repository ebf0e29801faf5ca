"""The functions that follow from a function of a list of arrays: its tangents, its cotangents, and it for many rows.

``computation`` makes programs of them. They have names, by which a store finds these programs.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from .compiled import Rest
from .derivatives.differentiation import NO_REVERSE, differentiate_forward
from .derivatives.reverse_rules import PullByForwardMode, choose, replace_chosen
from .derivatives.steering import (
    DIRECTIONS,
    directions_of,
    steer_from_outside,
    steering_by_itself,
    steering_by_last_row,
)


class Result(NamedTuple):
    """The arrays of a result, and the parts of it that are not."""

    arrays: list[Any]
    rest: Rest


def arrays_of(result: list[Any] | Result) -> list[Any]:
    """Returns the arrays of a result."""
    return result.arrays if isinstance(result, Result) else result


def tangents_of(function: Callable, which: tuple[bool, ...], arrays: list[Any]) -> list[Any]:
    """Computes the tangents of the results that have some, along those of the arrays chosen by ``which``."""
    primals, tangents = arrays[: len(which)], arrays[len(which) :]

    def of_moving(*moving: Any) -> list[Any]:
        return list(filter(has_tangents, arrays_of(function(replace_chosen(primals, which, moving)))))

    with differentiate_forward():
        return jax.jvp(of_moving, choose(primals, which), tangents)[1]


def first_of(along: Callable, arrays: list[Any]) -> list[Any]:
    """Computes tangents in one direction by what computes them in several."""
    return [result[0] for result in along((False,) * len(arrays), 1, arrays)]


def tangents_and_probe(
    function: Callable, which: tuple[bool, ...], mapped: tuple[bool, ...], count: int, arrays: list[Any]
) -> list[Any]:
    """Computes tangents in ``count`` directions, which the ``mapped`` ones among the arrays have as leading axis, in
    steps that are chosen for a probe. Of a single number all are multiples of one, which is the probe.
    """
    primals, tangents = arrays[: len(which)], arrays[len(which) :]
    each = [
        tangent if many else jnp.broadcast_to(tangent, (count, *tangent.shape))
        for tangent, many in zip(tangents, mapped[len(which) :], strict=True)
    ]
    probe = directions_of(choose(primals, which))
    if len(probe) == 1 and probe[0].size == 1:
        shares = jnp.ravel(each[0]) / jnp.ravel(probe[0])
        with steering_by_itself():
            rates = tangents_of(function, which, [*primals, *probe])
        return [shares.reshape(-1, *(1,) * rate.ndim).astype(rate.dtype) * rate[None] for rate in rates]
    with steering_by_last_row():
        rows = jax.vmap(lambda tangents: tangents_of(function, which, [*primals, *tangents]), axis_name=DIRECTIONS)(
            [jnp.concatenate([rows, direction[None]]) for rows, direction in zip(each, probe, strict=True)]
        )
    return [result[:count] for result in rows]


def in_steps_of_probe(function: Callable, which: tuple[bool, ...], arrays: list[Any]) -> list[Any]:
    """Computes a function in the steps that its derivatives by the arrays chosen by ``which`` take."""
    moving = choose(arrays, which)
    with differentiate_forward(), steering_by_itself():
        return jax.jvp(
            lambda *moving: arrays_of(function(replace_chosen(arrays, which, moving))), moving, directions_of(moving)
        )[0]


def results_and_rates(function: Callable, which: tuple[bool, ...], arrays: list[Any]) -> list[Any]:
    """Computes a function, and the derivatives of the results that have some by each number of the arrays chosen by
    ``which``, all in the steps that are chosen for a probe. A derivative has these numbers as leading axis.
    """
    moving = choose(arrays, which)
    numbers, unravel = ravel_pytree(moving)
    probe = ravel_pytree(list(directions_of(moving)))[0]
    directions = jnp.concatenate([jnp.eye(numbers.size, dtype=numbers.dtype), probe[None]])

    def of_numbers(numbers: Any) -> tuple[list[Any], list[Any]]:
        results = arrays_of(function(replace_chosen(arrays, which, unravel(numbers))))
        return list(filter(has_tangents, results)), results

    def along(direction: Any) -> tuple[list[Any], list[Any]]:
        _, rates, results = jax.jvp(of_numbers, (numbers,), (direction,), has_aux=True)
        return rates, results

    with differentiate_forward(), steering_by_last_row():
        rates, results = jax.vmap(along, out_axes=(0, None), axis_name=DIRECTIONS)(directions)
    return [*results, *(rate[:-1] for rate in rates)]


def cotangents_of(
    function: Callable, which: tuple[bool, ...], of: tuple[bool, ...], steered: bool, arrays: list[Any]
) -> list[Any]:
    """Computes cotangents of the arrays chosen by ``which`` in reverse mode, in steps for a probe if ``steered``."""
    primals, cotangents = arrays[: len(which)], arrays[len(which) :]

    def of_moving(*moving: Any) -> list[Any]:
        results = arrays_of(function(replace_chosen(primals, which, moving)))
        return choose(list(filter(has_tangents, results)), of)

    def back(*moving: Any) -> Any:
        return (), jax.vjp(of_moving, *moving)[1]

    moving = choose(primals, which)
    try:
        if not steered:
            pull = back(*moving)[1]
        else:  # The way forward has the tangents of the probe, and the way back none.
            with steer_from_outside():
                pull = jax.jvp(back, moving, directions_of(moving), has_aux=True)[2]
    except TypeError as error:  # of JAX 0.10, which fails at loops in such a derivative whose arguments have lost names
        if "'NoneType' and 'tuple'" not in str(error):
            raise
        pull = back(*moving)[1]  # with a probe of the loop's own
    except ValueError as error:  # where steps of a loop of forward mode alone depend on its tangents
        if "Linearization failed" not in str(error):
            raise
        raise TypeError(NO_REVERSE) from error
    return list(pull(cotangents))


def cotangents_by_tangents(
    function: Callable, which: tuple[bool, ...], of: tuple[bool, ...], arrays: list[Any]
) -> list[Any]:
    """Computes the same by forward mode, which can be differentiated again."""
    primals, cotangents = arrays[: len(which)], arrays[len(which) :]

    def results(primals: list[Any]) -> list[Any]:
        return choose(list(filter(has_tangents, arrays_of(function(primals)))), of)

    with differentiate_forward():
        pull = PullByForwardMode(results)
        return choose(pull((primals, None), cotangents, list(which)), which)


def in_directions(function: Callable, mapped: tuple[bool, ...], arrays: list[Any]) -> list[Any]:
    """Computes a function of several sets of the ``mapped`` arrays."""
    return jax.vmap(lambda arrays: arrays_of(function(arrays)), in_axes=([0 if many else None for many in mapped],))(
        arrays
    )


def of_each_row(function: Callable, mask: tuple[bool, ...], arrays: list[Any]) -> list[Any]:
    """Computes a function of each row of the arrays in the ``mask``."""

    def of_row(row: list[Any]) -> list[Any]:
        return arrays_of(function(replace_chosen(arrays, mask, row)))

    return jax.lax.map(of_row, choose(arrays, mask))


def has_tangents(array: Any) -> bool:
    """Returns whether an array may have tangents."""
    return jnp.issubdtype(array.dtype, jnp.inexact)
