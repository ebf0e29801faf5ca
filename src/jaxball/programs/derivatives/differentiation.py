"""Restricts the derivatives of numbers: to none, to one mode or to first ones, with a clear error for any other.

Solves, events and searches mark their numbers by these functions while they are traced.

A loop that goes back over its steps only has reverse mode, and only once; a plain loop only has forward mode. JAX finds
out after the solve is traced, and reports it in terms of its internals. Numbers that go into the former are marked:
their tangents cannot be evaluated, only transposed, and the result of that cannot be transposed again. Numbers that
come out of a plain loop are marked: their tangents cannot be transposed. Where derivatives are right up to some order,
the tangents of the last are marked: they cannot be differentiated again.
"""

import contextlib
from typing import Any, NoReturn, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, PyTree

from ...interface.compat import batch_by, declare_linear, differentiate_by, primitive
from .. import traces
from .steering import is_steered_from_outside

Tree = TypeVar("Tree", bound=PyTree)

WAY_OUT = (
    "leave it out, and simulate has both modes, in any order. Where JAX cannot take the solve as one operation "
    "(jax.disable_jit, jax.debug_nans, several devices), this is the default: "
    "pass adjoint=diffrax.ForwardMode() there."
)
NO_FORWARD = (
    "Argument `adjoint` must not be diffrax.RecursiveCheckpointAdjoint(), which has reverse mode only (jax.grad, "
    "jax.jacrev, jax.vjp), where a solve is differentiated in forward mode (jax.jvp, jax.jacfwd, jax.linearize, "
    f"jax.hessian); {WAY_OUT}"
)
NO_SECOND = (
    "Argument `adjoint` must not be diffrax.RecursiveCheckpointAdjoint() for second derivatives, because its loop does "
    f"not support reverse mode over reverse mode; {WAY_OUT}"
)
NO_REVERSE = (
    "Argument `adjoint` must not be diffrax.ForwardMode(), which has forward mode only (jax.jvp, jax.jacfwd), where a "
    "solve is differentiated in reverse mode (jax.grad, jax.jacrev, jax.vjp); leave it out, and simulate has both."
)
NO_FURTHER = (
    "There are no {what}. Second derivatives exist of states, events, switches and extremes, third ones only of states "
    "of runs whose modes do not change; take differences of those of the order below."
)
NO_CAPTURED = (
    "A run has no derivatives with respect to a traced number that is hidden in a function, such as in a list or in an "
    "attribute of an object that is called. Pass the number as `parameters` of the object that takes the function, or "
    "as `level` of an event, or write the function with `def` or `lambda`, whose captured numbers are found."
)


def differentiate_forward() -> contextlib.AbstractContextManager[Any]:
    """Returns the context in which all that is traced is differentiated in forward mode."""
    return traces.differentiated_forward(True)


def is_differentiated_forward() -> bool:
    """Returns whether the function being traced is differentiated in forward mode; if not, it is in reverse mode, or
    not at all.
    """
    return traces.differentiated_forward.value


def reverse_only(tree: PyTree) -> PyTree:
    """Returns ``tree`` unchanged, with derivatives in reverse mode, once; a clear ``TypeError`` for others."""
    numbers, others = eqx.partition(tree, eqx.is_inexact_array)
    return eqx.combine(jax.tree.map(_number.bind, numbers), others)


def forward_only(tree: PyTree) -> PyTree:
    """Returns ``tree`` unchanged, with derivatives in forward mode; a clear ``TypeError`` for reverse mode."""
    numbers, others = eqx.partition(tree, eqx.is_inexact_array)
    return eqx.combine(jax.tree.map(_result.bind, numbers), others)


def no_further(what: str, tangents: Tree) -> Tree:
    """Returns the arrays of ``tangents`` unchanged; for their derivatives, a clear ``TypeError`` that names ``what``
    these are.
    """
    return jax.tree.map(lambda leaf: _last.bind(leaf, what=what), tangents)


def without_captured_derivatives(arrays: list[Any]) -> list[Any]:
    """Returns the arrays, with a clear ``TypeError`` instead of derivatives with respect to them."""
    return [_captured.bind(x) if jnp.issubdtype(x.dtype, jnp.inexact) else x for x in arrays]


def _same(x: Any, **_) -> Any:
    return x


def _no_forward(*_, **__) -> NoReturn:
    raise TypeError(NO_FORWARD)


def _no_reverse(*_, **__) -> NoReturn:
    raise TypeError(NO_REVERSE)


def _no_captured(*_, **__) -> NoReturn:
    raise TypeError(NO_CAPTURED)


def _no_further(*_, what: str) -> NoReturn:
    raise TypeError(NO_FURTHER.format(what=what))


def _no_second(*_, **__) -> NoReturn:
    raise TypeError(NO_SECOND)


def _differentiate_number(primals: Any, tangents: Any) -> tuple[Any, Any]:
    # A probe goes forwards where a run is recorded for reverse mode.
    tangent = tangents[0] if is_steered_from_outside() else _tangent.bind(*tangents)
    return _number.bind(*primals), tangent


_number = primitive("number_of_solve", _same)
_tangent = primitive("tangent_of_solve", _no_forward)
_cotangent = primitive("cotangent_of_solve", _same)
_result = primitive("result_of_solve", _same)
_captured = primitive("captured_in_solve", _same)
_last = primitive("last_tangent_of_solve", _same)

differentiate_by(_number, _differentiate_number)
batch_by(_tangent, _no_forward)
declare_linear(_tangent, lambda cotangent, _: [_cotangent.bind(cotangent)])
declare_linear(_cotangent, _no_second)
declare_linear(_result, _no_reverse)

declare_linear(_last, lambda cotangent, _, what: [cotangent])
differentiate_by(_last, _no_further)
differentiate_by(_captured, _no_captured)


def differentiate_where(used: Bool[Array, ""], tree: Tree) -> Tree:
    """Returns ``tree`` unchanged, with derivatives only where it is ``used``.

    Values computed from an unused entry may have infinite derivatives. A mask on the result sends a zero back to them,
    and 0 · ∞ is NaN; this stops it.
    """

    numbers, others = eqx.partition(tree, eqx.is_inexact_array)
    masked = jax.tree.map(lambda leaf: jnp.where(used, leaf, jax.lax.stop_gradient(leaf)), numbers)
    return eqx.combine(masked, others)


def keep_if_known(known: Bool[Array, "*rows"], leaf: Array) -> Array:
    """Returns ``leaf`` where it is known; elsewhere NaN, or −1 where it consists of integers."""
    nothing = jnp.nan if jnp.issubdtype(leaf.dtype, jnp.inexact) else -1
    return jnp.where(known, leaf, jnp.asarray(nothing, leaf.dtype))


def keep_known_rows(known: Bool[Array, " rows"], leaf: Array) -> Array:
    """Returns the rows of ``leaf`` that are known; the others as :func:`keep_if_known` has them."""
    return keep_if_known(known.reshape(-1, *(1,) * (leaf.ndim - 1)), leaf)


def without_derivatives(tree: Tree) -> Tree:
    """Returns ``tree`` unchanged, as a constant."""
    numbers, others = eqx.partition(tree, eqx.is_inexact_array)
    return eqx.combine(jax.lax.stop_gradient(numbers), others)


def with_unknown_derivatives(tree: Tree, given: PyTree, here: Bool[Array, ""] | bool = False) -> Tree:
    """Returns ``tree`` unchanged, with NaN derivatives with respect to ``given`` ``here`` and wherever it is NaN
    itself.

    A mask that puts NaN there has the derivative 0, as if the result depended on nothing. Unused parts of a result
    still have no effect: in reverse mode a cotangent of 0 stays 0.
    """
    inputs = [jnp.sum(leaf) for leaf in jax.tree.leaves(given) if eqx.is_inexact_array(leaf)]
    numbers, others = eqx.partition(tree, eqx.is_inexact_array)
    together: dict[Any, Array] = {}  # of each type

    def one(leaf: Array) -> Array:
        if leaf.dtype not in together:
            together[leaf.dtype] = sum((x.astype(leaf.dtype) for x in inputs), jnp.zeros((), leaf.dtype))
        unknown = _zero.bind(jnp.broadcast_to(together[leaf.dtype], leaf.shape))
        # Less 0 a number is itself, also where it is −0, so that a compiler can leave all of this out.
        return jnp.where(here | jnp.isnan(leaf), leaf - unknown, leaf)

    return eqx.combine(jax.tree.map(one, numbers), others)


def along(numbers: Array, rates: Array) -> Array:
    """Computes the tangent of a result from those of ``numbers`` and its derivatives by each of these, which lead the
    axes of ``rates``.

    Where a derivative is not finite the tangent is NaN, and in reverse mode a cotangent of 0 stays 0.
    """
    each = numbers.astype(rates.dtype).reshape(-1, *(1,) * (rates.ndim - 1))
    finite = jnp.isfinite(rates)
    unknown = _nan.bind(jnp.broadcast_to(each, rates.shape))
    return jnp.sum(jnp.where(finite, each * jnp.where(finite, rates, 0), unknown), axis=0)


# 0, whose tangents are NaN, as is each returning cotangent except one of 0.
_zero = primitive("zero_of_unknown_derivative", jnp.zeros_like)
_nan = primitive("unknown_derivative", lambda x: jnp.full_like(x, jnp.nan))
declare_linear(_nan, lambda cotangent, _: [jnp.where(cotangent == 0, cotangent, jnp.nan)])
differentiate_by(_zero, lambda primals, tangents: (_zero.bind(*primals), _nan.bind(*tangents)))
