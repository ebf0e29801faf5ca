"""All that jaxball uses of JAX and equinox outside their documented interfaces, and where their releases differ.

``tests/test_compat.py`` tests each of these with the installed version.
"""

import contextlib
import functools
import importlib
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.core import ShapedArray, Tracer
from jax.interpreters import ad, batching, mlir, partial_eval as pe

try:
    from jaxlib._jax import batched_device_put as _put
except ImportError:  # in a version that has it elsewhere
    _put = None

try:
    from jaxlib._jax import ArrayImpl as _Array
except ImportError:  # in a version that has it elsewhere
    _Array = None

try:
    from jax._src.config import trace_context as trace_context
except ImportError:  # in a version that has it elsewhere

    def trace_context() -> Any:
        """Returns what, besides a function and its arguments, determines how the function is traced."""
        return tuple(settings().items())


try:
    from jax._src.core import trace_state_clean as _is_outside_traces
except ImportError:  # in a version that has it elsewhere

    def _is_outside_traces() -> bool:
        return False


try:
    from jax.extend.core import get_opaque_trace_state as _current_trace
except ImportError:  # in a version that has it elsewhere
    from jax.core import get_opaque_trace_state as _current_trace

try:
    from jax._src.config import traceback_in_locations_limit as _most_locations
except ImportError:  # in a version that has it elsewhere
    _most_locations = None


# Releases of JAX have these in other places, or under types that type checkers see only in some of them.
_core: Any = importlib.import_module("jax.extend.core")
ClosedJaxpr, Jaxpr, Literal, Primitive = _core.ClosedJaxpr, _core.Jaxpr, _core.Literal, _core.Primitive
Program = Any  # a jaxpr with its constants


def is_traced(x: Any) -> bool:
    """Returns whether ``x`` is traced, so that its value is unknown, as within jit, vmap and grad."""
    return isinstance(x, Tracer)


def is_tracer_type(of: type) -> bool:
    """Returns whether ``of`` is the type of a traced value."""
    return issubclass(of, Tracer)


def is_array_type(of: type) -> bool:
    """Returns whether ``of`` is the type of JAX's arrays of known numbers, which neither random keys nor traced values
    have; False as well where this version of JAX does not tell.
    """
    return of is _Array


def unvmap_any(x: Any) -> Any:
    """Returns whether any of ``x`` is true, also over axes of ``jax.vmap``."""
    from equinox.internal import unvmap_any  # here, because equinox takes far longer to import than all of the rest

    return unvmap_any(x)


def unvmap_max(x: Any) -> Any:
    """Returns the largest of ``x`` over axes of ``jax.vmap``."""
    from equinox.internal import unvmap_max  # here, as above

    return unvmap_max(x)


def settings() -> Mapping[str, Any]:
    """Returns JAX's settings by name, with their values at this point of the program."""
    return jax.config.values


HAS_SETTINGS_OF_TRACES = hasattr(jax, "make_user_context")


def setting_of_traces(default: Any) -> Any:
    """Makes a setting of one's own by which JAX's caches tell traced functions apart, where this version has such
    settings.

    Called with a value, it is the context in which its ``value`` is that.
    """
    constructor: Any = getattr(jax, "make_user_context", _Setting)
    return constructor(default)


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


def same_mesh() -> contextlib.AbstractContextManager[Any]:
    """Returns a context for a trace, in which JAX finds functions again that it has traced.

    Within the rules of derivatives in reverse mode, JAX has entered the mesh of no devices that is also the default,
    and takes that for another context than none.
    """
    use = getattr(jax.sharding, "use_abstract_mesh", None)
    return contextlib.nullcontext() if use is None else use(jax.sharding.get_abstract_mesh())


def without_locations() -> contextlib.AbstractContextManager[Any]:
    """Returns a context in which operations are lowered without the lines of Python that they are from.

    To find and to write these takes about a tenth of the time, and nothing here reads them.
    """
    return contextlib.nullcontext() if _most_locations is None else _most_locations(0)


def stablehlo_bindings() -> tuple[Any, Any]:
    """Returns the modules in which a lowered program is read: one for its types and one for StableHLO's attributes."""
    from jax.extend.mlir import ir
    from jax.extend.mlir.dialects import stablehlo

    return ir, stablehlo


@functools.cache
def stablehlo_passes() -> Any:
    """Returns the class that reads lowered programs and runs passes over them, including the passes of StableHLO."""
    from jax.extend.mlir import passmanager
    from jax.extend.mlir.dialects import stablehlo

    stablehlo.register_stablehlo_passes()
    return passmanager.PassManager


def array_type(shape: tuple[int, ...], dtype: np.dtype, weak: bool) -> Any:
    """Returns the type of an array, as JAX gives it to the results of a program."""
    return ShapedArray(shape, dtype, weak_type=weak)


def put(array: np.ndarray, aval: Any, sharding: Any, device: Any) -> jax.Array | np.ndarray:
    """Makes an array of JAX of the type ``aval``, which is not copied where it need not be.

    For a type without numbers, such as that of derivatives of integers, JAX uses NumPy arrays, and so does this.
    """
    if aval.dtype == jax.dtypes.float0:
        return np.zeros(aval.shape, jax.dtypes.float0)
    if _put is None:
        return jax.device_put(array, device)
    return _put(aval, sharding, [array], [device], False)


def node_of(structure: Any) -> tuple[type, Any] | None:
    """Returns the type at the root of a PyTree and its auxiliary data; None for a leaf."""
    return structure.node_data()


def node_functions(of: type) -> tuple[Any, ...]:
    """Returns the functions that take objects of a class apart and put them together, if it is a node of PyTrees.

    **Raises:** ``RuntimeError`` where this version of JAX does not tell.
    """
    try:
        from jax._src.tree_util import _registry
    except ImportError:
        raise RuntimeError(f"JAX {jax.__version__} does not tell how objects of {of} are taken apart.") from None
    return tuple(_registry.get(of, ()))


def unwrap_jit(value: Any) -> tuple[Any, ...] | None:
    """Returns the function that ``jax.jit`` was given, and which arguments are static; None for other values.

    **Raises:** ``RuntimeError`` where this version of JAX does not tell.
    """
    if type(value) is not type(_jitted):
        return None
    try:
        content: Any = value.__getstate__()
        return value.__wrapped__, tuple(content["static_argnums"]), tuple(content["static_argnames"])
    except (AttributeError, KeyError, TypeError):
        raise RuntimeError(f"JAX {jax.__version__} does not tell what a compiled function consists of.") from None


_jitted: Any = jax.jit(lambda x: x)  # of whose type are all that it returns


def primitive(name: str, function: Callable[..., Any], results: int | None = None) -> Any:
    """Makes an operation of JAX that computes ``function`` of an array.

    It returns as many arrays of the same shape and type as ``results`` says, or a single one outside any tuple.
    """
    new = Primitive(name)
    new.multiple_results = results is not None

    def of_each(x: Any) -> Any:
        return x if results is None else (x,) * results

    new.def_impl(function)
    new.def_abstract_eval(lambda x, **_: of_each(x))
    mlir.register_lowering(new, mlir.lower_fun(function, multiple_results=new.multiple_results))
    batching.primitive_batchers[new] = lambda operands, axes, **params: (
        new.bind(*operands, **params),
        of_each(axes[0]),
    )
    return new


class Rules(NamedTuple):
    """What JAX has to know of an operation of several arrays with several results; all take its parameters by name.

    - ``compute(*arrays)``: of arrays that are not traced.
    - ``types(*types)``: of the results, as ``jax.eval_shape`` gives them.
    - ``write(*arrays)``: the same as functions of JAX.
    - ``target(platform, context, types)``: the name of a registered function that XLA calls on a platform, ``"cpu"`` or
      ``"cuda"``; None to write it.
    - ``differentiate(primals, tangents)``: results and their tangents.
    - ``batch(arrays, axes)``: results and their axes.
    - ``transpose(cotangents, *arrays)``: the cotangents of the arrays, None of those that are no unknown tangents.
    """

    compute: Callable[..., Any]
    types: Callable[..., Any]
    write: Callable[..., Any]
    target: Callable[..., str | None]
    differentiate: Callable[..., Any]
    batch: Callable[..., Any]
    transpose: Callable[..., Any] | None


def new_primitive(name: str, rules: Rules) -> Any:
    """Makes an operation of JAX with these rules."""
    new = Primitive(name)
    new.multiple_results = True
    new.def_impl(rules.compute)
    new.def_abstract_eval(
        lambda *arrays, **params: [
            ShapedArray(of.shape, of.dtype, weak_type=bool(of.weak_type)) for of in rules.types(*arrays, **params)
        ]
    )
    written = mlir.lower_fun(rules.write, multiple_results=True)

    def call(platform: str, context: Any, *operands: Any, **params: Any) -> Any:
        target = rules.target(platform, context, context.avals_in, **params)
        if target is None:
            return written(context, *operands, **params)
        return jax.ffi.ffi_lowering(target)(context, *operands)

    mlir.register_lowering(new, written)
    for platform in ("cpu", "cuda"):
        mlir.register_lowering(new, functools.partial(call, platform), platform=platform)
    ad.primitive_jvps[new] = rules.differentiate
    batching.primitive_batchers[new] = rules.batch
    if rules.transpose is not None:
        ad.primitive_transposes[new] = rules.transpose
    return new


def no_tangent(tangent: Any) -> bool:
    """Returns whether a tangent or a cotangent is zero by its kind, as for integers."""
    return type(tangent) is ad.Zero or getattr(tangent, "dtype", None) == jax.dtypes.float0


def is_recorded(tangent: Any) -> bool:
    """Returns whether a tangent has no value yet, as where a program is recorded for reverse mode."""
    return isinstance(tangent, pe.JaxprTracer) and not tangent.is_known()


def zero_tangent(primal: Any) -> Any:
    """Returns the tangent of a value that does not vary."""
    return ad.Zero(primal.aval.to_tangent_aval())


def is_for_export(context: Any) -> bool:
    """Returns whether the program being lowered is to be run in another process, by the context that a rule for
    lowering receives.
    """
    return bool(getattr(context.module_context.lowering_parameters, "for_export", False))


def is_for_one_device(context: Any) -> bool:
    """Returns whether the program being lowered is to be run by a single device, by the context that a rule for
    lowering receives.
    """
    return getattr(context.module_context.axis_context, "num_devices", None) == 1


def differentiate_by(own: Any, rule: Callable[..., tuple[Any, Any]]) -> None:
    """Makes ``rule(primals, tangents)``, which returns results and their tangents, the derivative rule of ``own``."""
    ad.primitive_jvps[own] = rule


def batch_by(own: Any, rule: Callable[..., Any]) -> None:
    """Makes ``rule`` the batching rule of ``own``, instead of the one that batches along the axis of its operand."""
    batching.primitive_batchers[own] = rule


def declare_linear(own: Any, transposed: Callable[..., Any]) -> None:
    """Makes ``own`` its own derivative, with ``transposed(cotangent, x)`` for the cotangents of its operands."""
    ad.deflinear2(own, transposed)


class Loop(NamedTuple):
    """What the equation of a ``jax.lax.scan`` says.

    - ``body``: the program of a step, from constants, what is carried and elements of sequences to the last two.
    - ``constants``, ``carried``: how many operands are constants and how many are carried, in this order; the rest are
      sequences.
    - ``length``: how many steps there are.
    - ``backwards``: whether the steps are done from last to first.
    """

    body: Program
    constants: int
    carried: int
    length: int
    backwards: bool


def loop(equation: Any) -> Loop:
    """Describes the loop of an equation. Releases of JAX count its operands in several ways; sequences have an axis
    more.
    """
    body = argument(equation, "jaxpr")

    def of_one_rank(outer: Any, inner: Any) -> int:
        return sum(x.aval.ndim == y.aval.ndim for x, y in zip(outer, inner, strict=True))

    carried = of_one_rank(equation.outvars, body.jaxpr.outvars)
    constants = of_one_rank(equation.invars, body.jaxpr.invars) - carried
    return Loop(body, constants, carried, argument(equation, "length"), argument(equation, "reverse"))


def branches(equation: Any) -> tuple[Program, ...]:
    """Returns the branches of the equation of a ``jax.lax.cond`` or ``jax.lax.switch``."""
    return argument(equation, "branches")


def inner_program(equation: Any) -> Program | None:
    """Returns the program that an equation calls; None where it has a rule for derivatives, or calls none."""
    if equation.primitive.name == "scan" or equation.primitive.name.startswith(("custom_jvp_call", "custom_vjp_call")):
        return None
    inner = equation.params.get("jaxpr", equation.params.get("call_jaxpr"))
    return inner if isinstance(inner, ClosedJaxpr) else None


def program_within(equation: Any) -> Program | None:
    """Returns the program that an equation calls once, even where it has a rule for derivatives; None for a loop or a
    choice.
    """
    if equation.primitive.name in ("scan", "while", "cond"):
        return None
    for name in ("jaxpr", "call_jaxpr", "fun_jaxpr"):
        inner = equation.params.get(name)
        if isinstance(inner, ClosedJaxpr):
            return inner
        if isinstance(inner, Jaxpr):
            return ClosedJaxpr(inner, ())
    return None


def is_within_trace() -> bool:
    """Returns whether JAX is tracing anything, so that a function may have captured something traced."""
    return not _is_outside_traces()


def current_trace() -> Any:
    """Returns what is equal only to itself as long as JAX traces the same function, or none."""
    return _current_trace()


def captures(traced: Any) -> list[Any]:
    """Returns what is traced around a function that ``jax.jit`` has traced: the first arrays that its program takes."""
    constants = getattr(traced, "_consts", None)
    return list(getattr(traced, "_args_flat", ())[: traced._num_consts] if constants is None else constants)


def evaluate(program: Program, constants: Sequence[Any], operands: Sequence[Any]) -> list[Any]:
    """Computes the results of a program for these constants, instead of its own, and operands."""
    return _core.jaxpr_as_fun(ClosedJaxpr(program.jaxpr, list(constants)))(*operands)


def argument(equation: Any, name: str) -> Any:
    """Returns the argument with this name of the function of ``jax.lax`` that an equation stands for.

    **Raises:** ``RuntimeError`` where this version of JAX stores it differently.
    """
    try:
        return equation.params[name]
    except KeyError:
        raise RuntimeError(
            f"JAX {jax.__version__} records the operation `{equation.primitive.name}` without `{name}`, which jaxball "
            "needs; install a version of JAX that jaxball is tested with, as `pip install jaxball` does."
        ) from None


def function_of(equation: Any) -> Callable[..., Any]:
    """Returns the function that an equation computes, with its own rules of derivatives; releases of JAX keep these in
    two ways.
    """
    bound = equation.primitive.get_bind_params(equation.params)
    functions, params = ((), bound) if isinstance(bound, Mapping) else bound
    return lambda *operands: equation.primitive.bind(*functions, *operands, **params)
