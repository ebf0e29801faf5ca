"""Objectives that are functions of one's own."""

from collections.abc import Callable

import equinox as eqx
from jaxtyping import Array, Float, PyTree

from ...interface.arguments import require_callable, require_value
from ..run import Run
from .base import AbstractObjective, AbstractRunningObjective


class FunctionObjective(AbstractObjective):
    """function(run, parameters), a number of the whole run.

    **Arguments:**

    - ``function``: of (run, parameters), to one number; ``run`` has ``times``, ``state``, ``observables``, ``system``,
      and the units ``length`` and ``weight``.
    - ``parameters``: arrays, in any PyTree, that it is given.
    - ``weight``: by what it is multiplied in the sum of objectives.
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
    """The mean over the run of function(run, parameters), which knows each time by itself.

    **Arguments:**

    - ``function``: of (run, parameters), to an array, shape (t,), of the times of the run. In optimal control it is
      given one time after the other, and t is 1.
    - ``parameters``: arrays, in any PyTree, that it is given.
    - ``weight``: by what it is multiplied in the sum of objectives.
    """

    function: Callable[[Run, PyTree], Float[Array, " t"]] = eqx.field(static=True)
    parameters: PyTree = None

    def __check_init__(self):
        require_callable("function", self.function, "run", "parameters")

    def integrand(self, run: Run):
        values = self.function(run, self.parameters)
        require_value("function", values, run.times.shape)
        return values
