"""Numbers as JSON text: arrays in base64, equal ones once, and as many saved times as there is room for."""

import base64
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

CLOSE = 1e-6  # the allowed error of a point's position, in radii
AROUND = 80  # characters in JSON that name an array, its type and its shape


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
        """The place of an array, of which ``rows`` are kept if it is over time and they are given."""
        kept = rows is not None and numbers.over_time
        array = packed(numbers.values[rows] if kept else numbers.values, numbers.scale)
        key = (array["type"], array["data"], tuple(array["shape"]))
        if key not in self._places:
            self._places[key] = len(self.arrays)
            self.arrays.append(array)
        return self._places[key]


def packed(values: Any, scale: float | None = None) -> dict[str, Any]:
    """An array as the page reads it, in float32.

    With a ``scale``, in float64 where float32 would be off by more than a millionth of that.
    """
    exact = np.asarray(values, dtype="<f8")
    with np.errstate(over="ignore"):
        short = exact.astype("<f4")
    off = np.max(np.abs(short - exact), initial=0.0) if scale is not None else 0.0
    kept = short if scale is None or off <= CLOSE * scale else exact
    data = base64.b64encode(kept.tobytes()).decode("ascii")
    return {"type": kept.dtype.name, "shape": list(kept.shape), "data": data}


def chosen_rows(
    bodies: Sequence[Mapping[str, Numbers]], lengths: Sequence[int], room: float
) -> list[Int[np.ndarray, " rows"]]:
    """The saved times of each body that fit into ``room`` characters of JSON: all, or evenly spaced ones.

    Both ends are included, and the same fraction is kept for all bodies.
    """
    sizes = {True: 0, False: 0}  # of arrays over time, and of others
    pool = Pool()
    for body in bodies:
        for numbers in body.values():
            before = len(pool.arrays)
            pool.add(numbers)
            for array in pool.arrays[before:]:
                sizes[numbers.over_time] += len(array["data"])
    room -= sizes[False] + AROUND * sum(len(body) for body in bodies)
    share = max(room, 0.0) / sizes[True] if sizes[True] else 1.0
    return [evenly(length, length if share >= 1 else int(share * length)) for length in lengths]


def evenly(length: int, count: int) -> Int[np.ndarray, " rows"]:
    """Up to ``count`` of the indices below ``length``, evenly spaced, both ends among them."""
    return np.unique(np.round(np.linspace(0, length - 1, max(2, min(count, length)))).astype(int))


def sampled(points: Float[np.ndarray, "points 3"], close: float) -> Float[np.ndarray, "some 3"]:
    """Every k-th of the points of a curve, k as large as leaves the others within ``close`` of the chords."""
    for k in range(len(points) // 3, 1, -1):
        if (len(points) - 1) % k == 0 and _farthest(points, k) <= close:
            return points[::k]
    return points


def _farthest(points: Float[np.ndarray, "points 3"], k: int) -> float:
    """The largest distance of the points from the chords between every k-th of them."""
    starts, ends = points[:-1:k, None], points[k::k, None]
    inner = points[:-1].reshape(-1, k, points.shape[1])
    chords = ends - starts
    square = np.sum(chords**2, axis=-1, keepdims=True)
    along = np.sum((inner - starts) * chords, axis=-1, keepdims=True) / np.where(square > 0, square, 1.0)
    return float(np.max(np.linalg.norm(inner - starts - np.clip(along, 0.0, 1.0) * chords, axis=-1)))
