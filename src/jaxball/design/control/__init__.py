"""Optimal control: how the masses must move, found by direct collocation, in schedules of any shape."""

from ...interface.names import interface as _interface
from .collocation import Collocation as Collocation, Unknowns as Unknowns
from .curvature import least_curvature as least_curvature
from .guess import rolling_along as rolling_along
from .inequalities import violations as violations
from .means import means as means
from .path import Path as Path
from .problem import AbstractControlProblem as AbstractControlProblem
from .refine import Solution as Solution, finer_mesh as finer_mesh, mesh_errors as mesh_errors, solved as solved
from .rolling import Rolling as Rolling, between as between
from .schedules import (
    Resimulated as Resimulated,
    places as places,
    resimulated as resimulated,
    scenario_of as scenario_of,
    schedules_of as schedules_of,
)
from .sharpen import sharpened as sharpened
from .steps import at_rest as at_rest, continued as continued, started as started

__all__, __dir__ = _interface(globals())
