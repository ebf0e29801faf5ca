"""Optimal control: motions of the masses found by direct collocation, with schedules of any shape.

A ``problem``, such as that of a body ``rolling``, becomes the equations of ``collocation``. From a ``guess``, on a mesh
of which ``refinement`` makes finer ones, ``solve`` leads to a ``solution``, whose path gives the schedules of the
masses.
"""

from ....interface.names import interface as _interface
from .collocation import Collocation as Collocation
from .problem import AbstractControlProblem as AbstractControlProblem
from .rolling import Rolling as Rolling

__all__, __dir__ = _interface(globals())
