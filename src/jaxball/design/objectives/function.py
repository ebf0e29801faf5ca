"""Objectives given by a user's function."""

from collections.abc import Callable

import equinox as eqx
from jaxtyping import Array, Float, PyTree

from ...interface.arguments import require_callable, require_value
from ..run import Run
from .base import AbstractObjective, AbstractRunningObjective


class FunctionObjective(AbstractObjective):
    """function(run, parameters), one number for the whole run.

    **Arguments:**

    - ``function``: of (run, parameters), to one number; ``run`` has ``times``, ``state``, ``observables``, ``system``,
      and the units ``length`` and ``weight``.
    - ``parameters``: arrays, in any PyTree, passed to it.
    - ``weight``: its factor in the sum of objectives.
    """

    function: Callable[[Run, PyTree], Float[Array, ""]] = eqx.field(static=True)
    parameters: PyTree = None

    def __check_init__(self):
        require_callable("function", self.function, "run", "parameters")

    def __call__(self, run: Run):
        value = self.function(run, self.parameters)
        require_value("function", value, ())
        return value


class FunctionRunningObjective(AbstractRunningObjective):
    """The mean over the run of function(run, parameters), where each value depends only on its own time.

    **Arguments:**

    - ``function``: of (run, parameters), to an array, shape (t,), of the times of the run. In optimal control it is
      called for one time after the other, and t is 1.
    - ``parameters``: arrays, in any PyTree, passed to it.
    - ``weight``: its factor in the sum of objectives.
    """

    function: Callable[[Run, PyTree], Float[Array, " t"]] = eqx.field(static=True)
    parameters: PyTree = None

    def __check_init__(self):
        require_callable("function", self.function, "run", "parameters")

    def integrand(self, run: Run):
        values = self.function(run, self.parameters)
        require_value("function", values, run.times.shape)
        return values
