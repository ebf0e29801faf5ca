"""``jaxball.jit``, by which users compile functions of their own."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import jax

from .program import Program

P = ParamSpec("P")
T = TypeVar("T")


def jit(function: Callable[P, T]) -> Callable[P, T]:
    """Compiles a function like ``jax.jit``, but for the processor and in a fraction of the time that XLA takes.

    It is meant for programs of many operations on few numbers: simulations, their derivatives,
    ``jaxball.jit(jax.grad(loss))``, loops. Arrays of up to a few thousand numbers are fine; large matrix products and
    long arrays are computed one number after another, and ``jax.jit`` is faster for them.

    - ``function``: a pure function of PyTrees of arrays. Within another transformation of JAX, on devices other than a
      single CPU, and if the program contains operations that are not compiled natively, it is ``jax.jit(function)``.

    Several threads can run it at once, and Ctrl-C ends a run.

    If programs are kept (:func:`jaxball.programs.cache.enable`), a program that another process has compiled is loaded,
    and ``function`` is not called at all. It is found by what ``function`` consists of when it is first called with
    such arguments: its code and that of the functions, methods and classes of yours that it uses, the values of their
    defaults, of the objects that they hold and of the global names in them, and the versions of JAX, equinox, diffrax
    and jaxball. Where any of these is another, as after a change of a number or of a line, and for arguments with other
    shapes and types of arrays, it is traced anew. So it does not matter in which file or which cell of a notebook it is
    written. A function is traced in each process if it imports something, uses files, the time, random numbers of NumPy
    or packages other than these, or changes something when it is traced, and if it calls back to Python when it runs.

    **Example:**

    >>> import jax
    >>> import jaxball
    >>> f = jaxball.jit(jax.grad(lambda x: x**3))
    >>> print(f(2.0))
    12.0
    """
    return Program(function, jax.jit(function), None, large=True, opaque=False)
