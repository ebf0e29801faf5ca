"""What objectives and constraints want of a path, to be drawn."""

from collections.abc import Iterable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .constraints import ClearOfObstacles
from .objectives import AvoidObstacles, FollowCurve, FollowTrajectory

ON_A_CURVE = 400


def places_in_time(items: Iterable[Any], times: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t 2"] | None:
    """Where the centre is wanted at each time, if it is to follow a trajectory."""
    for item in items:
        if isinstance(item, FollowTrajectory):
            return np.asarray(item.targets(jnp.asarray(times)))
    return None


def curve_and_discs(
    items: Iterable[Any],
) -> tuple[Float[np.ndarray, "k 2"] | None, list[tuple[Float[np.ndarray, "2"], float]]]:
    """The curve to be followed, and the discs to be avoided."""
    curve, discs = None, []
    for item in items:
        if isinstance(item, FollowTrajectory | FollowCurve):
            curve = np.asarray(item.curve.points(ON_A_CURVE))
        if isinstance(item, AvoidObstacles | ClearOfObstacles):
            discs += list(zip(np.asarray(item.centres), map(float, item.radii), strict=True))
    return curve, discs
