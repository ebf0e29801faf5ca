"""A computation as one operation of JAX: a primitive, its tangents, and their rules.

Two primitives. ``run`` computes a computation. ``tangents`` is linear in its second half, the tangents of some of the
arrays. Their rules make new computations, which are compiled like any other:

- derivative of ``run``: ``run`` and ``tangents``; where results list steps, one ``run`` of both, in the same steps;
- derivative of ``tangents``: itself, of the other tangents, and ``tangents`` of the computation of tangents;
- transpose of ``tangents``: ``run`` of the cotangents, in reverse mode;
- either of many: ``run`` of many rows or, where only linear arguments are many, of many directions.

So one call is differentiated in both modes, in any order. On a CPU and on an NVIDIA GPU, XLA calls the native program
of a computation; where there is none, the function itself is written there.

Both take ``rows``: which arrays have rows as leading axis, of which each is a run; empty where it is a single one.
"""

import contextlib
import functools
import threading
from collections.abc import Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from ..interface.compat import Rules, is_for_export, is_for_one_device, new_primitive, no_tangent, zero_tangent
from . import native
from .batches import map_batches
from .compiled import Compiled
from .computation import Computation, in_rows
from .derivatives.differentiation import along
from .derivatives.reverse_rules import choose
from .store import current

MOST_DIRECTIONS = 32  # that are one program; more are rows
# Turns of a map within a run that a single thread of a GPU computes. More, such as the observables of a whole ensemble,
# are left to XLA, which makes operations of all turns together.
MOST_BY_ONE_THREAD = 4096

Which = tuple[bool, ...]


def may_be_an_operation() -> bool:
    """Returns whether computations can be operations of the traced program: not on several devices, nor for
    debugging.
    """
    config: Any = jax.config
    if config.jax_debug_nans or config.jax_debug_infs or config.jax_disable_jit:
        return False
    return jax.sharding.get_abstract_mesh().empty


def operation(computation: Computation, arrays: Sequence[Any]) -> list[Any]:
    """Returns the results of a computation, as one operation of the traced program."""
    return run.bind(*arrays, computation=computation, rows=())


def _types(computation: Computation, rows: Which, arrays: Sequence[Any]) -> list[Any]:
    """Returns the types of the results."""
    if not rows:
        return computation.gives
    count = _count(rows, arrays)
    return [in_rows(result, count) for result in computation.gives]


def _count(rows: Which, arrays: Sequence[Any]) -> int:
    return next(array.shape[0] for array, many in zip(arrays, rows, strict=True) if many)


@contextlib.contextmanager
def in_threads(count: int | None) -> Iterator[None]:
    """Calls within this block compute their rows in ``count`` threads; by all cores, if None."""
    before, _limit.threads = _limit.threads, count
    try:
        yield
    finally:
        _limit.threads = before


class _Limit(threading.local):
    threads: int | None = None


_limit = _Limit()


def _compute(*arrays: Any, computation: Computation, rows: Which) -> list[Any]:
    """Computes it of arrays that are not traced."""
    if not rows:
        return computation(arrays)
    if native.current_choice() == "native" and native.is_allowed():
        from .cpu import cores  # which a single run does without

        program = computation.program_of_rows(rows, _count(rows, arrays))
        if program is not None:
            weak = [bool(result.weak_type) for result in computation.gives]
            return program.of_rows(arrays, rows, weak, _limit.threads or cores())
    return _compile(computation, rows)(*arrays)


@functools.lru_cache(maxsize=1024)
def _compile(computation: Computation, rows: Which) -> Any:
    return jax.jit(functools.partial(run.bind, computation=computation, rows=rows))


def _write_here(*arrays: Any, computation: Computation, rows: Which) -> list[Any]:
    """Writes the function into what is being traced."""
    if not rows:
        return computation.here(arrays)
    if _count(rows, arrays) == 0:
        return [jnp.zeros(array.shape, array.dtype) for array in _types(computation, rows, arrays)]
    whole = list(arrays)

    def of_row(row: list[Any]) -> list[Any]:
        following = iter(row)
        return computation.here([next(following) if many else array for array, many in zip(whole, rows, strict=True)])

    leading = choose(whole, rows)
    if native.is_traced_natively():
        return jax.lax.map(of_row, leading)
    if jax.default_backend() != "cpu":
        return jax.vmap(of_row)(leading)
    return map_batches(of_row, leading, computation.together)


def _target(platform: str, context: Any, types: Sequence[Any], computation: Computation, rows: Which) -> str | None:
    """Returns the name by which XLA calls the native program; None where there is none, or the function must be written
    out.
    """
    if native.is_traced_natively() or is_for_export(context) or native.current_choice() != "native":
        return None
    count = _count(rows, types) if rows else 1
    if platform == "cuda":
        # A user's function as a whole may map over many rows, which a single thread would compute one by one.
        if not is_for_one_device(context) or count == 0 or not (computation.opaque or rows):
            return None
        on_gpu = computation.on_gpu(current.store())
        if not isinstance(on_gpu, Compiled) or (not rows and on_gpu.executable.form.longest_map > MOST_BY_ONE_THREAD):
            return None
        return on_gpu.target
    program = computation.program_of_rows(rows, count) if native.is_allowed() else None
    return None if program is None else program.target


def _differentiate(primals: Sequence[Any], tangents: Sequence[Any], *, computation: Computation, rows: Which) -> Any:
    which = tuple(not no_tangent(tangent) for tangent in tangents)
    if not any(which):
        results = run.bind(*primals, computation=computation, rows=rows)
        return results, list(map(zero_tangent, results))
    moving = choose(tangents, which)
    joint = computation.with_rates(which)
    if joint is None:
        results = run.bind(*primals, computation=computation.beside_derivatives(which), rows=rows)
        varied = iter(tangents_of_run.bind(*primals, *moving, computation=computation, which=which, rows=rows))
    else:
        both = run.bind(*primals, computation=joint, rows=rows)
        results, rates = both[: len(computation.gives)], both[len(computation.gives) :]
        varied = iter(_along(moving, tuple(choose(rows, which)) if rows else (), rates))
    have_tangents = [jnp.issubdtype(result.dtype, jnp.inexact) for result in computation.gives]
    return results, [
        next(varied) if has else zero_tangent(result) for result, has in zip(results, have_tangents, strict=True)
    ]


def _along(tangents: Sequence[Any], rows: Which, rates: Sequence[Any]) -> list[Any]:
    """Computes tangents of results from those of the arguments, and from the derivatives by each number of these."""
    if not rows:
        numbers = jnp.concatenate([jnp.ravel(tangent) for tangent in tangents])
        return [along(numbers, rate) for rate in rates]
    axes = [0 if many else None for many in rows]
    return jax.vmap(lambda tangents, rates: _along(tangents, (), rates), in_axes=(axes, 0))(list(tangents), list(rates))


def _batch(arrays: Sequence[Any], axes: Sequence[Any], *, computation: Computation, rows: Which) -> Any:
    mapped = tuple(axis is not None for axis in axes)
    count = next(array.shape[axis] for array, axis in zip(arrays, axes, strict=True) if axis is not None)
    first = [array if axis is None else jnp.moveaxis(array, axis, 0) for array, axis in zip(arrays, axes, strict=True)]
    if count <= MOST_DIRECTIONS and not any(choose(mapped, [not linear for linear in computation.linear])):
        # In each row, directions come second.
        inner = rows or (False,) * len(mapped)
        arrays = [
            jnp.moveaxis(array, 0, 1) if outer and many else array
            for array, outer, many in zip(first, mapped, inner, strict=True)
        ]
        results = run.bind(*arrays, computation=computation.directions(mapped, count), rows=rows)
        return results, [1 if rows else 0] * len(results)
    if not rows:
        results = run.bind(*first, computation=computation, rows=mapped)
        return results, [0] * len(results)
    of_each = _count(rows, [x[0] if many else x for x, many in zip(first, mapped, strict=True)])
    merged = [
        _merge_rows(array, outer, inner, count, of_each)
        for array, outer, inner in zip(first, mapped, rows, strict=True)
    ]
    both = tuple(outer or inner for outer, inner in zip(mapped, rows, strict=True))
    results = run.bind(*merged, computation=computation, rows=both)
    return [result.reshape(count, of_each, *result.shape[1:]) for result in results], [0] * len(results)


def _merge_rows(array: Any, outer: bool, inner: bool, count: int, of_each: int) -> Any:
    """Merges the rows of rows into rows."""
    if not (outer or inner):
        return array
    if not outer:
        array = jnp.broadcast_to(array, (count, *array.shape))
    elif not inner:
        array = jnp.broadcast_to(array[:, None], (count, of_each, *array.shape[1:]))
    return array.reshape(count * of_each, *array.shape[2:])


def _as_run(computation: Computation, which: Which, rows: Which) -> dict[str, Any]:
    """Returns the parameters with which ``run`` computes the same as ``tangents``."""
    return {"computation": computation.tangents(which), "rows": rows and (*rows, *choose(rows, which))}


def _differentiate_tangents(
    primals: Sequence[Any], tangents: Sequence[Any], *, computation: Computation, which: Which, rows: Which
) -> Any:
    how: dict[str, Any] = {"computation": computation, "which": which, "rows": rows}
    count = len(which)
    results = tangents_of_run.bind(*primals, **how)
    varied: list[list[Any]] = []
    if not all(map(no_tangent, tangents[count:])):
        moving = [
            jnp.zeros(x.shape, x.dtype) if no_tangent(tangent) else tangent
            for x, tangent in zip(primals[count:], tangents[count:], strict=True)
        ]
        varied.append(tangents_of_run.bind(*primals[:count], *moving, **how))
    of_primals = tuple(not no_tangent(tangent) for tangent in tangents[:count])
    if any(of_primals):
        second = _as_run(**how)
        moving = choose(tangents[:count], of_primals)
        others = (False,) * (len(primals) - count)
        varied.append(tangents_of_run.bind(*primals, *moving, which=(*of_primals, *others), **second))
    if not varied:
        return results, list(map(zero_tangent, results))
    return results, [sum(parts[1:], parts[0]) for parts in zip(*varied, strict=True)]


def _transpose_tangents(
    cotangents: Sequence[Any], *arrays: Any, computation: Computation, which: Which, rows: Which
) -> list[Any]:
    count = len(which)
    of = tuple(not no_tangent(cotangent) for cotangent in cotangents)
    if not any(of):
        return [None] * len(arrays)
    nonzero = choose(cotangents, of)
    back = computation.cotangents(which, of)
    results = run.bind(*arrays[:count], *nonzero, computation=back, rows=rows and (*rows, *(True,) * len(nonzero)))
    if rows:  # What all rows share has the cotangents of all.
        result_rows = choose(rows, which)
        results = [
            result if many else jnp.sum(result, axis=0) for result, many in zip(results, result_rows, strict=True)
        ]
    return [None] * count + list(results)


def _of_tangents(rule: Any) -> Any:
    """Makes a rule for ``tangents`` of a rule for ``run``."""

    def apply(*operands: Any, computation: Computation, which: Which, rows: Which) -> Any:
        return rule(*operands, **_as_run(computation, which, rows))

    return apply


def _target_of_tangents(
    platform: str, context: Any, types: Sequence[Any], *, computation: Computation, which: Which, rows: Which
) -> str | None:
    return _target(platform, context, types, **_as_run(computation, which, rows))


run: Any = new_primitive(
    "run",
    Rules(
        compute=_compute,
        types=lambda *arrays, computation, rows: _types(computation, rows, arrays),
        write=_write_here,
        target=_target,
        differentiate=_differentiate,
        batch=_batch,
        transpose=None,
    ),
)
tangents_of_run: Any = new_primitive(
    "tangents_of_run",
    Rules(
        compute=_of_tangents(_compute),
        types=_of_tangents(lambda *arrays, computation, rows: _types(computation, rows, arrays)),
        write=_of_tangents(_write_here),
        target=_target_of_tangents,
        differentiate=_differentiate_tangents,
        batch=_of_tangents(_batch),
        transpose=_transpose_tangents,
    ),
)
