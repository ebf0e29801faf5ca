"""The parts of a view: bodies of one kind with their numbers as JSON text, the camera, and graphs over time."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...simulation.trajectory import Trajectory
from ..palette import COMPONENTS, DASHED, SOLID, Dashes, Line, mass_look

CLOSE_TO_PATH = 1e-6  # the allowed error of a point's position, in radii
CHARACTERS_AROUND = 80  # characters in JSON that name an array, its type and its shape
Discs = Sequence[tuple[Float[np.ndarray, "2"], float]]  # of the plane, each with centre and radius
SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
PAIR = 2
BLUE, RED = COMPONENTS[:2]
INK = "ink"  # the colour of text, on light pages and on dark ones
LINE_WIDTH = 1.6  # of lines, pixels


class Numbers(NamedTuple):
    """An array to pack: to a millionth of ``scale``, if that is given, and by saved times, if it has them."""

    values: Float[np.ndarray, "..."]
    scale: float | None = None
    over_time: bool = True


class Pool:
    """Packed arrays, equal ones once; ``arrays`` is the list of them."""

    def __init__(self) -> None:
        self.arrays: list[dict[str, Any]] = []
        self._places: dict[tuple[str, str, tuple[int, ...]], int] = {}

    def add(self, numbers: Numbers, rows: Int[np.ndarray, " rows"] | None = None) -> int:
        """Returns the place of an array, of which ``rows`` are kept if it is over time and they are given."""
        is_partial = rows is not None and numbers.over_time
        # Rows that are chosen do not matter for arrays that have no times, such as rails.
        array = pack(numbers.values[rows] if is_partial else numbers.values, numbers.scale)
        key = (array["type"], array["data"], tuple(array["shape"]))
        if key not in self._places:
            self._places[key] = len(self.arrays)
            self.arrays.append(array)
        return self._places[key]


def pack(values: Any, scale: float | None = None) -> dict[str, Any]:
    """Packs an array as the page reads it, in float32.

    With a ``scale``, in float64 where float32 would be off by more than a millionth of that.
    """
    # Little-endian, as the page reads it on any machine.
    exact = np.asarray(values, dtype="<f8")
    with np.errstate(over="ignore"):
        # A number beyond float32 becomes infinite, and therefore off by more than is allowed.
        short = exact.astype("<f4")
    off = np.max(np.abs(short - exact), initial=0.0) if scale is not None else 0.0
    array = short if scale is None or off <= CLOSE_TO_PATH * scale else exact
    data = base64.b64encode(array.tobytes()).decode("ascii")
    return {"type": array.dtype.name, "shape": list(array.shape), "data": data}


def choose_rows(
    bodies: Sequence[Mapping[str, Numbers]], lengths: Sequence[int], room: float
) -> list[Int[np.ndarray, " rows"]]:
    """Chooses saved times of each body that fit into ``room`` characters of JSON: all, or evenly spaced ones.

    Both ends are included, and the same fraction is kept for all bodies.
    """
    sizes = {True: 0, False: 0}  # of arrays over time, and of others
    # All is packed in full once, because only that shows which arrays are equal.
    pool = Pool()
    for body in bodies:
        for numbers in body.values():
            before = len(pool.arrays)
            pool.add(numbers)
            for array in pool.arrays[before:]:
                sizes[numbers.over_time] += len(array["data"])
    room -= sizes[False] + CHARACTERS_AROUND * sum(len(body) for body in bodies)
    share = max(room, 0.0) / sizes[True] if sizes[True] else 1.0
    return [evenly(length, length if share >= 1 else int(share * length)) for length in lengths]


def evenly(length: int, count: int) -> Int[np.ndarray, " rows"]:
    """Returns up to ``count`` of the indices below ``length``, evenly spaced, both ends among them."""
    # `unique`, because with a single index both ends are the same.
    return np.unique(np.round(np.linspace(0, length - 1, max(2, min(count, length)))).astype(int))


def thin_curve(points: Float[np.ndarray, "points 3"], close: float) -> Float[np.ndarray, "some 3"]:
    """Keeps every k-th of the points of a curve, k as large as leaves the others within ``close`` of the chords."""
    # From the largest k on; it must divide the number of steps, so that the last point is kept.
    for k in range(len(points) // 3, 1, -1):
        if (len(points) - 1) % k == 0 and _farthest(points, k) <= close:
            return points[::k]
    return points


def _farthest(points: Float[np.ndarray, "points 3"], k: int) -> float:
    """Computes the largest distance of the points from the chords between every k-th of them."""
    starts, ends = points[:-1:k, None], points[k::k, None]
    inner = points[:-1].reshape(-1, k, points.shape[1])
    chords = ends - starts
    square = np.sum(chords**2, axis=-1, keepdims=True)
    # Two points in one place have no chord; the distance is that from the first one then.
    along = np.sum((inner - starts) * chords, axis=-1, keepdims=True) / np.where(square > 0, square, 1.0)
    return float(np.max(np.linalg.norm(inner - starts - np.clip(along, 0.0, 1.0) * chords, axis=-1)))


class Scene(NamedTuple):
    """Bodies of one kind, in parts of the dictionary of a view."""

    stand: dict[str, Any]  # ``axes``, ``floor``, ``obstacles`` and ``camera``
    made: list[dict[str, Any]]  # the parts of each body
    numbers: list[dict[str, Numbers]]  # those of each body
    plots: list[dict[str, Any]]
    wanted: Numbers | None = None


def free_stand(azimuth: float, elevation: float = 20.0) -> dict[str, Any]:
    """Returns the stand of bodies without a plane, seen from a direction in degrees."""
    return {
        "axes": np.eye(3).tolist(),
        "floor": None,
        "obstacles": [],
        "camera": {"elevation": elevation, "azimuth": azimuth},
    }


def make_body(kind: str, trajectory: Trajectory[Any, Any], radius: float, saved: int) -> dict[str, Any]:
    """Makes the entries that every body has, empty; a rolling body has more."""
    parts: dict[str, Any] = {"body": kind, "radius": radius, "ok": trajectory.ok, "message": trajectory.message}
    return parts | {"saved": saved, "masses": [], "rails": [], "arms": []}


def continuous(quaternions: Float[np.ndarray, "T 4"]) -> Float[np.ndarray, "T 4"]:
    """Returns the same quaternions, with signs that make each close to the one before."""
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    return quaternions * np.where(np.cumsum(np.concatenate([[0], flips])) % 2, -1.0, 1.0)[:, None]


def law_changes(trajectory: Trajectory[Any, Any], rows: np.ndarray) -> tuple[list[str], Float[np.ndarray, "T laws"]]:
    """Returns the names of the system's laws and their changes since the start; for a vector, the length of
    its change.
    """
    laws = trajectory.laws._asdict()
    changes = []
    for leaf in laws.values():
        values = np.asarray(leaf)[rows].reshape(len(rows), -1)
        change = values - values[:1]
        changes.append(change[:, 0] if change.shape[1] == 1 else np.linalg.norm(change, axis=1))
    # A letter keeps its index, as in p_y.
    names = [name if name[1:2] == "_" else name.replace("_", " ") for name in laws]
    return names, np.stack(changes, axis=1) if changes else np.zeros((len(rows), 0))


def graph(title: str, series: list[dict[str, Any]], size: float = 0.0, *, gaps: bool = False) -> dict[str, Any]:
    """Describes a graph of series, where rounding compared with ``size`` is 0; with ``gaps`` at switches
    between modes.
    """
    return {"title": title, "series": series, "size": size, "gaps": gaps}


def series(
    name: str, colour: str | None, array: str, columns: list[int], norm: bool = False, dashes: Dashes = SOLID
) -> dict[str, Any]:
    """Describes a series: the sum of ``columns`` of an array, or their norm; in the colour of the body unless another
    is given.
    """
    return {
        "name": name.translate(SUBSCRIPTS),
        "colour": colour,
        "dash": [LINE_WIDTH * length for length in dashes],
        "array": array,
        "columns": columns,
        "norm": norm,
    }


def each(names: Iterable[str], looks: Iterable[Line | str], array: str) -> list[dict[str, Any]]:
    """Returns a series for each column, with its colour or its line."""
    lines = [Line(look) if isinstance(look, str) else look for look in looks]
    pairs = enumerate(zip(names, lines, strict=False))
    return [series(name, line.colour, array, [k], dashes=line.dashes) for k, (name, line) in pairs]


def of_masses(numbers: Iterable[int]) -> list[Line]:
    """Returns the lines of masses or joints."""
    return [mass_look(i) for i in numbers]


def angular_velocity(count: int, size: float = 0.0) -> dict[str, Any]:
    """Returns the graph of Ω of one or two bodies, of |Ω| of more."""
    if count > PAIR:
        return graph("Angular speed", [series("|Ω|", None, "angular_velocity", [0, 1, 2], norm=True)], size)
    return graph("Angular velocity", each(("Ω1", "Ω2", "Ω3"), COMPONENTS, "angular_velocity"), size)


def energies(count: int, size: float = 0.0) -> dict[str, Any]:
    """Returns the graph of T, V and their sum for one or two bodies, of the sum for more."""
    if count > PAIR:
        return graph("Energy", [series("E", None, "energies", [0, 1])], size)
    parts = (("T", BLUE, [0], SOLID), ("V", RED, [1], SOLID), ("E", INK, [0, 1], DASHED))
    lines = [series(name, colour, "energies", columns, dashes=dashes) for name, colour, columns, dashes in parts]
    return graph("Energies", lines, size)


def laws(names: list[str]) -> list[dict[str, Any]]:
    """Returns the graph of the change of each law since the start, if there are any; for one system."""
    if not names:
        return []
    lines = each(names, of_masses(range(1, len(names) + 1)), "laws")
    return [graph("Laws, change since the start", lines) | {"valued": False}]
