"""The 30-digit solutions of the paper's two runs, at t = 0, 1, …, 20."""

import functools
import importlib.resources
import json
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

__all__ = ["ball", "disk"]


@dataclass(frozen=True)
class Reference:
    """A solution computed in 113-bit arithmetic, far more accurately than float64 can represent.

    - ``about``: how it was computed and checked.
    - ``times``: the T saved times.
    - ``names``: the names of the state's components, counted from 0 as in result files: ``Omega[1]``.
    - ``values``: the states, one row for each time.
    - ``decimals``: the same numbers as decimal strings of thirty or more digits.
    """

    about: str
    times: Float[np.ndarray, " T"]
    names: tuple[str, ...]
    values: Float[np.ndarray, "T state"]
    decimals: tuple[tuple[str, ...], ...]

    def column(self, name: str) -> Float[np.ndarray, " T"]:
        """Returns one component over time.

        **Raises:** ``KeyError`` when the state has no component of that name.
        """
        if name not in self.names:
            raise KeyError(f"Argument `name` must be one of {', '.join(self.names)}, but it is {name!r}.")
        return self.values[:, self.names.index(name)]

    def columns(self, symbol: str) -> Float[np.ndarray, "T k"]:
        """Returns a vector over time, by its symbol without indices; a scalar gives one column.

        **Raises:** ``KeyError`` when there is none.
        """
        components = [name for name in self.names if name.partition("[")[0] == symbol]
        if not components:
            raise KeyError(f"Argument `symbol` must name a part of {', '.join(self.names)}, but it is {symbol!r}.")
        return np.stack([self.column(name) for name in components], axis=1)


def ball() -> Reference:
    """Returns the reference solution of the ball of section 5: θ, θ̇, q, Ω, z."""
    return _load("paper_ball.json")


def disk() -> Reference:
    """Returns the reference solution of the disk of section 4: θ, θ̇, φ, φ̇."""
    return _load("paper_disk.json")


@functools.cache
def _load(name: str) -> Reference:
    text = importlib.resources.files("jaxball.paper").joinpath("data", name).read_text(encoding="utf-8")
    content = json.loads(text)
    times = sorted(content["values"], key=float)
    decimals = tuple(tuple(content["values"][time]) for time in times)
    times, values = np.asarray(times, dtype=float), np.asarray(decimals).astype(float)
    for array in (times, values):
        array.setflags(write=False)
    return Reference(content["about"], times, tuple(content["state"]), values, decimals)


def __dir__() -> list[str]:
    return __all__
