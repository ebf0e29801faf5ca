"""Sensitivity error control: the steps of a loop that is differentiated are chosen for its derivatives, too.

A solve chooses its steps by the error of the state. Where the state rests that is zero at any length, while the motion
linearised about it would need steps. So the derivative of the run along a fixed direction, the *probe*, is carried
along with a run that is differentiated, and the error of a step is the larger of the state's and of the probe's: the
embedded estimate is differentiated as the state is. CVODES does this for forward sensitivities (Hindmarsh et al., ACM
TOMS 31 (2005) 363–396, section 2.6). Here both modes do, and with the same probe, so that they take the same steps.

The probe is a tangent like any other: ``control_error`` marks the error in the program of a step, and its rule of
derivatives reads the tangents. So whatever can be differentiated forwards is controlled, whatever its method.
A run that is not differentiated has no tangents, and is the same as without the mark.
"""

import contextlib
from collections.abc import Iterator, Sequence
from threading import get_ident
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...interface.compat import Rules, is_recorded, new_primitive, no_tangent, unvmap_max, zero_tangent
from .. import traces

LAST_ROW, ALONE = "last row", "alone"
DIRECTIONS = "directions"  # the axis of the tangents along which a run is differentiated; the last is the probe
# A probe moves each array by the size of its largest number, and by 1 if that is smaller than this, as the numbers of a
# state at rest are.
LEAST_SIZE = 0.1
# A probe smaller than this, where the states for which absolute tolerances are meant have the size 1, is resolved as if
# it were that large: what has hardly any effect would ask for more steps than the state. So it is by roundings.
LEAST_PROBE = 0.1
PROBE_ROUNDINGS = 64
# The part of a probe's error that counts. With all of it a run that moves takes up to a quarter more steps than for
# itself, with this 3 to 8 %, and its derivatives are still as exact as the states of such runs.
SHARE = 0.25


def steering_by_last_row() -> contextlib.AbstractContextManager[Any]:
    """Returns the context of a derivative along several ``DIRECTIONS``, of which the last is the probe."""
    return traces.steering(LAST_ROW)


def steering_by_itself() -> contextlib.AbstractContextManager[Any]:
    """Returns the context of a derivative along one direction, which is the probe."""
    return traces.steering(ALONE)


_outside: set[int] = set()  # the threads in which runs that are recorded have their probe from outside


@contextlib.contextmanager
def steer_from_outside() -> Iterator[None]:
    """Runs that are recorded for reverse mode within this block have a probe already: their tangents.

    No setting of traces, for which JAX would trace the run anew: it is read only where a run is differentiated.
    """
    thread = get_ident()
    nested = thread in _outside
    _outside.add(thread)
    try:
        yield
    finally:
        if not nested:
            _outside.discard(thread)


def is_steered_from_outside() -> bool:
    """Returns whether a run that is recorded has a probe among its tangents."""
    return get_ident() in _outside


def direction_of(x: Array, number: int) -> Array:
    """Returns the direction in which a probe moves the array ``x`` that has this number among all that it moves: always
    the same, with signs as if at random.
    """
    draw, sizes = np.random.default_rng(number), jnp.abs(jax.lax.stop_gradient(x))
    size = jnp.max(jnp.where(jnp.isfinite(sizes), sizes, 0.0), initial=0.0)
    size = jnp.where(size < LEAST_SIZE, jnp.ones_like(size), size)
    return jnp.asarray(draw.choice([-1.0, 1.0], x.shape) * draw.uniform(0.5, 1.0, x.shape), x.dtype) * size


def directions_of(arrays: Sequence[Array]) -> list[Array]:
    """Returns the directions in which a probe moves arrays."""
    return [direction_of(x, number) for number, x in enumerate(arrays)]


def control_error(
    error: Float[Array, "*rows n"],
    ends: tuple[Float[Array, "*rows n"], Float[Array, "*rows n"]],
    weights: Float[Array, "*rows n"],
    tolerance: Float[Array, "*rows"],
    size: Float[Array, "*rows"],
) -> tuple[Float[Array, "*rows n"], Float[Array, "*rows"]]:
    """Returns the error by which a step is judged, in which that of the probe counts, and the ``size`` after it.

    - ``error``: the estimate of the state's error; with the root mean square of error / weights a step is accepted that
      is at most 1.
    - ``ends``: the states between which the step leads.
    - ``weights``: the tolerated error of each entry; ``tolerance`` is that of one of size 1.
    - ``size``: 0, whose tangent is the largest size that the probe has had.
    """
    return tuple(_control.bind(error, *ends, weights, tolerance, size))


def judge(operands: Sequence[Array]) -> tuple[list[Array], Array]:
    """Returns the results of ``control_error`` for its operands, and the step's error in units of the tolerance."""
    error, _, _, weights, _, _ = operands
    excess, size = _excess.bind(*operands)
    return [error_of_size(error, weights, excess), size], jnp.maximum(_rms(error / weights), excess)


def error_of_size(error: Array, weights: Array, size: Array) -> Array:
    """Returns ``error``, or one that is ``size`` in units of the tolerance if that is larger."""
    larger = (size > _rms(error / weights))[..., None]
    return jnp.where(larger, size[..., None] * weights, error)


def is_control(equation: Any) -> bool:
    """Returns whether an equation of a program is that of ``control_error``."""
    return equation.primitive is _control


def _rms(x: Array) -> Array:
    return jnp.sqrt(jnp.mean(x**2, axis=-1))


def _differentiate_excess(primals: Sequence[Any], tangents: Sequence[Any]) -> Any:
    """Reads the tangents along the probe: of the error, of both ends, and its size so far."""
    primals = jax.lax.stop_gradient(list(primals))
    error, _, _, weights, tolerance, size = primals
    moved = [
        # Where another library records a solve for reverse mode, there is no probe: its steps are those of the state.
        jnp.zeros_like(x) if no_tangent(tangent) or is_recorded(tangent) else _of_probe(jax.lax.stop_gradient(tangent))
        for x, tangent in zip(primals, tangents, strict=True)
    ]
    of_error, of_start, of_end, _, _, largest = moved
    unit = weights / tolerance[..., None]
    so_far = jnp.maximum(largest, jnp.max(jnp.abs(of_start) / unit, axis=-1))
    least = LEAST_PROBE + PROBE_ROUNDINGS * float(jnp.finfo(error.dtype).eps) / tolerance
    reached = jnp.maximum(so_far, jnp.max(jnp.abs(of_end) / unit, axis=-1))
    excess = SHARE * _rms(of_error / weights) / jnp.maximum(reached, least)
    # What is singular has no derivative to be controlled.
    excess = jnp.where(jnp.isfinite(excess), excess, 0.0)
    if traces.steering.value not in (LAST_ROW, ALONE) and not is_steered_from_outside():
        # Of all directions of a user's `jax.jacfwd`, which have the same steps; each of several errors by itself.
        excess = jnp.stack([unvmap_max(x) for x in jnp.ravel(excess)]).reshape(excess.shape)
    so_far = jnp.where(jnp.isfinite(so_far), so_far, largest)
    return [excess, size], [zero_tangent(excess), so_far]


def _of_probe(tangent: Array) -> Array:
    """Picks the probe among the tangents of all directions."""
    if traces.steering.value != LAST_ROW:
        return tangent
    return jax.lax.psum(jnp.where(_is_probe(), tangent, jnp.zeros_like(tangent)), DIRECTIONS)


def _is_probe() -> Array:
    return jax.lax.axis_index(DIRECTIONS) == jax.lax.psum(1, DIRECTIONS) - 1


def _differentiate_control(primals: Sequence[Any], tangents: Sequence[Any]) -> Any:
    filled = [
        jnp.zeros(x.shape, x.dtype) if no_tangent(tangent) else tangent
        for x, tangent in zip(primals, tangents, strict=True)
    ]
    (error, size), (_, so_far) = jax.jvp(lambda *operands: judge(operands)[0], list(primals), filled)
    return [jax.lax.stop_gradient(error), size], [zero_tangent(error), so_far]


def _batch(own: Any) -> Any:
    def rule(arrays: Sequence[Any], axes: Sequence[Any]) -> Any:
        count = next(array.shape[axis] for array, axis in zip(arrays, axes, strict=True) if axis is not None)
        rows = [
            jnp.broadcast_to(array, (count, *array.shape)) if axis is None else jnp.moveaxis(array, axis, 0)
            for array, axis in zip(arrays, axes, strict=True)
        ]
        return own().bind(*rows), [0, 0]

    return rule


def _rules(first: Any, differentiate: Any, own: Any) -> Rules:
    def compute(*operands: Any) -> list[Any]:
        return [first(*operands), operands[-1]]

    return Rules(
        compute=compute,
        types=lambda *operands: jax.eval_shape(compute, *operands),
        write=compute,
        target=lambda *_: None,
        differentiate=differentiate,
        batch=_batch(own),
        transpose=None,
    )


_control: Any = new_primitive(
    "control_error", _rules(lambda error, *_: error, _differentiate_control, lambda: _control)
)
_excess: Any = new_primitive(
    "excess_of_probe", _rules(lambda *operands: jnp.zeros_like(operands[-1]), _differentiate_excess, lambda: _excess)
)
