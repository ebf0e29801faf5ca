"""Writes a run as an MCAP file (https://mcap.dev), a recording of a robot: messages in JSON, with a schema per topic.

Frames and shapes have the schemas of Foxglove (https://docs.foxglove.dev/docs/sdk/schemas); joints, the contact force
and all other numbers have schemas of jaxball.
"""

import importlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ...physics.body import AbstractBody
from ...physics.state import ReducedState
from ...simulation.trajectory import Trajectory
from .variables import Variables, labels

WORLD, BODY = "world", "body"
NANO = 1_000_000_000
MASS = 0.04  # the radius of the sphere that shows a mass, relative to that of the body
THIN = 0.02  # the thickness of a disk, relative to its radius
SHELL_COLOUR = {"r": 0.55, "g": 0.6, "b": 0.7, "a": 0.35}
MASS_COLOUR = {"r": 0.8, "g": 0.3, "b": 0.1, "a": 1.0}
STILL = {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
PRIMITIVES = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")

Schema = dict[str, Any]
NUMBER: Schema = {"type": "number"}
TEXT: Schema = {"type": "string"}


class Topic(NamedTuple):
    """Messages of one schema, each with the row of the time that it belongs to."""

    name: str
    schema: Schema
    messages: Iterator[tuple[int, dict[str, Any]]]


def write_mcap(
    trajectory: Trajectory[Any, Any], path: Path, variables: Variables, attributes: Mapping[str, str | int | float]
) -> None:
    """Writes the rows of a run that the solve reached; ``variables`` are what a ``.nc`` has over time."""
    mcap = importlib.import_module("mcap.writer")  # here, because it is of an extra
    times = np.asarray(trajectory.times)
    # From 0, because a recording has unsigned times, and a run may begin at a negative one.
    since = [round(float(t - times[0]) * NANO) for t in times]
    rows = np.flatnonzero(np.all([_is_known(leaf) for leaf in jax.tree.leaves(trajectory.state)], axis=0))
    with path.open("wb") as file:
        writer = mcap.Writer(file)
        writer.start(library=f"jaxball {attributes['jaxball_version']}")
        texts = {name: str(value) for name, value in attributes.items() if name != "scenario"}
        writer.add_metadata("run", {"start": repr(float(times[0])), **texts})
        if attributes["scenario"]:
            text = str(attributes["scenario"]).encode()
            writer.add_attachment(0, 0, "scenario.toml", "application/toml", text)
        for topic in _topics(trajectory, variables, rows):
            schema = writer.register_schema(topic.schema["title"], "jsonschema", json.dumps(topic.schema).encode())
            channel = writer.register_channel(topic.name, "json", schema)
            for row, message in topic.messages:
                stamp = {"timestamp": _stamp(since[row])} if "timestamp" in topic.schema["properties"] else {}
                data = json.dumps(stamp | message, allow_nan=False).encode()
                writer.add_message(channel, log_time=since[row], publish_time=since[row], data=data)
        writer.finish()


def _is_known(leaf: Any) -> np.ndarray:
    leaf = np.asarray(leaf)
    return np.isfinite(leaf).reshape(len(leaf), -1).all(axis=1)


def _topics(trajectory: Trajectory[Any, Any], variables: Variables, rows: np.ndarray) -> Iterator[Topic]:
    system, state = trajectory.system, trajectory.state
    if isinstance(system, AbstractBody) and not isinstance(state, ReducedState):
        yield Topic("/tf", FRAME, _frames(trajectory, rows))
        yield Topic("/scene", SCENE, _shapes(trajectory, rows))
        yield Topic("/contact_force", CONTACT_FORCE, _forces(trajectory, rows))
        if system.mechanisms:
            yield Topic("/joint_states", JOINTS, _joints(trajectory, rows))
    yield Topic("/run", _of_variables(variables), _numbers(trajectory, variables, rows))


# Frames and shapes.


def _frames(trajectory: Trajectory[Any, Any], rows: np.ndarray) -> Iterator[tuple[int, dict[str, Any]]]:
    """Lists the frames of the body in the world, and of each mass in the body, whose axes it keeps."""
    seen = trajectory.observables
    centre = np.asarray(seen.geometric_centre)
    q = np.asarray(jax.vmap(lambda state: state.in_space().q)(trajectory.state))
    masses = np.asarray(seen.mass_positions_body)
    for row in rows:
        yield int(row), _frame(WORLD, BODY, centre[row], q[row])
        for k, place in enumerate(masses[row]):
            yield int(row), _frame(BODY, f"mass[{k}]", place, np.array([1.0, 0.0, 0.0, 0.0]))


def _frame(parent: str, child: str, place: Float[np.ndarray, "3"], q: Float[np.ndarray, "4"]) -> dict[str, Any]:
    rotation = dict(zip("wxyz", map(float, q), strict=True))
    return {"parent_frame_id": parent, "child_frame_id": child, "translation": _xyz(place), "rotation": rotation}


def _shapes(trajectory: Trajectory[Any, Any], rows: np.ndarray) -> Iterator[tuple[int, dict[str, Any]]]:
    """Lists the shapes of the shell and of the masses, once: they move with their frames."""
    system = trajectory.system
    r = float(system.radius)
    entities = []
    size = {"x": 2 * r, "y": 2 * r, "z": 2 * r}
    shell = {"pose": STILL, "size": size, "color": SHELL_COLOUR}
    if system.planar:  # a cylinder along z, which is turned to E2
        # A quarter turn about x takes z to −y, along the axis of the disk.
        quarter = {"x": float(np.sqrt(0.5)), "y": 0.0, "z": 0.0, "w": float(np.sqrt(0.5))}
        pose = {**STILL, "orientation": quarter}
        cylinder = {**shell, "pose": pose, "size": {**size, "z": THIN * r}, "bottom_scale": 1.0, "top_scale": 1.0}
        entities.append(_entity(BODY, "cylinders", cylinder))
    elif system.shape is None:  # no other surface is among the shapes of a recording
        entities.append(_entity(BODY, "spheres", shell))
    small = dict.fromkeys("xyz", 2 * MASS * r)
    for k in range(trajectory.observables.mass_positions_body.shape[1]):
        entities.append(_entity(f"mass[{k}]", "spheres", {"pose": STILL, "size": small, "color": MASS_COLOUR}))
    for row in rows[:1]:  # none where the solve did not start
        yield int(row), {"deletions": [], "entities": entities}


def _entity(frame: str, kind: str, primitive: dict[str, Any]) -> dict[str, Any]:
    of_no_kind: dict[str, Any] = {name: [] for name in PRIMITIVES}
    # A lifetime of 0 is for ever, and a locked shape moves with its frame.
    shown = {"timestamp": _stamp(0), "frame_id": frame, "id": frame, "lifetime": _stamp(0), "frame_locked": True}
    return {**shown, "metadata": [], **of_no_kind, kind: [primitive]}


# Numbers.


def _forces(trajectory: Trajectory[Any, Any], rows: np.ndarray) -> Iterator[tuple[int, dict[str, Any]]]:
    seen = trajectory.observables
    place, force = np.asarray(seen.contact_point), np.asarray(seen.contact_force)
    normal, ratio = np.asarray(seen.normal_force), np.asarray(seen.friction_ratio)
    for row in rows:
        numbers = {"normal_force": _finite(normal[row]), "friction_ratio": _finite(ratio[row])}
        yield int(row), {"frame_id": WORLD, "point": _xyz(place[row]), "force": _xyz(force[row]), **numbers}


def _joints(trajectory: Trajectory[Any, Any], rows: np.ndarray) -> Iterator[tuple[int, dict[str, Any]]]:
    seen = trajectory.observables
    parts = {"position": seen.joint_angles, "velocity": seen.joint_rates, "effort": seen.joint_efforts}
    arrays = {name: np.asarray(leaf) for name, leaf in parts.items()}
    names = labels(trajectory.system, {"joint": arrays["position"].shape[1]})["joint"].tolist()
    for row in rows:
        yield int(row), {"name": names, **{name: _finite(array[row]) for name, array in arrays.items()}}


def _numbers(
    trajectory: Trajectory[Any, Any], variables: Variables, rows: np.ndarray
) -> Iterator[tuple[int, dict[str, Any]]]:
    times = np.asarray(trajectory.times)
    for row in rows:
        numbers = {name: _finite(array[row]) for name, (_, array) in variables.items()}
        yield int(row), {"time": float(times[row]), **numbers}


def _finite(value: Any) -> Any:
    """Converts arrays to lists of numbers; None stands where JSON has no number, as for a ratio to 0."""
    if np.ndim(value):
        return [_finite(item) for item in value]
    return np.asarray(value).item() if np.isfinite(value) else None


def _xyz(vector: Float[np.ndarray, "3"]) -> dict[str, Any]:
    return dict(zip("xyz", _finite(vector), strict=True))


def _stamp(nanoseconds: int) -> dict[str, int]:
    return {"sec": nanoseconds // NANO, "nsec": nanoseconds % NANO}


# Schemas.


def _record(title: str, **properties: Schema) -> Schema:
    return {"title": title, "type": "object", "properties": properties}


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


_WHOLE: Schema = {"type": "integer"}
_TIME = _record("time", sec={**_WHOLE, "minimum": 0}, nsec={**_WHOLE, "minimum": 0, "maximum": NANO - 1})
_VECTOR = _record("foxglove.Vector3", x=NUMBER, y=NUMBER, z=NUMBER)
_QUATERNION = _record("foxglove.Quaternion", x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
_POSE = _record("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION)
_COLOUR = _record("foxglove.Color", r=NUMBER, g=NUMBER, b=NUMBER, a=NUMBER)
_SPHERE = _record("foxglove.SpherePrimitive", pose=_POSE, size=_VECTOR, color=_COLOUR)
_CYLINDER = _record(
    "foxglove.CylinderPrimitive", pose=_POSE, size=_VECTOR, color=_COLOUR, bottom_scale=NUMBER, top_scale=NUMBER
)
_ENTITY = _record(
    "foxglove.SceneEntity",
    timestamp=_TIME,
    frame_id=TEXT,
    id=TEXT,
    lifetime=_record("duration", sec=_WHOLE, nsec=_WHOLE),
    frame_locked={"type": "boolean"},
    metadata=_list({"type": "object"}),
    **{name: _list({"type": "object"}) for name in PRIMITIVES},
)
_ENTITY["properties"] |= {"spheres": _list(_SPHERE), "cylinders": _list(_CYLINDER)}
FRAME = _record(
    "foxglove.FrameTransform",
    timestamp=_TIME,
    parent_frame_id=TEXT,
    child_frame_id=TEXT,
    translation=_VECTOR,
    rotation=_QUATERNION,
)
SCENE = _record("foxglove.SceneUpdate", deletions=_list({"type": "object"}), entities=_list(_ENTITY))
CONTACT_FORCE = _record(
    "jaxball.ContactForce",
    timestamp=_TIME,
    frame_id=TEXT,
    point=_VECTOR,
    force=_VECTOR,
    normal_force=NUMBER,
    friction_ratio=NUMBER,
)
JOINTS = _record(
    "jaxball.JointStates",
    timestamp=_TIME,
    name=_list(TEXT),
    position=_list(NUMBER),
    velocity=_list(NUMBER),
    effort=_list(NUMBER),
)


def _of_variables(variables: Variables) -> Schema:
    """Returns the schema of all numbers of a time, with their units and meanings."""
    properties = {}
    for name, (variable, array) in variables.items():
        schema = NUMBER
        for _ in range(array.ndim - 1):
            schema = _list(schema)
        properties[name] = {**schema, "description": f"{variable.meaning} ({variable.units})"}
    return _record("jaxball.Run", timestamp=_TIME, time=NUMBER, **properties)
