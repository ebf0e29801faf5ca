"""The choice of compiler: ``native``, this package's own, or ``xla``."""

import contextlib
import os
from collections.abc import Iterator
from typing import Literal, TypeAlias, get_args

Compiler: TypeAlias = Literal["native", "xla"]
VARIABLE = "JAXBALL_COMPILER"
DEFAULT: Compiler = "native"

_asked_for: list[Compiler] = []


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
    _asked_for.append(_checked(name, "Argument `name`"))
    try:
        yield
    finally:
        _asked_for.pop()


def asked_for() -> Compiler | None:
    """The compiler chosen by name, if any.

    **Raises:** ``ValueError`` if the environment variable does not name one.
    """
    if _asked_for:
        return _asked_for[-1]
    name = os.environ.get(VARIABLE)
    return _checked(name, f"The environment variable {VARIABLE}") if name else None


def chosen() -> Compiler:
    """The compiler of the library's own programs: the one chosen, or the default."""
    return asked_for() or DEFAULT


def _checked(name: str, what: str) -> Compiler:
    for known in get_args(Compiler):
        if name == known:
            return known
    raise ValueError(f"{what} must be 'native' or 'xla', but it is {name!r}.")
