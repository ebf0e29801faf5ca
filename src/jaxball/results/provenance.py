"""What a result file says about the run it came from."""

import dataclasses
import importlib.metadata
from typing import Any

from ..body import Ball, Disk
from ..extremes import contact_extremes
from ..status import Status
from ..trajectory import Trajectory

PACKAGES = ("jaxball", "jax", "diffrax")


def attributes(trajectory: Trajectory[Any, Any], title: str, scenario: str) -> dict[str, str | int | float]:
    """Title, how the solve ended, the scenario's text, and the versions of the packages.

    ``ok`` is 1 for a solve that reached its end and 0 for one that failed. The extremes of the contact force,
    ``contact_friction_needed`` and the others of :class:`~jaxball.ContactExtremes`, are there for a run with dense
    output.
    """
    found: dict[str, str | int | float] = {
        "title": title,
        "ok": int(trajectory.ok),
        "status": Status(int(trajectory.status)).name,
        "message": trajectory.message,
        "reached": float(trajectory.reached),
        "steps": int(trajectory.steps),
        "rejected_steps": int(trajectory.rejected),
        "scenario": scenario,
    }
    if trajectory.interpolant is not None and isinstance(trajectory.system, Ball | Disk):
        extremes = contact_extremes(trajectory)
        found |= {
            f"contact_{field.name}": float(getattr(extremes, field.name)) for field in dataclasses.fields(extremes)
        }
    return found | {f"{name}_version": importlib.metadata.version(name) for name in PACKAGES}
