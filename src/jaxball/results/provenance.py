"""What a result file says about the run it came from."""

import importlib.metadata
from typing import Any

from ..status import Status
from ..trajectory import Trajectory

PACKAGES = ("jaxball", "jax", "diffrax")


def attributes(trajectory: Trajectory[Any, Any], title: str, scenario: str) -> dict[str, str | int | float]:
    """Title, how the solve ended, the scenario's text, and the versions of the packages.

    ``ok`` is 1 for a solve that reached its end and 0 for one that failed.
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
    return found | {f"{name}_version": importlib.metadata.version(name) for name in PACKAGES}
