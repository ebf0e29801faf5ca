"""Everything that makes programs of functions: traces, derivatives, machine code, and where programs are kept.

Users type ``jax.jit`` or :func:`jaxball.jit`; jaxball's own functions are compiled by ``programs.jit`` and
``programs.filter_jit``. From the top down:

- ``program``, ``users_functions``: functions that find, or make, the program for their arguments.
- ``operation``: a program as one operation of JAX, with rules for derivatives and batches.
- ``computation``, ``following``, ``compiled``, ``batches``: a function of arrays with all that follows from it; the
  functions that follow; programs with the structure of their results; rows side by side.
- ``derivatives``: rules for loops and rows of arrays, what depends on what, what has no derivative.
- ``store``: programs as files, kept between processes.
- ``identity``: what a function consists of, by which a program is found again; what is not pure.
- ``native``: the compiler.
- ``traces``: what a trace is made for.
- ``cache``, ``cpu``: programs kept between processes, switched on and off; settings of XLA for fast solves on a CPU.

Nothing here knows a ball, a solver or a scenario.
"""

from ..interface.names import lazy_interface

TYPE_CHECKING = False

if TYPE_CHECKING:
    from . import cache as cache, cpu as cpu
    from .program import (
        Program as Program,
        compile_quickly as compile_quickly,
        filter_jit as filter_jit,
        forget as forget,
        jit as jit,
    )
else:
    _, __dir__, __getattr__ = lazy_interface(__name__)
    __all__ = ()  # public are the packages alone
