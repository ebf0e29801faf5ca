"""The frame of a rail, in a scenario file."""

from typing import Any

import numpy as np

from ..physics.frames import AbstractFrame, MatrixFrame, SphericalFrame, VersorFrame
from .table import Family, Key, Module, join, read_one_of, write_member
from .values import FULL_TURN, NOT_ALL_ZERO, QUARTER_TURN, Nested, Numbers, Radians, key_error

ORTHONORMAL = 1e-9

_ANGLES = {"azimuth": Key(Radians(rule=FULL_TURN)), "elevation": Key(Radians(rule=QUARTER_TURN))}
_FRAMES: Family = {
    "azimuth": Module(SphericalFrame, _ANGLES),
    "versor": Module(VersorFrame, {"versor": Key(Numbers((4,), NOT_ALL_ZERO))}, attributes={"versor": "q"}),
    "matrix": Module(MatrixFrame, {"matrix": Key(Numbers((3, 3)))}, attributes={"matrix": "B"}),
}
_CHOICES = {name: frame.keys for name, frame in _FRAMES.items()}


def read_frame(values: Any, path: str) -> AbstractFrame:
    """A frame by spherical angles, a versor or a rotation matrix."""
    name, found = read_one_of(values, path, _CHOICES)
    if name == "azimuth":
        return SphericalFrame(**found)
    if name == "versor":
        return VersorFrame(found["versor"])
    B = found["matrix"]
    if not np.allclose(B.T @ B, np.eye(3), rtol=0, atol=ORTHONORMAL) or np.linalg.det(B) < 0:
        raise key_error(
            join(path, "matrix"),
            "a rotation matrix, whose columns are orthonormal and whose determinant is 1",
            str(B.tolist()),
        )
    return MatrixFrame(B)


def write_frame(frame: AbstractFrame, path: str) -> dict[str, Any] | None:
    """The table of a frame, or None for the identity, which need not be said."""
    _, table = write_member(frame, path, _FRAMES)
    return None if repr(table) == repr({"matrix": np.eye(3).tolist()}) else table


FRAME = Key(Nested(read_frame, write_frame, tables=_CHOICES), None)
