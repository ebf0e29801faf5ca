"""All that jaxball uses of JAX and equinox outside their documented interfaces, and where their releases differ.

``tests/test_compat.py`` tests each of these with the installed version.
"""

import contextlib
import functools
import importlib
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import jax
import numpy as np
from equinox.internal import unvmap_any, while_loop
from jax.core import ShapedArray, Tracer
from jax.interpreters import ad, batching, mlir

try:
    from jaxlib._jax import batched_device_put as _put
except ImportError:  # in a version that has it elsewhere
    _put = None

try:
    from jax._src.config import trace_context
except ImportError:  # in a version that has it elsewhere

    def trace_context() -> Any:
        """What, besides a function and its arguments, determines how the function is traced."""
        return tuple(settings().items())


# Releases of JAX have these in other places, or under types that type checkers see only in some of them.
Primitive: Any = importlib.import_module("jax.extend.core").Primitive

__all__ = [
    "array_type",
    "batch_by",
    "declare_linear",
    "differentiate_by",
    "is_traced",
    "is_tracer_type",
    "node_of",
    "primitive",
    "put",
    "setting_of_traces",
    "settings",
    "stablehlo_bindings",
    "stablehlo_passes",
    "trace_context",
    "unvmap_any",
    "while_loop",
]


def is_traced(x: Any) -> bool:
    """Whether ``x`` is traced, so that its value is unknown, as within jit, vmap and grad."""
    return isinstance(x, Tracer)


def is_tracer_type(of: type) -> bool:
    """Whether it is a type of what is traced."""
    return issubclass(of, Tracer)


def settings() -> Mapping[str, Any]:
    """JAX's settings by name, as they are at this point of the program."""
    return jax.config.values


def setting_of_traces(default: Any) -> Any:
    """A setting of one's own by which JAX's caches tell traced functions apart, where this version has such settings.

    Called with a value, it is the context in which its ``value`` is that.
    """
    own: Any = getattr(jax, "make_user_context", _Setting)
    return own(default)


class _Setting(threading.local):
    def __init__(self, default: Any):
        self.value = default

    @contextlib.contextmanager
    def __call__(self, value: Any) -> Iterator[None]:
        before, self.value = self.value, value
        try:
            yield
        finally:
            self.value = before


def stablehlo_bindings() -> tuple[Any, Any]:
    """The modules in which a lowered program is read: those of its types and of StableHLO's attributes."""
    from jax.extend.mlir import ir
    from jax.extend.mlir.dialects import stablehlo

    return ir, stablehlo


@functools.cache
def stablehlo_passes() -> Any:
    """What reads lowered programs and runs passes over them, including those of StableHLO."""
    from jax.extend.mlir import passmanager
    from jax.extend.mlir.dialects import stablehlo

    stablehlo.register_stablehlo_passes()
    return passmanager.PassManager


def array_type(shape: tuple[int, ...], dtype: np.dtype, weak: bool) -> Any:
    """The type of an array, as JAX gives it to the results of a program."""
    return ShapedArray(shape, dtype, weak_type=weak)


def put(array: np.ndarray, aval: Any, sharding: Any, device: Any) -> jax.Array | np.ndarray:
    """An array of JAX of the type ``aval``, which is not copied where it need not be.

    For a type without numbers, such as that of derivatives of integers, JAX uses NumPy arrays, and so does this.
    """
    if aval.dtype == jax.dtypes.float0:
        return np.zeros(aval.shape, jax.dtypes.float0)
    if _put is None:
        return jax.device_put(array, device)
    return _put(aval, sharding, [array], [device], False)


def node_of(structure: Any) -> tuple[type, Any] | None:
    """The type at the root of a PyTree and its auxiliary data; None for a leaf."""
    return structure.node_data()


def primitive(name: str, function: Callable[..., Any], results: int | None = None) -> Any:
    """An operation of JAX that computes ``function`` of an array.

    It returns as many arrays of the same shape and type as ``results`` says, or a single one outside any tuple.
    """
    new = Primitive(name)
    new.multiple_results = results is not None

    def of_each(x: Any) -> Any:
        return x if results is None else (x,) * results

    new.def_impl(function)
    new.def_abstract_eval(lambda x, **_: of_each(x))
    mlir.register_lowering(new, mlir.lower_fun(function, multiple_results=new.multiple_results))
    batching.primitive_batchers[new] = lambda given, axes, **params: (new.bind(*given, **params), of_each(axes[0]))
    return new


def differentiate_by(own: Any, rule: Callable[..., tuple[Any, Any]]) -> None:
    """Makes ``rule(primals, tangents)``, which returns results and their tangents, the derivative rule of ``own``."""
    ad.primitive_jvps[own] = rule


def batch_by(own: Any, rule: Callable[..., Any]) -> None:
    """Makes ``rule`` the batching rule of ``own``, instead of the one that batches along the axis of its operand."""
    batching.primitive_batchers[own] = rule


def declare_linear(own: Any, transposed: Callable[..., Any]) -> None:
    """Makes ``own`` its own derivative, with ``transposed(cotangent, x)`` for the cotangents of its operands."""
    ad.deflinear2(own, transposed)
