"""Scenario files of convex bodies."""

from typing import Any

_CONVEX = """
format = 1
kind = "convex-body"
body = { mass = 1.2, inertia = [0.5, 0.6, 0.7], gravity = 1.0, offset = [0.05, -0.03, 0.02], shape = SHAPE }
initial = { Omega = [0.4, -0.8, 0.3], z = [1.0, 0.5] }
time = { start = 0.0, end = 1.0, step = 0.5 }
"""
CONVEX = {
    "stone": _CONVEX.replace("SHAPE", '{ kind = "ellipsoid", semiaxes = [1.0, 1.3, 0.7], turn = 0.2 }'),
    "egg": _CONVEX.replace(
        "SHAPE", '{ kind = "function", function = "tests.support.convex_files:egg", parameters = 0.1 }'
    ),
}


def egg(Gamma: Any, sharpness: Any) -> Any:
    """The support function of an egg."""
    return (1.0 + 0.5 * Gamma[2] ** 2) ** 0.5 + sharpness * Gamma[2] ** 3
