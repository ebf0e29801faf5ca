"""Scenario files of what stops and friction of a limit surface hold, and of convex bodies."""

from .convex_files import CONVEX

CONVEX_OR_HELD = CONVEX | {
    "hard stops": """
format = 1
kind = "disk"
body = { mass = 1.0, radius = 1.0, inertia = 0.5, gravity = 1.0 }
initial = { theta = [0.1], thetadot = [0.5] }
time = { start = 0.0, end = 1.0, step = 0.5 }

[[mechanisms]]
masses = [{ mass = 0.5, place = [0.0, 0.0, -0.3] }]

[[mechanisms.joints]]
kind = "hinge"
axis = [0.0, 1.0, 0.0]
force = { kind = "hard-stops", lower = -0.3, upper = 0.3, restitution = 0.5, slowest = 1e-5 }
""",
    "limit surface": """
format = 1
kind = "ball"
body = { mass = 1.0, radius = 1.0, inertia = [0.4, 0.4, 0.4], gravity = 1.0 }
contact = { friction = { kind = "limit-surface", friction = 0.3, radius = 0.1 }, static_friction = 0.4 }
initial = { Omega = [0.0, 0.0, 2.0], velocity = [1.0, 0.0, 0.0] }
time = { start = 0.0, end = 1.0, step = 0.5 }
""",
}
