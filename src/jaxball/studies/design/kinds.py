"""The kinds of objectives, constraints and curves of problem files, with positions of a ball or of a disk."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...files.scenario.errors import key_error
from ...files.scenario.own import FUNCTION, Open, module_of, names_own, trying
from ...files.scenario.table import (
    Check,
    Family,
    Key,
    Keys,
    as_long_as,
    at_least,
    join,
    keys_of,
    member_of,
    read_family,
)
from ...files.scenario.values import Flag, Numbers
from ...interface.arguments import require_callable_with
from ...numerics.declare import NOT_ALL_ZERO, Rule
from ...physics.body import System
from . import constraints, objectives
from .problem.requirements import (
    AbstractConstraint,
    AbstractObjective,
    FigureEight,
    Sigmoid,
    Through,
)

_ON_LINE = ", because a disk rolls along e1"
_FLAT = Rule("finite", lambda x: (x == 0).all(), f" that is 0{_ON_LINE}")
_ABOUT_E2 = Rule(
    "finite",
    lambda x: (x != 0).any() & (x[1::2] == 0).all(),
    " [q0, 0, q2, 0], not all zero, because a disk turns about e2",
)


@dataclass(frozen=True)
class OnLine(Numbers):
    """Positions of a disk, one number each."""

    @property
    def words(self) -> str:
        return super().words + _ON_LINE

    def write(self, value: Any, path: str) -> Any:
        return np.asarray(value, dtype=float)[..., 0].tolist()


class Plane(NamedTuple):
    """The kinds of positions in a file: of a ball in the plane, of a disk on a line in it.

    - ``place``, ``places``: one position, and a list of them.
    - ``height``: the extent of a curve along e2.
    - ``versor``: an orientation.
    """

    place: Numbers
    places: Numbers
    height: Key
    versor: Numbers


PLANE = Plane(Numbers((2,)), Numbers((None, 2)), Key(Numbers()), Numbers((4,), NOT_ALL_ZERO))
LINE = Plane(OnLine(), OnLine((None,)), Key(Numbers(rule=_FLAT), 0.0), Numbers((4,), _ABOUT_E2))


@dataclass(frozen=True)
class _OfEither(Numbers):
    """Positions of a ball, or those of a disk: ``others``."""

    others: tuple[Numbers, ...] = ()


EITHER = Plane(
    _OfEither(PLANE.place.shape, others=(LINE.place,)),
    _OfEither(PLANE.places.shape, others=(LINE.places,)),
    LINE.height,
    PLANE.versor,
)


def plane_of(system: System) -> Plane:
    """Returns the kinds of positions of a system."""
    return LINE if system.planar else PLANE


def _modules(kinds: Mapping[str, type], keys: Keys, checks: Mapping[str, Check]) -> Family:
    return {name: module_of(kind, keys=keys, check=checks.get(name)) for name, kind in kinds.items()}


def curves(plane: Plane) -> Family:
    """Returns the curves that a path can follow."""
    keys = {"origin": Key(plane.place, (0.0, 0.0)), "height": plane.height, "points": Key(plane.places)}
    through = module_of(Through, keys=keys, attributes={"points": "through"}, check=at_least("points", 2, "two points"))
    return {**_modules({"sigmoid": Sigmoid, "figure-eight": FigureEight}, keys, {}), "through": through}


def objectives_of(plane: Plane) -> Family:
    """Returns the objectives, which are minimised."""
    keys = {
        "place": Key(plane.place),
        "versor": Key(plane.versor),
        "centres": Key(plane.places),
        "curve": Key(member_of(curves(plane))),
        "rest_to_rest": Key(Flag(), False),
        **FUNCTION,
    }
    return _modules(_OBJECTIVES, keys, {"follow-trajectory": _check_times, **_CHECKS})


def constraints_of(plane: Plane) -> Family:
    """Returns the constraints."""
    corners = {"lower": Key(plane.place), "upper": Key(plane.place)}
    keys = {**corners, "centres": Key(plane.places), **FUNCTION}
    return _modules(_CONSTRAINTS, keys, {"within": _check_corners, **_CHECKS})


def _check_function(values: dict[str, Any], path: str) -> None:
    with trying(join(path, "function")):
        require_callable_with("function", values["function"], values["parameters"], "run")


def _check_times(values: dict[str, Any], path: str) -> None:
    start, end = values["start"], values["end"]
    if start is not None and end is not None and not start < end:
        raise key_error(join(path, "end"), f"later than `start` = {start!r}", repr(end))


def _check_corners(values: dict[str, Any], path: str) -> None:
    lower, upper = np.asarray(values["lower"]), np.asarray(values["upper"])
    if not np.all(lower < upper):
        raise key_error(join(path, "upper"), f"above `lower`, {lower.tolist()}", str(upper.tolist()))


_CHECKS: dict[str, Check] = {
    **dict.fromkeys(("avoid-obstacles", "clear-of-obstacles"), as_long_as("centres", "radii")),
    "function": _check_function,
    "running-function": _check_function,
}
_OBJECTIVES = {
    "reach-place": objectives.ReachPlace,
    "reach-pose": objectives.ReachPose,
    "stop-at-rest": objectives.StopAtRest,
    "balanced": objectives.Balanced,
    "duration": objectives.Duration,
    "go-far": objectives.GoFar,
    "follow-trajectory": objectives.FollowTrajectory,
    "follow-curve": objectives.FollowCurve,
    "largest-distance": objectives.LargestDistance,
    "masses-near-centre": objectives.MassesNearCentre,
    "avoid-obstacles": objectives.AvoidObstacles,
    "acceleration-effort": objectives.AccelerationEffort,
    "power-effort": objectives.PowerEffort,
    "force-effort": objectives.ForceEffort,
    "joint-effort": objectives.JointEffort,
    "function": objectives.FunctionObjective,
    "running-function": objectives.FunctionRunningObjective,
}
_CONSTRAINTS = {
    "rails-inside": constraints.RailsInside,
    "rails-apart": constraints.RailsApart,
    "regular-rails": constraints.RegularRails,
    "masses-apart": constraints.MassesApart,
    "speed-limit": constraints.SpeedLimit,
    "acceleration-limit": constraints.AccelerationLimit,
    "force-limit": constraints.ForceLimit,
    "joint-effort-limit": constraints.JointEffortLimit,
    "normal-force": constraints.NormalForce,
    "friction": constraints.Friction,
    "on-ground": constraints.OnGround,
    "clear-of-obstacles": constraints.ClearOfObstacles,
    "within": constraints.Within,
    "function": constraints.FunctionConstraint,
    "running-function": constraints.FunctionRunningConstraint,
}


@dataclass(frozen=True)
class Requirements:
    """The objectives, or the constraints, of a file: those of jaxball, by their kind, and users' own classes.

    - ``path``: the key of their list.
    - ``family``: those of jaxball.
    - ``contract``: the class that all of them extend.
    """

    path: str
    family: Callable[[Plane], Family]
    contract: type

    def keys(self, plane: Plane) -> dict[str, Keys]:
        """Returns the keys of each kind of requirement that jaxball has."""
        return keys_of(self.family(plane))

    def read(self, values: Any, path: str, plane: Plane) -> tuple[str, Any]:
        """Reads the object that a table describes, and the name of its kind, or of the user's class."""
        item = read_family(values, path, Open(self.contract, self.family(plane)))
        return type(item).__name__ if names_own(values) else values["kind"], item


OBJECTIVES = Requirements("objectives", objectives_of, AbstractObjective)
CONSTRAINTS = Requirements("constraints", constraints_of, AbstractConstraint)
