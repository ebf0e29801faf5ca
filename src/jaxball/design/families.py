"""The objectives, constraints and curves that a problem file can hold, and their keys."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..interface.arguments import require_callable
from ..physics.body import Disk
from ..physics.system import AbstractSystem
from ..scenario.functions import FUNCTION, trying
from ..scenario.own import Open, names_own
from ..scenario.table import Family, Key, Keys, Module, join, keys_of, member_of, read_family
from ..scenario.values import NOT_ALL_ZERO, POSITIVE, Flag, Numbers, Rule, key_error
from . import constraints, objectives
from .problem.plane import FigureEight, Sigmoid, Through
from .problem.requirements import AbstractConstraint, AbstractObjective

NUMBER, SIZE = Numbers(), Numbers(rule=POSITIVE)
WEIGHT = {"weight": Key(NUMBER, 1.0)}

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


PLANE = Plane(Numbers((2,)), Numbers((None, 2)), Key(NUMBER), Numbers((4,), NOT_ALL_ZERO))
LINE = Plane(OnLine(), OnLine((None,)), Key(Numbers(rule=_FLAT), 0.0), Numbers((4,), _ABOUT_E2))


def plane_of(system: AbstractSystem) -> Plane:
    """The kinds of positions of a system."""
    return LINE if isinstance(system, Disk) else PLANE


def curves(plane: Plane) -> Family:
    """The curves that a path can follow."""
    origin = {"origin": Key(plane.place, (0.0, 0.0))}
    return {
        "sigmoid": Module(
            Sigmoid, {"length": Key(NUMBER), "height": plane.height, "steepness": Key(SIZE, 10.0), **origin}
        ),
        "figure-eight": Module(FigureEight, {"length": Key(NUMBER), "height": plane.height, **origin}),
        "through": Module(
            Through,
            {"points": Key(plane.places)},
            build=lambda points: Through(points),
            attributes={"points": "through"},
            check=_check_points,
        ),
    }


def objectives_of(plane: Plane) -> Family:
    """The objectives, which are minimised."""
    curve = {"curve": Key(member_of(curves(plane)))}
    return {
        "reach-place": Module(objectives.ReachPlace, {"place": Key(plane.place), **WEIGHT}),
        "reach-pose": Module(objectives.ReachPose, {"versor": Key(plane.versor), **WEIGHT}),
        "stop-at-rest": Module(objectives.StopAtRest, WEIGHT),
        "balanced": Module(objectives.Balanced, WEIGHT),
        "duration": Module(objectives.Duration, WEIGHT),
        "go-far": Module(objectives.GoFar, WEIGHT),
        "follow-trajectory": Module(
            objectives.FollowTrajectory,
            {
                **curve,
                "rest_to_rest": Key(Flag(), False),
                "start": Key(NUMBER, None),
                "end": Key(NUMBER, None),
                **WEIGHT,
            },
            check=_check_times,
        ),
        "follow-curve": Module(objectives.FollowCurve, {**curve, **WEIGHT}),
        "largest-distance": Module(objectives.LargestDistance, {**curve, **WEIGHT}),
        "masses-near-centre": Module(objectives.MassesNearCentre, WEIGHT),
        "avoid-obstacles": Module(
            objectives.AvoidObstacles, {**_discs(plane), "softness": Key(SIZE, 0.1), **WEIGHT}, check=_check_discs
        ),
        "acceleration-effort": Module(objectives.AccelerationEffort, WEIGHT),
        "power-effort": Module(objectives.PowerEffort, WEIGHT),
        "force-effort": Module(objectives.ForceEffort, WEIGHT),
        "joint-effort": Module(objectives.JointEffort, WEIGHT),
        "function": Module(objectives.FunctionObjective, {**FUNCTION, **WEIGHT}, check=_check_function),
        "running-function": Module(objectives.FunctionRunningObjective, {**FUNCTION, **WEIGHT}, check=_check_function),
    }


def constraints_of(plane: Plane) -> Family:
    """The constraints."""
    return {
        "rails-inside": Module(constraints.RailsInside, {"clearance": Key(NUMBER, 0.0)}),
        "rails-apart": Module(constraints.RailsApart, {"distance": Key(SIZE)}),
        "regular-rails": Module(constraints.RegularRails, {"least": Key(SIZE)}),
        "masses-apart": Module(constraints.MassesApart, {"distance": Key(SIZE)}),
        "speed-limit": Module(constraints.SpeedLimit, {"most": Key(SIZE)}),
        "acceleration-limit": Module(constraints.AccelerationLimit, {"most": Key(SIZE)}),
        "force-limit": Module(constraints.ForceLimit, {"most": Key(SIZE)}),
        "joint-effort-limit": Module(constraints.JointEffortLimit, {"most": Key(SIZE)}),
        "normal-force": Module(constraints.NormalForce, {"least": Key(NUMBER)}),
        "friction": Module(constraints.Friction, {"mu": Key(SIZE)}),
        "clear-of-obstacles": Module(constraints.ClearOfObstacles, _discs(plane), check=_check_discs),
        "within": Module(constraints.Within, {"low": Key(plane.place), "high": Key(plane.place)}, check=_check_corners),
        "function": Module(constraints.FunctionConstraint, FUNCTION, check=_check_function),
        "running-function": Module(constraints.FunctionRunningConstraint, FUNCTION, check=_check_function),
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
        """The keys of each kind of jaxball's."""
        return keys_of(self.family(plane))

    def read(self, values: Any, path: str, plane: Plane) -> tuple[str, Any]:
        """The object that a table describes, and the name of its kind, or of the user's class."""
        item = read_family(values, path, Open(self.contract, self.family(plane)))
        return type(item).__name__ if names_own(values) else values["kind"], item


OBJECTIVES = Requirements("objectives", objectives_of, AbstractObjective)
CONSTRAINTS = Requirements("constraints", constraints_of, AbstractConstraint)


def _discs(plane: Plane) -> dict[str, Key]:
    return {"centres": Key(plane.places), "radii": Key(Numbers((None,), POSITIVE))}


def _check_function(values: dict[str, Any], path: str) -> None:
    with trying(join(path, "function")):
        require_callable("function", values["function"], "run", "parameters")


def _check_points(values: dict[str, Any], path: str) -> None:
    n = len(values["points"])
    if n < 2:
        raise key_error(join(path, "points"), "a list of two points or more", f"one of {n}")


def _check_discs(values: dict[str, Any], path: str) -> None:
    n, m = len(values["centres"]), len(values["radii"])
    if m != n:
        raise key_error(join(path, "radii"), f"as long as `centres`, which has {n} entries", f"one of {m}")


def _check_times(values: dict[str, Any], path: str) -> None:
    start, end = values["start"], values["end"]
    if start is not None and end is not None and not start < end:
        raise key_error(join(path, "end"), f"later than `start` = {start!r}", repr(end))


def _check_corners(values: dict[str, Any], path: str) -> None:
    low, high = np.asarray(values["low"]), np.asarray(values["high"])
    if not np.all(low < high):
        raise key_error(join(path, "high"), f"above `low`, {low.tolist()}", str(high.tolist()))
