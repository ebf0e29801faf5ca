"""Small scenario files that the tests change."""

BALL = """\
format = 1
kind = "ball"

[body]
mass = 1.0
radius = 1.0
inertia = [0.9, 1.0, 1.1]
gravity = 1.0

[[masses]]
mass = 0.5
rail = { kind = "circle", radius = 0.9 }
schedule = { kind = "constant-rate", theta = 0.7, rate = 0.2 }

[time]
start = 0.0
end = 2.0
saves = 5
"""

DISK = BALL.replace('"ball"', '"disk"').replace("[0.9, 1.0, 1.1]", "1.0")

CIRCLE = 'rail = { kind = "circle", radius = 0.9 }'
TURNING = 'schedule = { kind = "constant-rate", theta = 0.7, rate = 0.2 }'
ON_RAIL = f"{CIRCLE}\n{TURNING}"


def with_rail(rail: str, text: str = BALL) -> str:
    """A document with another rail."""
    return text.replace(CIRCLE, f"rail = {rail}")


def with_schedule(schedule: str, text: str = BALL) -> str:
    """A document with another schedule."""
    return text.replace(TURNING, f"schedule = {schedule}")


def with_motion(motion: str, text: str = BALL) -> str:
    """A document with other keys in place of the rail and the schedule."""
    return text.replace(ON_RAIL, motion)


def edited(old: str, new: str, text: str = BALL) -> str:
    """A document with one text in it replaced by another."""
    assert old in text
    return text.replace(old, new)
