"""Optimal control: motions of the masses found by direct collocation, with schedules of any shape.

A ``problem``, such as that of a body ``rolling`` with its ``inputs``, becomes the equations of ``collocation``. From a
``guess``, on a mesh that is refined, ``solve`` leads to a ``solution``, whose path gives the ``schedules`` of the
masses.
"""

from ...interface.names import interface as _interface
from .collocation import Collocation as Collocation, Unknowns as Unknowns
from .free_end import solve_with_free_end as solve_with_free_end
from .guess import rolling_along as rolling_along
from .problem import AbstractControlProblem as AbstractControlProblem, Path as Path
from .rolling import Rolling as Rolling, between as between
from .schedules import (
    Resimulated as Resimulated,
    holding as holding,
    places as places,
    resimulate as resimulate,
    scenario_of as scenario_of,
    schedules_of as schedules_of,
    signals_of as signals_of,
    system_of as system_of,
)
from .solution import (
    Solution as Solution,
    finer_mesh as finer_mesh,
    least_curvature as least_curvature,
    means as means,
    mesh_errors as mesh_errors,
    solve_near as solve_near,
    violations as violations,
)
from .solve import (
    at_rest as at_rest,
    continue_to as continue_to,
    sharpen as sharpen,
    solve_from_guess as solve_from_guess,
)

__all__, __dir__ = _interface(globals())
