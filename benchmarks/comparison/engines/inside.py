"""What a robot carries on hinges, for engines whose robots are made by calls; and a disk as a ball that rolls so."""

import dataclasses
import xml.etree.ElementTree as ET
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxball import Scenario
from jaxball.files.mjcf import MJCFError
from jaxball.files.mjcf.writing import Exported
from jaxball.physics.body import Ball, Disk
from jaxball.physics.prescribed.motion import OnRail
from jaxball.physics.prescribed.rails import Circle


class Hung(NamedTuple):
    """A mass on a hinge in the shell: the joint's name and numbers, in the axes of the ball with every θ at 0."""

    name: str
    mass: float
    point: Float[np.ndarray, "3"]
    place: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]


def in_space(scenario: Scenario) -> Scenario:
    """A scenario of a disk as one of a ball with equal moments, which rolls in the same plane; a ball's is itself."""
    disk, state = scenario.system, cast(Any, scenario.state)
    if not isinstance(disk, Disk):
        return scenario
    shell = {name: getattr(disk, name) for name in ("mass", "radius", "offset", "gravity")}
    ball = Ball(**shell, inertia=jnp.full(3, disk.inertia), masses=disk.point_masses, mechanisms=disk.mechanisms)
    return dataclasses.replace(scenario, system=ball, state=state.in_space())


def masses_on_hinges(exported: Exported) -> list[Hung]:
    """Returns the masses on hinges of a robot.

    **Raises:** :class:`~jaxball.files.mjcf.MJCFError` for a robot that carries something else.
    """
    shell = ET.fromstring(exported.text).find("worldbody/body[@name='shell']")
    assert shell is not None
    found = []
    for link in shell.findall("body"):
        joints, masses = link.findall("joint"), link.findall("body")
        kinds = [joint.get("type") for joint in joints]
        if kinds != ["hinge"] or len(masses) != 1 or masses[0].find("body") is not None:
            raise MJCFError("Mechanisms other than a mass on a hinge are left out, because no others are made.")
        inertial = masses[0].find("inertial")
        assert inertial is not None
        point, axis = (_vector(joints[0], name, "0 0 0") for name in ("pos", "axis"))
        name, mass = joints[0].get("name", ""), float(inertial.get("mass", ""))
        found.append(Hung(name, mass, point, _vector(masses[0], "pos", "0 0 0"), axis))
    return found


def _vector(element: ET.Element, name: str, default: str) -> Float[np.ndarray, "3"]:
    return np.asarray([float(word) for word in element.get(name, default).split()])


def angles_by_schedule(system: Any, times: Float[np.ndarray, " T"]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Computes θ and θ̇ of the masses that move on circles by schedules at some times, by the names of their hinges.

    **Raises:** :class:`~jaxball.files.mjcf.MJCFError` for a mass that moves in another way.
    """
    found = {}
    for index, item in enumerate(system.point_masses):
        if not isinstance(item.motion, OnRail) or not isinstance(item.motion.rail, Circle):
            raise MJCFError("Masses that move otherwise than on circles are left out, because no others are made.")
        schedule = item.motion.schedule.prepare()
        theta, rate, _ = jax.vmap(schedule.derivatives)(jnp.asarray(times))
        found[f"masses[{index}]"] = np.asarray(theta), np.asarray(rate)
    return found
