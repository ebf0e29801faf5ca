"""Constraints given by a user's function."""

from collections.abc import Callable

import equinox as eqx
from jaxtyping import Array, Float, PyTree

from ...interface.arguments import require_callable
from ..run import Run
from .base import AbstractConstraint, AbstractRunningConstraint


class FunctionConstraint(AbstractConstraint):
    """function(run, parameters) ≤ 0, of any shape.

    **Arguments:**

    - ``function``: of (run, parameters), to an array that is positive where the constraint is violated; ``run`` is as
      for a :class:`FunctionObjective`.
    - ``parameters``: arrays, in any PyTree, passed to it.
    """

    function: Callable[[Run, PyTree], Float[Array, "..."]] = eqx.field(static=True)
    parameters: PyTree = None

    def __check_init__(self):
        require_callable("function", self.function, "run", "parameters")

    def __call__(self, run: Run):
        return self.function(run, self.parameters)


class FunctionRunningConstraint(AbstractRunningConstraint):
    """function(run, parameters) ≤ 0 at each time, where the value depends only on that time.

    **Arguments:**

    - ``function``: as for a :class:`FunctionConstraint`, with the times of the run as the first axis. Optimal control
      needs its second derivatives.
    - ``parameters``: arrays, in any PyTree, passed to it.
    """

    function: Callable[[Run, PyTree], Float[Array, "t ..."]] = eqx.field(static=True)
    parameters: PyTree = None

    def __check_init__(self):
        require_callable("function", self.function, "run", "parameters")

    def __call__(self, run: Run):
        return self.function(run, self.parameters)
