"""Checks of arguments: an error is a sentence that says what was given, what it must be, and how to mend it.

Only types, shapes and counts are checked, so arguments may be traced.
"""

import contextlib
import functools
import inspect
import reprlib
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypeGuard, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .compat import is_traced
from .wording import did_you_mean, number_of

Kind = TypeVar("Kind")

# For each function that has been checked, the shapes of the arguments that it was checked with.
_checked: weakref.WeakKeyDictionary[Any, set[Any]] = weakref.WeakKeyDictionary()


def require(
    name: str, value: Any, kind: type[Kind] | tuple[type[Kind], ...], must: str, remedy: str = ""
) -> TypeGuard[Kind]:
    """Raises a ``TypeError`` unless the argument ``name`` is a ``kind``, which ``must`` describes."""
    if isinstance(value, kind):
        return True
    raise refusal(name, must, value, remedy)


def require_each(name: str, values: Any, kind: type[Kind], must: str) -> None:
    """Raises a ``TypeError`` unless the argument ``name`` is a list or a tuple whose items are all a ``kind``."""
    if not isinstance(values, list | tuple):
        raise refusal(name, f"a list, each item {must}", values)
    for index, value in enumerate(values):
        require(f"{name}[{index}]", value, kind, must)


def require_flags(**values: Any) -> None:
    """Raises a ``TypeError`` for the first of these arguments that is not True or False."""
    for name, value in values.items():
        require(name, value, (bool, np.bool_), "True or False")


def whole_number(name: str, value: Any, least: int, most: int | None = None) -> int:
    """Returns an argument that counts something, as an ``int``.

    **Raises:** ``TypeError`` for anything but a whole number, ``ValueError`` for one below ``least`` or above ``most``.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise refusal(name, "a whole number", value)
    if value < least:
        raise ValueError(f"Argument `{name}` must be {least} or more, but it is {value}.")
    if most is not None and value > most:
        raise ValueError(f"Argument `{name}` must be at most {most:,}, but it is {value:,}.")
    return int(value)


def require_count(what: str, size: int | tuple[int, ...], count: int, each: str) -> None:
    """Raises a ``ValueError`` unless ``what``, such as "Argument `theta`", has ``count`` entries, one for ``each``.

    - ``size``: how many it has, or the shape of the array that it is.
    """
    if size not in (count, (count,)):
        got = f"its shape is {size}" if isinstance(size, tuple) else f"it has {size}"
        raise ValueError(f"{what} must have {number_of(count, 'entry', 'entries')}, one for each {each}, but {got}.")


def refusal(name: str, must: str, value: Any, remedy: str = "") -> TypeError:
    """Makes the error for the argument ``name``: what it ``must`` be, and the ``value`` that it is."""
    if isinstance(value, type) and not remedy:
        remedy = f"make one with {value.__name__}(...)"
    end = f"; {remedy}." if remedy else "."
    return TypeError(f"Argument `{name}` must be {must}, but it is {describe(value)}{end}")


def describe(value: Any) -> str:
    """Describes a value in a few words."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        return reprlib.repr(value)
    if isinstance(value, list | tuple | dict | set):
        return f"the {type(value).__name__} {reprlib.repr(value)}"
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return f"an array of shape {value.shape} and type {value.dtype}"
    if inspect.isroutine(value):
        return f"the function {value.__name__}"
    return a(type(value).__name__)


def a(noun: str) -> str:
    """Returns ``noun`` with its article."""
    return f"{'an' if noun[:1] in 'AEIOUaeiou' else 'a'} {noun}"


def require_arguments(cls: type, given: Sequence[Any], named: Mapping[str, Any]) -> None:
    """Raises a ``TypeError`` that names the class, for arguments with which it cannot be made.

    Python's own error would name the class whose constructor it inherits.
    """
    signature = _arguments_of(cls)
    if signature is None:
        return
    in_order, required, parameters = signature
    kind = cls.__name__
    for name in named:
        if name not in parameters:
            if name in getattr(cls, "__dataclass_fields__", {}):
                example = f"equinox.tree_at(lambda it: it.{parameters[0]}, it, 2.0)"
                raise TypeError(
                    f"A {kind} must be changed by equinox.tree_at, as in {example}, "
                    f"or made anew, but dataclasses.replace passes its field `{name}`, which is no argument."
                )
            there = f"the arguments are {', '.join(parameters)}" if parameters else "it takes none"
            raise TypeError(f"Argument `{name}` of {kind} is not known{did_you_mean(name, parameters, there, '`')}")
    if len(given) > len(in_order):
        if in_order or not parameters:
            most = f"no more than {', '.join(in_order)}" if in_order else "left out"
            raise TypeError(f"Arguments of {kind} must be {most}, but there are {len(given)}.")
        without = "1 has no name" if len(given) == 1 else f"{len(given)} have no names"
        raise TypeError(f"Arguments of {kind} must be named, as in {kind}({parameters[0]}=...), but {without}.")
    there = {*in_order[: len(given)], *named}
    for name in required:
        if name not in there:
            raise TypeError(f"Argument `{name}` of {kind} must be given, but it is missing.")


@functools.cache
def _arguments_of(cls: type) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]] | None:
    """Lists the arguments of a class that may come without a name, those that it requires, and all; None
    where any may.
    """
    _, *parameters = inspect.signature(cls.__init__).parameters.values()
    if any(parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD) for parameter in parameters):
        return None
    return (
        tuple(parameter.name for parameter in parameters if parameter.kind is not parameter.KEYWORD_ONLY),
        tuple(parameter.name for parameter in parameters if parameter.default is parameter.empty),
        tuple(parameter.name for parameter in parameters),
    )


def require_callable(name: str, function: Any, *takes: str, or_with: str = "") -> None:
    """Raises a ``TypeError`` unless the argument ``name`` is a function of the arguments named in ``takes``, which may
    also take what ``or_with`` names.
    """
    forms = (takes, (*takes, or_with)) if or_with else (takes,)
    signature = " or ".join(f"({', '.join(names)})" for names in forms)
    if isinstance(function, type) or not callable(function):
        raise refusal(name, f"a function of {signature}", function)
    try:
        parameters = inspect.signature(function)
    except ValueError:  # some functions written in C have no signature
        return
    try:
        parameters.bind(*takes)
    except TypeError:
        raise TypeError(
            f"Argument `{name}` must be a function of {signature}, but {_name(function)} takes {parameters}."
        ) from None


def takes_parameters(function: Any, count: int, parameters: Any) -> bool:
    """Returns whether a user's function of ``count`` arguments is passed ``parameters`` as one more.

    It is if it takes them; None is not passed where the function has a default for it.
    """
    try:
        signature = inspect.signature(function)
        signature.bind(*range(count + 1))
    except ValueError:  # some functions written in C have no signature
        return True
    except TypeError:
        return False
    places = [p for p in signature.parameters.values() if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    required = len(places) > count and places[count].default is inspect.Parameter.empty
    return required or parameters is not None


def call_with(function: Callable[..., Any], *arguments: Any, parameters: Any) -> Any:
    """Calls a user's function with ``arguments`` and, if it takes them, ``parameters``."""
    more = (parameters,) if takes_parameters(function, len(arguments), parameters) else ()
    return function(*arguments, *more)


def require_callable_with(name: str, function: Any, parameters: Any, *takes: str) -> None:
    """Raises a ``TypeError`` unless the argument ``name`` is a function of the arguments named in ``takes`` and, where
    they are not None or it takes them, of ``parameters``.
    """
    if parameters is not None or takes_parameters(function, len(takes), None):
        require_callable(name, function, *takes, "parameters")
    else:
        require_callable(name, function, *takes, or_with="parameters")


def require_function(name: str, function: Any, shape: tuple[int, ...], **arguments: Any) -> None:
    """Raises a ``TypeError`` unless the argument ``name`` is a function whose value is an array of ``shape``.

    It is traced with ``arguments``, whose names appear only in the message, once for each combination of shapes. It
    need not take the last of them where this is ``parameters`` and None. An error that the function itself raises is
    passed on with a note.
    """
    if "parameters" in arguments:
        *takes, _ = arguments
        require_callable_with(name, function, arguments["parameters"], *takes)
        if not takes_parameters(function, len(takes), arguments["parameters"]):
            del arguments["parameters"]
    else:
        require_callable(name, function, *arguments)
    checked = _checked.setdefault(function, set()) if _is_weakly_hashable(function) else set()
    leaves, structure = jax.tree.flatten(arguments)
    key = shape, structure, tuple((getattr(leaf, "shape", type(leaf)), getattr(leaf, "dtype", None)) for leaf in leaves)
    if key in checked:
        return
    try:
        with traceable(name, function):
            value = eqx.filter_eval_shape(function, *arguments.values())
    except Exception as error:
        error.add_note(f"This came from argument `{name}`, when it was traced to find the shape of its value.")
        raise
    require_value(name, value, shape)
    checked.add(key)


@contextlib.contextmanager
def traceable(name: str, function: Any) -> Iterator[None]:
    """Raises a clear ``TypeError`` where JAX cannot trace the argument ``name``, a function that is called here."""
    try:
        yield
    except jax.errors.JAXTypeError as error:
        raise TypeError(
            f"Argument `{name}` must be a function that JAX can trace, but {_name(function)} needs to know a number "
            "that is not known while it is traced, as in `if` or float(); write it with jax.numpy, and "
            "`jnp.where(condition, a, b)` for `if`."
        ) from error


def require_value(name: str, value: Any, shape: tuple[int, ...]) -> None:
    """Raises a ``TypeError`` unless ``value``, returned by a function, is an array of real numbers of ``shape``."""
    expected = "a single number" if shape == () else f"an array of shape {shape}"
    description, remedy = describe(value), ""
    if isinstance(value, jax.Array | np.ndarray | np.generic | jax.ShapeDtypeStruct):
        if value.shape == shape and jnp.issubdtype(value.dtype, jnp.floating):
            return
    elif isinstance(value, int | float) and shape == ():
        return
    elif isinstance(value, list | tuple):
        description, remedy = f"a {type(value).__name__} of length {len(value)}", "; join its parts with jnp.stack"
    raise TypeError(f"Argument `{name}` must give {expected}, but it gives {description}{remedy}.")


def _is_weakly_hashable(function: Any) -> bool:
    try:
        hash(function)
        weakref.ref(function)
    except TypeError:
        return False
    return True


def _name(function: Callable[..., Any]) -> str:
    name = getattr(function, "__name__", type(function).__name__)
    return "the lambda given" if name == "<lambda>" else name


def require_one(argument: str, kind: str, given: Any, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Raises ``ValueError`` where an array has another shape; of a sized field, another number of axes.

    The system has checked the length of such a field, but not that it belongs to one state.
    """
    sized, values = getattr(given, "sized", ()), vars(given)  # Equinox looks up attributes more slowly
    for name, shape in shapes.items():
        if (value := values[name]) is None:
            continue
        actual = value.shape if hasattr(value, "shape") else np.shape(value)
        fits = len(actual) == len(shape) if name in sized else actual == shape
        if not fits:
            raise ValueError(
                f"Argument `{argument}` must be one {kind}, with `{name}` of shape {shape}, but its shape is {actual}; "
                "for many runs use jax.vmap or jaxball.simulation.ensemble.simulate_ensemble."
            )


ONE_OF_THEM = "take one of them with jax.tree.map(lambda leaf: leaf[k], ...)"


def require_one_run(status: Any, what: str, remedy: str = ONE_OF_THEM) -> None:
    """Raises ``ValueError`` for the ``status`` of a batch of trajectories, which ``what`` is not for."""
    if np.ndim(status):
        raise ValueError(f"{what} is for one trajectory, but this is a batch of shape {np.shape(status)}; {remedy}.")


def require_known(status: Any, what: str) -> None:
    """Raises ``ValueError`` for a batch, and ``TypeError`` where it is not known yet how the solve ends."""
    require_one_run(status, what, "the array `status` says how each run ended")
    if is_traced(status):
        raise TypeError(
            f"{what} is for a trajectory whose numbers are known, but this one is traced, as within jax.jit; use it "
            "outside, and `status` within, as in jnp.where(run.status == jaxball.Status.SUCCESS, ...)."
        )
