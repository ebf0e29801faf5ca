"""The two runs of the paper (sections 4 and 5) and their reference solutions of 30 digits."""

import json
from importlib.resources import files

import numpy as np

import jaxball

BALL_ANGLES = (0.0, 2.0369, 0.7044)
BALL_RADII = (0.95, 0.9, 0.85)
BALL_DIRECTIONS = ((0.0, 0.0), (np.pi / 2, 0.0), (np.pi / 4, np.pi / 4))
DISK_RADII = (0.9, 19 / 30, 11 / 30, 0.1)


def paper_ball() -> jaxball.Ball:
    """The ball of section 5, with θ(t) in closed form."""
    rails = [
        jaxball.Circle(radius, frame=jaxball.SphericalFrame(azimuth, elevation))
        for radius, (azimuth, elevation) in zip(BALL_RADII, BALL_DIRECTIONS, strict=True)
    ]
    return jaxball.Ball(
        mass=1.0,
        inertia=(0.9, 1.0, 1.1),
        offset=(0.0, 0.0, -0.05),
        masses=[
            jaxball.PointMass(1.0, jaxball.OnRail(rail, jaxball.Pulse(angle)))
            for rail, angle in zip(rails, BALL_ANGLES, strict=True)
        ],
    )


def paper_disk() -> jaxball.Disk:
    """The disk of section 4, with θ(t) in closed form."""
    return jaxball.Disk(
        mass=1.0,
        inertia=1.0,
        masses=[
            jaxball.PointMass(
                1.0, jaxball.OnRail(jaxball.Circle(radius), jaxball.Pulse(-np.pi / 2, height=(-1.0) ** i))
            )
            for i, radius in enumerate(DISK_RADII, start=1)
        ],
    )


def reference(name: str) -> tuple[np.ndarray, list[str]]:
    """The reference states of ``name`` at t = 0, 1, ..., 20, shape (21, components), and their names."""
    data = json.loads(files("jaxball.paper").joinpath("data", f"{name}.json").read_text())
    rows = [[float(x) for x in data["values"][str(t)]] for t in range(21)]
    return np.array(rows), data["state"]
