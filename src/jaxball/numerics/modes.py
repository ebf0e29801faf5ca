"""A clear error when a solve is differentiated in a mode that its loop does not support.

A loop that goes back over its steps only has reverse mode, and only once; a plain loop only has forward mode. JAX finds
out after the solve is traced, and reports it in terms of its internals. Numbers that go into the former are marked:
their tangents cannot be evaluated, only transposed, and the result of that cannot be transposed again. Numbers that
come out of a plain loop are marked: their tangents cannot be transposed. Times and states of events are marked: their
tangents cannot be differentiated again.
"""

from typing import Any, NoReturn

import equinox as eqx
import jax
from jaxtyping import PyTree

from ..compat import batch_by, declare_linear, differentiate_by, primitive

WAY_OUT = (
    "pass adjoint=diffrax.ForwardMode() to simulate, with jax.jvp or jax.jacfwd, and for second derivatives "
    "jax.jacfwd(jax.jacfwd(f))."
)
NO_FORWARD = (
    "Argument `adjoint` must be diffrax.ForwardMode() where a solve is differentiated in forward mode (jax.jvp, "
    "jax.jacfwd, jax.linearize, jax.hessian), but it is diffrax.RecursiveCheckpointAdjoint(), the default, which has "
    f"reverse mode only (jax.grad, jax.jacrev, jax.vjp); {WAY_OUT}"
)
NO_SECOND = (
    "Argument `adjoint` must be diffrax.ForwardMode() for second derivatives, but it is "
    "diffrax.RecursiveCheckpointAdjoint(), the default, whose loop does not support reverse mode over reverse mode; "
    f"{WAY_OUT}"
)
NO_REVERSE = (
    "Argument `adjoint` must be diffrax.RecursiveCheckpointAdjoint() where a solve is differentiated in reverse mode "
    "(jax.grad, jax.jacrev, jax.vjp), but it is diffrax.ForwardMode(), which has forward mode only (jax.jvp, "
    "jax.jacfwd)."
)
NO_SECOND_OF = (
    "Second derivatives are only those of states at fixed times, but they were requested for {what}, which have only "
    "first derivatives; take differences of these."
)


def reverse_only(tree: PyTree) -> PyTree:
    """``tree`` unchanged, with derivatives in reverse mode, once; a clear ``TypeError`` for others."""
    numbers, others = eqx.partition(tree, eqx.is_inexact_array)
    return eqx.combine(jax.tree.map(_number.bind, numbers), others)


def forward_only(tree: PyTree) -> PyTree:
    """``tree`` unchanged, with derivatives in forward mode; a clear ``TypeError`` for reverse mode."""
    numbers, others = eqx.partition(tree, eqx.is_inexact_array)
    return eqx.combine(jax.tree.map(_result.bind, numbers), others)


def once(what: str, tree: PyTree) -> PyTree:
    """``tree`` unchanged, with first derivatives; a clear ``TypeError`` that names ``what`` it is for second ones."""
    numbers, others = eqx.partition(tree, eqx.is_inexact_array)
    return eqx.combine(jax.tree.map(lambda leaf: _found.bind(leaf, what=what), numbers), others)


def _same(x: Any, **_) -> Any:
    return x


def _no_forward(*_, **__) -> NoReturn:
    raise TypeError(NO_FORWARD)


def _no_reverse(*_, **__) -> NoReturn:
    raise TypeError(NO_REVERSE)


def _no_second_of(*_, what: str) -> NoReturn:
    raise TypeError(NO_SECOND_OF.format(what=what))


def _no_second(*_, **__) -> NoReturn:
    raise TypeError(NO_SECOND)


_number = primitive("number_of_solve", _same)
_tangent = primitive("tangent_of_solve", _no_forward)
_cotangent = primitive("cotangent_of_solve", _same)
_result = primitive("result_of_solve", _same)
_found = primitive("found_in_solve", _same)
_tangent_of_found = primitive("tangent_of_found_in_solve", _same)

differentiate_by(_number, lambda primals, tangents: (_number.bind(*primals), _tangent.bind(*tangents)))
batch_by(_tangent, _no_forward)
declare_linear(_tangent, lambda cotangent, _: [_cotangent.bind(cotangent)])
declare_linear(_cotangent, _no_second)
declare_linear(_result, _no_reverse)

differentiate_by(
    _found,
    lambda primals, tangents, what: (_found.bind(*primals, what=what), _tangent_of_found.bind(*tangents, what=what)),
)
declare_linear(_tangent_of_found, lambda cotangent, _, what: [cotangent])
differentiate_by(_tangent_of_found, _no_second_of)
