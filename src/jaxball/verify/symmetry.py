"""Whether the integrals of Chaplygin, Jellett and Routh hold for a ball, judged from its moments along a run."""

import numpy as np
from jaxtyping import Float

from ..physics.body import AbstractBody, Disk
from ..physics.moments import Moments

ZERO = 1e-9  # relative to the scale
MASSES_MOVE = "masses move"
PLANAR = "a disk rolls in a plane, where it is zero"
NO_TURNTABLE = "the ground has no turntable"


def why_not_chaplygin(system: AbstractBody, at: Moments) -> str:
    """Why ΛΠ is not constant; empty where it is, for p = 0 at all times and no force or resistance on level ground."""
    if reason := _what_acts(system):
        return reason
    distance = float(np.max(np.linalg.norm(at.p, axis=-1) / np.asarray(at.M)))
    if distance > ZERO * float(system.radius):
        return f"the centre of mass is up to {distance:.3g} from the geometric centre"
    return ""


def why_not_moving_energy(system: AbstractBody) -> str:
    """Why there is no balance of the moving energy; empty where there is, on a level turntable."""
    if system.ground is None or system.ground.turntable is None:
        return NO_TURNTABLE
    if system.ground.motion is not None or float(system.ground.angle) != 0:
        return "the ground is tilted or moves"
    return ""


def why_not_routh(system: AbstractBody, at: Moments, axis: Float[np.ndarray, "steps nodes 3"]) -> str:
    """Why the integrals of Jellett and Routh are not constant; empty where they are.

    They are constant where no force acts, no mass moves, and the ball with its masses is a body of revolution about the
    axis through the geometric centre and the centre of mass: with d1 = d2 and every mass on E3, or so in other axes.
    """
    if isinstance(system, Disk):
        return PLANAR
    if reason := _what_acts(system):
        return reason
    J, p = np.asarray(at.J), np.asarray(at.p)
    moved = max(np.ptp(J, axis=(0, 1)).max(), np.ptp(p, axis=(0, 1)).max() * float(system.radius))
    # Two equal masses that circle the axis opposite each other change neither J nor p.
    if moved > ZERO * np.max(np.abs(J)) or np.max(np.abs(at.l)) > 0:
        return MASSES_MOVE
    J, p = J[0, 0], p[0, 0]
    about_centre_of_mass = J - (p @ p * np.eye(3) - np.outer(p, p)) / float(at.M[0, 0])
    return why_no_revolution(about_centre_of_mass, axis[0, 0])


def _what_acts(system: AbstractBody) -> str:
    """What acts on a body besides a level plane at rest; empty if nothing does."""
    if system.force is not None:
        return "a force acts"
    if system.ground is not None:
        return "the ground is tilted or moves"
    return "resistance acts" if system.resistance is not None else ""


def why_no_revolution(J: Float[np.ndarray, "3 3"], axis: Float[np.ndarray, "3"]) -> str:
    """Why a body with the moments of inertia ``J`` is not a body of revolution about ``axis``; empty where it is."""
    scale = float(np.max(np.abs(J)))
    along = J @ axis
    if np.max(np.abs(along - (axis @ along) * axis)) > ZERO * scale:
        return f"the axis {_text(axis)} is not a principal one"
    across = np.sort(np.linalg.eigvalsh(J + 10 * scale * np.outer(axis, axis)))[:2]
    if across[1] - across[0] > ZERO * scale:
        return f"the moments across the axis {_text(axis)} differ, {across[0]:.4g} and {across[1]:.4g}"
    return ""


def _text(axis: Float[np.ndarray, "3"]) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in axis) + ")"
