"""The choice of compiler: ``native``, this package's own, or ``xla``; and where ``native`` is possible."""

import contextlib
import os
import warnings
from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import jax

from ...interface.compat import trace_context
from . import gpu
from .arguments import are_numbers, some_traced
from .targets import machine

Compiler: TypeAlias = Literal["native", "xla"]
VARIABLE = "JAXBALL_COMPILER"
DEFAULT: Compiler = "native"

_asked_for: list[Compiler] = []


class Refusal(NamedTuple):
    """Why a program is not compiled natively: the subject of the sentence "… is not compiled natively"."""

    reason: str


@contextlib.contextmanager
def compiler(name: str) -> Iterator[None]:
    """Chooses the compiler of the programs called in this block; threads share the choice.

    - ``name``: ``"native"``, which compiles small programs for the processor in tenths of a second, by LLVM, or
      ``"xla"``. A program that cannot be compiled natively runs through XLA with a warning that says why.

    Without a choice, here or by the environment variable ``JAXBALL_COMPILER``, programs are compiled natively, or
    silently by XLA if that is not possible.

    **Raises:** ``ValueError`` for another name.

    **Example:**

    >>> import jax.numpy as jnp
    >>> import jaxball
    >>> with jaxball.compiler("native"):
    ...     print(jaxball.jit(lambda x: 2 * x)(jnp.arange(3)))
    [0 2 4]
    """
    _asked_for.append(_check_name(name, "Argument `name`"))
    try:
        yield
    finally:
        _asked_for.pop()


def explicit_choice() -> Compiler | None:
    """Returns the compiler chosen by name, if any.

    **Raises:** ``ValueError`` if the environment variable does not name one.
    """
    if _asked_for:
        return _asked_for[-1]
    name = os.environ.get(VARIABLE)
    return _check_name(name, f"The environment variable {VARIABLE}") if name else None


def current_choice() -> Compiler:
    """Returns the compiler of the library's own programs: the one chosen, or the default."""
    return explicit_choice() or DEFAULT


def _check_name(name: str, what: str) -> Compiler:
    for choice in get_args(Compiler):
        if name == choice:
            return choice
    raise ValueError(f"{what} must be 'native' or 'xla', but it is {name!r}.")


def warn_if_chosen_by_name(refusal: Refusal, name: str) -> None:
    """Warns why XLA compiles the program with this name, if the native compiler was chosen by name."""
    if explicit_choice() == "native":
        message = f"{refusal.reason} is not compiled natively: XLA compiles the program `{name}`."
        warnings.warn(message, stacklevel=4)


def is_allowed() -> bool:
    """Returns whether programs are compiled natively at all."""
    return machine.is_present() and on_one_cpu()


def is_allowed_on_gpu() -> bool:
    """Returns whether programs are compiled natively for NVIDIA's GPUs."""
    if not machine.is_present() or _is_debugging():
        return False
    return gpu.why_not() is None


def identity_on_gpu() -> list[str]:
    """Lists everything that, besides its text, determines the code of a program for a GPU."""
    return gpu.identity()


def is_usable(leaves: Sequence[Any]) -> bool:
    """Returns whether programs can be compiled natively for such arguments: on the one device of a CPU, and with
    numbers.
    """
    return is_allowed() and not some_traced(leaves) and are_numbers(leaves)


def on_one_cpu() -> bool:
    """Returns whether programs run on the one device of a CPU, and without settings that are for debugging."""
    config: Any = jax.config
    if _is_debugging():
        return False
    if not jax.sharding.get_abstract_mesh().empty or jax.default_backend() != "cpu" or jax.device_count() != 1:
        return False
    return config.jax_default_device in (None, "cpu", jax.devices()[0])


def _is_debugging() -> bool:
    config: Any = jax.config
    return config.jax_debug_nans or config.jax_debug_infs or config.jax_disable_jit


def settings() -> Any:
    """Returns the settings of JAX that determine, within a process, which program is run."""
    config: Any = jax.config
    debugging = config.jax_debug_nans, config.jax_debug_infs, config.jax_disable_jit
    return trace_context(), config.jax_default_device, debugging
