"""Runs as one plain dictionary of JSON's types: all that a page needs to show them, and nothing else.

``format`` and ``version`` say what the dictionary is. ``bodies`` are those of the runs, all on one plane and one clock;
each has its ``name``, what it is made of, and where its ``arrays`` are in the list ``arrays`` of the dictionary. There
equal ones are once, each with its ``type``, float32 or float64, its ``shape`` and its ``data``: the bytes, the least
significant first, in base64. They hold numbers at each saved time that the solve reached, or of a long run at evenly
spaced ones of them, of which there were ``saved``, as ``note`` says. A body has

- ``time`` (T,); ``centre`` (T, 3), of the shell, and ``quaternion`` (T, 4), the scalar last: from body axes to those of
  the page; ``moved`` (T, 3) and ``turned`` (T,), of a plane that moves and of a turntable;
- ``masses`` (T, n, 3) and ``arms_j`` (T, n_j, points, 3), of the j-th mechanism, in body axes from the centre;
  ``rail_j`` (points, 3), which is at rest there. With the ``shell``, masses give the centre of mass;
- ``normal_force`` (T,), ``friction`` (T, 2) in space axes, ``angular_velocity`` and ``angular_momentum`` (T, 3) in body
  axes, the latter Π about the contact point, and what else the ``plots`` draw. Each of their ``series`` names an array
  and the columns of it whose sum is drawn, or whose ``norm``, divided by the array ``over``, if there is one.

``axes`` are three rows that take space axes to those of the page, whose third axis points against gravity; ``floor`` is
the plane, in axes of the page. Where radii differ, it is that of the first body. ``wanted`` is the place of an array
(points, 3) on it, or None. ``scale`` says which number the bodies' colours stand for, by its values at equal steps of
the colours ``stops``, or is None.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, to_hex

from ...interface.views import MOST_BODIES
from ...physics.body import Disk, System
from ...simulation.trajectory import Trajectory
from ..floor import Setting, floor_under
from ..style import COMPONENTS, TRAIL, described, dimensionless, mass_colour
from ..sweeps.axes import COLOURS, norm_of
from .body import Shown, body_document, body_numbers, shown
from .graphs import PAIR, graphs_of
from .packing import Numbers, Pool, chosen_rows

FORMAT, VERSION = "jaxball view", 2
ELEVATION, AZIMUTH = {False: 20.0, True: 8.0}, {False: -60.0, True: -90.0}  # degrees, of a ball and of a disk
BEFORE, UNKNOWN = "#8a8a8a", "#8a8a8a"
MOMENTUM = "#7B3FA0"
STOPS = 9
# So that no text of a run ends the element that it stands in, or a line of a program that reads it.
ESCAPES = {ord(letter): f"\\u{ord(letter):04x}" for letter in "<>&\u2028\u2029"}
Runs = Trajectory[Any, Any] | Mapping[str, Trajectory[Any, Any]]


class ColourScale(NamedTuple):
    """A number by which the bodies of a view are coloured.

    **Arguments:**

    - ``name``: what the number is, such as ``"body.mass"``.
    - ``values``: that of each body, in their order; NaN, where it is not known, is grey.
    - ``logarithmic``: whether colours are spaced by its logarithm.

    **Example:**

    >>> from jaxball.plot import ColourScale
    >>> ColourScale("body.mass", [0.5, 1.0, 2.0], logarithmic=True).values
    [0.5, 1.0, 2.0]
    """

    name: str
    values: Sequence[float]
    logarithmic: bool = False


def view_document(
    trajectories: Runs,
    title: str = "",
    friction: float | None = None,
    *,
    wanted: Float[np.ndarray, "k 2"] | None = None,
    scale: ColourScale | None = None,
    room: float = np.inf,
) -> dict[str, Any]:
    """The dictionary of a run, or of several by their names, in at most ``room`` characters of JSON if that can be.

    **Raises:** ``ValueError`` as :func:`~jaxball.plot.write_view`.
    """
    if friction is not None and not 0 < friction < np.inf:
        raise ValueError(f"Argument `friction` must be a positive number, but it is {friction}.")
    named = trajectories if isinstance(trajectories, Mapping) else {"": trajectories}
    _check_number(len(named), scale)
    bodies = [shown(trajectory) for trajectory in named.values()]
    _check_grounds(bodies, list(named))
    first, setting, planar = bodies[0], bodies[0].setting, isinstance(bodies[0].system, Disk)
    # On the plane a disk's line is at e2 = 0.
    goal = None if wanted is None else np.column_stack([wanted, np.full(len(wanted), -first.radius)])
    looks = _looks(bodies, scale)
    document = {
        "format": FORMAT,
        "version": VERSION,
        "title": title or _title(bodies),
        "units": _units(bodies),
        "friction": friction,
        "axes": setting.page.tolist(),
        "floor": _floor(bodies, setting, goal),
        "camera": {"elevation": ELEVATION[planar], "azimuth": AZIMUTH[planar] + (0 if planar else setting.downhill)},
        "palette": {"trail": TRAIL, "components": list(COMPONENTS), "momentum": MOMENTUM},
        "scale": None if scale is None else _stops(scale),
        "plots": graphs_of(bodies),
        "bodies": [
            {"name": name, **look} | body_document(one) for name, look, one in zip(named, looks, bodies, strict=True)
        ],
    }
    document |= _outcome(document["bodies"]) | {"note": "", "wanted": None}
    numbers = [body_numbers(one, first.radius) for one in bodies]
    extra = {} if goal is None else {"wanted": Numbers(goal @ setting.page.T, first.radius, over_time=False)}
    lengths = [len(one.run.times) for one in bodies]
    rows = chosen_rows([*numbers, extra], [*lengths, 2], room - len(in_element(document).encode()) - len(_note(0, 0)))
    pool = Pool()
    for body, found, kept in zip(document["bodies"], numbers, rows, strict=False):
        body["arrays"] = {name: pool.add(array, kept) for name, array in found.items()}
    kept, saved = sum(map(len, rows[:-1])), sum(lengths)
    return document | {
        "note": _note(kept, saved) if kept < saved else "",
        "wanted": pool.add(extra["wanted"]) if extra else None,
        "arrays": pool.arrays,
    }


def in_element(document: Mapping[str, Any]) -> str:
    """JSON that can stand in an element of HTML."""
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.translate(ESCAPES)


def _check_number(count: int, scale: ColourScale | None) -> None:
    if not 1 <= count <= MOST_BODIES:
        raise ValueError(f"Argument `trajectories` must have from one run to {MOST_BODIES}, but it has {count}.")
    if scale is not None and len(scale.values) != count:
        raise ValueError(
            f"Argument `scale` must have a value for each of the {count} runs, but it has {len(scale.values)}."
        )


def _check_grounds(bodies: Sequence[Shown], names: Sequence[str]) -> None:
    """Raises a ``ValueError`` for bodies that do not roll on the same plane."""
    other = other_ground([one.system for one in bodies])
    if other is not None:
        raise ValueError(
            f'Argument `trajectories` must have runs on one plane, but that of "{names[other]}" is not that of '
            f'"{names[0]}"; show them one by one.'
        )


def other_ground(systems: Sequence[System]) -> int | None:
    """The place of the first body whose ground is not that of the first of all, None where all have the same."""
    others = (k for k, system in enumerate(systems) if not eqx.tree_equal(system.ground, systems[0].ground))
    return next(others, None)


def _title(bodies: Sequence[Shown]) -> str:
    return described(bodies[0].system) if len(bodies) == 1 else f"{len(bodies)} runs"


def _units(bodies: Sequence[Shown]) -> str:
    same = all(dimensionless(one.system) for one in bodies)
    return "dimensionless, m₀ = r = g = 1" if same else "in the units of its parameters"


def _looks(bodies: Sequence[Shown], scale: ColourScale | None) -> list[dict[str, Any]]:
    """The colour of each body, None for a single one, whether its curves are ``dashed``, and its ``value``."""
    plain: dict[str, Any] = {"dashed": False, "value": None}
    if scale is not None:
        values = np.asarray(scale.values, dtype=float)
        colours = ScalarMappable(norm_of(values, scale.logarithmic), COLOURS).to_rgba(values)
        return [
            plain | ({"colour": to_hex(colour), "value": value} if np.isfinite(value) else {"colour": UNKNOWN})
            for colour, value in zip(colours, values.tolist(), strict=True)
        ]
    if len(bodies) == 1:
        return [plain | {"colour": None}]
    if len(bodies) == PAIR:
        return [plain | {"colour": BEFORE, "dashed": True}, plain | {"colour": TRAIL}]
    return [plain | {"colour": mass_colour(k)} for k in range(1, len(bodies) + 1)]


def _stops(scale: ColourScale) -> dict[str, Any]:
    norm = norm_of(np.asarray(scale.values, dtype=float), scale.logarithmic)
    shares = np.linspace(0.0, 1.0, STOPS)
    colours = ScalarMappable(None, COLOURS).to_rgba(shares, norm=False)
    return {
        "name": scale.name,
        "low": float(norm.vmin or 0.0),
        "high": float(norm.vmax or 0.0),
        "logarithmic": isinstance(norm, LogNorm),
        "stops": [to_hex(colour) for colour in colours],
    }


def _outcome(bodies: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Whether all solves reached their end, and a sentence of each that did not."""
    failed = [body for body in bodies if not body["ok"]]
    if len(bodies) == 1:
        return {"ok": not failed, "message": bodies[0]["message"]}
    sentences = [f"{body['name']}: {body['message']}" for body in failed]
    return {"ok": not failed, "message": " ".join(sentences) or "Every solve reached its end."}


def _note(kept: int, saved: int) -> str:
    """The sentence that says how many of the saved times are shown."""
    if not saved:
        return " " * 200  # as long as it may be
    return (
        f"Shown are {kept:,} of the {saved:,} saved times, evenly spaced, to keep this file small; all_times=True in "
        "Python, or --all-times of jaxball view, keeps all of them."
    )


def _floor(bodies: Sequence[Shown], setting: Setting, goal: Float[np.ndarray, "k 3"] | None) -> dict[str, Any]:
    r = bodies[0].radius
    paths = [one.run.observables.contact_point + np.array([0.0, 0.0, one.radius - r]) for one in bodies]
    path = np.concatenate(paths if goal is None else [*paths, goal])
    floor = floor_under(path, max(one.radius for one in bodies), setting)
    return {
        "low": floor.low.tolist(),
        "high": floor.high.tolist(),
        "height": floor.height,
        "table": floor.table,
        "centre": setting.centre.tolist(),
        "tilted": setting.tilted,
        "top": floor.block.top.tolist(),
        "base": floor.block.base.tolist(),
    }
