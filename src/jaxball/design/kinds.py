"""The objectives, constraints and curves that a problem file can hold, and their keys."""

from typing import Any

from ..scenario.table import Family, Key, Module, read_family, write_family
from ..scenario.values import NOT_ALL_ZERO, POSITIVE, Flag, Nested, Numbers
from . import constraints, objectives
from .curves import FigureEight, Sigmoid, Through

NUMBER, SIZE, PLACE = Numbers(), Numbers(rule=POSITIVE), Numbers((2,))


def _through(points: Any) -> Through:
    return Through(points)


CURVES: Family = {
    "sigmoid": Module(
        Sigmoid,
        {
            "length": Key(NUMBER),
            "height": Key(NUMBER),
            "steepness": Key(SIZE, 10.0),
            "origin": Key(PLACE, (0.0, 0.0)),
        },
    ),
    "figure-eight": Module(
        FigureEight,
        {"length": Key(NUMBER), "height": Key(NUMBER), "origin": Key(PLACE, (0.0, 0.0))},
    ),
    "through": Module(Through, {"points": Key(Numbers((None, 2)))}, build=_through, attributes={"points": "through"}),
}
CURVE = Key(
    Nested(
        lambda values, path: read_family(values, path, CURVES),
        lambda curve, path: write_family(curve, path, CURVES),
    )
)
WEIGHT = {"weight": Key(NUMBER, 1.0)}
DISCS = {"centres": Key(Numbers((None, 2))), "radii": Key(Numbers((None,), POSITIVE))}

OBJECTIVES: Family = {
    "reach-place": Module(objectives.ReachPlace, {"place": Key(PLACE), **WEIGHT}),
    "reach-pose": Module(objectives.ReachPose, {"versor": Key(Numbers((4,), NOT_ALL_ZERO)), **WEIGHT}),
    "stop-at-rest": Module(objectives.StopAtRest, WEIGHT),
    "balanced": Module(objectives.Balanced, WEIGHT),
    "duration": Module(objectives.Duration, WEIGHT),
    "go-far": Module(objectives.GoFar, WEIGHT),
    "follow-trajectory": Module(
        objectives.FollowTrajectory,
        {
            "curve": CURVE,
            "rest_to_rest": Key(Flag(), False),
            "start": Key(NUMBER, None),
            "end": Key(NUMBER, None),
            **WEIGHT,
        },
    ),
    "follow-curve": Module(objectives.FollowCurve, {"curve": CURVE, **WEIGHT}),
    "largest-distance": Module(objectives.LargestDistance, {"curve": CURVE, **WEIGHT}),
    "masses-near-centre": Module(objectives.MassesNearCentre, WEIGHT),
    "avoid-obstacles": Module(objectives.AvoidObstacles, {**DISCS, "softness": Key(SIZE, 0.1), **WEIGHT}),
    "acceleration-effort": Module(objectives.AccelerationEffort, WEIGHT),
    "power-effort": Module(objectives.PowerEffort, WEIGHT),
    "force-effort": Module(objectives.ForceEffort, WEIGHT),
}

CONSTRAINTS: Family = {
    "rails-inside": Module(constraints.RailsInside, {"clearance": Key(NUMBER, 0.0)}),
    "rails-apart": Module(constraints.RailsApart, {"distance": Key(SIZE)}),
    "regular-rails": Module(constraints.RegularRails, {"least": Key(SIZE)}),
    "masses-apart": Module(constraints.MassesApart, {"distance": Key(SIZE)}),
    "speed-limit": Module(constraints.SpeedLimit, {"most": Key(SIZE)}),
    "acceleration-limit": Module(constraints.AccelerationLimit, {"most": Key(SIZE)}),
    "force-limit": Module(constraints.ForceLimit, {"most": Key(SIZE)}),
    "normal-force": Module(constraints.NormalForce, {"least": Key(NUMBER)}),
    "friction": Module(constraints.Friction, {"mu": Key(SIZE)}),
    "clear-of-obstacles": Module(constraints.ClearOfObstacles, DISCS),
    "within": Module(constraints.Within, {"low": Key(PLACE), "high": Key(PLACE)}),
}
