"""Which runs a view can show."""

from typing import Any

from ...classical import ParticleState, RigidBodyState, VakonomicState
from ...physics.body import AbstractBody
from ...simulation.trajectory import Trajectory

ROLLING, RIGID, PARTICLE = "body that rolls", "rigid body", "particle"
SHOWN = "a ball, a disk, a rigid body with a RigidBodyState or a particle with a ParticleState or a VakonomicState"


def kind_of(trajectory: Trajectory[Any, Any]) -> str | None:
    """The kind as which a run is shown; None if it cannot be shown."""
    if isinstance(trajectory.system, AbstractBody):
        return ROLLING
    if isinstance(trajectory.state, RigidBodyState):
        return RIGID
    return PARTICLE if isinstance(trajectory.state, ParticleState | VakonomicState) else None
