"""Grounds of any smooth form that may move: their contract, their motion, and the ones that jaxball has.

A surface is one function p(t, u1, u2), a place in space for two coordinates; everything else follows by automatic
differentiation.
"""

from .carriers import Belt as Belt, MovingFrame as MovingFrame, Turn as Turn, Turntable as Turntable
from .ground import Footing as Footing
from .shapes import (
    Bowl as Bowl,
    Cylinder as Cylinder,
    HeightField as HeightField,
    Paraboloid as Paraboloid,
    ParametricSurface as ParametricSurface,
    SphereOutside as SphereOutside,
    TiltingPlane as TiltingPlane,
    Washboard as Washboard,
)
from .signed_distance import SignedDistance as SignedDistance
from .surface import AbstractSurface as AbstractSurface
