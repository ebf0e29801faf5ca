"""The frame of a rail, in a scenario file."""

from typing import Any

import numpy as np

from ..physics.frames import AbstractFrame, MatrixFrame, SphericalFrame, VersorFrame
from .table import Family, Key, Module, join, read_one_of, write_member
from .traced import namespace, require
from .values import ANGLE, FULL_TURN, NOT_ALL_ZERO, QUARTER_TURN, Nested, Numbers, Radians

ORTHONORMAL = 1e-9

_ANGLES = {"azimuth": Key(Radians((), FULL_TURN, ANGLE)), "elevation": Key(Radians((), QUARTER_TURN, ANGLE))}
_FRAMES: Family = {
    "azimuth": Module(SphericalFrame, _ANGLES),
    "versor": Module(VersorFrame, {"versor": Key(Numbers((4,), NOT_ALL_ZERO))}, attributes={"versor": "q"}),
    "matrix": Module(MatrixFrame, {"matrix": Key(Numbers((3, 3)))}, attributes={"matrix": "B"}),
}
_CHOICES = {name: frame.keys for name, frame in _FRAMES.items()}


def read_frame(values: Any, path: str) -> AbstractFrame:
    """A frame by spherical angles, a versor or a rotation matrix."""
    name, table = read_one_of(values, path, _CHOICES)
    if name == "azimuth":
        return SphericalFrame(**table)
    if name == "versor":
        return VersorFrame(table["versor"])
    B = table["matrix"]
    xp = namespace(B)
    require(
        xp.allclose(B.T @ B, np.eye(3), rtol=0, atol=ORTHONORMAL) & (xp.linalg.det(B) > 0),
        join(path, "matrix"),
        "a rotation matrix, whose columns are orthonormal and whose determinant is 1",
        lambda: str(B.tolist()),
    )
    return MatrixFrame(B)


def write_frame(frame: AbstractFrame, path: str) -> dict[str, Any] | None:
    """The table of a frame, or None for the identity, which is the default."""
    _, table = write_member(frame, path, _FRAMES)
    return None if repr(table) == repr({"matrix": np.eye(3).tolist()}) else table


FRAME = Key(Nested(read_frame, write_frame, tables=_CHOICES), None)
