"""Scenario files of the systems that jaxball makes with a Lagrangian, and the same in Python."""

from typing import Any

from jaxball.physics.classical import (
    AbstractLagrangianSystem,
    ChaplyginSleigh,
    KnifeEdge,
    LagrangianState,
    RollerRacer,
    RollingCoin,
    Snakeboard,
)

_FILE = """format = 1
kind = "{kind}"
{tables}
time = {{ start = 0.0, end = 1.0, saves = 3 }}
"""
_TABLES = {
    "chaplygin-sleigh": """body = { mass = 2.0, inertia = 0.39, ahead = 0.5 }
initial = { q = [1.0, 2.0, 0.0], qdot = [0.5, 0.0, 1.0] }""",
    "knife-edge": """body = { slope = 0.3, gravity = 9.81 }
initial = { qdot = [0.0, 0.0, 1.0] }""",
    "rolling-coin": """body = { mass = 2.0, radius = 0.5 }
initial = { q = [0.0, 0.0, 0.0, 0.1, 0.0], qdot = [1.0, 0.0, 0.2, 0.0, 2.0] }""",
    "snakeboard": """body = { half_length = 0.4 }
initial = { qdot = [1.0, 0.0, 0.0, 0.5, 0.0, 0.0] }""",
    "roller-racer": """body = { lengths = [0.6, 0.2] }
initial = { qdot = [1.0, 0.0, 0.0, 0.0] }""",
}
VEHICLES = {kind: _FILE.format(kind=kind, tables=tables) for kind, tables in _TABLES.items()}


def in_python() -> dict[str, tuple[AbstractLagrangianSystem, Any]]:
    """The systems and states of the files, by their kinds."""
    return {
        "chaplygin-sleigh": (
            ChaplyginSleigh(mass=2.0, inertia=0.39, ahead=0.5),
            LagrangianState([1.0, 2.0, 0.0], [0.5, 0.0, 1.0]),
        ),
        "knife-edge": (KnifeEdge(slope=0.3, gravity=9.81), LagrangianState([0.0] * 3, [0.0, 0.0, 1.0])),
        "rolling-coin": (
            RollingCoin(mass=2.0, radius=0.5),
            LagrangianState([0.0, 0.0, 0.0, 0.1, 0.0], [1.0, 0.0, 0.2, 0.0, 2.0]),
        ),
        "snakeboard": (Snakeboard(half_length=0.4), LagrangianState([0.0] * 6, [1.0, 0.0, 0.0, 0.5, 0.0, 0.0])),
        "roller-racer": (RollerRacer(lengths=(0.6, 0.2)), LagrangianState([0.0] * 4, [1.0, 0.0, 0.0, 0.0])),
    }
